"""Kinematics of the links for aerodynamics, compiled: placement in the body's frame, and motion relative to the air."""

from __future__ import annotations

from typing import Annotated, NamedTuple

from aerobat_pin.aerobat.link_kernels import Tree, chain
from aerobat_pin.numerics import ELSEWHERE, Array, copy_values, inner


class PinocchioResults(NamedTuple):
    """Views of Pinocchio's results in a `pin.Data`.

    Inertia `M` (nv, nv), bias `nle` (nv,), joint placements `liMi` (njoints, 12) as rotation by columns, then
    translation, joint twists `v` (njoints, 6), and accelerations `a_gf` (njoints, 6), which include gravity.
    """

    M: Annotated[Array, "nv, nv", ELSEWHERE]
    nle: Annotated[Array, "nv", ELSEWHERE]
    liMi: Annotated[Array, "joints, 12", ELSEWHERE]
    v: Annotated[Array, "joints, 6", ELSEWHERE]
    a_gf: Annotated[Array, "joints, 6", ELSEWHERE]


class Links(NamedTuple):
    """The five links at one instant.

    `rotation` (5, 3, 3) and `origin` (5, 3) place the links in the body's frame. `twists` (5, 6) relative to the air
    and `wrenches` (5, 6) from the air are both at the origin and in the axes of each link's frame. Vectors (3,) in body
    axes: `gravity_B`, gravitational acceleration with its sign reversed (upward), `wind_B`, the wind velocity, and
    `wind_rate_B`, its rate of change. `normals` (3, 8) is a scratch array of `add_mass`: three rows, with columns for
    the six base velocities, the link's joint and the parent's joint, in this order.
    """

    rotation: Annotated[Array, "link_count, 3, 3"]
    origin: Annotated[Array, "link_count, 3"]
    twists: Annotated[Array, "link_count, 6"]
    wrenches: Annotated[Array, "link_count, 6"]
    gravity_B: Annotated[Array, "3"]
    wind_B: Annotated[Array, "3"]
    wind_rate_B: Annotated[Array, "3"]
    normals: Annotated[Array, "3, 8"]


@inner
def place_links(tree: Tree, results: PinocchioResults, gravity: Array, wind: Array, links: Links) -> None:
    """Write placements of the links, their twists relative to the air, and gravity and wind in body axes.

    Args:
        tree: tree of the links.
        results: Pinocchio's placements and twists.
        gravity: () gravitational acceleration, positive downward [m/s2].
        wind: (2, 3) wind velocity and its rate of change, world axes.
        links: all fields except `wrenches` and `normals` are written.
    """
    chain(tree, results.liMi, links.rotation, links.origin)
    joint, v, rotation, twists = tree.joint, results.v, links.rotation, links.twists
    gravity_B, wind_B, wind_rate_B = links.gravity_B, links.wind_B, links.wind_rate_B
    body = results.liMi[joint[0]]
    for i in range(3):
        x, y, z = body[3 * i], body[3 * i + 1], body[3 * i + 2]
        gravity_B[i] = gravity[()] * z
        wind_B[i] = x * wind[0, 0] + y * wind[0, 1] + z * wind[0, 2]
        wind_rate_B[i] = x * wind[1, 0] + y * wind[1, 1] + z * wind[1, 2]
    for link in range(joint.shape[0]):
        R, twist = rotation[link], twists[link]
        copy_values(v[joint[link]], twist)
        for i in range(3):
            twist[i] -= R[0, i] * wind_B[0] + R[1, i] * wind_B[1] + R[2, i] * wind_B[2]
