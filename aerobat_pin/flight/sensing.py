"""Sensors in the loop: the samples of `sensors`, one time of the log after the other, as the flight goes.

The errors are drawn in advance with the same random streams as those of a log, so a controller sees to the bit what
the log of its flight shows. Only what makes up configuration and velocity is read: position, attitude, velocity, gyro
and joints.
"""

from __future__ import annotations

import zlib
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import pinocchio as pin

from aerobat_pin.flight.sensors import last_arrived, quantised, sampling_times, sensor_errors
from aerobat_pin.numerics import Array
from aerobat_pin.robot import Aerobat
from aerobat_pin.scenario import SensorSection, SensorsSection

ChannelColumns = slice | list[int]
SENSED: dict[str, tuple[str, ChannelColumns]] = {
    "position": ("q", slice(0, 3)),
    "attitude": ("q", slice(3, 7)),
    "velocity": ("v", slice(0, 3)),
    "gyro": ("v", slice(3, 6)),
}
ORIGIN = np.zeros(3)


class Sensing:
    """What a robot's sensors show of q, v and crank angle during a flight.

    Args:
        robot: the robot that flies.
        sensors: settings of the sensors.
        time: (n + 1,) times of the samples [s]; after them, the errors are drawn anew and the sensors start again.
        seed: seed of all random numbers.
    """

    def __init__(self, robot: Aerobat, sensors: SensorsSection, time: Array, seed: int) -> None:
        """Draw the errors of the first n + 1 samples."""
        places = SENSED | {"joint_angle": ("q", list(robot.idx_q)), "joint_rate": ("v", list(robot.idx_v))}
        self._fitted = [(name, *places[name], one) for name, one in sensors.fitted.items() if name in places]
        self._crank = [("crank_angle", "crank", slice(0, 1), one) for one in [sensors.fitted.get("crank_angle")] if one]
        self._time, self._seed, self._first = time, seed, 0
        self._readers, self._crank_readers = self._drawn(self._fitted), self._drawn(self._crank)

    def draw(self, k: int) -> None:
        """Draw the errors that sample k needs, unless they are drawn: work of a simulation, and of no sensor."""
        if k - self._first == len(self._time):
            self._first = k
            self._readers, self._crank_readers = self._drawn(self._fitted), self._drawn(self._crank)

    def read(self, k: int, q: Array, v: Array) -> tuple[Array, Array]:
        """Return what the sensors show at sample k of a flight whose true q and v are given; k counts up by one."""
        self.draw(k)
        k -= self._first
        if self._readers:
            q, v = q.copy(), v.copy()
            table = {"q": q, "v": v}
            for which, columns, reader in self._readers:
                values = table[which]
                values[columns] = reader(k, values[columns])
        return q, v

    def crank(self, k: int, angle: float) -> float:
        """Return what the crank's sensor shows at sample k, which `read` has been called for, at a true angle [rad]."""
        for _, _, reader in self._crank_readers:
            angle = float(reader(k - self._first, np.array([angle]))[0])
        return angle

    def _drawn(
        self, fitted: Sequence[tuple[str, str, ChannelColumns, SensorSection]]
    ) -> list[tuple[str, ChannelColumns, Callable[[int, Array], Array]]]:
        seeds = [self._seed] if self._first == 0 else [self._seed, self._first]
        return [
            (which, columns, _Reader(name, one, self._time, np.random.default_rng([*seeds, zlib.crc32(name.encode())])))
            for name, which, columns, one in fitted
        ]


class _Reader:
    """The readings of one sensor."""

    def __init__(self, name: str, sensor: SensorSection, time: Array, rng: np.random.Generator) -> None:
        self._attitude, self._quantum = name == "attitude", sensor.quantum
        taken = sampling_times(time, sensor.rate)
        axes = {"joint_angle": 4, "joint_rate": 4, "crank_angle": 1}.get(name, 3)
        errors = sensor_errors(time[taken], axes, sensor, rng)
        self._errors = [_quaternion_of(pin.exp3(error)) for error in errors] if self._attitude else errors
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
            samples[number % len(samples)] = sample = self._sample(true, self._errors[number])
            if len(samples) == 1:  # nothing waits, and nothing was lost
                return sample
        return np.asarray(samples[self._shown[k] % len(samples)])

    def _sample(self, true: Array, error: Any) -> Array:
        if not self._attitude:
            return quantised(true + error, self._quantum)
        attitude = pin.Quaternion(true) * error
        if self._quantum > 0.0:
            angles = quantised(pin.rpy.matrixToRpy(attitude.matrix()), self._quantum)
            attitude = _quaternion_of(pin.rpy.rpyToMatrix(angles))
        shown: Array = attitude.coeffs()
        return shown if shown @ true >= 0.0 else -shown


def _quaternion_of(rotation: Array) -> pin.Quaternion:
    """Return the quaternion of a rotation (3, 3); `pin.Quaternion(rotation)` loses 80 bytes of memory at each call."""
    return pin.Quaternion(pin.SE3ToXYZQUAT(pin.SE3(rotation, ORIGIN))[3:])
