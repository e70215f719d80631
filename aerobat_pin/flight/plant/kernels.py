"""The equations of motion as one compiled call after Pinocchio's M and nle; `plant` states the equations."""

from __future__ import annotations

import numpy as np

from aerobat_pin.aerobat import add_mass, air_loads, climb, place_links
from aerobat_pin.flight.attitude_hold import hold_wrench
from aerobat_pin.flight.crank import CRANK_SIZE, add_crank, crank_rates
from aerobat_pin.flight.plant.plant_state import PlantState, UnknownForces
from aerobat_pin.linkage import joints_at
from aerobat_pin.numerics import (
    DEPARTURES,
    HALF_STEPS,
    Array,
    add_stage,
    array_at,
    copy_values,
    fields_of,
    in_inner_axes,
    in_outer_axes,
    inlined,
    kernel,
    next_state,
    next_tangent,
    rotated,
    solve_positive,
)


@kernel
def push(
    unknown: UnknownForces,
    elbow: float,
    step_means: Array,
    k: int,
    world: Array,
    rotation: Array,
    wrenches: Array,
    noisy: Array,
    clean: Array,
) -> None:
    """Write the unknown forces: as wrenches on the links, and as forces at their points with and without noise.

    Args:
        unknown: the forces.
        elbow: elbow angle [rad].
        step_means: (2, f, intervals) mean noise and mean signal of each force [N].
        k: index of the interval.
        world: (12,) placement of the body: rotation by columns, then position.
        rotation: (5, 3, 3) rotations from link axes to body axes.
        wrenches: (5, 6) written: wrench on each link, at the origin and in the axes of the link's frame.
        noisy: (p, 3) written: forces with noise, world axes [N].
        clean: (p, 3) written: forces without noise, world axes [N].
    """
    wrenches[:] = 0.0
    noisy[:] = 0.0
    clean[:] = 0.0
    for i in range(unknown.point.shape[0]):
        point, axes = unknown.point[i], unknown.axes[i]
        signal = unknown.elbow_amplitude[i] * np.sin(elbow) + step_means[1, i, k]
        with_noise = signal + step_means[0, i, k]
        direction = (unknown.direction[i, 0], unknown.direction[i, 1], unknown.direction[i, 2])
        if axes == 0:
            direction = rotated(rotation[unknown.link[i]], direction[0], direction[1], direction[2])
        if axes != 2:
            direction = in_outer_axes(world, direction[0], direction[1], direction[2])
        for row in range(3):
            noisy[point, row] += with_noise * direction[row]
            clean[point, row] += signal * direction[row]
    for point in range(unknown.point_link.shape[0]):
        f, place, link = noisy[point], unknown.point_place[point], unknown.point_link[point]
        bx, by, bz = in_inner_axes(world, f[0], f[1], f[2])
        fx, fy, fz = rotated(rotation[link].T, bx, by, bz)
        x, y, z = place[0], place[1], place[2]
        wrench = wrenches[link]
        wrench[0] += fx
        wrench[1] += fy
        wrench[2] += fz
        wrench[3] += y * fz - z * fy
        wrench[4] += z * fx - x * fz
        wrench[5] += x * fy - y * fx


@inlined
def apply_forces(
    plant: PlantState, elbow: float, wind: Array, step_means: Array, k: int, air_state: Array, air_rate: Array
) -> None:
    """Write the generalised forces of air, unknown forces, and attitude hold or command, and the rate of the air.

    `forces.air_power` is that of the air without added mass; the other arguments are as of `equations_of_motion`.
    """
    robot, forces, pushes = plant.robot, plant.forces, plant.pushes
    tree, liMi, v, links, wrenches = robot.tree, robot.results.liMi, robot.results.v, robot.links, robot.links.wrenches
    world, body, base = liMi[tree.joint[0]], v[tree.joint[0]], tree.row[0]
    place_links(tree, robot.results, robot.gravity, wind, links)
    air_loads(robot.air, links.twists, air_state, wrenches, air_rate, robot.loads)
    noisy, clean = forces.force_W, forces.force_noise_free_W
    push(plant.unknown, elbow, step_means, k, world, links.rotation, pushes, noisy, clean)
    climb(tree, liMi, pushes, forces.unknown)
    air_power = 0.0
    for link in range(tree.joint.shape[0]):
        for i in range(6):
            forces.link_wrench[link, i] = wrenches[link, i]
            air_power += wrenches[link, i] * v[tree.joint[link], i]
    forces.air_power[()] = air_power
    climb(tree, liMi, wrenches, forces.aerodynamic)
    forces.thrusters[:] = 0.0
    if plant.holds[()] > 0.0:
        hold_wrench(plant.hold, world, body, plant.error_rotation, forces.thrusters[base : base + 6])
    else:
        copy_values(plant.command, forces.thrusters[base : base + 6])


