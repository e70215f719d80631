"""The links as the air meets them, compiled: where they are in the body's frame, and how fast they move through it."""

from __future__ import annotations

from typing import NamedTuple

from aerobat_pin.numerics import Array, copy_values, inner
from aerobat_pin.robot import Tree, chain


class PinocchioResults(NamedTuple):
    """Pinocchio's results where it keeps them.

    M (nv, nv), nle (nv,), liMi (njoints, 12) rotation by columns then translation, v and a_gf (njoints, 6).
    """

    M: Array
    nle: Array
    liMi: Array
    v: Array
    a_gf: Array


class Links(NamedTuple):
    """The five links at one instant.

    `rotation` (5, 3, 3) and `origin` (5, 3) in the body's frame; `twists` (5, 6) against the air and `wrenches` (5, 6)
    of the air, at and in the links' own frames; in body axes (3,) `gravity_B`, its acceleration upward, `wind_B`, the
    velocity of the air, and `wind_rate_B`; `normals` (3, 8) scratch of `add_mass`: the rows n of the base, of the
    parent's joint and of the link's own.
    """

    rotation: Array
    origin: Array
    twists: Array
    wrenches: Array
    gravity_B: Array
    wind_B: Array
    wind_rate_B: Array
    normals: Array


@inner
def place_links(tree: Tree, found: PinocchioResults, gravity: Array, wind: Array, links: Links) -> None:
    """Write where the links are and their twists against the air, gravity and wind in body axes.

    Args:
        tree: of the links.
        found: Pinocchio's placements and twists.
        gravity: () [m/s2].
        wind: (2, 3) velocity of the air and its rate, world axes.
        links: written, but for `wrenches` and `normals`.
    """
    chain(tree, found.liMi, links.rotation, links.origin)
    joint, v, rotation, twists = tree.joint, found.v, links.rotation, links.twists
    gravity_B, wind_B, wind_rate_B = links.gravity_B, links.wind_B, links.wind_rate_B
    body = found.liMi[joint[0]]
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
