"""What the motion needs, computed without an observer: for fits and checks."""

from __future__ import annotations

from collections.abc import Iterator
from math import comb, sqrt

import numpy as np
import pinocchio as pin

from aerobat_pin.errors import MapError
from aerobat_pin.forces.deviations import DIFFERENCE, sample_noise
from aerobat_pin.numerics import Array, frame_id, frame_jacobian
from aerobat_pin.records import Block, Record, slopes, typical_spacing, uneven_slopes, world_turn

ALL = slice(None)
JOINTS_APART = 0.01  # [s]: in sixth differences so far apart, 8 Hz are no noise
SMOOTHING = 0.03  # [s]: window of the parabolas whose slope is the acceleration
MEASURED_AS = (  # velocities of a free robot: the base's, its rate, the joints'
    ("base.velocity", "base.position"),
    ("base.rate", "base.quaternion"),
    ("joints.velocity", "joints.position"),
)


def accelerations(block: Block, record: Record) -> Array:
    """Return accelerations (m, nv) between the samples of a block: slopes of parabolas through the velocities."""
    if record.knots is None:
        a = slopes(block.v, record.dt, SMOOTHING)
    else:
        a = uneven_slopes(block.time, block.v, SMOOTHING)
    return np.asarray(0.5 * (a[1:] + a[:-1]))


def noise_of_rows(rows: Array, record: Record) -> Array:
    """Return `sample_noise` (nv,) of rows or velocities (m, nv) at common times."""
    noise = sample_noise(rows)
    for columns, step in _samples_apart(record):
        if step > 1:
            noise[columns] = np.maximum(noise[columns], sample_noise(rows[::step, columns]))
    return noise


def _samples_apart(record: Record) -> list[tuple[slice, int]]:
    """Return rows of a free base, and of its joints, and how many samples apart their noise is told.

    Where a free base is slower than these, what is interpolated hides its noise: samples are taken as far apart as its
    own, of joints, whose motion is fast and whose rows feel the base, by at most `JOINTS_APART`.
    """
    base = [record.channels.get(f"base.{part}") for part in ("velocity", "rate", "position", "quaternion")]
    spacing = max((typical_spacing(each.time) for each in base if each is not None), default=0.0)
    rows = ((slice(6), np.inf), (slice(6, None), JOINTS_APART)) if record.robot.free else ()
    return [(columns, max(1, round(min(spacing, most) * record.rate))) for columns, most in rows]


def slope_noise(v: Array, record: Record) -> Array:
    """Return the standard deviation (nv,) of a free robot's `accelerations` [m/s2, rad/s2] by velocities (m, nv).

    Slopes of places over a window hardly change from sample to sample, but over the window by the places' noise.
    """
    size = np.ones(v.shape[1])
    (_, base), (_, joints) = _samples_apart(record)
    for k, keys, apart, window in zip((0, 3, 6), MEASURED_AS, (base, base, joints), record.windows, strict=True):
        spacing = next((typical_spacing(record.channels[key].time) for key in keys if key in record.channels), 0.0)
        own = max(1, round(spacing * record.rate))
        reach = 7 * max(own, apart) + round((SMOOTHING + window) / record.dt)
        felt = np.maximum(1.0 - np.abs(np.arange(-reach, reach + 1.0)) / own, 0.0)[:, None]  # of one sample's noise
        felt = slopes(felt, record.dt, window) if window else felt
        a, seen = slopes(felt, record.dt, SMOOTHING), felt
        for _ in range(DIFFERENCE):
            seen = seen[apart:] - seen[:-apart]
        size[k:] = 0.5 * np.linalg.norm(a[1:] + a[:-1]) / np.linalg.norm(seen) * sqrt(comb(2 * DIFFERENCE, DIFFERENCE))
    return size * noise_of_rows(v, record)


def required_torque(record: Record, block: Block, acceleration: Array, at: slice = ALL) -> Array:
    """Return the generalised force (m, nv) that the motion needs: inertia, Coriolis and gravity (Pinocchio's rnea).

    Accelerations (intervals, nv) are those of the whole block, of which `at` are the m intervals that are wanted.
    """
    model = record.robot.model
    data, v = model.createData(), 0.5 * (block.v[1:] + block.v[:-1])
    motions = zip(halfway(record, block, at), v[at], acceleration[at], strict=True)
    torque = np.empty_like(block.tau[at])
    for k, motion in enumerate(motions):
        torque[k] = pin.rnea(model, data, *motion)
    return torque


