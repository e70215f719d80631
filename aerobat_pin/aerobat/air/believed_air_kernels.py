"""The compiled part of `believed_air`: what happens between Pinocchio's calls."""

from __future__ import annotations

from typing import Annotated, NamedTuple

from aerobat_pin.aerobat.air.added_mass import add_mass
from aerobat_pin.aerobat.air.robot_air import air_loads
from aerobat_pin.aerobat.air.robot_in_air import RobotState
from aerobat_pin.aerobat.link_kernels import climb, place_links
from aerobat_pin.numerics import (
    ELSEWHERE,
    HALF_STEPS,
    Array,
    add_stage,
    copy_values,
    fields_of,
    inlined,
    inner,
    kernel,
    next_state,
)

BASE, PLACE = 6, 7  # rows of the base in v and in q


@kernel
def advance_air_stage(memory: Array, wind: Array, acceleration: Array, dt: float, place: int, means: Array) -> None:
    """Do what `advance_air` does; `memory` is the state of the robot in its air."""
    advance_air(fields_of(memory, RobotState), wind, acceleration, dt, place, means)


@inner
def advance_air(robot: RobotState, wind: Array, acceleration: Array, dt: float, place: int, means: Array) -> None:
    """Evaluate the Runge-Kutta stages at one place of a step, and add their forces to the mean over the step.

    Pinocchio's `nonLinearEffects` must have been called for the robot's motion at this place.

    Args:
        robot: the robot in its air. Before place 0, `state` and `start` are
            the aerodynamic states at the step's start; after place 2, those at its end.
        wind: (2, 3) velocity of the air and its time derivative, world axes [m/s, m/s2].
        acceleration: (nv,) mean acceleration of the robot over the step; used at place 1 only.
        dt: length of the step [s].
        place: 0 at the start of the step, 1 in its middle, 2 at its end.
        means: (2, nv) sums to which the generalised forces are added: aerodynamic, and of the added mass.
    """
    air, mass, tree, results, links = robot.air, robot.added_mass, robot.tree, robot.results, robot.links
    H, h, loads, rates, start, state = robot.H, robot.h, robot.loads, robot.rates, robot.start, robot.state
    liMi, twists, wrenches, nv = results.liMi, links.twists, links.wrenches, means.shape[1]
    place_links(tree, results, robot.gravity, wind, links)
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
        add_mass(mass, tree, results, links, H, h)
        for i in range(nv):
            dragged = h[i]
            for j in range(nv):
                dragged += H[i, j] * acceleration[j]
            means[1, i] -= dragged


class Stream(NamedTuple):
    """State of a stream; the robot in its air has a state of its own.

    `q`, `v`, `wind` are those of the sample before; `last_wind` is the newest one, which the caller writes where it
    changes. `dt` is the time between samples [s], `acceleration` and `means` belong to the interval, `velocity` and
    `wind_now` to an instant in it.
    """

    air: Annotated[RobotState, ELSEWHERE]
    dt: Annotated[Array, ""]
    q: Annotated[Array, "nq"]
    v: Annotated[Array, "nv"]
    wind: Annotated[Array, "2, 3"]
    last_wind: Annotated[Array, "2, 3"]
    acceleration: Annotated[Array, "nv"]
    means: Annotated[Array, "2, nv"]
    velocity: Annotated[Array, "nv"]
    wind_now: Annotated[Array, "2, 3"]


@kernel
def air_at(memory: Array, q: Array, v: Array, half: int, count: int, middle: Array) -> None:
    """Add the forces at a place of an interval to its means, and move on by half a step.

    Pinocchio's `nonLinearEffects` must have been called for the motion at this place.

    Args:
        memory: the stream's state.
        q: (nq,) configuration at the interval's end.
        v: (nv,) velocity there.
        half: number of half steps from the interval's start to this place.
        count: number of steps in the interval.
        middle: (nq,) configuration at the next place, on the straight line between the samples; its joints are put on
            the cubic, and `velocity` is the velocity there. Not used where that is the end, or after it.
    """
    stream = fields_of(memory, Stream)
    air, length, nv = stream.air, float(stream.dt[()]) / count, v.shape[0]
    means, wind_now = stream.means, stream.wind_now
    if half == 0:
        for i in range(nv):
            stream.acceleration[i] = (v[i] - stream.v[i]) / stream.dt[()]
            means[0, i], means[1, i] = 0.0, 0.0
        blend_winds(stream, 0.0)
    if half % 2 == 1:
        advance_air(air, wind_now, stream.acceleration, length, 1, means)
    elif half > 0:
        advance_air(air, wind_now, stream.acceleration, length, 2, means)
    if half == 2 * count:
        for i in range(nv):
            means[0, i] /= count
            means[1, i] /= count
        copy_values(q, stream.q)
        copy_values(v, stream.v)
        for i in range(2):
            copy_values(stream.last_wind[i], stream.wind[i])
        return
    if half % 2 == 0:
        advance_air(air, wind_now, stream.acceleration, length, 0, means)
    share = 0.5 * (half + 1) / count
    blend_winds(stream, share)
    if half + 1 < 2 * count:
        for i in range(nv):
            stream.velocity[i] = stream.v[i] + share * (v[i] - stream.v[i])
        for i in range(q.shape[0] - PLACE):
            gap = q[PLACE + i] - stream.q[PLACE + i]  # bend and twist: the slopes less the chord's, over the interval
            bend, twist = gap - stream.dt[()] * stream.v[BASE + i], gap - stream.dt[()] * v[BASE + i]
            middle[PLACE + i] -= share * (1.0 - share) * ((1.0 - share) * bend - share * twist)


@inlined
def blend_winds(stream: Stream, share: float) -> None:
    """Write the wind at a share of the interval to `wind_now`."""
    for i in range(2):
        for j in range(3):
            stream.wind_now[i, j] = stream.wind[i, j] + share * (stream.last_wind[i, j] - stream.wind[i, j])
