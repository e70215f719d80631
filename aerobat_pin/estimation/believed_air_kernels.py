"""The compiled part of `believed_air`: it is called at the start, the middle and the end of each integration step."""

from __future__ import annotations

from aerobat_pin.aerodynamics import add_mass, air_loads, place_links, robot_in
from aerobat_pin.numerics import HALF_STEPS, Array, add_stage, copy_values, kernel, next_state
from aerobat_pin.robot import climb


@kernel
def advance_air_stage(memory: Array, wind: Array, acceleration: Array, dt: float, place: int, means: Array) -> None:
    """Evaluate the Runge-Kutta stages at one place of a step, and add their forces to the mean over the step.

    Pinocchio's `nonLinearEffects` must have been called for the robot's motion at this place.

    Args:
        memory: memory of the robot and its aerodynamic model, see `robot_in`. Before place 0, `state` and `start` are
            the aerodynamic states at the step's start; after place 2, those at its end.
        wind: (2, 3) velocity of the air and its time derivative, world axes [m/s, m/s2].
        acceleration: (nv,) mean acceleration of the robot over the step; used at place 1 only.
        dt: length of the step [s].
        place: 0 at the start of the step, 1 in its middle, 2 at its end.
        means: (2, nv) sums to which the generalised forces are added: aerodynamic, and of the added mass.
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
