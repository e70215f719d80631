"""Read map files, lay options over them, take out the channels that a log may lack and does, and describe every key."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar

from aerobat_pin.errors import LogError, MapError
from aerobat_pin.numerics import guarded
from aerobat_pin.records.columns import Columns
from aerobat_pin.records.map_tables import ChannelSection, Map
from aerobat_pin.records.robot_files import option_of_robot
from aerobat_pin.scenario import Section, describe_tables, read_toml, validated

MapPart = TypeVar("MapPart", bound=Section)
HEAD = (
    "A map is a TOML file that says what the columns of a recording mean: `aerobat estimate LOG --map map.toml`. "
    "`aerobat estimate LOG --suggest` prints one from what it finds. Only what is marked required must be written; a "
    "channel is a table with `columns` (of a table, in order) or a `topic` (of a bag)."
)


@guarded()
def load_map(path: Path) -> Map:
    """Read a map file. Raises MapError, which names key, value and rule, if it is not one."""
    values = read_toml("map", str(path) if path.suffix else f"{path}.toml", path.parent, MapError)
    if not values:
        raise MapError(f"map {path}: the file is empty; `aerobat estimate LOG --suggest` prints one to begin with")
    return parse_map(values, str(path))


@guarded()
def parse_map(values: Mapping[str, Any], source: str) -> Map:
    """Build a map from nested plain values. Raises MapError, which names every broken rule."""
    return validated(Map, values, f"map {source}", MapError)


@guarded()
def with_options(chosen: Map, said: str | None, points: Sequence[str], observers: Sequence[str]) -> Map:
    """Return a map with values of the command line laid over it; empty ones change nothing.

    `said` is the URDF file, or the name, of another robot, and `points` are frames of it.
    """
    robot, observer = chosen.robot, chosen.observer
    if said is not None:
        other = dict.fromkeys(("body", "urdf", "mjcf", "name")) | option_of_robot(said)
        robot = robot.model_copy(update=other)
    if points:
        robot = robot.model_copy(update={"points": tuple(points)})
    if observers:
        observer = observer.model_copy(update={"names": tuple(observers)})
    return chosen.model_copy(update={"robot": robot, "observer": observer})


def without_absent(table: MapPart, columns: Columns) -> MapPart:
    """Return a table of a map without optional channels that a log lacks. Raises LogError if it has parts of one."""
    changes: dict[str, Any] = {}
    for key, value in table:
        present: Any = value
        if isinstance(value, ChannelSection):
            present = value if _is_there(value, columns) else None
        elif isinstance(value, dict) and any(isinstance(section, ChannelSection) for section in value.values()):
            present = {name: section for name, section in value.items() if _is_there(section, columns)}
        elif isinstance(value, Section):
            present = without_absent(value, columns)
        if present != value:
            changes[key] = present
    return table.model_copy(update=changes) if changes else table


def _is_there(section: ChannelSection, columns: Columns) -> bool:
    """Return whether a log has a channel; one that is not optional is asked for in any case."""
    if not section.optional:
        return True
    if section.topic is not None and not section.columns:
        return any(name.startswith(f"{section.topic}.") for name in columns.names)
    present = [name for name in section.columns if name in columns.values]
    missing = [name for name in section.columns if name not in columns.values]
    if present and missing:
        raise LogError(f"log {columns.path}: {', '.join(present)} without {', '.join(missing)}: all of them or none")
    return not missing


def describe_map(wanted: str | None = None) -> str:
    """Return the description of the keys of a map file, or of one table or key; see `describe_tables`."""
    return describe_tables(Map, HEAD, "map", wanted)
