"""Sensors turn the exact channels of a simulated flight into what is measured: of a whole log, or in a loop as it goes.

    sample i, taken at the first log time not before i / rate:   round((true + bias + walk + noise) / quantum) quantum

The log's times do not change. At each time a channel shows the latest sample that was not lost and whose delay is
over. Before the first sample has arrived, the channel already shows that sample. Attitude errors are small rotations
about body axes; the attitude is rounded in roll, pitch and yaw.

In a loop the errors are drawn in advance with the same random streams as those of a log, so a controller sees to the
bit what the log of its flight shows. Only what makes up configuration and velocity is read there: position, attitude,
velocity, gyro and joints, and the crank.
"""

from __future__ import annotations

import zlib
from typing import Any

import numpy as np
import pinocchio as pin

from aerobat_pin.aerobat import Aerobat, FlightLog
from aerobat_pin.flight.raw_sensors import measure_raw
from aerobat_pin.numerics import Array
from aerobat_pin.scenario import SensorSection, SensorsSection

Indices = np.ndarray[Any, np.dtype[np.intp]]
ChannelColumns = slice | list[int]
ORIGIN = np.zeros(3)


def measure(log: FlightLog, robot: Aerobat, sensors: SensorsSection, seed: int) -> FlightLog:
    """Return a log as its sensors recorded it; the exact values of each changed channel stay in its truth.

    Each sensor has its own stream of random numbers, seeded by the sensor's name, so adding one sensor does not change
    the errors of the others.
    """
    if sensors.raw:
        return measure_raw(log, robot, sensors, seed)
    if not sensors.fitted:
        return log
    assert log.truth is not None
    measured, truth = log.measured.copy(deep=True), log.truth.copy()
    time = log.time
    places = places_in_motion(robot) | {"motor_torque": ("motor_torque", list(robot.idx_v))}
    for name, sensor in sensors.fitted.items():
        channel, columns = places.get(name, (name, slice(None)))
        table = measured[channel].values.reshape(len(measured[channel]), -1)  # a view of the channel
        rng = np.random.default_rng([seed, zlib.crc32(name.encode())])
        # In the truth, `airspeed` is the name of the strips' airspeeds.
        kept = "body_airspeed" if channel == "airspeed" else channel
        if kept not in truth:
            truth[kept] = log.measured[channel]
        table[:, columns] = sensed(table[:, columns], time[: len(table)], sensor, rng, name == "attitude")
    return FlightLog(measured, truth)


def places_in_motion(robot: Aerobat) -> dict[str, tuple[str, ChannelColumns]]:
    """Return where in q, v or crank angle each sensor of the motion reads."""
    return {
        "position": ("q", slice(0, 3)),
        "attitude": ("q", slice(3, 7)),
        "velocity": ("v", slice(0, 3)),
        "gyro": ("v", slice(3, 6)),
        "joint_angle": ("q", list(robot.idx_q)),
        "joint_rate": ("v", list(robot.idx_v)),
        "crank_angle": ("crank_angle", slice(0, 1)),
    }


def sensed(true: Array, time: Array, sensor: SensorSection, rng: np.random.Generator, attitude: bool = False) -> Array:
    """Return a sensor's readings (n, c) at times (n,) [s] of true values (n, c), or of true quaternions xyzw (n, 4)."""
    taken = sampling_times(time, sensor.rate)
    errors = sensor_errors(time[taken], 3 if attitude else true.shape[1], sensor, rng)
    if attitude:
        turns = [_quaternion_of(pin.exp3(error)) for error in errors]
        samples = np.array(
            [attitude_sample(*turned, sensor.quantum) for turned in zip(true[taken], turns, strict=True)]
        )
    else:
        samples = quantised(true[taken] + errors, sensor.quantum)
    return np.asarray(samples[last_arrived(time, taken, sensor, rng)])


def attitude_sample(true: Array, error: pin.Quaternion, quantum: float) -> Array:
    """Return a quaternion xyzw (4,), turned by an error and rounded in roll, pitch, yaw, with the nearer sign."""
    attitude = pin.Quaternion(true) * error
    if quantum > 0.0:
        attitude = _quaternion_of(pin.rpy.rpyToMatrix(quantised(pin.rpy.matrixToRpy(attitude.matrix()), quantum)))
    shown: Array = attitude.coeffs()
    return shown if shown @ true >= 0.0 else -shown


def sampling_times(time: Array, rate: float | None) -> Indices:
    """Return the indices of the times (n,) at which a sample is taken; the first time is always among them."""
    if rate is None:
        return np.arange(len(time))
    count = np.floor((time - time[0]) * rate + 1e-6)
    return np.flatnonzero(np.diff(count, prepend=-1.0) > 0.0)


def sensor_errors(time: Array, axes: int, sensor: SensorSection, rng: np.random.Generator) -> Array:
    """Draw the errors (m, axes) of samples taken at times (m,) [s]: the sum of bias, random walk and white noise."""
    noise, steps = rng.standard_normal((2, len(time), axes))
    steps *= np.sqrt(np.diff(time, prepend=time[0]))[:, None]
    return np.asarray(sensor.noise * noise + sensor.walk * np.cumsum(steps, axis=0) + np.array(sensor.bias))


