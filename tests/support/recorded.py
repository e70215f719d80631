"""The record of a log by a map, as tests write and change them."""

import copy
from functools import reduce
from pathlib import Path
from typing import Any

import pandas as pd

from aerobat_pin import open_record
from aerobat_pin.records import Map, PlainRobot, Record, parse_map, suggested_map


def recorded(log: Path, values: Map | dict[str, Any], robot: PlainRobot | None = None, table: Any = None) -> Record:
    """Return the record of a log, or of a table written there, by a map or its values; the robot's file lies there."""
    if table is not None:
        table.to_csv(log, index=False)
    chosen = values if isinstance(values, Map) else parse_map(values, "of the test")
    return open_record(log, chosen, log.parent, robot)


def edited(values: dict[str, Any], changes: dict[str, Any]) -> dict[str, Any]:
    """Return a copy of a map's nested values with the values of some dotted keys changed; None takes a key away."""
    copied = copy.deepcopy(values)
    for key, value in changes.items():
        *tables, last = key.split(".")
        table = reduce(lambda table, name: table.setdefault(name, {}), tables, copied)
        table[last] = value
        if value is None:
            del table[last]
    return copied


def suggestion(folder: Path, table: Any, *parts: str) -> str:
    """Return the map that is suggested for a table, `log.csv`, and a robot: the text of a URDF, or links and joints."""
    text = "".join(parts)
    pd.DataFrame(table).to_csv(folder / "log.csv", index=False)
    (folder / "robot.urdf").write_text(text if text.startswith("<robot") else f'<robot name="robot">{text}</robot>')
    return suggested_map(folder / "log.csv", folder / "robot.urdf" if parts else None)
