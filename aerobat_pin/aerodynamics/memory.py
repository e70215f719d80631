"""Memory layouts of the aerodynamic kernels (see `numerics.memory`): aerodynamic constants, and a robot in its air."""

from __future__ import annotations

from typing import Any, NamedTuple

from aerobat_pin.aerodynamics.added_mass import AddedMass
from aerobat_pin.aerodynamics.links import Links, PinocchioResults
from aerobat_pin.aerodynamics.strip_forces import STRIP_ROWS, AirConstants, Pieces, Strips, Surfaces
from aerobat_pin.numerics import Array, array_at, merged, next_size, rewind, take, take_integers
from aerobat_pin.robot import LINKS, Tree

LINK_COUNT = len(LINKS)


class RobotMemory(NamedTuple):
    """Memory of a robot in its air.

    `gravity` () [m/s2]. `H` (nv, nv) and `h` (nv,) are scratch arrays for inertia and bias. `loads` (9, N) are the
    strips' loads. For a Runge-Kutta step of the aerodynamic state (S,): its `rates` (4, S) at the stages, the state at
    the step's `start` (S,), and the current `state` (S,).
    """

    air: AirConstants
    added_mass: AddedMass
    gravity: Array
    tree: Tree
    found: PinocchioResults
    links: Links
    H: Array
    h: Array
    loads: Array
    rates: Array
    start: Array
    state: Array


@merged
def air_in(memory: Array) -> AirConstants:
    """Lay out the aerodynamic constants. Sizes: number of strips, and of their pieces."""
    cursor = rewind(memory)
    n, p = next_size(cursor), next_size(cursor)
    return AirConstants(
        quasi_steady=take(cursor, ()),
        density=take(cursor, ()),
        lift_slope=take(cursor, ()),
        profile_drag=take(cursor, ()),
        slope_over_limit=take(cursor, ()),
        strips=Strips(
            quarter_chord=take(cursor, (n,)),
            per_semichord=take(cursor, (n,)),
            force_factor=take(cursor, (n,)),
        ),
        pieces=Pieces(
            strip=take_integers(cursor, (p,)),
            link=take_integers(cursor, (p,)),
            x=take(cursor, (p,)),
            y=take(cursor, (p,)),
            z=take(cursor, (p,)),
            share=take(cursor, (p,)),
            pitch_damping=take(cursor, (p,)),
        ),
        downwash=take(cursor, (n, n)),
        tail_downwash=take(cursor, (n,)),
        surfaces=Surfaces(
            drag_area=take(cursor, ()),
            downwash_factor=take(cursor, ()),
            tail=take(cursor, (3,)),
            tail_cosine=take(cursor, ()),
            tail_sine=take(cursor, ()),
            tail_lift=take(cursor, ()),
            fin=take(cursor, (3,)),
            fin_lift=take(cursor, ()),
        ),
    )


@merged
def robot_in(memory: Array) -> RobotMemory:
    """Lay out a robot in its air.

    Sizes: addresses of the memory of `air_in` and of Pinocchio's M, nle, liMi, v, a_gf; then nv, njoints, number of
    strips, number of aerodynamic states.
    """
    cursor = rewind(memory)
    air, M, nle, liMi = next_size(cursor), next_size(cursor), next_size(cursor), next_size(cursor)
    v, a_gf, nv, joints = next_size(cursor), next_size(cursor), next_size(cursor), next_size(cursor)
    n, states = next_size(cursor), next_size(cursor)
    return RobotMemory(
        air=air_in(array_at(air, (1,))),
        added_mass=AddedMass(
            masses=take(cursor, (LINK_COUNT, 3)),
            x=take(cursor, (LINK_COUNT,)),
            y=take(cursor, (LINK_COUNT,)),
            skew=take(cursor, (LINK_COUNT,)),
        ),
        gravity=take(cursor, ()),
        tree=Tree(
            joint=take_integers(cursor, (LINK_COUNT,)),
            parent=take_integers(cursor, (LINK_COUNT,)),
            row=take_integers(cursor, (LINK_COUNT,)),
            angle=take_integers(cursor, (LINK_COUNT,)),
            axis=take(cursor, (LINK_COUNT, 3)),
        ),
        found=PinocchioResults(
            M=array_at(M, (nv, nv)),
            nle=array_at(nle, (nv,)),
            liMi=array_at(liMi, (joints, 12)),
            v=array_at(v, (joints, 6)),
            a_gf=array_at(a_gf, (joints, 6)),
        ),
        links=Links(
            rotation=take(cursor, (LINK_COUNT, 3, 3)),
            origin=take(cursor, (LINK_COUNT, 3)),
            twists=take(cursor, (LINK_COUNT, 6)),
            wrenches=take(cursor, (LINK_COUNT, 6)),
            gravity_B=take(cursor, (3,)),
            wind_B=take(cursor, (3,)),
            wind_rate_B=take(cursor, (3,)),
            normals=take(cursor, (3, 8)),
        ),
        H=take(cursor, (nv, nv)),
        h=take(cursor, (nv,)),
        loads=take(cursor, (STRIP_ROWS, n)),
        rates=take(cursor, (4, states)),
        start=take(cursor, (states,)),
        state=take(cursor, (states,)),
    )


def fill(fields: tuple[Any, ...], values: tuple[Any, ...]) -> None:
    """Copy values into the fields of a memory, in order; nested tuples into nested fields."""
    for field, value in zip(fields, values, strict=True):
        if isinstance(field, tuple):
            fill(field, value)
        else:
            field[...] = value
