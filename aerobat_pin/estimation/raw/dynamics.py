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
from aerobat_pin.estimation.raw.dynamics_kernels import linearise, transitions, wing_angles
from aerobat_pin.estimation.raw.layout import CRANK_ERROR, Layout
from aerobat_pin.estimation.raw.nominal import NominalMotion
from aerobat_pin.numerics import Array
from aerobat_pin.robot import BASE_SIZE, Aerobat


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
    series: Array,
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
        series: of its linkage, see `joint_series`.
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
    joints = np.empty((m, 4, len(at_v)))
    wing_angles(series, crank[0], joints)
    q, v, a = np.empty((m, robot.model.nq)), np.empty((m, nv)), np.empty((m, nv))
    v[:, :BASE_SIZE], a[:, :BASE_SIZE] = twist, rate
    q[:, list(robot.idx_q)] = joints[:, 0]
    v[:, at_v] = joints[:, 1] * crank[1][:, None]
    a[:, at_v] = joints[:, 1] * crank[2][:, None] + joints[:, 2] * crank[1][:, None] ** 2
    rotation = np.empty((m, 3, 3))
    ID, Dq, Dv, M = np.empty((m, nv)), np.empty((m, nv, nv)), np.empty((m, nv, nv)), np.empty((m, nv, nv))
    J = np.empty((m, 3 * len(frames), nv))
    defect, ad_half, ad = np.empty((m, 6)), np.empty((m, 6, 6)), np.empty((m, 6, 6))
    model = robot.model
    data = model.createData() if data is None else data
    world = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
    ids = [model.getFrameId(frame) for frame in frames]
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
        q[k, :7] = pin.SE3ToXYZQUAT(halfway)
        Dq[k], Dv[k], M[k] = pin.computeRNEADerivatives(model, data, q[k], v[k], a[k])
        ID[k] = data.tau
        for i, frame in enumerate(ids):
            pin.updateFramePlacement(model, data, frame)  # the joints' Jacobian is that of the derivatives
            J[k, 3 * i : 3 * i + 3] = pin.getFrameJacobian(model, data, frame, world)[:3]
    at = [layout.walk.start, layout.white.start, layout.mass_at, layout.air_at, CRANK_ERROR.start]
    places = np.array([-1 if place is None else place for place in at], dtype=np.intp)
    shape = (m, BASE_SIZE, n)
    A, pose, turned = np.zeros(shape), np.zeros(shape), np.zeros(shape)
    push, kick = np.empty((m, BASE_SIZE)), np.empty((m, BASE_SIZE))
    torque, torque_at = np.empty((m, len(at_v), n)), np.empty((m, len(at_v)))
    linearise(
        places, np.array(at_v, dtype=np.intp), layout.by_mode, dt, np.ascontiguousarray(crank[1:].T), joints,
        ad_half, rotation,
        Dq, Dv, air.by_twist, M + air.added_mass, ID, ID - air.force - known, air.force, J, force.reshape(m, -1),
        pose, turned, kick, A, push, torque, torque_at,
    )  # fmt: skip

    F, shift = np.zeros((m, layout.moving, n)), np.empty((m, layout.moving))
    transitions(places, layout.moving, dt, nominal.crank, ad, defect, A, push, F, shift)
    up = np.einsum("kji,j->ki", rotation, model.gravity.linear)
    return LinearDynamics(F, shift, A, push, pose, turned, kick, torque, torque_at, joints[:, 1], twist, rate, up)


def cross_matrices(vectors: Array) -> Array:
    """Return the matrices (k, 3, 3) of the cross products with vectors (k, 3)."""
    made = np.zeros((len(vectors), 3, 3))
    x, y, z = vectors.T
    made[:, 0, 1], made[:, 0, 2], made[:, 1, 2] = -z, y, -x
    made[:, 1, 0], made[:, 2, 0], made[:, 2, 1] = z, -y, x
    return made
