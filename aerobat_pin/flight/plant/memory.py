"""How robot, air, hold and unknown forces lie in memory for the plant's kernels.

A compiled call pays for every array it is handed, and for every view of one that it makes. Constants, scratch and
Pinocchio's results are therefore found by address, in one array of integers that a call begins with; `unpack` gives
them their names back inside.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pinocchio as pin

from aerobat_pin.aerodynamics import LOADS, AirArrays, RobotAir, factored
from aerobat_pin.flight.attitude_hold import AttitudeHold
from aerobat_pin.flight.point_forces import PointForce
from aerobat_pin.numerics import (
    DOUBLE,
    Array,
    Integers,
    addresses,
    array_at,
    check_views,
    frame_id,
    integers_at,
    kernel,
    motions,
    placements,
)
from aerobat_pin.robot import LINKS, Tree, tree_of

AXES = ("link", "body", "world")
BODIES = 5
PLACES = 7  # addresses in front of the integers: numbers, scratch, M, nle, liMi, v, a_gf
SIZES = 6  # then sizes: strips, forces, points, hold, nv, njoints
INTEGER = 8  # bytes


class Unknown(NamedTuple):
    """Unknown forces. `table` (n, 3): point, link, axes. `numbers` (n, 4): direction, amplitude. `points` (p, 4)."""

    table: Integers
    numbers: Array
    points: Array  # link, then x, y, z in the link's frame [m]


class Constants(NamedTuple):
    """Everything about robot, air, hold and unknown forces that does not change in flight; `hold` may be empty.

    `mass` (5, 6) is the added mass of the links, see `added_mass.factored`; `gravity` (1,) [m/s2].
    """

    air: AirArrays
    mass: Array
    gravity: Array
    tree: Tree
    unknown: Unknown
    hold: Array


class Work(NamedTuple):
    """Scratch of the kernels.

    Two sets of link twists, the second against the air, and two of link wrenches (4, 5, 6); rotations (5, 3, 3) and
    origins (5, 3) of the links in the body's frame; gravity and the air's motion in body axes (3, 3); rows of added
    mass (3, 8); inertia and bias with added mass (nv + 1, nv); the base's equations (7, 6); strip loads (9, N); the
    base twists of the four stages (4, 6).
    """

    spatial: Array
    rotation: Array
    origin: Array
    field: Array
    rows: Array
    inertia: Array
    base: Array
    loads: Array
    twists: Array


class Found(NamedTuple):
    """Pinocchio's results as they are: M (nv, nv), nle (nv,), liMi (njoints, 12), v and a_gf (njoints, 6)."""

    M: Array
    nle: Array
    liMi: Array
    v: Array
    a_gf: Array


def unknown_of(model: pin.Model, forces: tuple[PointForce, ...], points: tuple[str, ...]) -> Unknown:
    """Place unknown forces on the links, at the frames named in `points`."""
    carriers = [model.frames[model.getFrameId(link)].parentJoint for link in LINKS]
    frames = [model.frames[frame_id(model, name)] for name in points]
    links = [carriers.index(frame.parentJoint) for frame in frames]
    table, numbers = [], []
    for force in forces:
        point = points.index(force.frame)
        turned = frames[point].placement.rotation if force.axes == "link" else np.eye(3)
        table.append((point, links[point], AXES.index(force.axes)))
        numbers.append([*(turned @ force.direction), force.signal.elbow_amplitude])
    places = [[link, *frame.placement.translation] for link, frame in zip(links, frames, strict=True)]
    return Unknown(
        np.array(table, dtype=np.intp).reshape(-1, 3),
        np.array(numbers, dtype=float).reshape(-1, 4),
        np.array(places, dtype=float).reshape(-1, 4),
    )


def pack(constants: Constants) -> tuple[Array, Integers]:
    """Flatten the constants into numbers and integers, in the order in which `unpack` reads them."""
    air, mass, gravity, tree, unknown, hold = constants
    of_air = (air.strips, air.downwash, air.numbers, air.tail, mass, gravity)
    numbers = (*of_air, tree.axis, unknown.numbers, unknown.points, hold)
    integers = (air.link, tree.table, unknown.table)
    return np.concatenate([np.ravel(x) for x in numbers]), np.concatenate([np.ravel(x) for x in integers])


