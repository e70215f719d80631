"""The motion about which the joint smoother linearises, and a first guess of it from splines and the gyro."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from aerobat_pin.aerobat.raw.channels import RawRecord, SensorSamples
from aerobat_pin.errors import LogError
from aerobat_pin.linkage import joints_along
from aerobat_pin.numerics import Array

POSITION_KNOTS = 0.030  # [s] between the knots of the splines of a first guess; longer if samples are rare
CRANK_KNOTS = 0.020
DRIFT_KNOTS = 0.10  # of the correction of the integrated gyro
ENDS = 0.10  # [s] at both ends of a channel, of which the slope goes on where it has no samples
WING_JOINTS = slice(-4, None)  # the joints in a configuration and in a velocity
CRANK_STEP = 1.0e-4  # [rad]: difference quotient for the third derivative of the linkage


class NominalMotion(NamedTuple):
    """A motion at the knots.

    Attributes:
        time: (m + 1,) [s].
        rotation: (m + 1, 3, 3) body to world.
        position: (m + 1, 3) of the body's COM in world axes [m].
        twist: (m + 1, 6) of the body, body axes [m/s, rad/s].
        crank: (m + 1, 3) angle, rate and acceleration of the crank.
    """

    time: Array
    rotation: Array
    position: Array
    twist: Array
    crank: Array

    def moved(self, errors: Array) -> NominalMotion:
        """Return the motion with errors (m + 1, 15) added: pose (in se(3), body axes), twist, crank."""
        rotation, position = np.empty_like(self.rotation), np.empty_like(self.position)
        for k, error in enumerate(errors[:, :6]):
            step = pin.exp6(error)
            rotation[k] = self.rotation[k] @ step.rotation
            position[k] = self.position[k] + self.rotation[k] @ step.translation
        twist, crank = self.twist + errors[:, 6:12], self.crank + errors[:, 12:15]
        return NominalMotion(self.time, rotation, position, twist, crank)

    def body(self, k: int) -> pin.SE3:
        """Return the placement of the body at a knot."""
        return pin.SE3(self.rotation[k], self.position[k])

    def part(self, start: int, stop: int) -> NominalMotion:
        """Return the knots `start` to `stop`, both included."""
        return NominalMotion(*(each[start : stop + 1] for each in self))

    def extended(self, dt: float, rate: Array) -> NominalMotion:
        """Return one knot and the next one, `dt` [s] later, under an acceleration of the twist `rate` (6,)."""
        twist = self.twist[0] + dt * rate
        step = pin.exp6(0.5 * dt * (self.twist[0] + twist))
        rotation = self.rotation[0] @ step.rotation
        position = self.position[0] + self.rotation[0] @ step.translation
        angle, turning, speeding = self.crank[0]
        crank = np.array([angle + dt * turning + 0.5 * dt**2 * speeding, turning + dt * speeding, speeding])
        ends = (self.time[0] + dt, rotation, position, twist, crank)
        return NominalMotion(*(np.array([each[0], end]) for each, end in zip(self, ends, strict=True)))

    @classmethod
    def joined(cls, parts: Sequence[NominalMotion]) -> NominalMotion:
        """Return motions one after the other as one."""
        return cls(*map(np.concatenate, zip(*parts, strict=True)))

    def middles(self) -> Array:
        """Return the times (m,) in the middle of the intervals [s]."""
        return 0.5 * (self.time[1:] + self.time[:-1])

    def placements(self) -> Array:
        """Return position and quaternion xyzw of the body (m + 1, 7), the quaternion without jumps of sign."""
        quaternion = np.array([pin.Quaternion(R).coeffs() for R in self.rotation])
        signs = np.cumprod(np.where(np.sum(quaternion[1:] * quaternion[:-1], axis=1) < 0.0, -1.0, 1.0))
        quaternion[1:] *= signs[:, None]
        return np.concatenate([self.position, quaternion], axis=1)


def wing_angles(series: Array, angles: Array) -> Array:
    """Return angle and first to third derivative by crank angle (m, 4, 4) of the four joints, left wing, right wing."""
    joints = np.empty((3, len(angles), 3, 2))
    joints_along(series, np.concatenate([angles, angles + CRANK_STEP, angles - CRANK_STEP]), joints.reshape(-1, 3, 2))
    third = (joints[1, :, 2:] - joints[2, :, 2:]) / (2.0 * CRANK_STEP)
    return np.concatenate([joints[0], third], axis=1)[:, :, [0, 1, 0, 1]]


def wing_motion(wings: Array, rate: Array, bend: Array | float) -> tuple[Array, Array, Array]:
    """Return angles, rates and accelerations (m, 4) of the joints under rate and acceleration (m, 1) of the crank."""
    angle, first, second, _ = wings.transpose(1, 0, 2)
    return angle, first * rate, first * bend + second * rate**2


def first_guess(record: RawRecord) -> NominalMotion:
    """Return a first guess: position and crank by splines, attitude by the gyro held to the poses. Raises LogError."""
    channels, time = record.channels, record.time
    position, orientation, crank = (channels[name] for name in ("position", "orientation", "crank"))
    for channel in (position, orientation, crank):
        if len(channel.time) < 8:
            raise LogError(f"flight log: {len(channel.time)} samples of {channel.name}: 8 or more were expected")
    marker = np.array([pin.Quaternion(q / np.linalg.norm(q)).matrix() for q in orientation.values])
    body = marker @ orientation.turn.T
    rotation = _attitude(time, orientation.time, body, channels.get("gyro"))
    seen = position.values - _slerped(position.time, orientation.time, body) @ position.place
    path = _spline(time, position.time, seen, POSITION_KNOTS)
    where, velocity = path(time), path.derivative()(time)
    steps = np.array([pin.log3(a.T @ b) for a, b in itertools.pairwise(rotation)]) / np.diff(time)[:, None]
    rate = np.concatenate([steps[:1], 0.5 * (steps[1:] + steps[:-1]), steps[-1:]])
    twist = np.concatenate([np.einsum("kji,kj->ki", rotation, velocity), rate], axis=1)
    angle = _spline(time, crank.time, np.unwrap(crank.values[:, 0]), CRANK_KNOTS)
    turned = np.column_stack([angle(time), angle.derivative()(time), angle.derivative(2)(time)])
    return NominalMotion(time, rotation, where, twist, turned)


def _spline(wanted: Array, time: Array, values: Array, step: float, degree: int = 5):  # type: ignore[no-untyped-def]
    """Return the least-squares spline with knots `step` apart, or three samples if these are rare.

    It follows straight lines across holes of the samples, and where none are at the ends of the `wanted` times.
    """
    from scipy.interpolate import make_lsq_spline

    span = time[-1] - time[0]
    step, period = max(step, 3.0 * span / (len(time) - 1)), span / (len(time) - 1)
    more = np.linspace(wanted[0], wanted[-1], int((wanted[-1] - wanted[0]) / period) + 2)
    after = np.clip(np.searchsorted(time, more), 1, len(time) - 1)
    near = np.minimum(np.abs(more - time[after - 1]), np.abs(more - time[after]))
    between = (more > time[0]) & (more < time[-1])
    more = more[near > np.where(between, step, 1.1 * period)]
    if len(more):
        lines = np.column_stack([_line(more, time, column) for column in values.reshape(len(time), -1).T])
        order = np.argsort(time := np.concatenate([time, more]))
        time, values = time[order], np.concatenate([values, lines.reshape(len(more), *values.shape[1:])])[order]
    span = time[-1] - time[0]
    inside = np.linspace(time[0], time[-1], max(int(span / step), 1) + 1)[1:-1]
    knots = np.concatenate([np.full(degree + 1, time[0]), inside, np.full(degree + 1, time[-1])])
    return make_lsq_spline(time, values, knots, k=degree)


def _line(at: Array, time: Array, series: Array) -> Array:
    """Return a series between its samples on straight lines, and beyond its ends along the slopes there."""
    line = np.interp(at, time, series)
    for beyond, end in ((at < time[0], time[0]), (at > time[-1], time[-1])):
        if np.any(beyond):
            near = np.abs(time - end) <= max(ENDS, abs(time[1] - time[0]), abs(time[-1] - time[-2]))
            line[beyond] = np.polyval(np.polyfit(time[near] - end, series[near], 1), at[beyond] - end)
    return line


def _attitude(time: Array, seen_at: Array, seen: Array, gyro: SensorSamples | None) -> Array:
    """Return rotations (m + 1, 3, 3): the integrated gyro, turned slowly to those seen (n, 3, 3) by motion capture."""
    if gyro is None:
        return _slerped(time, seen_at, seen)
    rates = gyro.values @ gyro.turn.T
    middle = 0.5 * (time[1:] + time[:-1])
    steps = np.column_stack([np.interp(middle, gyro.time, rates[:, i]) for i in range(3)]) * np.diff(time)[:, None]
    turned = np.empty((len(time), 3, 3))
    turned[0] = np.eye(3)
    for k, step in enumerate(steps):
        turned[k + 1] = turned[k] @ pin.exp3(step)
    attitude = _slerped(seen_at, time, turned)
    offsets = np.array([a @ b.T for a, b in zip(seen, attitude, strict=True)])  # world axes
    before = offsets[0]
    logs = np.array([pin.log3(before.T @ offset) for offset in offsets])
    for k in range(1, len(logs)):  # without jumps by whole turns
        size = np.linalg.norm(logs[k])
        if size > 0.0 and np.linalg.norm(logs[k] - logs[k - 1]) > np.pi:
            logs[k] *= 1.0 - 2.0 * np.pi / size
    drift = _spline(time, seen_at, logs, DRIFT_KNOTS, degree=1)(time)
    return np.array([before @ pin.exp3(turn) @ R for turn, R in zip(drift, turned, strict=True)])


def _slerped(time: Array, at: Array, rotation: Array) -> Array:
    """Interpolate rotations (n, 3, 3) given at times `at` (n,) at `time` (m,), each interval at a constant rate."""
    from scipy.spatial.transform import Rotation, Slerp  # slow to import

    return np.asarray(Slerp(at, Rotation.from_matrix(rotation))(np.clip(time, at[0], at[-1])).as_matrix())
