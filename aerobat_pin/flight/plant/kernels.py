"""The equations of motion as one compiled call after Pinocchio's M and nle; `plant` says what they are."""

from __future__ import annotations

import numpy as np

from aerobat_pin.aerodynamics import add_mass, air_loads
from aerobat_pin.flight.attitude_hold import hold_wrench
from aerobat_pin.flight.plant.memory import Unknown, unpack, unpack_found, unpack_work
from aerobat_pin.numerics import DOUBLE, Array, Integers, array_at, copy_values, kernel, next_stage, solve_positive
from aerobat_pin.robot import against_the_air, chain, climb


@kernel
def push(
    unknown: Unknown,
    elbow: float,
    held: Array,
    k: int,
    world: Array,
    rotation: Array,
    wrenches: Array,
    at_points: Array,
) -> None:
    """Write the unknown forces as link wrenches (5, 6), and at their points (2, p, 3) with and without noise.

    Args:
        unknown: the forces.
        elbow: elbow angle [rad].
        held: (2, n, intervals) noise and signal of each force [N].
        k: interval.
        world: (12,) placement of the body, rotation by columns.
        rotation: (5, 3, 3) links to body.
        wrenches: (5, 6) written.
        at_points: (2, p, 3) written, world axes [N].
    """
    wrenches[:] = 0.0
    at_points[:] = 0.0
    for i in range(unknown.table.shape[0]):
        point, link, axes = unknown.table[i, 0], unknown.table[i, 1], unknown.table[i, 2]
        clean = unknown.numbers[i, 3] * np.sin(elbow) + held[1, i, k]
        noisy = clean + held[0, i, k]
        x, y, z = unknown.numbers[i, 0], unknown.numbers[i, 1], unknown.numbers[i, 2]
        if axes == 0:
            R = rotation[link]
            x, y, z = (
                R[0, 0] * x + R[0, 1] * y + R[0, 2] * z,
                R[1, 0] * x + R[1, 1] * y + R[1, 2] * z,
                R[2, 0] * x + R[2, 1] * y + R[2, 2] * z,
            )
        for row in range(3):
            direction = (
                unknown.numbers[i, row] if axes == 2 else world[row] * x + world[3 + row] * y + world[6 + row] * z
            )
            at_points[0, point, row] += noisy * direction
            at_points[1, point, row] += clean * direction
    for point in range(unknown.points.shape[0]):
        link = int(unknown.points[point, 0])
        x, y, z = unknown.points[point, 1], unknown.points[point, 2], unknown.points[point, 3]
        R, f, wrench = rotation[link], at_points[0, point], wrenches[link]
        bx = world[0] * f[0] + world[1] * f[1] + world[2] * f[2]
        by = world[3] * f[0] + world[4] * f[1] + world[5] * f[2]
        bz = world[6] * f[0] + world[7] * f[1] + world[8] * f[2]
        fx = R[0, 0] * bx + R[1, 0] * by + R[2, 0] * bz
        fy = R[0, 1] * bx + R[1, 1] * by + R[2, 1] * bz
        fz = R[0, 2] * bx + R[1, 2] * by + R[2, 2] * bz
        wrench[0] += fx
        wrench[1] += fy
        wrench[2] += fz
        wrench[3] += y * fz - z * fy
        wrench[4] += z * fx - x * fz
        wrench[5] += x * fy - y * fx


