"""What pushes on the body that nobody believes in: a momentum observer that runs as it would beside a robot.

It gets what the sensors show and what the controller knows: the mean wrench that the thrusters should have made, by
their believed lag, and the forces of the believed air along the measured motion. No joint torque is known, so only the
rows of the base count: the residual there is the wrench of all that is unknown.

It is filtered as a wrench at the robot's mean centre of mass, each component by a gain of its own, and given at the
body's centre of mass, c away, where thrusters count. About the body's centre of mass, the angular momentum has a part
m c x v, whose noise would be that of the velocity.
"""

from __future__ import annotations

from typing import Protocol

import numpy as np
import pinocchio as pin

from aerobat_pin.control.nominal import Nominal
from aerobat_pin.estimation import AirStream
from aerobat_pin.flight import Plant
from aerobat_pin.numerics import Array, kernel
from aerobat_pin.observers import Application, ForceLevelObserver
from aerobat_pin.robot import BASE_SIZE, Aerobat
from aerobat_pin.scenario import AirSection, ControlSection

CENTRE = "mean_centre_of_mass"  # frame of the body


class Disturbance(Protocol):
    """Anything that says which unknown wrench acts on the body, at its centre of mass and in body axes."""

    def reset(self, time: float, q: Array, v: Array, crank_angle: float) -> None:
        """Start at a sample."""

    def update(self, time: float, q: Array, v: Array, thrust: Array) -> Array:
        """Take a sample and the thrusters' mean wrench (6,) since the last one; return the unknown wrench (6,)."""
        ...


def observer_gains(control: ControlSection) -> Array:
    """Return the observer's gains (6,) [1/s]: forces x, y, z, then moments at the centre of mass, body axes."""
    forces = [control.forward_gain, control.lateral_gain, control.lift_gain]
    return np.array([*forces, *[control.moment_gain] * 3])


def moved(wrench: Array, lever: Array) -> Array:
    """Return a wrench (6,) at a point from which its own point lies at `lever` (3,) [m]; all in the same axes."""
    there = np.empty(BASE_SIZE)
    move(wrench, lever, there)
    return there


@kernel
def move(wrench: Array, lever: Array, there: Array) -> None:
    """Write what `moved` returns."""
    fx, fy, fz, x, y, z = wrench[0], wrench[1], wrench[2], lever[0], lever[1], lever[2]
    there[0], there[1], there[2] = fx, fy, fz
    there[3] = wrench[3] + y * fz - z * fy
    there[4] = wrench[4] + z * fx - x * fz
    there[5] = wrench[5] + x * fy - y * fx


@kernel
def add_thrust(air: Array, thrust: Array, known: Array) -> None:
    """Write the sum of all known forces (nv,): of the air (n, nv), and the thrusters' wrench (6,) on the base."""
    for i in range(known.shape[0]):
        known[i] = thrust[i] if i < BASE_SIZE else 0.0
        for j in range(air.shape[0]):
            known[i] += air[j, i]


class TrueDisturbance:
    """What an observer looks for, as only a simulation knows it: for comparisons.

    It is the mean of all forces over the last interval, air and real thrusters included, less what is believed of air
    (along the true motion) and of thrusters.

    Args:
        plant: the plant that flies.
        robot: the believed robot.
        air: the believed air.
        centre: (3,) the robot's mean centre of mass from the body's, body axes [m].
        gains: (6,) an observer's gains, to filter it by [1/s]; None does not.
        dt: time between samples [s].
        crank_rate: of the crank before the flight [rad/s].
    """

    def __init__(
        self,
        plant: Plant,
        robot: Aerobat,
        air: AirSection,
        centre: Array,
        gains: Array | None,
        dt: float,
        crank_rate: float,
    ) -> None:
        """Set up the believed air; `reset` starts it."""
        self._centre = centre
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
        self._seen = self._seen + self._follow * (moved(push, -self._centre) - self._seen)
        return moved(self._seen, self._centre)


class DisturbanceObserver:
    """The momentum observer of a controller.

    Args:
        robot: the believed robot.
        air: the believed air.
        control: gains; and whether the air is known along the motion, or by its mean only.
        nominal: the robot's mean centre of mass, and the air's mean wrench, which is used in the second case.
        dt: time between samples [s].
        crank_rate: of the crank before the flight [rad/s].
    """

    def __init__(
        self, robot: Aerobat, air: AirSection, control: ControlSection, nominal: Nominal, dt: float, crank_rate: float
    ) -> None:
        """Set up observer and air; `reset` starts them."""
        model = pin.Model(robot.model)
        body = model.joints[1]
        centre = pin.SE3(np.eye(3), nominal.centre)
        model.addFrame(pin.Frame(CENTRE, body.id, 0, centre, pin.FrameType.OP_FRAME))
        unknown = [Application(CENTRE, kind="wrench", axes="frame")]
        self.observer = ForceLevelObserver(model, unknown, observer_gains(control), rows="base")
        self._stream = AirStream(robot, air, dt) if control.air else None
        self._rate, self._centre = crank_rate, nominal.centre
        self._tau, self._known = np.zeros(model.nv), {"air and thrusters": np.zeros(model.nv)}
        self._mean = np.append(nominal.air, np.zeros(model.nv - BASE_SIZE))[None]

    def reset(self, time: float, q: Array, v: Array, crank_angle: float) -> None:
        """Start at a sample."""
        self.observer.reset(q, v, time)
        if self._stream is not None:
            self._stream.reset(time, q, v, crank_angle, self._rate)

    def update(self, time: float, q: Array, v: Array, thrust: Array) -> Array:
        """Take a sample and the thrusters' mean wrench (6,) since the last one; return the unknown wrench (6,)."""
        air = self._mean if self._stream is None else self._stream.update(time, q, v)
        add_thrust(air, thrust, self._known["air and thrusters"])
        return moved(self.observer.update(time, q, v, self._tau, self._known).components, self._centre)