def halfway(record: Record, block: Block, at: slice = ALL) -> Array:
    """Return the configurations (m, nq) in the middle of intervals of a block, of all when omitted."""
    before, after = block.q[:-1][at], block.q[1:][at]
    if not record.robot.free:
        return np.asarray(0.5 * (after + before))
    model = record.robot.model
    return np.array([pin.interpolate(model, *ends, 0.5) for ends in zip(before, after, strict=True)])


def sensor_force(record: Record, time: Array, attitude_of: Array | None = None) -> Array:
    """Return the force (m, 3 or 6) of `check.wrench` on the robot, interval means between times (m + 1,), tare off.

    `attitude_of` (m, 3, 3) are the axes of the sensor's frame in the world, if its columns are in the frame's axes.
    """
    section = record.map.check.wrench
    assert section is not None
    force = record.means("check.wrench", time)
    if section.tare is not None:
        force = force - mean_in(record, "check.wrench", section.tare)
    force = section.sign * force
    if section.axes == "world":
        force = turned(force, world_turn(record.map))
    if section.axes == "frame" and attitude_of is not None:
        parts = [np.einsum("nij,nj->ni", attitude_of, force[:, k : k + 3]) for k in range(0, force.shape[1], 3)]
        return np.concatenate(parts, axis=1)
    return np.asarray(force)


def mean_in(record: Record, key: str, part: tuple[float, float]) -> Array:
    """Return the mean (k,) of a channel from and to times after the start [s]. Raises MapError without samples."""
    _, values = record.channels[key].between(record.start + part[0], record.start + part[1])
    if not len(values):
        raise MapError(f"map: {key}: no sample from {part[0]:g} to {part[1]:g} s after the start")
    return np.asarray(values.mean(axis=0))


def turned(wrench: Array, turn: Array) -> Array:
    """Return forces (m, 3), or forces and moments (m, 6), in axes turned by a matrix (3, 3)."""
    return np.concatenate([wrench[:, k : k + 3] @ turn.T for k in range(0, wrench.shape[1], 3)], axis=1)


def frame_axes(record: Record, block: Block, frame: str) -> Array:
    """Return the axes (m, 3, 3) of a frame in the world in the middle of each interval."""
    model = record.robot.model
    data, index = model.createData(), frame_id(model, frame)
    axes = np.empty((len(block.tau), 3, 3))
    for k, q in enumerate(halfway(record, block)):
        pin.framesForwardKinematics(model, data, q)
        axes[k] = data.oMf[index].rotation
    return axes


def sensor_point(record: Record) -> str:
    """Return the frame of `check.wrench`. Raises MapError if it is not one of the points, or there is none."""
    section, robot = record.map.check.wrench, record.map.robot
    assert section is not None
    points = (*robot.points, *robot.wrenches)
    if not points:
        raise MapError(
            "map: check.wrench: a sensor is compared with the force at a point, of which robot.points = [] has none: "
            "leave one of the two out"
        )
    point = section.point or (points[0] if len(points) == 1 else None)
    if point is None or point not in points:
        raise MapError(f"map: check.wrench.point = {section.point}: one of {', '.join(points)} was expected")
    return point


def frame_jacobians(
    model: pin.Model, q: Array, frame: int, axes: pin.ReferenceFrame = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
) -> Iterator[Array]:
    """Yield the Jacobian (6, nv) of a frame's origin at each of some configurations (m, nq)."""
    data = model.createData()
    return (frame_jacobian(model, data, q_k, frame, axes) for q_k in q)


def contact_torque(record: Record, block: Block) -> Array:
    """Return the generalised force (m, nv) of the sensor's force at its point. Raises MapError without a sensor."""
    if "check.wrench" not in record.channels:
        raise MapError("map: joints.friction.to = check.wrench, but check.wrench has no columns")
    model, point = record.robot.model, sensor_point(record)
    section = record.map.check.wrench
    assert section is not None
    axes = frame_axes(record, block, point) if section.axes == "frame" else None
    force = sensor_force(record, block.time, axes)
    jacobians = frame_jacobians(model, halfway(record, block), frame_id(model, point))
    torque = [J[: force.shape[1]].T @ f for J, f in zip(jacobians, force, strict=True)]
    return np.array(torque).reshape(-1, model.nv)
