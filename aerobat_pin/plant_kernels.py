"""The equations of motion as one compiled call after Pinocchio's M and nle; `plant` says what they are."""

from __future__ import annotations

import numpy as np

from aerobat_pin.aerodynamics.robot_air import AirArrays, air_loads
from aerobat_pin.arrays import Array
from aerobat_pin.hold import hold_wrench
from aerobat_pin.integrators import next_stage
from aerobat_pin.jit import Integers, copy_values, kernel, solve_positive
from aerobat_pin.plant_layout import Constants, Tree, Unknown, Work, unpack, unpack_work


@kernel
def climb(tree: Tree, liMi: Array, wrenches: Array, force: Array) -> None:
    """Carry link wrenches (5, 6) up the tree (in place) and write the generalised force sum J^T f (nv,)."""
    for link in range(tree.table.shape[0] - 1, 0, -1):
        joint, parent, at, _ = tree.table[link]
        fx, fy, fz, mx, my, mz = wrenches[link]
        force[at] = tree.axis[link, 0] * mx + tree.axis[link, 1] * my + tree.axis[link, 2] * mz
        P = liMi[joint]
        gx = P[0] * fx + P[3] * fy + P[6] * fz
        gy = P[1] * fx + P[4] * fy + P[7] * fz
        gz = P[2] * fx + P[5] * fy + P[8] * fz
        up = wrenches[parent]
        up[0] += gx
        up[1] += gy
        up[2] += gz
        up[3] += P[0] * mx + P[3] * my + P[6] * mz + P[10] * gz - P[11] * gy
        up[4] += P[1] * mx + P[4] * my + P[7] * mz + P[11] * gx - P[9] * gz
        up[5] += P[2] * mx + P[5] * my + P[8] * mz + P[9] * gy - P[10] * gx
    at = tree.table[0, 2]
    copy_values(wrenches[0], force[at : at + 6])


@kernel
def rotations(tree: Tree, liMi: Array, rotation: Array) -> None:
    """Write the rotations of the links to world (5, 3, 3), down the tree."""
    for link in range(tree.table.shape[0]):
        P, parent = liMi[tree.table[link, 0]], tree.table[link, 1]
        for i in range(3):
            for j in range(3):
                if parent < 0:
                    rotation[link, i, j] = P[i + 3 * j]
                else:
                    up = rotation[parent]
                    rotation[link, i, j] = up[i, 0] * P[3 * j] + up[i, 1] * P[1 + 3 * j] + up[i, 2] * P[2 + 3 * j]


@kernel
def push(
    unknown: Unknown, elbow: float, held: Array, k: int, rotation: Array, wrenches: Array, at_points: Array
) -> None:
    """Write the unknown forces as link wrenches (5, 6), and at their points (2, p, 3) with and without noise.

    Args:
        unknown: the forces.
        elbow: elbow angle [rad].
        held: (2, n, intervals) noise and step of each force [N].
        k: interval.
        rotation: (5, 3, 3) links to world.
        wrenches: (5, 6) written.
        at_points: (2, p, 3) written, world axes [N].
    """
    wrenches[:] = 0.0
    at_points[:] = 0.0
    for i in range(unknown.table.shape[0]):
        point, link, axes = unknown.table[i]
        clean = unknown.numbers[i, 3] * np.sin(elbow) + held[1, i, k]
        noisy = clean + held[0, i, k]
        for row in range(3):
            direction = unknown.numbers[i, row]
            if axes < 2:
                R = rotation[link if axes == 0 else 0]
                direction = (
                    R[row, 0] * unknown.numbers[i, 0]
                    + R[row, 1] * unknown.numbers[i, 1]
                    + R[row, 2] * unknown.numbers[i, 2]
                )
            at_points[0, point, row] += noisy * direction
            at_points[1, point, row] += clean * direction
    for point in range(unknown.points.shape[0]):
        link = int(unknown.points[point, 0])
        x, y, z = unknown.points[point, 1:]
        R, f, wrench = rotation[link], at_points[0, point], wrenches[link]
        fx = R[0, 0] * f[0] + R[1, 0] * f[1] + R[2, 0] * f[2]
        fy = R[0, 1] * f[0] + R[1, 1] * f[1] + R[2, 1] * f[2]
        fz = R[0, 2] * f[0] + R[1, 2] * f[1] + R[2, 2] * f[2]
        wrench[0] += fx
        wrench[1] += fy
        wrench[2] += fz
        wrench[3] += y * fz - z * fy
        wrench[4] += z * fx - x * fz
        wrench[5] += x * fy - y * fx


