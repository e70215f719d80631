"""A line about a flight, which stands wherever the flight is shown."""

from __future__ import annotations

from aerobat_pin.flight import FlightLog
from aerobat_pin.robot import Aerobat
from aerobat_pin.scenario import Scenario


def flight_note(scenario: Scenario, robot: Aerobat) -> str:
    """Say in a line what keeps the robot up, which sensors err, and which forces nobody looks for.

    It goes wherever the flight is shown. The share is the hold's constant lift over the weight; what it lifts on
    average in flight is among the metrics.
    """
    weight = robot.mass * scenario.flight.gravity
    note = "free flight, nothing held"
    if scenario.hold is not None:
        note = "attitude held"
        if weight > 0.0:
            note += f", {100.0 * scenario.hold.lift / weight:.0f} % thruster-borne"
    unseen = sorted({force.frame for force in scenario.unknown_force} - set(scenario.observers.frames))
    sensors = scenario.sensors.fitted
    note += f"; imperfect sensors: {', '.join(sensors)}" if sensors else ""
    return note + (f"; forces act at {', '.join(unseen)} where no observer looks" if unseen else "")


def recorded_note(log: FlightLog, robot: Aerobat) -> str:
    """Say in a line how long a recorded flight is, and which robot is believed to have flown it."""
    duration = log.time[-1] - log.time[0]
    return f"recorded flight of {duration:.3g} s, {len(log.time)} samples; believed robot {robot.model.name}"
