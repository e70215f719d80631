"""The robot's dynamics about a nominal motion, linear in the errors of that motion.

At the middle of each interval, with ID = M a + C v + g (Pinocchio's recursive Newton-Euler algorithm), u the air and
the known forces, and J the Jacobians of the points at which the forces f act:

    base rows      0   = r_b + M_bb da + Z_b x        r = ID - u,   Z x: change of ID - u - J^T f with the state x
    joint rows     tau = r_j + M_jb da + Z_j x

The first gives the change da = c + A x of the body's acceleration, the second the motor's torque. The added mass of the
air is part of M: as a force that is known before the acceleration it would diverge on a light robot. The air's change
with the body's twist, DA, comes from flights along shifted motions (`air`).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pinocchio as pin

from aerobat_pin.aerobat.aerobat import Aerobat
from aerobat_pin.aerobat.prescribed_joints import BASE_SIZE
from aerobat_pin.aerobat.raw.air import AirForces
from aerobat_pin.aerobat.raw.layout import CRANK_ERROR, POSE_ERROR, TWIST_ERROR, Layout
from aerobat_pin.aerobat.raw.nominal_motion import WING_JOINTS, NominalMotion, wing_angles, wing_motion
from aerobat_pin.numerics import Array

BODY_ROWS = slice(0, BASE_SIZE)


class LinearDynamics(NamedTuple):
    """The linear model of m intervals with n states; x is the state at the start of the interval.

    Attributes:
        transition: (m, moving, n) rows of the transition of the first states, see `Layout.moving`.
        shift: (m, moving) their shift.
        acceleration: (m, 6, n) rows of the change of the body's acceleration; `push` (m, 6) its constant part.
        torque: (m, 4, n) rows of the joint torques; `torque_at` (m, 4) the torques at x = 0.
        slope: (m, 4) derivative of the joint angles by crank angle, at the middle.
        half: (m, 1, 1) from the start to the middle [s]; `ad_half` (m, 6, 6) takes a pose error there.
        middle_twist, middle_acceleration: (m, 6) of the nominal motion; `up` (m, 3) is R^T g.
    """

    transition: Array
    shift: Array
    acceleration: Array
    push: Array
    torque: Array
    torque_at: Array
    slope: Array
    half: Array
    ad_half: Array
    middle_twist: Array
    middle_acceleration: Array
    up: Array


def linear_dynamics(
    robot: Aerobat,
    series: Array,
    frames: tuple[str, ...],
    layout: Layout,
    nominal: NominalMotion,
    air: AirForces,
    known: Array,
    force: Array,
    data: pin.Data,
) -> LinearDynamics:
    """Linearise the dynamics about a nominal motion, with the air along it and other `known` forces (m, nv).

    The forces of the last iteration, `force` (m, points, 3) in world axes [N] at the frames, turn with the Jacobians.
    """
    # The motion at the middles.
    dt = nominal.time[1:] - nominal.time[:-1]
    m, n, model = len(dt), layout.size, robot.model
    full, half = dt[:, None, None], 0.5 * dt[:, None, None]
    twist, rate = 0.5 * (nominal.twist[1:] + nominal.twist[:-1]), (nominal.twist[1:] - nominal.twist[:-1]) / dt[:, None]
    to_middle, to_end, start = _crank_after(0.5 * dt), _crank_after(dt), nominal.crank[:-1, :, None]
    crank = to_middle @ start
    wings = wing_angles(series, crank[:, 0, 0])
    q, v, a = np.empty((m, model.nq)), np.empty((m, model.nv)), np.empty((m, model.nv))
    v[:, BODY_ROWS], a[:, BODY_ROWS] = twist, rate
    q[:, WING_JOINTS], v[:, WING_JOINTS], a[:, WING_JOINTS] = wing_motion(wings, crank[:, 1], crank[:, 2])
    # What Pinocchio says there: ID and its derivatives, M, and the Jacobians of the points.
    ids, world = [model.getFrameId(frame) for frame in frames], pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
    rotation, ID, J = np.empty((m, 3, 3)), np.empty((m, model.nv)), np.empty((m, 3 * len(ids), model.nv))
    Dq, Dv, M = (np.empty((m, model.nv, model.nv)) for _ in range(3))
    ad_half, ad, defect = np.empty((m, 6, 6)), np.empty((m, 6, 6)), np.empty((m, 6))
    after = nominal.body(0)
    for k in range(m):
        before, after = after, nominal.body(k + 1)
        step, moved = before.actInv(after), pin.exp6(dt[k] * twist[k])
        halfway = before * pin.exp6(0.5 * pin.log6(step))
        defect[k] = pin.log6(step.actInv(moved))  # by how much the motion's pose misses what its twist gives
        ad_half[k] = pin.exp6(0.5 * dt[k] * nominal.twist[k]).toActionMatrixInverse()
        ad[k], rotation[k], q[k, :7] = moved.toActionMatrixInverse(), halfway.rotation, pin.SE3ToXYZQUAT(halfway)
        Dq[k], Dv[k], M[k] = pin.computeRNEADerivatives(model, data, q[k], v[k], a[k])
        ID[k] = data.tau
        for i, frame in enumerate(ids):
            pin.updateFramePlacement(model, data, frame)  # the joints' Jacobian is that of the derivatives
            J[k, 3 * i : 3 * i + 3] = pin.getFrameJacobian(model, data, frame, world)[:3]
    M += air.added_mass

    # The rows by the state at the start, and what they say of the acceleration and the torques.
    Z, Jt = np.zeros((m, model.nv, n)), J.transpose(0, 2, 1)
    Zq, Zv = Dq[:, :, BODY_ROWS], Dv[:, :, BODY_ROWS] - air.by_twist
    Zq[:, :, 3:] -= Jt @ (cross_matrices(force.reshape(-1, 3)).reshape(m, -1, 3) @ rotation)
    Z[:, :, POSE_ERROR], Z[:, :, TWIST_ERROR] = Zq @ ad_half, half * Zq + Zv
    by_wings = np.concatenate([Dq[:, :, WING_JOINTS], Dv[:, :, WING_JOINTS], M[:, :, WING_JOINTS]], axis=2)
    Z[:, :, CRANK_ERROR] = by_wings @ wings_by_crank(wings, crank[:, 1], crank[:, 2]) @ to_middle
    Z[:, :, layout.walk], Z[:, :, layout.white] = -Jt @ layout.by_mode, -Jt
    Z[:, :, layout.mass_at], Z[:, :, layout.air_at] = ID[:, :, None], -air.force[:, :, None]
    r, through = ID - air.force - known, M[:, :, BODY_ROWS] + half * Zv
    solved = np.linalg.solve(-through[:, BODY_ROWS], np.concatenate([Z[:, BODY_ROWS], r[:, BODY_ROWS, None]], axis=2))
    A, push = solved[:, :, :n], solved[:, :, n]
    torque = through[:, WING_JOINTS] @ solved

    # The transition of the states.
    F, shift = np.zeros((m, layout.moving, n)), np.zeros((m, layout.moving))
    F[:] = np.eye(layout.moving, n)
    F[:, TWIST_ERROR] += full * A
    F[:, POSE_ERROR] = 0.5 * full**2 * A
    F[:, POSE_ERROR, POSE_ERROR] += ad
    F[:, POSE_ERROR, TWIST_ERROR] += full * np.eye(6)
    F[:, CRANK_ERROR, CRANK_ERROR] = to_end
    F[:, layout.walk, layout.slope] = full * np.eye(len(layout.by_mode))
    shift[:, POSE_ERROR], shift[:, TWIST_ERROR] = defect + 0.5 * full[:, 0] ** 2 * push, full[:, 0] * push
    shift[:, CRANK_ERROR] = (to_end @ start)[:, :, 0] - nominal.crank[1:]
    return LinearDynamics(
        transition=F,
        shift=shift,
        acceleration=A,
        push=push,
        torque=Z[:, WING_JOINTS] + torque[:, :, :n],
        torque_at=r[:, WING_JOINTS] + torque[:, :, n],
        slope=wings[:, 1],
        half=half,
        ad_half=ad_half,
        middle_twist=twist,
        middle_acceleration=rate,
        up=model.gravity.linear @ rotation,
    )


def _crank_after(time: Array) -> Array:
    """Return the matrices (m, 3, 3) that take angle, rate and acceleration of the crank on by times (m,) [s]."""
    after = np.zeros((len(time), 3, 3))
    after[:, 0, 0] = after[:, 1, 1] = after[:, 2, 2] = 1.0
    after[:, 0, 1] = after[:, 1, 2] = time
    after[:, 0, 2] = 0.5 * time**2
    return after


def wings_by_crank(wings: Array, rate: Array, bend: Array) -> Array:
    """Return the derivatives (m, 12, 3) of the joints' angles, rates and accelerations by those of the crank.

    `wings` are of `wing_angles`; rate [rad/s] and acceleration `bend` [rad/s2] (m, 1) are those of the crank.
    """
    by_crank = np.zeros((len(wings), 3, 4, 3))
    _, first, second, third = wings.transpose(1, 0, 2)
    by_crank[:, 0, :, 0] = by_crank[:, 1, :, 1] = by_crank[:, 2, :, 2] = first
    by_crank[:, 1, :, 0], by_crank[:, 2, :, 1] = second * rate, 2.0 * second * rate
    by_crank[:, 2, :, 0] = third * rate**2 + second * bend
    return by_crank.reshape(len(wings), 12, 3)


def cross_matrices(vectors: Array) -> Array:
    """Return the matrices (k, 3, 3) of the cross products with vectors (k, 3)."""
    matrices = np.zeros((len(vectors), 3, 3))
    x, y, z = vectors.T
    matrices[:, 0, 1], matrices[:, 0, 2], matrices[:, 1, 2] = -z, y, -x
    matrices[:, 1, 0], matrices[:, 2, 0], matrices[:, 2, 1] = z, -y, x
    return matrices
