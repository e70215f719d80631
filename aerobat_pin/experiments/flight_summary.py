"""Summarise a flight in a few numbers, the entry `flight` of `metrics.json`."""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from typing import Any

import numpy as np

from aerobat_pin.aerobat import KNOWN, FlightLog
from aerobat_pin.numerics import Array, guarded
from aerobat_pin.robot import euler_angles, world_velocity

Range = tuple[float, float]


def _in(unit: str) -> dict[str, str]:
    return {"unit": unit}


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

    duration: float = field(metadata=_in("s"))
    position_end: tuple[float, float, float] = field(metadata=_in("m"))
    z_range: Range = field(metadata=_in("m"))
    roll_range: Range = field(metadata=_in("rad"))
    pitch_range: Range = field(metadata=_in("rad"))
    yaw_range: Range = field(metadata=_in("rad"))
    thrusters_lift_over_weight: float | None = field(default=None, metadata=_in("1"))
    aerodynamic_lift_over_weight: float | None = field(default=None, metadata=_in("1"))
    motor_power_mean: float | None = field(default=None, metadata=_in("W"))
    incidence_range: Range | None = field(default=None, metadata=_in("rad"))
    diverged_at: float | None = field(default=None, metadata=_in("s"))
    rms: dict[str, float] | None = field(default=None, metadata=_in("m, rad"))

    def to_json(self) -> dict[str, Any]:
        """Return all numbers that are not None, as written to `metrics.json`."""
        values = {item.name: getattr(self, item.name) for item in fields(self)}
        return {
            name: list(value) if isinstance(value, tuple) else value
            for name, value in values.items()
            if value is not None
        }


@guarded(mass="positive")
def flight_summary(log: FlightLog, mass: float) -> FlightSummary:
    """Summarise a flight.

    Args:
        log: the flight log.
        mass: mass of the robot [kg].
    """
    measured, truth = log.measured, log.truth
    q = (measured if truth is None or "q" not in truth else truth)["q"].values
    roll, pitch, yaw = (_range(angle) for angle in euler_angles(q).T)
    weight = mass * float(measured.attrs["gravity"])

    def lift_over_weight(force: Array) -> float | None:
        return float(np.mean(world_velocity(q[:-1], force)[:, 2]) / weight) if weight > 0.0 else None

    thrusters = measured.get(f"{KNOWN}thrusters")
    x, y, z = q[-1, :3].tolist()
    return FlightSummary(
        duration=float(log.time[-1]),
        position_end=(x, y, z),
        z_range=_range(q[:, 2]),
        roll_range=roll,
        pitch_range=pitch,
        yaw_range=yaw,
        thrusters_lift_over_weight=None if thrusters is None else lift_over_weight(thrusters.values),
        aerodynamic_lift_over_weight=(
            None if truth is None else lift_over_weight(truth["aerodynamic"].values + truth["added_mass"].values)
        ),
        motor_power_mean=None if truth is None else float(np.mean(truth["motor_power"].values)),
        incidence_range=None if truth is None else _range(truth["incidence"].values),
        diverged_at=measured.attrs.get("diverged_at"),
    )


def _range(values: Array) -> Range:
    return float(values.min()), float(values.max())
