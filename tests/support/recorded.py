"""The record of a log by a map, as tests write them."""

from pathlib import Path
from typing import Any

from aerobat_pin.records import Map, PlainRobot, Record, open_record, parse_map


def recorded(log: Path, values: Map | dict[str, Any], robot: PlainRobot | None = None) -> Record:
    """Return the record of a log by a map, or by its nested values; the robot's file lies beside the log."""
    chosen = values if isinstance(values, Map) else parse_map(values, "of the test")
    return open_record(log, chosen, log.parent, robot)