def layout(
    model: pin.Model,
    data: pin.Data,
    air: RobotAir,
    forces: tuple[PointForce, ...] = (),
    points: tuple[str, ...] = (),
    hold: AttitudeHold | None = None,
) -> tuple[Constants, Integers, tuple[Array, Array]]:
    """Lay out a robot in its air.

    Args:
        model: of the robot.
        data: where the kernels find Pinocchio's results; they live as long as it does.
        air: on the robot.
        forces: unknown ones that push.
        points: frames at which they push.
        hold: that holds the attitude.

    Returns:
        The constants; the array of integers that a kernel's call begins with; numbers and scratch, which must outlive
        it.
    """
    found = Found(data.M, data.nle, placements(data.liMi), motions(data.v), motions(data.a_gf))
    check_views(model, data, placements(data.oMi), *found[2:])
    constants = Constants(
        air.arrays,
        factored(air.added_mass),
        np.array([-model.gravity.linear[2]]),
        tree_of(model),
        unknown_of(model, forces, points),
        np.zeros(0) if hold is None else hold.packed,
    )
    numbers, integers = pack(constants)
    count, nv = air.line.strips, int(model.nv)
    scratch = np.zeros(scratch_size(count, nv))
    places = addresses(numbers, scratch, *found)
    sizes = (count, len(forces), len(points), len(constants.hold), nv, model.njoints)
    return constants, np.concatenate([places, sizes, integers]), (numbers, scratch)


@kernel
def unpack(integers: Integers) -> Constants:
    """Give the constants their names and shapes, without copying."""
    count, forces, points, hold = integers[PLACES], integers[PLACES + 1], integers[PLACES + 2], integers[PLACES + 3]
    a = integers[0]
    b = a + DOUBLE * 6 * count
    c = b + DOUBLE * (count + 1) * count
    d = c + DOUBLE * 7
    e = d + DOUBLE * 9
    f = e + DOUBLE * 6 * BODIES
    g = f + DOUBLE
    h = g + DOUBLE * 3 * BODIES
    i = h + DOUBLE * 4 * forces
    j = i + DOUBLE * 4 * points
    k = integers.ctypes.data + INTEGER * (PLACES + SIZES)
    m = k + INTEGER * count
    n = m + INTEGER * 4 * BODIES
    return Constants(
        AirArrays(
            array_at(a, (6, count)),
            integers_at(k, (count,)),
            array_at(b, (count + 1, count)),
            array_at(c, (7,)),
            array_at(d, (9,)),
        ),
        array_at(e, (BODIES, 6)),
        array_at(f, (1,)),
        Tree(integers_at(m, (BODIES, 4)), array_at(g, (BODIES, 3))),
        Unknown(integers_at(n, (forces, 3)), array_at(h, (forces, 4)), array_at(i, (points, 4))),
        array_at(j, (hold,)),
    )


@kernel
def unpack_found(integers: Integers) -> Found:
    """View Pinocchio's results."""
    nv, joints = integers[PLACES + 4], integers[PLACES + 5]
    return Found(
        array_at(integers[2], (nv, nv)),
        array_at(integers[3], (nv,)),
        array_at(integers[4], (joints, 12)),
        array_at(integers[5], (joints, 6)),
        array_at(integers[6], (joints, 6)),
    )


def scratch_size(strips: int, nv: int) -> int:
    """Return the number of doubles of the kernels' scratch."""
    return 24 * BODIES + 9 * BODIES + 3 * BODIES + 9 + 24 + (nv + 1) * nv + 42 + LOADS * strips + 24


@kernel
def unpack_work(integers: Integers) -> Work:
    """Give the scratch its names and shapes."""
    count, nv = integers[PLACES], integers[PLACES + 4]
    a = integers[1]
    b = a + DOUBLE * 24 * BODIES
    c = b + DOUBLE * 9 * BODIES
    d = c + DOUBLE * 3 * BODIES
    e = d + DOUBLE * 9
    f = e + DOUBLE * 24
    g = f + DOUBLE * (nv + 1) * nv
    h = g + DOUBLE * 42
    i = h + DOUBLE * LOADS * count
    return Work(
        array_at(a, (4, BODIES, 6)),
        array_at(b, (BODIES, 3, 3)),
        array_at(c, (BODIES, 3)),
        array_at(d, (3, 3)),
        array_at(e, (3, 8)),
        array_at(f, (nv + 1, nv)),
        array_at(g, (7, 6)),
        array_at(h, (LOADS, count)),
        array_at(i, (4, 6)),
    )