def quantised(values: Array, quantum: float) -> Array:
    """Round values to whole multiples of a quantum; 0 leaves them."""
    return np.asarray(np.round(values / quantum) * quantum) if quantum > 0.0 else values


def last_arrived(time: Array, taken: Indices, sensor: SensorSection, rng: np.random.Generator) -> Indices:
    """Return, for each time (n,), the index of the latest sample that the sensor has delivered."""
    kept = np.flatnonzero(rng.random(len(taken)) >= sensor.dropout)
    kept = kept if len(kept) and kept[0] == 0 else np.insert(kept, 0, 0)  # the first sample is never lost
    arrived = time[taken[kept]] + sensor.delay
    last = np.searchsorted(arrived, time + 1e-9, side="right") - 1
    return np.asarray(kept[np.maximum(last, 0)])


class Sensing:
    """What a robot's sensors show of q, v and crank angle during a flight.

    Args:
        robot: the robot that flies.
        sensors: settings of the sensors.
        time: (n + 1,) times of the samples [s]; after them, the errors are drawn anew and the sensors start again.
        seed: seed of all random numbers.
        first: number of the sample that is read first.
    """

    def __init__(self, robot: Aerobat, sensors: SensorsSection, time: Array, seed: int, first: int = 0) -> None:
        places = places_in_motion(robot)
        self._fitted = [(name, *places[name], sensor) for name, sensor in sensors.fitted.items() if name in places]
        self._time, self._seed = time, seed
        self._draw_from(first)

    def draw(self, k: int) -> None:
        """Draw the errors that sample k needs, unless they are drawn: work of a simulation, and of no sensor."""
        if k - self._first == len(self._time):
            self._draw_from(k)

    def read(self, k: int, q: Array, v: Array) -> tuple[Array, Array]:
        """Return what the sensors show at sample k of a flight whose true q and v are given; k counts up by one."""
        self.draw(k)
        q, v = q.copy(), v.copy()
        self._show(k, {"q": q, "v": v})
        return q, v

    def crank(self, k: int, angle: float) -> float:
        """Return what the crank's sensor shows at sample k, which `read` has been called for, at a true angle [rad]."""
        shown = np.array([angle])
        self._show(k, {"crank_angle": shown})
        return float(shown[0])

    def _draw_from(self, first: int) -> None:
        self._first, seeds = first, [self._seed] if first == 0 else [self._seed, first]
        self._readers = []
        for name, channel, columns, sensor in self._fitted:
            rng = np.random.default_rng([*seeds, zlib.crc32(name.encode())])
            self._readers.append((channel, columns, _Reader(name, sensor, self._time, rng)))

    def _show(self, k: int, channels: dict[str, Array]) -> None:
        """Replace the true values of channels by what their sensors show."""
        for channel, columns, reader in self._readers:
            if channel in channels:
                values = channels[channel]
                values[columns] = reader(k - self._first, values[columns])


class _Reader:
    """The readings of one sensor."""

    def __init__(self, name: str, sensor: SensorSection, time: Array, rng: np.random.Generator) -> None:
        self._attitude, self._quantum = name == "attitude", sensor.quantum
        taken = sampling_times(time, sensor.rate)
        axes = {"joint_angle": 4, "joint_rate": 4, "crank_angle": 1}.get(name, 3)
        errors = sensor_errors(time[taken], axes, sensor, rng)
        self._errors: Any = [_quaternion_of(pin.exp3(error)) for error in errors] if self._attitude else errors
        self._number = np.full(len(time), -1)
        self._number[taken] = np.arange(len(taken))
        self._shown = last_arrived(time, taken, sensor, rng)
        newest = np.searchsorted(taken, np.arange(len(time)), side="right") - 1
        kept = int(np.max(newest - self._shown)) + 1  # samples that are still waiting, or lost since
        self._samples = np.zeros((kept, 4 if self._attitude else axes))

    def __call__(self, k: int, true: Array) -> Array:
        """Return the reading at time k, at which the channel's true value is given."""
        samples, number = self._samples, self._number[k]
        if number >= 0:
            error, quantum = self._errors[number], self._quantum
            sample = attitude_sample(true, error, quantum) if self._attitude else quantised(true + error, quantum)
            samples[number % len(samples)] = sample
            if len(samples) == 1:  # nothing waits, and nothing was lost
                return sample
        return np.asarray(samples[self._shown[k] % len(samples)])


def _quaternion_of(rotation: Array) -> pin.Quaternion:
    """Return the quaternion of a rotation (3, 3); `pin.Quaternion(rotation)` loses 80 bytes of memory at each call."""
    return pin.Quaternion(pin.SE3ToXYZQUAT(pin.SE3(rotation, ORIGIN))[3:])
