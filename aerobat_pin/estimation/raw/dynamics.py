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

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from aerobat_pin.estimation.raw.air import AirForces
from aerobat_pin.estimation.raw.layout import CRANK_ERROR, POSE_ERROR, TWIST_ERROR, Layout
from aerobat_pin.estimation.raw.nominal import NominalMotion
from aerobat_pin.numerics import Array
from aerobat_pin.robot import BASE_SIZE, Aerobat

CRANK_STEP = 1.0e-4  # [rad]: difference quotient for the third derivative of the linkage


@dataclass(frozen=True)
class LinearDynamics:
    """The linear model of m intervals with n states; x is the state at the start of the interval.

    Attributes:
        transition: (m, moving, n) rows of the transition of the first states, see `Layout.moving`.
        shift: (m, moving) their shift.
        acceleration: (m, 6, n) rows of the change of the body's acceleration; `push` (m, 6) its constant part.
        pose, twist: (m, 6, n) rows of pose and twist error at the middle; `kick` (m, 6) the constant part of the twist.
        torque: (m, 4, n) rows of the joint torques; `torque_at` (m, 4) the torques at x = 0.
        slope: (m, 4) derivative of the joint angles by crank angle, at the middle.
        middle_twist, middle_acceleration: (m, 6) of the nominal motion; `up` (m, 3) is R^T g.
    """

    transition: Array
    shift: Array
    acceleration: Array
    push: Array
    pose: Array
    twist: Array
    kick: Array
    torque: Array
    torque_at: Array
    slope: Array
    middle_twist: Array
    middle_acceleration: Array
    up: Array


