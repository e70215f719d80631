"""What pushes on the body that nobody believes in: a momentum observer that runs as it would beside a robot.

It gets what the sensors show and what the controller knows: the mean wrench that the thrusters should have made, by
their believed lag, and the forces of the believed air along the measured motion. No joint torque is known, so only the
rows of the base count: the residual there is the wrench of all that is unknown, filtered.
"""

from __future__ import annotations

from typing import Protocol

import numpy as np

from aerobat_pin.estimation import AirStream
from aerobat_pin.flight import Plant
from aerobat_pin.numerics import Array
from aerobat_pin.observers import MomentumObserver
from aerobat_pin.robot import BASE_SIZE, Aerobat
from aerobat_pin.scenario import AirSection, ControlSection


class Disturbance(Protocol):
    """Anything that says which unknown wrench acts on the body, at its centre of mass and in body axes."""

    def reset(self, time: float, q: Array, v: Array, crank_angle: float) -> None:
        """Start at a sample."""

    def update(self, time: float, q: Array, v: Array, thrust: Array) -> Array:
        """Take a sample and the thrusters' mean wrench (6,) since the last one; return the unknown wrench (6,)."""


def observer_gains(control: ControlSection) -> Array:
    """Return the observer's gains (6,) of the base's rows [1/s]: forces x, y, z, then moments, body axes."""
    forces = [control.forward_gain, control.lateral_gain, control.lift_gain]
    return np.array([*forces, *[control.moment_gain] * 3])


class TrueDisturbance:
    """What an observer looks for, as only a simulation knows it: for comparisons.

    It is the mean of all forces over the last interval, air and real thrusters included, less what is believed of air
    (along the true motion) and of thrusters.

    Args:
        plant: the plant that flies.
        robot: the believed robot.
        air: the believed air.
        gains: (6,) an observer's gains, to filter it by [1/s]; None does not.
        dt: time between samples [s].
        crank_rate: of the crank before the flight [rad/s].
    """

    def __init__(
        self, plant: Plant, robot: Aerobat, air: AirSection, gains: Array | None, dt: float, crank_rate: float
    ) -> None:
        """Set up the believed air; `reset` starts it."""
        self._plant, self._stream, self._rate = plant, AirStream(robot, air, dt), crank_rate
        self._follow = np.ones(BASE_SIZE) if gains is None else 1.0 - np.exp(-gains * dt)
        self._seen = np.zeros(BASE_SIZE)

    def reset(self, time: float, q: Array, v: Array, crank_angle: float) -> None:
        """Start with a flight that has begun; what sensors show is not used."""
        flight = self._plant.flight
        assert flight is not None
        self._stream.reset(time, flight.q, flight.v, crank_angle, self._rate)
        self._seen = np.zeros(BASE_SIZE)

    def update(self, time: float, q: Array, v: Array, thrust: Array) -> Array:
        """Return the true unknown wrench (6,) over the last interval, or its filtered past."""
        flight = self._plant.flight
        assert flight is not None
        forces, believed = flight.last_forces(), self._stream.update(time, flight.q, flight.v)
        total = forces.aerodynamic[0] + forces.added_mass[0] + forces.unknown[0] + forces.thrusters[0]
        push = (total - believed[0] - believed[1])[:BASE_SIZE] - thrust
        self._seen = self._seen + self._follow * (push - self._seen)
        return self._seen


class DisturbanceObserver:
    """The momentum observer of a controller.

    Args:
        robot: the believed robot.
        air: the believed air.
        control: gains; and whether the air is known along the motion, or by its mean only.
        mean_air: (6,) mean wrench of the air, used in the second case.
        dt: time between samples [s].
        crank_rate: of the crank before the flight [rad/s].
    """

    def __init__(
        self, robot: Aerobat, air: AirSection, control: ControlSection, mean_air: Array, dt: float, crank_rate: float
    ) -> None:
        """Set up observer and air; `reset` starts them."""
        rest = robot.model.nv - BASE_SIZE
        gains = np.append(observer_gains(control), np.full(rest, control.moment_gain))  # joint rows are not used
        self.observer = MomentumObserver(robot.model, gain=gains)
        self._stream = AirStream(robot, air, dt) if control.air else None
        self._rate = crank_rate
        self._tau, self._pushed = np.zeros(robot.model.nv), np.zeros(robot.model.nv)
        self._mean = np.append(mean_air, np.zeros(rest))

    def reset(self, time: float, q: Array, v: Array, crank_angle: float) -> None:
        """Start at a sample."""
        self.observer.reset(q, v, time)
        if self._stream is not None:
            self._stream.reset(time, q, v, crank_angle, self._rate)

    def update(self, time: float, q: Array, v: Array, thrust: Array) -> Array:
        """Take a sample and the thrusters' mean wrench (6,) since the last one; return the unknown wrench (6,)."""
        self._pushed[:BASE_SIZE] = thrust
        known = {"thrusters": self._pushed, "air": self._mean}
        if self._stream is not None:
            known["air"], known["added_mass"] = self._stream.update(time, q, v)
        return self.observer.update(time, q, v, self._tau, known).residual[:BASE_SIZE]
