"""One-line notes about a flight, shown with its results in tables, figures and pages."""

from __future__ import annotations

from aerobat_pin.aerobat import FlightLog
from aerobat_pin.numerics import guarded
from aerobat_pin.robot import Aerobat
from aerobat_pin.scenario import Scenario


@guarded()
def flight_note(scenario: Scenario, robot: Aerobat, log: FlightLog) -> str:
    """Return a line about a flight: is the attitude held, which sensors have errors, did it diverge.

    It also names the points of forces that no observer seeks.

    For instance, `attitude held, 79 % thruster-borne` means that the attitude hold (an ideal controller, a wrench on
    the body) is active, and that its constant lift is 79 % of the weight. The metrics contain its mean lift in flight,
    `thrusters_lift_over_weight`. `closed loop: PD + integral + feedforward` names what acts of a controller's law.
    """
    weight = robot.mass * scenario.flight.gravity
    note = "free flight, nothing held"
    if scenario.control is not None:
        parts = [name for name in ("integral", "feedforward") if getattr(scenario.control, name)]
        note = f"closed loop: PD{''.join(f' + {part}' for part in parts)}"
    elif scenario.hold is not None:
        note = "attitude held"
        if weight > 0.0:
            note += f", {100.0 * scenario.hold.lift / weight:.0f} % thruster-borne"
    unseen = sorted({force.frame for force in scenario.unknown_force} - set(scenario.observers.frames))
    sensors = scenario.sensors.sampled
    note += f"; imperfect sensors: {', '.join(sensors)}" if sensors else ""
    note += f"; forces act at {', '.join(unseen)} where no observer looks" if unseen else ""
    return note + _divergence_note(log)


@guarded()
def recorded_note(log: FlightLog, robot: Aerobat) -> str:
    """Return a line with the duration of a recorded flight and the robot that is assumed to have flown."""
    duration = log.time[-1] - log.time[0]
    return f"recorded flight of {duration:.3g} s, {len(log.time)} samples; believed robot {robot.model.name}" + (
        _divergence_note(log)
    )


def _divergence_note(log: FlightLog) -> str:
    time = log.measured.attrs.get("diverged_at")
    return "" if time is None else f"; DIVERGED at {float(time):.4g} s, shown until then"
