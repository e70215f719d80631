"""What an observer is given of a stretch of a record: configuration, velocity, joint torques and known forces.

A base without a measured velocity has one but for a constant (`base.from = "imu"`), which no force depends on.
The constant is chosen anew every `records.ZEROED` seconds, so that a bias of the accelerometer does not make the
velocity grow: with it grows what noise of the gyro makes of it. Where it is chosen anew, the momentum jumps by
M (v' - v). Given to the observers as one more known generalised force over the interval that ends there, the jump is
no force that they find, and filters need not start again.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
import pinocchio as pin

from aerobat_pin.errors import CalibrationError
from aerobat_pin.forces.calibration_use import CalibrationUse
from aerobat_pin.forces.known_forces import CALIBRATION, KnownForces
from aerobat_pin.numerics import Array
from aerobat_pin.observers import Rows, rotation_matrices
from aerobat_pin.records import Block, Condition, Record

CHANGE_OF_AXES = "change of axes"  # name of the known force


@dataclass(frozen=True, repr=False)
class KnownInputs:
    """The inputs of an observer.

    Attributes:
        time: (m + 1,) times of the samples [s].
        q: (m + 1, nq) configurations.
        v: (m + 1, nv) velocities.
        tau: (m, nv) known joint torques, interval means.
        known: name -> (m, nv) other known generalised forces, interval means.
        rows: rows of the equations of motion that the observer can use.
        source: input -> where it comes from: `measured`, `reconstructed` or `believed`, and the kind of torque that is
            known for `motor_torque`.
        calibration: how a calibration was used, if there is one.
        crank: (m + 1,) crank angle [rad], if it was estimated together with the motion; else None.
        condition: phase and state of the intervals, where a calibration needs them; else None.
    """

    time: Array
    q: Array
    v: Array
    tau: Array
    known: Mapping[str, Array]
    rows: Rows
    source: Mapping[str, str]
    calibration: CalibrationUse | None = None
    crank: Array | None = None
    condition: Condition | None = None

    def between(self, first: int, last: int) -> KnownInputs:
        """Return the inputs from one index of the samples to another, inclusive."""
        if (first, last) == (0, len(self.tau)):
            return self
        samples, intervals = slice(first, last + 1), slice(first, last)
        known = {name: force[intervals] for name, force in self.known.items()}
        return replace(
            self,
            time=self.time[samples],
            q=self.q[samples],
            v=self.v[samples],
            tau=self.tau[intervals],
            known=known,
            crank=None if self.crank is None else self.crank[samples],
            condition=None if self.condition is None else self.condition.part(intervals),
        )

    def __repr__(self) -> str:
        sources = ", ".join(f"{name} {source}" for name, source in self.source.items())
        span = f"{self.time[0]:.4g} to {self.time[-1]:.4g} s"
        return f"KnownInputs of {len(self.tau)} intervals, {span}; rows {self.rows}\n  {sources}"


def inputs_of(record: Record, first: int, last: int, forces: KnownForces, rows: Rows) -> KnownInputs:
    """Return the inputs of an observer from index `first` to `last` inclusive of a record.

    Raises:
        LogError, LinkageError: the robot cannot complete this stretch, or its known forces cannot be computed there.
        CalibrationError: a calibration needs a phase that this stretch does not show.
    """
    return inputs_of_block(record, record.block(first, last), forces, rows)


def inputs_of_block(record: Record, block: Block, forces: KnownForces, rows: Rows) -> KnownInputs:
    """Return the inputs of an observer in a completed block of a record; errors as of `inputs_of`."""
    known = forces.known(block)
    tau = forces.torque(replace(block, tau=record.robot.torque(block, known)))
    condition = None
    if forces.series is not None:
        condition = record.robot.condition(block)
        if condition is None:
            raise CalibrationError(f"{record.title}: the calibration follows a phase, and this robot has none")
        known[CALIBRATION] = forces.series.force(condition, known)
    source = {**block.source, **{name: block.source.get(name, "reconstructed") for name in known}, **forces.sources}
    return KnownInputs(block.time, block.q, block.v, tau, known, rows, source, condition=condition)


def change_of_axes(model: pin.Model, data: pin.Data, q: Array, before: Array, after: Array, dt: float) -> Array:
    """Return the generalised force (nv,) over an interval that ends with velocity `after` in place of `before`.

    With phi = (p1 - p0) / dt - (d0 + d1) / 2 - u and d = C^T v - g, it is u = (p1' - p1) / dt - (d1' - d1) / 2.

    Args:
        model: the robot.
        data: written.
        q: (nq,) configuration at the end of the interval.
        before: (nv,) its velocity in the old axes.
        after: (nv,) its velocity in the new ones.
        dt: length of the interval [s].
    """
    M = pin.crba(model, data, q)
    drifts = [pin.computeCoriolisMatrix(model, data, q, v).T @ v for v in (before, after)]
    return np.asarray(M @ (after - before) / dt - 0.5 * (drifts[1] - drifts[0]))


def with_zeroed_velocity(record: Record, inputs: KnownInputs, first: int) -> KnownInputs:
    """Return inputs, which begin at a common time `first`, whose velocity from an IMU begins at zero again and again.

    The inputs of all other records are returned as they are.
    """
    if record.map.base.from_ != "imu" or record.map.base.held or not record.robot.free:
        return inputs
    model, v, force = record.robot.model, inputs.v.copy(), np.zeros_like(inputs.tau)
    data = model.createData()
    R = rotation_matrices(inputs.q[:, 3:7])
    u = np.einsum("nij,nj->ni", R, v[:, :3] + np.cross(v[:, 3:6], record.map.base.imu.place))
    begins = [record.zeroed_at(first + k) for k in range(len(v))]
    since = u[np.maximum(np.array(begins) - first, 0)] * (np.array(begins) >= first)[:, None]
    v[:, :3] -= np.einsum("nji,nj->ni", R, since)
    for k in range(1, len(v)):
        if begins[k] == first + k:
            before = v[k].copy()
            before[:3] += R[k].T @ (u[k] - since[k - 1])
            force[k - 1] = change_of_axes(model, data, inputs.q[k], before, v[k], inputs.time[k] - inputs.time[k - 1])
    return replace(inputs, v=v, known={**inputs.known, CHANGE_OF_AXES: force})