@inlined
def write_powers(plant: PlantState, linked_rates: Array) -> None:
    """Write the powers of the forces, of which `forces.air_power` has all but that of the added mass."""
    forces, tree, swing = plant.forces, plant.robot.tree, plant.swing
    body, added = plant.robot.results.v[tree.joint[0]], forces.added_mass
    motor_power, air_power, held_power, pushed_power = 0.0, forces.air_power[()], 0.0, 0.0
    for i in range(6):
        air_power += added[i] * body[i]
        held_power += forces.thrusters[i] * body[i]
        pushed_power += forces.unknown[i] * body[i]
    for link in range(1, tree.joint.shape[0]):
        row, speed = tree.row[link], swing[0, link]
        motor_power += forces.motor[row] * linked_rates[tree.angle[link]]
        air_power += added[row] * speed
        pushed_power += forces.unknown[row] * speed
    forces.motor_power[()], forces.air_power[()] = motor_power, air_power
    forces.thruster_power[()], forces.unknown_power[()] = held_power, pushed_power


@inlined
def equations_of_motion(
    plant: PlantState, joints: Array, wind: Array, step_means: Array, k: int, state: Array, rate: Array
) -> None:
    """Evaluate the equations of motion from Pinocchio's M, nle, placements and twists.

    The plant's `forces` and its robot's `loads` are written. `step_means` (2, f, intervals) are those of all intervals,
    of which k is this one; other arguments are as of `Plant.evaluate`. Without the crank's state and the deflections in
    `state`, all joints follow `joints`.
    """
    robot, forces, swing, A, b = plant.robot, plant.forces, plant.swing, plant.A, plant.b
    tree, results, closed, whole = robot.tree, robot.results, plant.closed, plant.start.shape[0]
    H, h, M, nle, row_of, angle_of = robot.H, robot.h, results.M, results.nle, tree.row, tree.angle
    aerodynamic, thrusters, pushed, motor = forces.aerodynamic, forces.thrusters, forces.unknown, forces.motor
    nv, count, complete = nle.shape[0], tree.joint.shape[0], state.shape[0] == whole
    free, bends = plant.linkage.shape[0] > 0 and complete, plant.elastic.shape[0] if complete else 0
    tail = state.shape[0] - 2 * bends
    end = tail - CRANK_SIZE if free else tail
    crank, bent = state[end:tail], state[tail:]
    if free:
        joints_at(plant.linkage, crank[0], closed)
        for angle in range(2):
            joints[2, angle] = closed[2, angle] * crank[1] * crank[1]
    apply_forces(plant, joints[0, 1], wind, step_means, k, state[6:end], rate[6:end])

    # The equations A x = b of base, crank and deflections; x overwrites b.
    for i in range(nv):
        h[i] = nle[i]
        for j in range(nv):
            H[i, j] = M[i, j]
    add_mass(robot.added_mass, tree, results, robot.links, H, h)
    for i in range(6):
        b[i] = aerodynamic[i] + thrusters[i] + pushed[i] - h[i]
        for j in range(6):
            A[i, j] = H[i, j]
        for link in range(1, count):
            b[i] -= H[i, row_of[link]] * joints[2, angle_of[link]]
    unknowns = 7 if free else 6
    if free:
        add_crank(plant.motor, crank, closed, row_of, angle_of, H, h, aerodynamic, pushed, joints, A, b)
    for e in range(bends):
        at, row = unknowns + e, row_of[plant.elastic[e]]
        torque = -plant.stiffness[e] * bent[e] - plant.damping[e] * bent[bends + e]
        b[at] = aerodynamic[row] + pushed[row] + torque - h[row]
        for j in range(6):
            A[at, j] = H[row, j]
        if free:
            A[at, 6] = 0.0
        for other in range(1, count):
            column, angle = row_of[other], angle_of[other]
            b[at] -= H[row, column] * joints[2, angle]
            if free:
                A[at, 6] += H[row, column] * closed[1, angle]
        for f in range(e + 1):
            A[at, unknowns + f] = H[row, row_of[plant.elastic[f]]]
    solve_positive(A, b[: unknowns + bends])

    # The rates of the states, and the joints' rates and accelerations.
    copy_values(b[:6], rate[:6])
    if free:
        crank_rates(plant.motor, crank, b[6], rate[end:tail])
        for angle in range(2):
            joints[2, angle] += closed[1, angle] * b[6]
    for link in range(1, count):
        swing[0, link], swing[1, link] = joints[1, angle_of[link]], joints[2, angle_of[link]]
    for e in range(bends):
        link, rate[tail + e], rate[tail + bends + e] = plant.elastic[e], bent[bends + e], b[unknowns + e]
        swing[0, link] += bent[bends + e]
        swing[1, link] += b[unknowns + e]

    # What the added mass and the motor did, by inverse dynamics.
    motor[:6] = 0.0
    for row in range(nv):
        inertial, dragged = h[row], nle[row] - h[row]
        for j in range(6):
            inertial += H[row, j] * b[j]
            dragged += (M[row, j] - H[row, j]) * b[j]
        for other in range(1, count):
            column, acceleration = row_of[other], swing[1, other]
            inertial += H[row, column] * acceleration
            dragged += (M[row, column] - H[row, column]) * acceleration
        forces.added_mass[row] = dragged
        if row > 5:
            motor[row] = inertial - aerodynamic[row] - thrusters[row] - pushed[row]
    write_powers(plant, joints[1])
    if free:
        torque = 0.0
        for link in range(1, count):
            torque += motor[row_of[link]] * closed[1, angle_of[link]]
        forces.crank_torque[()], forces.drive_torque[()] = torque, crank[2]
        forces.drive_power[()] = crank[2] * crank[1]
        forces.friction_power[()] = plant.motor.friction[()] * crank[1] * crank[1]


