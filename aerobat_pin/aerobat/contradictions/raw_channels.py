"""Find contradictions between the raw channels of a log: held or interpolated samples, a misread quaternion, units.

| what | how it shows |
|---|---|
| held channel | samples repeat at even intervals |
| interpolated channel | most triples of neighbours lie on a straight line |
| quaternion order, sense | the gyro's turn between two poses differs less for another reading; or the mean specific |
| | force points up in the world for another reading only, which decides in nearly pure pitch |
| unit of the gyro | its size over that of the attitude's rate is 57.3 or 1/57.3 |
| unit of the accelerometer | the mean specific force is one, not 9.81 |

The bounds are those of prototypes on simulated flights: a right reading leaves 4.2 mrad a frame with 3 mrad of noise.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np
import pinocchio as pin

from aerobat_pin.aerobat.flight_log import FlightLog
from aerobat_pin.numerics import Array

if TYPE_CHECKING:
    import xarray as xr

REPEATS, PERIOD, EVENLY = 0.3, 1.5, 0.95  # share of repeats, samples between changes, share of even intervals
STRAIGHT = 0.5  # share of triples on a straight line
STRAIGHT_ERROR = 1e-7  # of the channel's size: how straight
ALIKE = 1.1
BETTER = 0.85  # a reading is better if it leaves this share of the turn that is not explained
LEAST_TURN = 5.0e-3  # [rad] a frame: 3 mrad of noise leave 4.2 mrad if the quaternion is read rightly
LEAST_UPWARD = 0.5  # of gravity: mean specific force along the world's vertical
TITLES = {
    "mocap_position": "position of motion capture",
    "mocap_quaternion": "quaternion of motion capture",
    "gyro": "gyro",
    "accelerometer": "accelerometer",
    "encoder": "encoder",
    "joint_torque_sample": "joint torque",
    "crank_torque_sample": "crank torque",
}
READINGS = {"x, y, z, w": [0, 1, 2, 3], "w, x, y, z": [1, 2, 3, 0]}


def raw_contradictions(log: FlightLog) -> list[str]:
    """Return the contradictions in the raw channels of a log, as `contradictions` does."""
    found = []
    for name, title in TITLES.items():
        if name in log.measured:
            found += list(_repeated(title, log.measured[name]))
    found += list(_quaternion_misread(log))
    found += list(_units(log))
    return found


def _stamped(data: xr.DataArray) -> tuple[Array, Array]:
    values = np.asarray(data.values, float)
    return np.asarray(data[data.dims[0]].values, float), values.reshape(len(values), -1)


def _repeated(title: str, data: xr.DataArray) -> Iterator[str]:
    """Yield a channel whose samples are held, or interpolated, from a slower one."""
    time, values = _stamped(data)
    if len(time) < 20:
        return
    changes = np.flatnonzero(np.any(values[1:] != values[:-1], axis=1))
    rate = (len(time) - 1) / (time[-1] - time[0])
    if 8 < len(changes) < (1.0 - REPEATS) * len(time):
        gaps = np.diff(changes)
        period = float(np.median(gaps))
        off = np.abs(gaps - period * np.maximum(np.round(gaps / period), 1.0))
        if period > PERIOD and float(np.mean(off <= (1.0 if period >= 4.0 else 0.0))) > EVENLY:
            own = rate / float(np.mean(gaps))
            yield (
                f"held channel: {title} changes only {own:.3g} times a second among {rate:.4g} samples a second; leave "
                "its cells empty where there is no sample"
            )
            return
    if title == TITLES["encoder"]:
        return  # a steady crank turns straight
    step = time[1:] - time[:-1]
    share = (step[1:] / (step[1:] + step[:-1]))[:, None]
    bend = values[1:-1] - (values[:-2] * share + values[2:] * (1.0 - share))
    size = np.maximum(np.max(np.abs(values), axis=0), 1e-12)
    moving = np.any(values[2:] != values[:-2], axis=1)
    straight = np.all(np.abs(bend) < STRAIGHT_ERROR * size, axis=1) & moving
    if (figure := float(np.mean(straight))) > STRAIGHT:
        yield (
            f"interpolated channel: {100 * figure:.0f} % of the neighbours in {title} lie on straight lines; leave its "
            "cells empty where there is no sample"
        )


def _rotations_of(quaternions: Array) -> Array:
    return np.array([pin.Quaternion(q / np.linalg.norm(q)).matrix() for q in quaternions])


def _gyro_turns(log: FlightLog, time: Array) -> Array:
    """Return the integral of the gyro's rates (k, 3) at the times of other samples."""
    at, rates = _stamped(log.measured["gyro"])
    turned = np.concatenate([np.zeros((1, 3)), np.cumsum(0.5 * (rates[1:] + rates[:-1]) * np.diff(at)[:, None], 0)])
    return np.column_stack([np.interp(time, at, column) for column in turned.T])


