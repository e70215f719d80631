"""Read map files, make maps from options of the command line, and describe every key."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from aerobat_pin.errors import MapError
from aerobat_pin.numerics import guarded
from aerobat_pin.records.map_tables import Map
from aerobat_pin.records.robot_files import option_of_robot
from aerobat_pin.scenario import describe_tables, read_toml, validated

HEAD = (
    "A map is a TOML file that says what the columns of a recording mean: `aerobat estimate LOG --map map.toml`. "
    "`aerobat estimate LOG --suggest` writes one from what it finds. Only what is marked required must be written; a "
    "channel is a table with `columns` (of a table, in order) or a `topic` (of a bag)."
)


@guarded()
def load_map(path: Path) -> Map:
    """Read a map file. Raises MapError, which names key, value and rule, if it is not one."""
    return parse_map(read_toml("map", str(path) if path.suffix else f"{path}.toml", path.parent, MapError), str(path))


@guarded()
def parse_map(values: Mapping[str, Any], source: str) -> Map:
    """Build a map from nested plain values. Raises MapError, which names every broken rule."""
    return validated(Map, values, f"map {source}", MapError)


@guarded()
def with_options(chosen: Map, said: str | None, points: Sequence[str], observers: Sequence[str]) -> Map:
    """Return a map with values of the command line laid over it; empty ones change nothing.

    Args:
        chosen: the map.
        said: URDF file, or name, of another robot.
        points: frames of it.
        observers: their names.
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


def describe_map(wanted: str | None = None) -> str:
    """Return the description of the keys of a map file, or of one table or key; see `describe_tables`."""
    return describe_tables(Map, HEAD, "map", wanted)
