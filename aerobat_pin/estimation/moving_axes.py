"""A base without a measured velocity has one but for a constant (`base.from = "imu"`), which no force depends on.

The constant is chosen anew every `records.ZEROED` seconds, so that a bias of the accelerometer does not make the
velocity grow: with it grows what noise of the gyro makes of it. Where it is chosen anew, the momentum jumps by
M (v' - v). Given to the observers as one more known generalised force over the interval that ends there, the jump is
no force that they find, and filters need not start again.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin

from aerobat_pin.estimation.inputs import KnownInputs
from aerobat_pin.numerics import Array
from aerobat_pin.records import Record, imu_arm, rotation_matrices

CHANGE_OF_AXES = "change of axes"  # name of the known force


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
    u = np.einsum("nij,nj->ni", R, v[:, :3] + np.cross(v[:, 3:6], imu_arm(record.map)))
    begins = [record.zeroed_at(first + k) for k in range(len(v))]
    since = u[np.maximum(np.array(begins) - first, 0)] * (np.array(begins) >= first)[:, None]
    v[:, :3] -= np.einsum("nji,nj->ni", R, since)
    for k in range(1, len(v)):
        if begins[k] == first + k:
            before = v[k].copy()
            before[:3] += R[k].T @ (u[k] - since[k - 1])
            force[k - 1] = change_of_axes(model, data, inputs.q[k], before, v[k], inputs.time[k] - inputs.time[k - 1])
    return replace(inputs, v=v, known={**inputs.known, CHANGE_OF_AXES: force})