def _turns(rotation: Array) -> Array:
    return np.array([pin.log3(a.T @ b) for a, b in itertools.pairwise(rotation)])


def _quaternion_misread(log: FlightLog) -> Iterator[str]:
    """Yield a quaternion that fits gyro and gravity better if it is read in another order or the other way round."""
    time, values = _stamped(log.measured["mocap_quaternion"])
    readings = {}
    for order, columns in READINGS.items():
        rotation = _rotations_of(values[:, columns])
        readings[f"{order}, body to world"] = rotation
        readings[f"{order}, world to body"] = np.swapaxes(rotation, 1, 2)
    here = "x, y, z, w, body to world"
    left: dict[str, float] = {}
    if "gyro" in log.measured:
        steps = np.diff(_gyro_turns(log, time), axis=0)
        seen = _turn_of(log, "mocap_quaternion") @ _turn_of(log, "gyro").T
        for name, rotation in readings.items():
            left[name] = float(np.sqrt(np.mean((_turns(rotation) - steps @ seen.T) ** 2)))
        least = min(left.values())
        best = next(name for name in left if left[name] <= ALIKE * least)  # the most usual of those that fit alike
        if best != here and left[here] > LEAST_TURN and left[best] < BETTER * left[here]:
            yield (
                f"quaternion order: read as {here}, it turns {1e3 * left[here]:.1f} mrad a frame away from the gyro "
                f"(rms), as {best} {1e3 * left[best]:.1f}: the columns seem to be {best}"
            )
            return
    if "accelerometer" in log.measured:
        at, felt = _stamped(log.measured["accelerometer"])
        felt = np.column_stack([np.interp(time, at, column) for column in (felt @ _turn_of(log, "accelerometer").T).T])
        up = {name: float(np.mean(np.einsum("kj,kj->k", R[:, 2], felt))) / 9.81 for name, R in readings.items()}
        if up[here] < LEAST_UPWARD * min(1.0, _size(felt) / 9.81):
            least = 1.3 * min(left.values(), default=1.0)
            fit = {name: value for name, value in up.items() if left.get(name, 0.0) < least}
            best = max(fit, key=lambda name: fit[name])
            if best != here and fit[best] > up[here] + LEAST_UPWARD:
                yield (
                    f"quaternion order: read as {here}, the mean specific force is {9.81 * up[here]:.1f} m/s2 upward, "
                    f"as {best} {9.81 * up[best]:.1f}: the columns seem to be {best}"
                )


def _turn_of(log: FlightLog, name: str) -> Array:
    return np.asarray(pin.rpy.rpyToMatrix(*np.radians(np.array(log.measured[name].attrs.get("turn_deg", np.zeros(3))))))


def _size(values: Array) -> float:
    return float(np.median(np.linalg.norm(values, axis=1)))


def _units(log: FlightLog) -> Iterator[str]:
    """Yield a gyro in degrees, and an accelerometer in g."""
    if "gyro" in log.measured:
        time, values = _stamped(log.measured["mocap_quaternion"])
        rotation = _rotations_of(values)
        n = max(1, round(0.1 * (len(time) - 1) / (time[-1] - time[0])))
        seen = np.array([np.linalg.norm(pin.log3(a.T @ b)) for a, b in zip(rotation[:-n], rotation[n:], strict=True)])
        turned = _gyro_turns(log, time)
        felt = np.linalg.norm(turned[n:] - turned[:-n], axis=1)
        ratio = float(np.sqrt(np.mean(np.minimum(felt, 1e6) ** 2)) / max(np.sqrt(np.mean(seen**2)), 1e-9))
        if ratio > 20.0:
            yield f"gyro against attitude: its rates are {ratio:.3g} times the attitude's: rad/s were expected"
    if "accelerometer" in log.measured:
        _, felt = _stamped(log.measured["accelerometer"])
        mean = float(np.linalg.norm(np.mean(felt, axis=0)))
        if 0.5 < mean < 2.0 and _size(felt) < 3.0:
            yield f"accelerometer against gravity: its mean is {mean:.2f}: m/s2 were expected, not g"
