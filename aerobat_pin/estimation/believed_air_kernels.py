"""The air along a recorded motion, compiled: one call after Pinocchio's bias at each place of a step."""

from __future__ import annotations

from aerobat_pin.aerodynamics import add_mass, air_loads, place_links, robot_in
from aerobat_pin.numerics import HALF_STEPS, Array, add_stage, copy_values, kernel, next_state
from aerobat_pin.robot import climb


@kernel
def advance_air_stage(memory: Array, wind: Array, acceleration: Array, dt: float, place: int, means: Array) -> None:
    """Advance the air by the stages of a Runge-Kutta step that lie at one place of it, and add to the step's means.

    Args:
        memory: of the robot in its air, see `robot_in`; `state` and `start` are the air's at the step's start before
            place 0, and at its end after place 2.
        wind: (2, 3) velocity of the air and its rate, world axes.
        acceleration: (nv,) of the robot, mean over the step; used in its middle.
        dt: step [s].
        place: half steps from the step's start: 0, 1 or 2.
        means: (2, nv) gathers the aerodynamic generalised force and that of the added mass.
    """
    robot = robot_in(memory)
    air, mass, tree, found, links = robot.air, robot.added_mass, robot.tree, robot.found, robot.links
    H, h, loads, rates, start, state = robot.H, robot.h, robot.loads, robot.rates, robot.start, robot.state
    liMi, twists, wrenches, nv = found.liMi, links.twists, links.wrenches, means.shape[1]
    place_links(tree, found, robot.gravity, wind, links)
    for stage in range(4):
        if HALF_STEPS[stage] == place:
            air_loads(air, twists, state, wrenches, rates[stage], loads)
            climb(tree, liMi, wrenches, h)
            add_stage(stage, h, means[0])
            next_state(stage, dt, rates, start, state)
    if place == 2:
        copy_values(state, start)
    if place == 1:
        for i in range(nv):
            h[i] = 0.0
            H[i, :] = 0.0
        add_mass(mass, tree, found, links, H, h)
        for i in range(nv):
            dragged = h[i]
            for j in range(nv):
                dragged += H[i, j] * acceleration[j]
            means[1, i] -= dragged
