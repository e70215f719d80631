"""The air along a recorded motion, compiled: one call after Pinocchio's bias at the middle and the end of a step."""

from __future__ import annotations

from aerobat_pin.aerodynamics import add_mass, air_loads
from aerobat_pin.flight import Constants, Found, Work, unpack, unpack_found, unpack_work
from aerobat_pin.numerics import Array, Integers, copy_values, inner, kernel, next_stage
from aerobat_pin.robot import against_the_air, chain, climb

START, MIDDLE, END = 0, 1, 2


@inner
def look_around(constants: Constants, work: Work, found: Found, wind: Array) -> None:
    """Place the links and take their twists against the air, from what Pinocchio found at this instant."""
    tree, twists = constants.tree, work.spatial[1]
    for link in range(tree.table.shape[0]):
        copy_values(found.v[tree.table[link, 0]], twists[link])
    chain(tree, found.liMi, work.rotation, work.origin)
    against_the_air(found.liMi[tree.table[0, 0]], constants.gravity[0], wind, work.rotation, work.field, twists)


@kernel
def blow(
    integers: Integers,
    steady: bool | None,
    wind: Array,
    acceleration: Array,
    dt: float,
    place: int,
    stages: Array,
    none: Array,
    means: Array,
) -> None:
    """Advance the air by the stages of a Runge-Kutta step that lie at one place of it, and add to the step's means.

    Args:
        integers: where everything lies, see `plant_layout`.
        steady: which model of the air, see `air_loads`.
        wind: (2, 3) velocity of the air and its rate, world axes.
        acceleration: (nv,) of the robot, mean over the step; used in its middle.
        dt: step [s].
        place: `START` of the step, its `MIDDLE`, or its `END`, after which `stages[4]` is the state there.
        stages: (6, 3N): the rates of the four stages, the state at the start of the step, the state of the stage.
        none: (4, 0): nothing moves on a manifold here.
        means: (2, nv) gathers the aerodynamic generalised force and that of the added mass.
    """
    constants, work, found = unpack(integers), unpack_work(integers), unpack_found(integers)
    tree, nv = constants.tree, means.shape[1]
    look_around(constants, work, found, wind)
    force, wrenches = work.inertia[nv], work.spatial[2]
    first = 0 if place == START else (1 if place == MIDDLE else 3)
    for stage in range(first, first + (2 if place == MIDDLE else 1)):
        air_loads(constants.air, steady, work.spatial[1], stages[5], wrenches, stages[stage], work.loads)
        climb(tree, found.liMi, wrenches, force)
        weight = 1.0 / 6.0 if stage == 0 or stage == 3 else 1.0 / 3.0
        for i in range(nv):
            means[0, i] += weight * force[i]
        next_stage(stage, dt, none, stages[:4], stages[4], stages[5], none)
    if place == END:
        copy_values(stages[5], stages[4])
    if place == MIDDLE:
        H, h = work.inertia[:nv], work.inertia[nv]
        for i in range(nv):
            h[i] = 0.0
            H[i, :] = 0.0
        add_mass(
            constants.mass,
            tree.table,
            tree.axis,
            found.liMi,
            work.rotation,
            work.origin,
            work.spatial[1],
            found.a_gf,
            work.field,
            work.rows,
            H,
            h,
        )
        for i in range(nv):
            dragged = h[i]
            for j in range(nv):
                dragged += H[i, j] * acceleration[j]
            means[1, i] -= dragged
