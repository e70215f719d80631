"""Names and units of the results of a sweep, and the names that its dimensions therefore cannot have."""

from __future__ import annotations

from dataclasses import fields

from aerobat_pin.estimation import AxisScore, FlightSummary

SCORES = {item.name: (item.metadata["unit"], item.metadata["meaning"]) for item in fields(AxisScore)}
JUDGED = {"rank": "of the equations for the forces", "condition": "of the equations for the forces"}
FLIGHT_UNITS = {item.name: item.metadata["unit"] for item in fields(FlightSummary)}
LISTS: dict[int, tuple[str, list[str]]] = {2: ("bound", ["lowest", "highest"]), 3: ("axis", ["x", "y", "z"])}
RESERVED_NAMES = frozenset(
    {"run", "failed", "warnings", "observer", "point", "axis", "bound", *SCORES, *JUDGED, *FLIGHT_UNITS}
)
