"""Names and units of the results of a sweep, and the names that its dimensions therefore cannot have."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields
from typing import Any

from aerobat_pin.estimation import TRUTH_SCORES, Score
from aerobat_pin.experiments import FlightSummary

UNIT_AND_MEANING = {item.name: item.metadata for item in fields(Score)}
SCORES = {name: (UNIT_AND_MEANING[name]["unit"], UNIT_AND_MEANING[name]["meaning"]) for name in TRUTH_SCORES}
JUDGED = {"rank": "of the equations for the forces", "condition": "of the equations for the forces"}
CONTROL_UNITS = {"slew_rms": "N/s", "saturated_share": "1", "largest_ms": "1", "delay_margin": "s"}
COURSE_UNITS = {f"rms_{axis}": "m" if axis in "xyz" else "rad" for axis in ("x", "y", "z", "roll", "pitch", "yaw")}
FLIGHT_UNITS = {item.name: item.metadata["unit"] for item in fields(FlightSummary)} | CONTROL_UNITS | COURSE_UNITS
LISTS: dict[int, tuple[str, list[str]]] = {2: ("bound", ["lowest", "highest"]), 3: ("axis", ["x", "y", "z"])}
RESERVED_NAMES = frozenset(
    {"run", "failed", "warnings", "observer", "point", "axis", "bound", *SCORES, *JUDGED, *FLIGHT_UNITS}
)


def flight_columns(metrics: Mapping[str, Any]) -> dict[str, Any]:
    """Return the numbers of a run's flight and of its control, without nested tables, as columns of the results."""
    found = dict(metrics["flight"])
    found |= {f"rms_{axis}": value for axis, value in found.pop("rms", {}).items()}
    control = metrics.get("control")
    if control is not None:
        margins = control["margins"].values()
        found |= {name: control[name] for name in ("slew_rms", "saturated_share")}
        found["largest_ms"] = max(margin["ms"] for margin in margins)
        found["delay_margin"] = min(margin["delay"] for margin in margins if margin["delay"] is not None)
    return found
