"""How robot, air, hold and unknown forces lie in memory for the plant's kernels.

A compiled call pays for every array it is handed. The constants therefore travel as two flat arrays, and `unpack` gives
them their names back inside; so does `unpack_work` for the scratch.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from aerobat_pin.aerodynamics.robot_air import AirArrays
from aerobat_pin.arrays import Array
from aerobat_pin.jit import Integers, kernel

BODIES = 5


class Tree(NamedTuple):
    """The five links in the order of `LINKS`.

    `table` (5, 4): Pinocchio joint, parent link, first velocity, 0 shoulder or 1 elbow. `axis` (5, 3): joint axes.
    """

    table: Integers
    axis: Array


class Unknown(NamedTuple):
    """Unknown forces. `table` (n, 3): point, link, axes. `numbers` (n, 4): direction, amplitude. `points` (p, 4)."""

    table: Integers
    numbers: Array
    points: Array  # link, then x, y, z in the link's frame [m]


class Work(NamedTuple):
    """Scratch of the kernels.

    Link twists and two sets of link wrenches (3, 5, 6), rotations (5, 3, 3), strip loads (5, N), the base's equations
    (7, 6), and the base twists of the four stages (4, 6).
    """

    spatial: Array
    rotation: Array
    loads: Array
    base: Array
    twists: Array


class Constants(NamedTuple):
    """Everything about robot, air, hold and unknown forces that does not change in flight; `hold` may be empty."""

    air: AirArrays
    tree: Tree
    unknown: Unknown
    hold: Array


def pack(constants: Constants) -> tuple[Array, Integers]:
    """Flatten the constants into numbers and integers, in the order in which `unpack` reads them."""
    air, tree, unknown, hold = constants
    numbers = (*air[:1], *air[2:], tree.axis, unknown.numbers, unknown.points, hold)
    sizes = (len(air.link), len(unknown.table), len(unknown.points), len(hold))
    integers = (sizes, air.link, tree.table, unknown.table)
    return np.concatenate([np.ravel(x) for x in numbers]), np.concatenate([np.ravel(x) for x in integers])


@kernel
def unpack(numbers: Array, integers: Integers) -> Constants:
    """Give the flat constants their names and shapes back, without copying."""
    count, forces, points, hold = integers[0], integers[1], integers[2], integers[3]
    a = 8 * count
    b = a + (count + 1) * count
    c = b + 6
    d = c + 9
    e = d + 3 * BODIES
    f = e + 4 * forces
    g = f + 4 * points
    i = 4 + count
    j = i + 4 * BODIES
    return Constants(
        AirArrays(
            numbers[:a].reshape((count, 8)),
            integers[4:i],
            numbers[a:b].reshape((count + 1, count)),
            numbers[b:c],
            numbers[c:d],
        ),
        Tree(integers[i:j].reshape((BODIES, 4)), numbers[d:e].reshape((BODIES, 3))),
        Unknown(
            integers[j : j + 3 * forces].reshape((forces, 3)),
            numbers[e:f].reshape((forces, 4)),
            numbers[f:g].reshape((points, 4)),
        ),
        numbers[g : g + hold],
    )


def scratch(strips: int) -> Array:
    """Return the kernels' scratch for a number of strips."""
    return np.zeros(18 * BODIES + 9 * BODIES + 42 + 24 + 5 * strips)


@kernel
def unpack_work(flat: Array) -> Work:
    """Give the scratch its names and shapes."""
    a = 18 * BODIES
    b = a + 9 * BODIES
    loads = flat[b + 66 :]
    return Work(
        flat[:a].reshape((3, BODIES, 6)),
        flat[a:b].reshape((BODIES, 3, 3)),
        loads.reshape((5, loads.shape[0] // 5)),
        flat[b : b + 42].reshape((7, 6)),
        flat[b + 42 : b + 66].reshape((4, 6)),
    )
