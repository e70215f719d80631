"""Memory layouts of the aerodynamic kernels (see `numerics.memory`): aerodynamic constants, and a robot in its air."""

from __future__ import annotations

from typing import Annotated, Any, NamedTuple

from aerobat_pin.aerodynamics.added_mass import AddedMass
from aerobat_pin.aerodynamics.links import Links, PinocchioResults
from aerobat_pin.aerodynamics.strip_forces import STRIP_ROWS, AirConstants
from aerobat_pin.numerics import Array, array_at, layout_of, merged, next_size, rewind
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
    gravity: Annotated[Array, ""]
    tree: Tree
    found: PinocchioResults
    links: Links
    H: Annotated[Array, "nv, nv"]
    h: Annotated[Array, "nv"]
    loads: Annotated[Array, "strip_rows, n"]
    rates: Annotated[Array, "4, states"]
    start: Annotated[Array, "states"]
    state: Annotated[Array, "states"]


air_fields = layout_of(AirConstants, "n", "p")
robot_fields = layout_of(RobotMemory, "air", "found", "link_count", "nv", "strip_rows", "n", "states")


@merged
def air_in(memory: Array) -> AirConstants:
    """Lay out the aerodynamic constants. Sizes: number of strips, and of their pieces."""
    cursor = rewind(memory)
    n, p = next_size(cursor), next_size(cursor)
    return air_fields(cursor, n, p)


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
    found = PinocchioResults(
        M=array_at(M, (nv, nv)),
        nle=array_at(nle, (nv,)),
        liMi=array_at(liMi, (joints, 12)),
        v=array_at(v, (joints, 6)),
        a_gf=array_at(a_gf, (joints, 6)),
    )
    return robot_fields(cursor, air_in(array_at(air, (1,))), found, LINK_COUNT, nv, STRIP_ROWS, n, states)


def fill(fields: tuple[Any, ...], values: tuple[Any, ...]) -> None:
    """Copy values into the fields of a memory, in order; nested tuples into nested fields."""
    for field, value in zip(fields, values, strict=True):
        if isinstance(field, tuple):
            fill(field, value)
        else:
            field[...] = value
