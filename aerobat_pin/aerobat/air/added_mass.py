"""Added mass in the equations of motion: the air that the wings accelerate, as a part of inertia and bias.

The normal velocity of a strip at mid-chord is n v, with a row vector n and the robot's velocity v. With the strips'
added masses m

    M_a = sum m n^T n        C_a = sum m n^T n'        M_a' = C_a + C_a^T        force on the robot -(M_a a + C_a v)

The added mass must be part of the inertia matrix: as a force computed before the accelerations it would diverge for
wings lighter than the air they accelerate. A strip that turns about its span has one more row n, that rate of turning,
with the moment of inertia m b^2 / 8. The strips of one link share a constant matrix G (see `robot_air`).
Factoring G = L D L^T leaves three rows for each link: the normal velocity at the centre of the link's added mass, and
two angular rates. With wind, v is replaced by the velocity relative to the air, and v' accordingly.

The force acts along the normal only. A rigid body of the same inertia would also feel the terms omega x (G v) and
v x (G v). These terms do no work, and the circulatory forces already contain them (lift at the 1/4 chord, suction).
"""

from __future__ import annotations

from typing import Annotated, NamedTuple

import numpy as np

from aerobat_pin.aerobat.link_kernels import Links, PinocchioResults, Tree
from aerobat_pin.numerics import Array, in_inner_axes, inlined, inner, rotated


class AddedMass(NamedTuple):
    """The added masses of the links, factored.

    The three `masses` of each link (5, 3) [kg, kg m2, kg m2] belong to the rows v_z + y omega_x - x omega_y,
    omega_x + skew omega_y, and omega_y. `x` and `y` (5,) [m] are the centre of the link's added mass, in its frame;
    `skew` (5,) is a number without unit.
    """

    masses: Annotated[Array, "link_count, 3"]
    x: Annotated[Array, "link_count"]
    y: Annotated[Array, "link_count"]
    skew: Annotated[Array, "link_count"]


def factored(G: Array) -> AddedMass:
    """Factor the links' added masses G (n, 3, 3)."""
    matrices = AddedMass(np.zeros((len(G), 3)), *np.zeros((3, len(G))))
    for link, g in enumerate(G):
        if g[0, 0] == 0.0:
            continue
        turning = g[1:, 1:] - np.outer(g[1:, 0], g[1:, 0]) / g[0, 0]
        # A single strip has no added moment of inertia about x: the rounding error in its place is set to zero.
        turning[np.abs(turning) < 1e-12 * np.max(np.abs(g[1:, 1:]))] = 0.0
        skew = turning[0, 1] / turning[0, 0] if turning[0, 0] > 0.0 else 0.0
        matrices.masses[link] = g[0, 0], turning[0, 0], turning[1, 1] - skew * turning[0, 1]
        matrices.x[link], matrices.y[link], matrices.skew[link] = -g[0, 2] / g[0, 0], g[0, 1] / g[0, 0], skew
    return matrices


@inlined
def write_normals(added: AddedMass, tree: Tree, liMi: Array, links: Links, link: int) -> int:
    """Write a link's rows n to `links.normals`, and return the number of their columns: 6, 7 or 8, see `Links`."""
    rows, x, y, skew = links.normals, added.x[link], added.y[link], added.skew[link]
    R, p, parent, size = links.rotation[link], links.origin[link], tree.parent[link], 6
    qx = p[0] + R[0, 0] * x + R[0, 1] * y  # centre of the added mass, in the body's frame
    qy = p[1] + R[1, 0] * x + R[1, 1] * y
    qz = p[2] + R[2, 0] * x + R[2, 1] * y
    zx, zy, zz = R[0, 2], R[1, 2], R[2, 2]
    rows[0, 0], rows[0, 1], rows[0, 2] = zx, zy, zz
    rows[0, 3], rows[0, 4], rows[0, 5] = qy * zz - qz * zy, qz * zx - qx * zz, qx * zy - qy * zx
    for i in range(3):
        rows[1, 3 + i], rows[2, 3 + i] = R[i, 0] + skew * R[i, 1], R[i, 1]
    if link > 0:
        turn = tree.axis[link]
        rows[0, 6] = turn[0] * y - turn[1] * x
        rows[1, 6], rows[2, 6] = turn[0] + skew * turn[1], turn[1]
        size = 7
    if parent > 0:
        P, a = liMi[tree.joint[link]], tree.axis[parent]
        wx, wy, _ = in_inner_axes(P, a[0], a[1], a[2])
        lift = (
            P[6] * (a[1] * P[11] - a[2] * P[10])
            + P[7] * (a[2] * P[9] - a[0] * P[11])
            + P[8] * (a[0] * P[10] - a[1] * P[9])
        )
        rows[0, 7], rows[1, 7], rows[2, 7] = lift + wx * y - wy * x, wx + skew * wy, wy
        size = 8
    return size


@inner
def add_mass(added: AddedMass, tree: Tree, results: PinocchioResults, links: Links, H: Array, h: Array) -> None:
    """Add the added inertia M_a to H, and the added bias C_a v, corrected for the wind, to h.

    Args:
        added: added masses of the links.
        tree: tree of the links.
        results: Pinocchio's results after `nonLinearEffects`.
        links: links placed by `place_links`; the field `normals` is overwritten.
        H: (nv, nv) inertia; M_a is added in place.
        h: (nv,) bias; C_a v is added in place.
    """
    rows, gravity, wind, wind_rate = links.normals, links.gravity_B, links.wind_B, links.wind_rate_B
    for link in range(tree.joint.shape[0]):
        mass = added.masses[link]
        if mass[0] == 0.0:
            continue
        size = write_normals(added, tree, results.liMi, links, link)
        # Accelerations relative to the air that are due to v alone.
        R, twist, bias = links.rotation[link], links.twists[link], results.a_gf[tree.joint[link]]
        along, across, _ = rotated(R.T, wind[0], wind[1], wind[2])
        rise = bias[2] + twist[3] * across - twist[4] * along
        for i in range(3):
            rise -= R[i, 2] * (gravity[i] + wind_rate[i])
        spin, tilt = bias[3], bias[4]
        rise = mass[0] * (rise + added.y[link] * spin - added.x[link] * tilt)
        spin = mass[1] * (spin + added.skew[link] * tilt)
        tilt *= mass[2]
        row, above = tree.row[link], tree.row[max(tree.parent[link], 0)]
        for i in range(size):
            column = i if i < 6 else (row if i == 6 else above)
            first, second, third = mass[0] * rows[0, i], 0.0, 0.0
            h[column] += rise * rows[0, i]
            if i > 2:
                second, third = mass[1] * rows[1, i], mass[2] * rows[2, i]
                h[column] += spin * rows[1, i] + tilt * rows[2, i]
            for j in range(i + 1):
                value = first * rows[0, j]
                if i > 2 and j > 2:
                    value += second * rows[1, j] + third * rows[2, j]
                other = column if i == j else (j if j < 6 else row)
                H[column, other] += value
                if i != j:
                    H[other, column] += value
