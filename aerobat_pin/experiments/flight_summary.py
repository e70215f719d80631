"""Summarise a flight in a few numbers, the entry `flight` of `metrics.json`, and in a line."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np

from aerobat_pin.aerobat import KNOWN, Aerobat, FlightLog
from aerobat_pin.numerics import Array, guarded
from aerobat_pin.observers import euler_angles, world_velocity
from aerobat_pin.scenario import Scenario

Range = tuple[float, float]


@dataclass(frozen=True)
class FlightSummary:
    """Numbers that summarise one flight, in SI units and radians; the metadata of each field names its unit.

    Numbers that the log does not determine are None.

    Attributes:
        duration: duration of the flight, until it diverged if it did.
        diverged_at: time at which the flight diverged.
        position_end: world position of the body COM at the end.
        z_range: lowest and highest height of the body COM.
        roll_range, pitch_range, yaw_range: smallest and largest angle; pitch is positive nose up.
        thrusters_lift_over_weight: mean lift of the attitude hold, or of recorded thrusters, divided by the weight.
        aerodynamic_lift_over_weight: mean aerodynamic lift, added mass included, divided by the weight.
        motor_power_mean: mean power of the motor.
        incidence_range: smallest and largest angle of attack of any strip.
        rms: of a controlled flight, the root mean square of its errors about its course: x, y, z [m], roll, pitch, yaw
            [rad].
    """

    duration: float = field(metadata={"unit": "s"})
    position_end: tuple[float, float, float] = field(metadata={"unit": "m"})
    z_range: Range = field(metadata={"unit": "m"})
    roll_range: Range = field(metadata={"unit": "rad"})
    pitch_range: Range = field(metadata={"unit": "rad"})
    yaw_range: Range = field(metadata={"unit": "rad"})
    thrusters_lift_over_weight: float | None = field(default=None, metadata={"unit": "1"})
    aerodynamic_lift_over_weight: float | None = field(default=None, metadata={"unit": "1"})
    motor_power_mean: float | None = field(default=None, metadata={"unit": "W"})
    incidence_range: Range | None = field(default=None, metadata={"unit": "rad"})
    diverged_at: float | None = field(default=None, metadata={"unit": "s"})
    rms: dict[str, float] | None = field(default=None, metadata={"unit": "m, rad"})

    def to_json(self) -> dict[str, Any]:
        """Return all numbers that are not None, as written to `metrics.json`."""
        values = {name: list(value) if isinstance(value, tuple) else value for name, value in asdict(self).items()}
        return {name: value for name, value in values.items() if value is not None}


@guarded(mass="positive")
def flight_summary(log: FlightLog, mass: float) -> FlightSummary:
    """Summarise a flight of a robot of some mass [kg]."""
    measured, truth = log.measured, log.truth
    q = (measured if truth is None or "q" not in truth else truth)["q"].values
    roll, pitch, yaw = (_range(angle) for angle in euler_angles(q).T)
    weight = mass * float(measured.attrs["gravity"])

    def lift_over_weight(force: Any) -> float | None:
        if force is None or weight <= 0.0:
            return None
        return float(np.mean(world_velocity(q[:-1], force.values)[:, 2]) / weight)

    x, y, z = q[-1, :3].tolist()
    return FlightSummary(
        duration=float(log.time[-1] - log.time[0]),
        position_end=(x, y, z),
        z_range=_range(q[:, 2]),
        roll_range=roll,
        pitch_range=pitch,
        yaw_range=yaw,
        thrusters_lift_over_weight=lift_over_weight(measured.get(f"{KNOWN}thrusters")),
        aerodynamic_lift_over_weight=lift_over_weight(
            None if truth is None else truth["aerodynamic"] + truth["added_mass"]
        ),
        motor_power_mean=None if truth is None else float(np.mean(truth["motor_power"].values)),
        incidence_range=None if truth is None else _range(truth["incidence"].values),
        diverged_at=measured.attrs.get("diverged_at"),
    )


def _range(values: Array) -> Range:
    return float(values.min()), float(values.max())


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
    note = f"recorded flight of {duration:.3g} s, {len(log.time)} samples; believed robot {robot.model.name}"
    return note + _divergence_note(log)


def _divergence_note(log: FlightLog) -> str:
    time = log.measured.attrs.get("diverged_at")
    return "" if time is None else f"; DIVERGED at {float(time):.4g} s (or its controller failed), shown until then"