@kernel
def evaluate(
    constants: Constants,
    work: Work,
    M: Array,
    nle: Array,
    liMi: Array,
    twist: Array,
    joints: Array,
    held: Array,
    k: int,
    state: Array,
    rate: Array,
    forces: Array,
) -> None:
    """Evaluate the equations of motion from Pinocchio's M, nle, placements and twists.

    Args:
        constants: robot, air, hold and unknown forces.
        work: scratch; its `loads` hold the strips' loads afterwards.
        M: (nv, nv) Pinocchio's inertia at this instant.
        nle: (nv,) its C v + g.
        liMi: (njoints, 12) its placements in the parents.
        twist: (njoints, 6) its velocities.
        joints: (3, 2) angle, rate and acceleration of shoulder and elbow.
        held: (2, n, intervals) noise and step of each unknown force [N].
        k: interval.
        state: (6 + 3N,) base twist in body axes, then the air.
        rate: (6 + 3N,) written: base acceleration, then the rate of the air.
        forces: (4 nv + 6 p + 1,) written, in the order of `Forces`.
    """
    air, tree, unknown, hold = constants
    nv = nle.shape[0]
    points = unknown.points.shape[0]
    twists, wrenches, pushes = work.spatial[0], work.spatial[1], work.spatial[2]
    for link in range(tree.table.shape[0]):
        copy_values(twist[tree.table[link, 0]], twists[link])
    aerodynamic, thrusters = forces[:nv], forces[nv : 2 * nv]
    motor, pushed = forces[2 * nv : 3 * nv], forces[3 * nv : 4 * nv]
    air_loads(air, twists, state[6:], wrenches, rate[6:], work.loads)
    climb(tree, liMi, wrenches, aerodynamic)
    rotations(tree, liMi, work.rotation)
    thrusters[:] = 0.0
    if hold.shape[0] > 0:
        base = tree.table[0, 2]
        position = liMi[tree.table[0, 0], 9:]
        hold_wrench(hold, position, work.rotation[0], twists[0], thrusters[base : base + 6])
    at_points = forces[4 * nv : 4 * nv + 6 * points].reshape((2, points, 3))
    push(unknown, joints[0, 1], held, k, work.rotation, pushes, at_points)
    climb(tree, liMi, pushes, pushed)

    A, b = work.base[:6], work.base[6]
    for i in range(6):
        b[i] = aerodynamic[i] + thrusters[i] + pushed[i] - nle[i]
        for j in range(6):
            A[i, j] = M[i, j]
        for link in range(1, tree.table.shape[0]):
            b[i] -= M[i, tree.table[link, 2]] * joints[2, tree.table[link, 3]]
    solve_positive(A, b)
    copy_values(b, rate[:6])
    power = 0.0
    motor[:6] = 0.0
    for link in range(1, tree.table.shape[0]):
        row = tree.table[link, 2]
        torque = nle[row] - aerodynamic[row] - thrusters[row] - pushed[row]
        for j in range(6):
            torque += M[row, j] * b[j]
        for other in range(1, tree.table.shape[0]):
            torque += M[row, tree.table[other, 2]] * joints[2, tree.table[other, 3]]
        motor[row] = torque
        power += torque * joints[1, tree.table[link, 3]]
    forces[4 * nv + 6 * points] = power


