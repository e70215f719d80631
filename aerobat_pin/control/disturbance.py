"""What pushes on the body that nobody believes in: a momentum observer that runs as it would beside a robot.

It gets what the sensors show and what the controller knows: the mean wrench that the thrusters should have made, by
their believed lag, and the forces of the believed air along the measured motion. No joint torque is known, so only the
rows of the base count: the residual there is the wrench of all that is unknown.

It is filtered as a wrench at the robot's mean centre of mass, each component by a gain of its own, and given at the
body's centre of mass, c away, where thrusters count. About the body's centre of mass, the angular momentum has a part
m c x v, whose noise would be that of the velocity.

What it sees is part noise, and is weighed by what its size says of that, so that little is answered where nothing
pushes, and nothing changes at once where something begins to:

    counted = seen smooth^2 / (smooth^2 + variance)            smooth: seen, filtered by K once more

Momenta whose samples, dt apart, have a deviation s leave in `smooth` a variance s^2 K^3 dt / 4. s is that of velocity
and gyro, as is believed of the sensors, by the momentum that the robot has per velocity. The push of a gust is a
hundred times the deviation. The observer begins with the nominal velocity: a first sample's noise would look like a
push.
"""

from __future__ import annotations

from typing import Protocol

import numpy as np
import pinocchio as pin

from aerobat_pin.aerobat import BASE_SIZE, Aerobat, AirStream
from aerobat_pin.control.nominal_wrench import Nominal, control_of
from aerobat_pin.flight import Plant
from aerobat_pin.numerics import Array, kernel
from aerobat_pin.observers import Application, ForceLevelObserver
from aerobat_pin.scenario import AirSection, ControlSection, Scenario, SensorSection

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
    return np.concatenate([forces, np.broadcast_to(control.moment_gain, 3)])


def moved(wrench: Array, lever: Array) -> Array:
    """Return a wrench (6,) at a point from which its own point lies at `lever` (3,) [m]; all in the same axes."""
    shifted = np.empty(BASE_SIZE)
    move(wrench, lever, shifted)
    return shifted


@kernel
def move(wrench: Array, lever: Array, shifted: Array) -> None:
    """Write what `moved` returns."""
    fx, fy, fz, x, y, z = wrench[0], wrench[1], wrench[2], lever[0], lever[1], lever[2]
    shifted[0], shifted[1], shifted[2] = fx, fy, fz
    shifted[3] = wrench[3] + y * fz - z * fy
    shifted[4] = wrench[4] + z * fx - x * fz
    shifted[5] = wrench[5] + x * fy - y * fx


def sample_variance(sensor: SensorSection | None, dt: float) -> tuple[Array, float]:
    """Return the variance (3,) of a sensor's samples, by noise alone, and the time between them [s], at least dt."""
    if sensor is None:
        return np.zeros(3), dt
    variance = np.array(sensor.noise) ** 2 + sensor.quantum**2 / 12.0
    return variance * np.ones(3), dt if sensor.rate is None else max(dt, 1.0 / sensor.rate)


@kernel
def weigh(seen: Array, follow: Array, variance: Array, smooth: Array, counted: Array) -> None:
    """Write what counts (6,) of what the observer sees (6,).

    Args:
        seen: what the observer sees.
        follow: (6,) share by which `smooth` follows in a sample.
        variance: (6,) that noise has in what is smoothed.
        smooth: (6,) state.
        counted: written.
    """
    for i in range(seen.shape[0]):
        smooth[i] += follow[i] * (seen[i] - smooth[i])
        signal = smooth[i] * smooth[i]
        counted[i] = seen[i] * signal / (signal + variance[i]) if signal > 0.0 else 0.0


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
        scenario: the believed air, the sensors, and of the table `control` gains, and whether the air is known along
            the motion, or by its mean only.
        nominal: the robot's mean centre of mass and momentum, and the air's mean wrench, used in the second case.
        dt: time between samples [s].
    """

    def __init__(self, robot: Aerobat, scenario: Scenario, nominal: Nominal, dt: float) -> None:
        """Set up observer and air; `reset` starts them."""
        model = pin.Model(robot.model)
        body = model.joints[1]
        centre = pin.SE3(np.eye(3), nominal.centre)
        model.addFrame(pin.Frame(CENTRE, body.id, 0, centre, pin.FrameType.OP_FRAME))
        unknown = [Application(CENTRE, kind="wrench", axes="frame")]
        control, sensors = control_of(scenario), scenario.believed_sensors
        gains = observer_gains(control)
        self.observer = ForceLevelObserver(model, unknown, gains, rows="base")
        self._stream = AirStream(robot, scenario.believed_air, dt) if control.air else None
        self._rate, self._centre = 2.0 * np.pi * scenario.crank.frequency, nominal.centre
        samples = [sample_variance(sensor, dt) for sensor in (sensors.velocity, sensors.gyro)]
        density = nominal.momentum**2 @ np.concatenate([variance * period for variance, period in samples])
        self._variance = gains**3 / 4.0 * density
        self._follow, self._smooth, self._counted = 1.0 - np.exp(-gains * dt), np.zeros(BASE_SIZE), np.zeros(BASE_SIZE)
        self._tau, self._known = np.zeros(model.nv), {"air and thrusters": np.zeros(model.nv)}
        self._mean = np.append(nominal.air, np.zeros(model.nv - BASE_SIZE))[None]

    def reset(self, time: float, q: Array, v: Array, crank_angle: float) -> None:
        """Start at a sample."""
        self.observer.reset(q, v, time)
        self._smooth[:] = 0.0
        if self._stream is not None:
            self._stream.reset(time, q, v, crank_angle, self._rate)

    def update(self, time: float, q: Array, v: Array, thrust: Array) -> Array:
        """Take a sample and the thrusters' mean wrench (6,) since the last one; return the unknown wrench (6,)."""
        air = self._mean if self._stream is None else self._stream.update(time, q, v)
        add_thrust(air, thrust, self._known["air and thrusters"])
        seen = self.observer.update(time, q, v, self._tau, self._known).components
        weigh(seen, self._follow, self._variance, self._smooth, self._counted)
        return moved(self._counted, self._centre)
