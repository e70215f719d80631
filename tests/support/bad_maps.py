"""Maps with one value of any kind at any key of `Map`: refused at the door or later, no change, or a finding."""

import copy
from collections.abc import Iterator
from pathlib import Path
from typing import Any, get_args, get_origin

import numpy as np
from pydantic import BaseModel, TypeAdapter, ValidationError

from aerobat_pin import open_record
from aerobat_pin.estimation import estimate
from aerobat_pin.records import Map
from support.bad_texts import Rng
from support.recorded import edited
from support.walking_log import table_map

VALUES: tuple[Any, ...] = (
    *(0, 1, -1, 0.5, 1e-300, 1e-15, 1e-6, 1e3, 1e6, 1e12, 1e300, float("nan"), float("inf"), True, False),
    *("", "x", "px", "FL_FOOT", "FL_HAA", "\\s+", "$\\frac$", 300 * "n", "/etc/passwd", "../x", "²", "deg", "momentum"),
    *([], [0.1, 0.2], [0.2, 0.1], [0.1, 0.1], [-5.0, -4.0], [50.0, 60.0], [-1.0, 1e6], [0.0, 0.0, 0.0], [1e300, 0.0]),
    *(["px"], ["px", "px"], ["FL_FOOT", "FL_FOOT"], ["momentum", "momentum"], ["x", "y", "z"], ["px", "py", "pz"]),
    *({}, {"x": 1}, {"FL_HAA": 0.0}, {"FL_HAA": 1e12}, {"*": -1.0}, {"FL_HAA": {"FL_HFE": 1.0}}, {"column": "px"}),
)
CHOICES = {  # keys whose every value is what a user means, so that other forces are no fault
    *("robot.points", "robot.wrenches", "robot.rows.ignore", "robot.root", "observer.names", "observer.gain"),
    *("log.rate", "log.times", "use.part", "use.when", "log.clock"),
}
# Tables that a good map can have, so that keys within them are reached.
MORE: dict[str, Any] = {
    "use.when": {"column": "px", "above": -1.0},
    "payload": {"frame": "trunk", "mass": 0.1, "com": [0.0, 0.0, 0.0]},
    "joints.friction": {"fit": [0.0, 0.3]},
    "known.thrust": {"columns": ["px"], "law": "polynomial 1", "coefficients": [1e-9]},
    "check.wrench": {"columns": ["fl_fx", "fl_fy", "fl_fz"], "point": "FL_FOOT", "filter": 20.0},
}


def keys(table: Any = Map, before: str = "") -> Iterator[tuple[str, Any]]:
    """Yield dotted key -> type of all keys of a table and of the tables in it."""
    for name, field in table.model_fields.items():
        key = f"{before}{field.alias or name}"
        yield key, field.rebuild_annotation()
        for kind in _tables(field.annotation):
            named = get_origin(field.annotation) is dict
            yield from keys(kind, f"{key}.thrust." if named else f"{key}.")


def _tables(annotation: Any) -> Iterator[type[BaseModel]]:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield annotation
    for inner in get_args(annotation):
        yield from _tables(inner)


def drawn_map(rng: Rng) -> tuple[str, dict[str, Any], bool]:
    """Return what was drawn, the map as nested values, and whether the key's own type refuses the value."""
    everything = list(keys())
    key, kind = everything[rng.integers(len(everything))]
    value = copy.deepcopy(VALUES[rng.integers(len(VALUES))])
    more = {name: copy.deepcopy(table) for name, table in MORE.items() if key.startswith(f"{name}.")}
    values = edited(table_map(Path("robot.urdf")), more | {key: value})
    if any(key == chosen or key.startswith(f"{chosen}.") for chosen in CHOICES):
        key = f"choice {key}"
    try:
        TypeAdapter(kind).validate_python(value)
    except ValidationError:
        return f"{key} = {value!r}", values, True
    return f"{key} = {value!r}", values, False


def by_map(place: Path) -> Any:
    """Return the estimate of `log.csv` by `map.toml`."""
    return estimate(open_record(place / "log.csv", place / "map.toml"))


def changes_nothing(good: Any, found: Any) -> bool:
    """Return whether the same forces are found, to a millionth."""
    one, other = (next(iter(result.estimates.values())) for result in (good, found))
    if one.components.shape != other.components.shape:
        return False
    return bool(np.allclose(one.components, other.components, rtol=1e-6, atol=1e-6, equal_nan=True))
