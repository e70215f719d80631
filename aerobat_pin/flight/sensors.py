"""Sensors: they turn the exact channels of a simulated flight into the log's measured channels.

    sample i, taken at the first log time not before i / rate:   round((true + bias + walk + noise) / quantum) quantum

The log's times do not change. At each time a channel shows the latest sample that was not lost and whose delay is
over. Before the first sample has arrived, the channel already shows that sample. Attitude errors are small rotations
about body axes; the attitude is rounded in roll, pitch and yaw.
"""

from __future__ import annotations

import zlib
from typing import Any

import numpy as np
import pinocchio as pin

from aerobat_pin.aerobat import FlightLog
from aerobat_pin.flight.raw_sensors import recorded_raw
from aerobat_pin.numerics import Array
from aerobat_pin.robot import Aerobat
from aerobat_pin.scenario import SensorSection, SensorsSection

Indices = np.ndarray[Any, np.dtype[np.intp]]


def recorded(log: FlightLog, robot: Aerobat, sensors: SensorsSection, seed: int) -> FlightLog:
    """Return a log as its sensors recorded it; the exact values of each changed channel stay in its truth.

    Each sensor has its own stream of random numbers, seeded by the sensor's name, so adding one sensor does not change
    the errors of the others.

    Args:
        log: a simulated flight with exact channels and a truth.
        robot: the robot that flew; it gives the places of the joints in q and v.
        sensors: settings of the sensors.
        seed: seed of all random numbers.
    """
    if sensors.raw:
        return recorded_raw(log, robot, sensors, seed)
    if not sensors.fitted:
        return log
    assert log.truth is not None
    measured, truth = log.measured.copy(deep=True), log.truth.copy()
    time = log.time
    at_q, at_v = list(robot.idx_q), list(robot.idx_v)
    places: dict[str, tuple[str, list[int] | None]] = {
        "position": ("q", [0, 1, 2]),
        "attitude": ("q", [3, 4, 5, 6]),
        "velocity": ("v", [0, 1, 2]),
        "gyro": ("v", [3, 4, 5]),
        "joint_angle": ("q", at_q),
        "joint_rate": ("v", at_v),
        "crank_angle": ("crank_angle", None),
        "airspeed": ("airspeed", None),
        "motor_torque": ("motor_torque", at_v),
    }
    for name, sensor in sensors.fitted.items():
        channel, columns = places[name]
        values = measured[channel].values
        table = values[:, None] if columns is None else values[:, columns]
        rng = np.random.default_rng([seed, zlib.crc32(name.encode())])
        sense = sensed_attitude if name == "attitude" else sensed
        shown = sense(table, time[: len(table)], sensor, rng)
        # In the truth, `airspeed` is the name of the strips' airspeeds.
        kept = "body_airspeed" if channel == "airspeed" else channel
        if kept not in truth:
            truth[kept] = log.measured[channel]
        if columns is None:
            values[:] = shown[:, 0]
        else:
            values[:, columns] = shown
    return FlightLog(measured, truth)


def sensed(true: Array, time: Array, sensor: SensorSection, rng: np.random.Generator) -> Array:
    """Return the readings (n, c) of a sensor at times (n,) [s], given the true values (n, c) of its channel."""
    taken = sampling_times(time, sensor.rate)
    samples = true[taken] + sensor_errors(time[taken], true.shape[1], sensor, rng)
    return np.asarray(quantised(samples, sensor.quantum)[last_arrived(time, taken, sensor, rng)])


def sensed_attitude(true: Array, time: Array, sensor: SensorSection, rng: np.random.Generator) -> Array:
    """Return the readings (n, 4) of an attitude sensor at times (n,) [s], given the true quaternions xyzw (n, 4)."""
    taken = sampling_times(time, sensor.rate)
    errors = sensor_errors(time[taken], 3, sensor, rng)
    samples = np.empty((len(taken), 4))
    for shown, row, error in zip(samples, true[taken], errors, strict=True):
        attitude = pin.Quaternion(row) * pin.Quaternion(pin.exp3(error))
        if sensor.quantum > 0.0:
            angles = quantised(pin.rpy.matrixToRpy(attitude.matrix()), sensor.quantum)
            attitude = pin.Quaternion(pin.rpy.rpyToMatrix(angles))
        shown[:] = attitude.coeffs() if attitude.coeffs() @ row >= 0.0 else -attitude.coeffs()
    return np.asarray(samples[last_arrived(time, taken, sensor, rng)])


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
