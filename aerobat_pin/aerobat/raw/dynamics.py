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

import numpy as np
import pinocchio as pin

from aerobat_pin.aerobat.raw.air import AirForces
from aerobat_pin.aerobat.raw.dynamics_kernels import LinearDynamics, Middle, linearise, wing_angles
from aerobat_pin.aerobat.raw.layout import Layout
from aerobat_pin.aerobat.raw.nominal_motion import NominalMotion
from aerobat_pin.numerics import Array
from aerobat_pin.robot import BASE_SIZE, Aerobat


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
        data: of the robot's model; changes.
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
    model, world = robot.model, pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
    ids = [model.getFrameId(frame) for frame in frames]
    shapes = (3, 3), (nv,), (nv, nv), (nv, nv), (nv, nv), (3 * len(ids), nv), (6, 6), (6, 6), (6,)
    middle = Middle(*(np.empty((m, *shape)) for shape in shapes))
    for k in range(m):
        before = pin.SE3(nominal.rotation[k], nominal.position[k])
        after = pin.SE3(nominal.rotation[k + 1], nominal.position[k + 1])
        step = before.actInv(after)
        halfway = before * pin.exp6(0.5 * pin.log6(step))
        moved = pin.exp6(dt[k] * twist[k])
        middle.defect[k] = pin.log6(step.actInv(moved))
        middle.ad_half[k] = pin.exp6(half[k] * nominal.twist[k]).toActionMatrixInverse()
        middle.ad[k] = moved.toActionMatrixInverse()
        middle.rotation[k] = halfway.rotation
        q[k, :7] = pin.SE3ToXYZQUAT(halfway)
        middle.Dq[k], middle.Dv[k], middle.M[k] = pin.computeRNEADerivatives(model, data, q[k], v[k], a[k])
        middle.ID[k] = data.tau
        for i, frame in enumerate(ids):
            pin.updateFramePlacement(model, data, frame)  # the joints' Jacobian is that of the derivatives
            middle.J[k, 3 * i : 3 * i + 3] = pin.getFrameJacobian(model, data, frame, world)[:3]
    up, moving = np.einsum("kji,j->ki", middle.rotation, model.gravity.linear), layout.moving
    rows, torque = (m, BASE_SIZE, n), (m, len(at_v), n)
    linear = LinearDynamics(
        transition=np.zeros((m, moving, n)),
        shift=np.empty((m, moving)),
        acceleration=np.empty(rows),
        push=np.empty(rows[:2]),
        pose=np.zeros(rows),
        twist=np.zeros(rows),
        kick=np.empty(rows[:2]),
        torque=np.empty(torque),
        torque_at=np.empty(torque[:2]),
        slope=joints[:, 1],
        middle_twist=twist,
        middle_acceleration=rate,
        up=up,
    )
    middle.M[:] += air.added_mass
    linearise(
        layout.places, np.array(at_v, dtype=np.intp), layout.by_mode, dt, nominal.crank, joints, middle,
        middle.ID - air.force - known, air.force, air.by_twist, force.reshape(m, -1), linear,
    )  # fmt: skip
    return linear


def cross_matrices(vectors: Array) -> Array:
    """Return the matrices (k, 3, 3) of the cross products with vectors (k, 3)."""
    matrices = np.zeros((len(vectors), 3, 3))
    x, y, z = vectors.T
    matrices[:, 0, 1], matrices[:, 0, 2], matrices[:, 1, 2] = -z, y, -x
    matrices[:, 1, 0], matrices[:, 2, 0], matrices[:, 2, 1] = z, -y, x
    return matrices
