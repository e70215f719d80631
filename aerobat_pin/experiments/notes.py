"""A line about a flight, printed wherever its results are shown."""

from __future__ import annotations

from aerobat_pin.flight import FlightLog
from aerobat_pin.robot import Aerobat
from aerobat_pin.scenario import Scenario


def flight_note(scenario: Scenario, robot: Aerobat) -> str:
    """Return a line that names what holds the robot, its imperfect sensors, and forces that no observer looks for.

    `attitude held, 79 % thruster-borne`: an ideal wrench at the body holds the attitude, and its constant lift is 79 %
    of the weight. Its mean lift in flight is `thrusters_lift_over_weight` of the metrics.
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
    """Return a line with the length of a recorded flight and the robot that is believed to have flown it."""
    duration = log.time[-1] - log.time[0]
    return f"recorded flight of {duration:.3g} s, {len(log.time)} samples; believed robot {robot.model.name}"