@kernel
def evaluate(memory: Array, joints: Array, wind: Array, step_means: Array, k: int, state: Array, rate: Array) -> None:
    """Evaluate the equations of motion in a plant's state; the other arguments are those of `equations_of_motion`."""
    equations_of_motion(fields_of(memory, PlantState), joints, wind, step_means, k, state, rate)


@kernel
def advance_stage(
    memory: Array,
    motion: Array,
    wind: Array,
    step_means: Array,
    dt: float,
    k: int,
    stage: int,
    parts: int,
    means: Array,
    loads: Array,
) -> None:
    """Evaluate one Runge-Kutta stage of step k, and write `state`, `tangent` and `v` for the next stage.

    Args:
        memory: the plant's state.
        motion: (2 n + 1, 3, 2) angle, rate and acceleration of shoulder and elbow at every half step. If the crank is
            free, rows after the first are written.
        wind: (2 n + 1, 2, 3) wind velocity and its rate of change at every half step, world axes.
        step_means: (2, f, n / parts) mean noise and mean signal of each unknown force over each interval [N].
        dt: time step [s].
        k: index of the step.
        stage: index of the stage, 0 to 3.
        parts: number of steps in an interval.
        means: (n / parts, size) sums of the forces' means over the steps of each interval; this stage's share is added.
        loads: (n / parts, 9, N) strip loads at the start of each interval; stage 0 of its first step writes them.
    """
    plant = fields_of(memory, PlantState)
    tree, state, start, rates, twists = plant.robot.tree, plant.state, plant.start, plant.rates, plant.twists
    tangent, v, strips, row_of, angle_of = plant.tangent, plant.v, plant.robot.loads, tree.row, tree.angle
    forces = array_at(plant.forces.aerodynamic.ctypes.data, (means.shape[1],))
    linkage, closed, second = plant.linkage, plant.closed, plant.second
    elastic, departed_by = plant.elastic, plant.departed
    bends, deflections = elastic.shape[0], start.shape[0] - 2 * elastic.shape[0]
    half = 2 * k + HALF_STEPS[stage]
    interval = k // parts
    equations_of_motion(plant, motion[half], wind[half], step_means, interval, state, rates[stage])
    add_stage(stage, forces, means[interval])
    if stage == 0 and k == interval * parts:
        for row in range(loads.shape[1]):
            copy_values(strips[row], loads[interval, row])
    copy_values(state[:6], twists[stage])
    next_tangent(stage, dt, twists, tangent)
    if stage == 0:
        copy_values(start[deflections : deflections + bends], departed_by[0])
    next_state(stage, dt, rates, start, state)
    if stage == 0:
        copy_values(state[deflections : deflections + bends], departed_by[1])
    if stage == 3:
        copy_values(state, start)
    # The crank angle gives the joint angles: in their rows the tangent is the change of the joint angle.
    begin, end = 2 * k + DEPARTURES[stage], 2 * k + (HALF_STEPS[stage + 1] if stage < 3 else 2)
    departed = motion[begin, 0]
    if linkage.shape[0] > 0:
        crank = state[deflections - CRANK_SIZE : deflections]
        joints_at(linkage, crank[0], closed)
        for angle in range(2):
            motion[end, 0, angle], motion[end, 1, angle] = closed[0, angle], closed[1, angle] * crank[1]
        if stage == 0:
            copy_values(closed[0], second)
        elif stage == 2:
            departed = second
    copy_values(state[:6], v[row_of[0] : row_of[0] + 6])
    for link in range(1, row_of.shape[0]):
        row, angle = row_of[link], angle_of[link]
        v[row] = motion[end, 1, angle]
        tangent[:, row] = 0.0
        tangent[1 if stage == 3 else 0, row] = motion[end, 0, angle] - departed[angle]
    for e in range(bends):
        row, deflection = row_of[elastic[e]], state[deflections + e]
        v[row] += state[deflections + bends + e]
        tangent[1 if stage == 3 else 0, row] += deflection - departed_by[DEPARTURES[stage], e]