def linear_dynamics(
    robot: Aerobat,
    frames: tuple[str, ...],
    layout: Layout,
    nominal: NominalMotion,
    air: AirForces,
    known: Array,
    force: Array,
    data: pin.Data | None = None,
) -> LinearDynamics:
    """Linearise the dynamics about a nominal motion.

    Args:
        robot: the believed robot.
        frames: frames at whose origins the forces act.
        layout: places of the states.
        nominal: the motion.
        air: the air along it.
        known: (m, nv) other known generalised forces.
        force: (m, points, 3) forces of the last iteration, world axes [N]; they turn with the Jacobians.
        data: of the robot's model, changes; made anew when omitted.
    """
    dt = np.diff(nominal.time)
    m, n, nv = len(dt), layout.size, robot.model.nv
    at_v = list(robot.idx_v)
    half = 0.5 * dt
    twist = 0.5 * (nominal.twist[1:] + nominal.twist[:-1])
    rate = np.diff(nominal.twist, axis=0) / dt[:, None]
    angle, turning, speeding = nominal.crank[:-1].T
    crank = np.stack([angle + half * turning + 0.5 * half**2 * speeding, turning + half * speeding, speeding])
    closure = robot.linkage.solve(*crank)
    near = robot.linkage.solve(crank[0] + np.array([[CRANK_STEP], [-CRANK_STEP]]))

    def both(shoulder: Array, elbow: Array) -> Array:
        return np.stack([shoulder, elbow, shoulder, elbow], axis=-1)

    d1, d2 = both(closure.dtheta_s, closure.dtheta_e), both(closure.d2theta_s, closure.d2theta_e)
    d3 = -both(*(np.diff(one, axis=0)[0] for one in (near.d2theta_s, near.d2theta_e))) / (2.0 * CRANK_STEP)
    v = robot.velocity(twist, closure.theta_s_dot, closure.theta_e_dot)
    a = robot.velocity(rate, closure.theta_s_ddot, closure.theta_e_ddot)
    rotation = np.empty((m, 3, 3))
    ID, Dq, Dv, M = np.empty((m, nv)), np.empty((m, nv, nv)), np.empty((m, nv, nv)), np.empty((m, nv, nv))
    J = np.empty((m, 3 * len(frames), nv))
    defect, ad_half, ad = np.empty((m, 6)), np.empty((m, 6, 6)), np.empty((m, 6, 6))
    model = robot.model
    data = model.createData() if data is None else data
    ids = [model.getFrameId(frame) for frame in frames]
    placement = np.zeros((m, 7))
    for k in range(m):
        here = pin.SE3(nominal.rotation[k], nominal.position[k])
        there = pin.SE3(nominal.rotation[k + 1], nominal.position[k + 1])
        step = here.actInv(there)
        halfway = here * pin.exp6(0.5 * pin.log6(step))
        moved = pin.exp6(dt[k] * twist[k])
        defect[k] = pin.log6(step.actInv(moved))
        ad_half[k] = pin.exp6(half[k] * nominal.twist[k]).toActionMatrixInverse()
        ad[k] = moved.toActionMatrixInverse()
        rotation[k] = halfway.rotation
        placement[k] = pin.SE3ToXYZQUAT(halfway)
    q = robot.configuration(placement, closure.theta_s, closure.theta_e)
    for k in range(m):
        Dq[k], Dv[k], M[k] = pin.computeRNEADerivatives(model, data, q[k], v[k], a[k])
        ID[k] = data.tau
        for i, frame in enumerate(ids):
            J[k, 3 * i : 3 * i + 3] = pin.computeFrameJacobian(
                model, data, q[k], frame, pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
            )[:3]
    M_rigid_a = ID
    M = M + air.added_mass
    r = ID - air.force - known
    Dv[:, :, :BASE_SIZE] -= air.by_twist

    Z = np.zeros((m, nv, n))  # all but the pose and the twist of the middle
    Zq, Zv = Dq[:, :, :BASE_SIZE].copy(), Dv[:, :, :BASE_SIZE]
    for i in range(len(frames)):
        Jt = np.swapaxes(J[:, 3 * i : 3 * i + 3], 1, 2)
        Z[:, :, layout.white][:, :, 3 * i : 3 * i + 3] = -Jt
        in_body = np.einsum("kji,kj->ki", rotation, force[:, i])
        Zq[:, :, 3:] -= Jt @ rotation @ cross_matrices(in_body)
    Z[:, :, layout.walk] = Z[:, :, layout.white] @ layout.by_mode
    phi_rate, phi_bend = crank[1][:, None, None], crank[2][:, None, None]
    Dqj, Dvj, Mj = Dq[:, :, at_v], Dv[:, :, at_v], M[:, :, at_v]
    d1c, d2c, d3c = d1[:, :, None], d2[:, :, None], d3[:, :, None]
    by_angle = Dqj @ d1c + Dvj @ (d2c * phi_rate) + Mj @ (d3c * phi_rate**2 + d2c * phi_bend)
    by_rate = Dvj @ d1c + Mj @ (2.0 * d2c * phi_rate)
    by_bend = Mj @ d1c
    h1 = half[:, None]
    Z[:, :, 12] = by_angle[:, :, 0]
    Z[:, :, 13] = by_angle[:, :, 0] * h1 + by_rate[:, :, 0]
    Z[:, :, 14] = by_angle[:, :, 0] * 0.5 * h1**2 + by_rate[:, :, 0] * h1 + by_bend[:, :, 0]
    if layout.mass_at is not None:
        Z[:, :, layout.mass_at] = M_rigid_a
    if layout.air_at is not None:
        Z[:, :, layout.air_at] = -air.force

    base = slice(0, BASE_SIZE)
    pose, turned = np.zeros((m, 6, n)), np.zeros((m, 6, n))
    pose[:, :, POSE_ERROR] = ad_half
    pose[:, :, TWIST_ERROR] = half[:, None, None] * np.eye(6)
    turned[:, :, TWIST_ERROR] = np.eye(6)
    Z += Zq @ pose + Zv @ turned
    G = M[:, base, base] + half[:, None, None] * Zv[:, base]
    found = -np.linalg.solve(G, np.concatenate([r[:, base, None], Z[:, base]], axis=2))
    push, A = found[:, :, 0], found[:, :, 1:]
    turned = turned + half[:, None, None] * A
    kick = half[:, None] * push

    through = M[:, at_v, :BASE_SIZE] + half[:, None, None] * Zv[:, at_v]
    torque = Z[:, at_v] + through @ A
    torque_at = r[:, at_v] + np.einsum("kij,kj->ki", through, push)

    F, shift = np.zeros((m, layout.moving, n)), np.zeros((m, layout.moving))
    F[:, POSE_ERROR, POSE_ERROR] = ad
    F[:, POSE_ERROR, TWIST_ERROR] = dt[:, None, None] * np.eye(6)
    F[:, POSE_ERROR] += (0.5 * dt**2)[:, None, None] * A
    shift[:, POSE_ERROR] = defect + (0.5 * dt**2)[:, None] * push
    F[:, TWIST_ERROR, TWIST_ERROR] = np.eye(6)
    F[:, TWIST_ERROR] += dt[:, None, None] * A
    shift[:, TWIST_ERROR] = dt[:, None] * push
    turn = np.zeros((m, 3, 3))
    turn[:] = np.eye(3)
    turn[:, 0, 1] = turn[:, 1, 2] = dt
    turn[:, 0, 2] = 0.5 * dt**2
    F[:, CRANK_ERROR, CRANK_ERROR] = turn
    shift[:, CRANK_ERROR] = np.einsum("kij,kj->ki", turn, nominal.crank[:-1]) - nominal.crank[1:]
    F[:, layout.walk, layout.walk] = np.eye(3 * layout.points)
    F[:, layout.walk, layout.slope] = dt[:, None, None] * np.eye(3 * layout.points)
    up = np.einsum("kji,j->ki", rotation, model.gravity.linear)
    return LinearDynamics(F, shift, A, push, pose, turned, kick, torque, torque_at, d1, twist, rate, up)


def cross_matrices(vectors: Array) -> Array:
    """Return the matrices (k, 3, 3) of the cross products with vectors (k, 3)."""
    made = np.zeros((len(vectors), 3, 3))
    x, y, z = vectors.T
    made[:, 0, 1], made[:, 0, 2], made[:, 1, 2] = -z, y, -x
    made[:, 1, 0], made[:, 2, 0], made[:, 2, 1] = z, -y, x
    return made