@kernel
def advance(
    numbers: Array,
    integers: Integers,
    flat: Array,
    M: Array,
    nle: Array,
    liMi: Array,
    twist: Array,
    motion: Array,
    held: Array,
    dt: float,
    k: int,
    stage: int,
    stages: Array,
    tangent: Array,
    v: Array,
    forces: Array,
    means: Array,
    loads: Array,
) -> None:
    """Evaluate one stage of step k and prepare the next: what `integrators.step` does, without its arrays in between.

    Args:
        numbers: of the packed constants.
        integers: of the packed constants.
        flat: scratch.
        M: (nv, nv) Pinocchio's inertia at this stage.
        nle: (nv,) its C v + g.
        liMi: (njoints, 12) its placements in the parents.
        twist: (njoints, 6) its velocities.
        motion: (2 n + 1, 3, 2) joints every half step.
        held: (2, forces, n) noise and step of each unknown force [N].
        dt: step [s].
        k: step.
        stage: 0 to 3.
        stages: (6, 6 + 3N): the rates of the four stages, the state at the start of the step, the state of the stage.
        tangent: (2, nv) written: the way of q to the next stage (row 0), or in two parts to the next step.
        v: (nv,) written: velocity at the next stage.
        forces: (4 nv + 6 p + 1,) scratch.
        means: (n, 4 nv + 6 p + 1) row k gathers the mean of the forces.
        loads: (n, 5, N) row k takes the strips' loads at the start of the step.
    """
    constants, work = unpack(numbers, integers), unpack_work(flat)
    tree = constants.tree
    start, state = stages[4], stages[5]
    half = 2 * k + (stage + 1) // 2
    evaluate(constants, work, M, nle, liMi, twist, motion[half], held, k, state, stages[stage], forces)
    weight = 1.0 / 6.0 if stage == 0 or stage == 3 else 1.0 / 3.0
    for i in range(forces.shape[0]):
        means[k, i] += weight * forces[i]
    if stage == 0:
        for row in range(loads.shape[1]):
            copy_values(work.loads[row], loads[k, row])
    copy_values(state[:6], work.twists[stage])
    next_stage(stage, dt, work.twists, stages[:4], start, state, tangent)
    if stage == 3:
        copy_values(state, start)
    # The joints follow the closed linkage: their part of the tangent leads from where the way starts to where it ends.
    begin = 2 * k + (1 if stage == 2 else 0)
    end = 2 * k + (stage + 2) // 2 if stage < 3 else 2 * k + 2
    base = tree.table[0, 2]
    copy_values(state[:6], v[base : base + 6])
    for link in range(1, tree.table.shape[0]):
        at, which = tree.table[link, 2], tree.table[link, 3]
        v[at] = motion[end, 1, which]
        tangent[:, at] = 0.0
        tangent[1 if stage == 3 else 0, at] = motion[end, 0, which] - motion[begin, 0, which]


@kernel
def evaluate_once(
    numbers: Array,
    integers: Integers,
    flat: Array,
    M: Array,
    nle: Array,
    liMi: Array,
    twist: Array,
    joints: Array,
    held: Array,
    state: Array,
    rate: Array,
    forces: Array,
) -> None:
    """Unpack and `evaluate`, whose arguments these are."""
    evaluate(unpack(numbers, integers), unpack_work(flat), M, nle, liMi, twist, joints, held, 0, state, rate, forces)


@kernel
def warm_up(air: AirArrays, twists: Array, dt: float, state: Array) -> None:
    """Fly the air alone: integrate its state (3N,) in place under link twists (2 n + 1, 5, 6) given every half step."""
    size = state.shape[0]
    k, rate, tangent = np.zeros((4, 0)), np.empty((4, size)), np.zeros((2, 0))
    start, wrenches, loads = np.empty(size), np.empty((5, 6)), np.empty((5, size // 3))
    for i in range(twists.shape[0] // 2):
        copy_values(state, start)
        for stage in range(4):
            air_loads(air, twists[2 * i + (stage + 1) // 2], state, wrenches, rate[stage], loads)
            next_stage(stage, dt, k, rate, start, state, tangent)