@kernel
def evaluate(
    integers: Integers,
    steady: bool | None,
    joints: Array,
    wind: Array,
    held: Array,
    k: int,
    state: Array,
    rate: Array,
    forces: Array,
) -> None:
    """Evaluate the equations of motion from Pinocchio's M, nle, placements and twists.

    Args:
        integers: where constants, Pinocchio's results and scratch lie, see `plant_layout`; the scratch's `loads` hold
            the strips' loads afterwards.
        steady: which model of the air, see `air_loads`.
        joints: (3, 2) angle, rate and acceleration of shoulder and elbow.
        wind: (2, 3) velocity of the air and its rate, world axes.
        held: (2, n, intervals) noise and signal of each unknown force [N].
        k: interval.
        state: (6 + 3N,) base twist in body axes, then the air.
        rate: (6 + 3N,) written: base acceleration, then the rate of the air.
        forces: (5 nv + 6 p + 32,) written, in the order of `Forces`.
    """
    constants, work, found = unpack(integers), unpack_work(integers), unpack_found(integers)
    air, tree, unknown, hold = constants.air, constants.tree, constants.unknown, constants.hold
    M, nle, liMi = found.M, found.nle, found.liMi
    nv, points = nle.shape[0], unknown.points.shape[0]
    absolute, twists, wrenches, pushes = work.spatial[0], work.spatial[1], work.spatial[2], work.spatial[3]
    aerodynamic, added, thrusters = forces[:nv], forces[nv : 2 * nv], forces[2 * nv : 3 * nv]
    motor, pushed = forces[3 * nv : 4 * nv], forces[4 * nv : 5 * nv]
    end = 5 * nv + 6 * points
    links = tree.table.shape[0]
    world, base = liMi[tree.table[0, 0]], tree.table[0, 2]
    for link in range(links):
        for i in range(6):
            absolute[link, i] = twists[link, i] = found.v[tree.table[link, 0], i]
    chain(tree, liMi, work.rotation, work.origin)
    against_the_air(world, constants.gravity[0], wind, work.rotation, work.field, twists)
    air_loads(air, steady, twists, state[6:], wrenches, rate[6:], work.loads)
    air_power = 0.0
    for link in range(links):
        for i in range(6):
            forces[end + 6 * link + i] = wrenches[link, i]
            air_power += wrenches[link, i] * absolute[link, i]
    climb(tree, liMi, wrenches, aerodynamic)
    thrusters[:] = 0.0
    if hold.shape[0] > 0:
        hold_wrench(hold, world, absolute[0], thrusters[base : base + 6])
    at_points = array_at(forces.ctypes.data + DOUBLE * 5 * nv, (2, points, 3))
    push(unknown, joints[0, 1], held, k, world, work.rotation, pushes, at_points)
    climb(tree, liMi, pushes, pushed)

    H, h = work.inertia[:nv], work.inertia[nv]
    for i in range(nv):
        h[i] = nle[i]
        for j in range(nv):
            H[i, j] = M[i, j]
    add_mass(
        constants.mass,
        tree.table,
        tree.axis,
        liMi,
        work.rotation,
        work.origin,
        twists,
        found.a_gf,
        work.field,
        work.rows,
        H,
        h,
    )
    A, b = work.base[:6], work.base[6]
    for i in range(6):
        b[i] = aerodynamic[i] + thrusters[i] + pushed[i] - h[i]
        for j in range(6):
            A[i, j] = H[i, j]
        for link in range(1, links):
            b[i] -= H[i, tree.table[link, 2]] * joints[2, tree.table[link, 3]]
    solve_positive(A, b)
    copy_values(b, rate[:6])
    motor_power = 0.0
    motor[:6] = 0.0
    for row in range(nv):
        inertial, dragged = h[row], nle[row] - h[row]
        for j in range(6):
            inertial += H[row, j] * b[j]
            dragged += (M[row, j] - H[row, j]) * b[j]
        for other in range(1, links):
            at, acceleration = tree.table[other, 2], joints[2, tree.table[other, 3]]
            inertial += H[row, at] * acceleration
            dragged += (M[row, at] - H[row, at]) * acceleration
        added[row] = dragged
        if row > 5:
            motor[row] = inertial - aerodynamic[row] - thrusters[row] - pushed[row]
    for i in range(6):
        air_power += added[i] * absolute[0, i]
    for link in range(1, links):
        row, speed = tree.table[link, 2], joints[1, tree.table[link, 3]]
        motor_power += motor[row] * speed
        air_power += added[row] * speed
    forces[end + 30], forces[end + 31] = motor_power, air_power


@kernel
def advance(
    integers: Integers,
    steady: bool | None,
    motion: Array,
    wind: Array,
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
        integers: where everything lies, see `plant_layout`.
        steady: which model of the air, see `air_loads`.
        motion: (2 n + 1, 3, 2) joints every half step.
        wind: (2 n + 1, 2, 3) velocity of the air and its rate every half step, world axes.
        held: (2, forces, n) noise and signal of each unknown force [N].
        dt: step [s].
        k: step.
        stage: 0 to 3.
        stages: (6, 6 + 3N): the rates of the four stages, the state at the start of the step, the state of the stage.
        tangent: (2, nv) written: the way of q to the next stage (row 0), or in two parts to the next step.
        v: (nv,) written: velocity at the next stage.
        forces: (5 nv + 6 p + 32,) scratch.
        means: (n, 5 nv + 6 p + 32) row k gathers the mean of the forces.
        loads: (n, 9, N) row k takes the strips' loads at the start of the step.
    """
    tree, work = unpack(integers).tree, unpack_work(integers)
    start, state = stages[4], stages[5]
    half = 2 * k + (stage + 1) // 2
    evaluate(integers, steady, motion[half], wind[half], held, k, state, stages[stage], forces)
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
def warm_up(integers: Integers, steady: bool | None, twists: Array, dt: float, state: Array) -> None:
    """Fly the air alone: integrate its state (3N,) in place under link twists (2 n + 1, 5, 6) given every half step.

    The twists are those against the air; `steady` as in `air_loads`.
    """
    air, work, size = unpack(integers).air, unpack_work(integers), state.shape[0]
    k, rate, tangent = np.zeros((4, 0)), np.empty((4, size)), np.zeros((2, 0))
    start, wrenches, loads = np.empty(size), work.spatial[0], work.loads
    for i in range(twists.shape[0] // 2):
        copy_values(state, start)
        for stage in range(4):
            air_loads(air, steady, twists[2 * i + (stage + 1) // 2], state, wrenches, rate[stage], loads)
            next_stage(stage, dt, k, rate, start, state, tangent)
