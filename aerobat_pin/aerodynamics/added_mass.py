"""Added mass in the equations of motion: the air that the wings drag along, as a part of inertia and bias.

Row n of strip s gives its normal velocity at mid-chord, n v. With the added masses m

    M_a = sum m n^T n        C_a = sum m n^T n'        M_a' = C_a + C_a^T        force on the robot -(M_a a + C_a v)

It must stand in the inertia: as a force computed beforehand it diverges for wings lighter than their air. The strips of
one link share a constant G (see `robot_air`), and G = L D L^T leaves three rows a link: the normal velocity at the
centre of its added mass, and two rates of turning. Wind enters as the air's own velocity: n (v - v_air), and its rate.

The force acts along the normal, and not as a rigid body of that inertia would: the terms omega x (G v) and
v x (G v) by which the two differ do no work, and circulation holds them already (lift at the 1/4 chord, suction).
"""

from __future__ import annotations

import numpy as np

from aerobat_pin.numerics import Array, Integers, inner


def factored(G: Array) -> Array:
    """Factor the links' added masses (n, 3, 3) as (n, 6): three masses [kg, kg m2, kg m2], centre x and y [m], skew.

    The rows that the masses belong to: v_z + y omega_x - x omega_y, omega_x + skew omega_y, omega_y.
    """
    out = np.zeros((len(G), 6))
    for row, g in zip(out, G, strict=True):
        if g[0, 0] == 0.0:
            continue
        turning = g[1:, 1:] - np.outer(g[1:, 0], g[1:, 0]) / g[0, 0]
        # One strip alone turns freely; what rounding leaves of its inertia is not one.
        turning[np.abs(turning) < 1e-12 * np.max(np.abs(g[1:, 1:]))] = 0.0
        skew = turning[0, 1] / turning[0, 0] if turning[0, 0] > 0.0 else 0.0
        row[:3] = g[0, 0], turning[0, 0], turning[1, 1] - skew * turning[0, 1]
        row[3:] = -g[0, 2] / g[0, 0], g[0, 1] / g[0, 0], skew
    return out


@inner
def add_mass(
    mass: Array,
    table: Integers,
    axis: Array,
    liMi: Array,
    rotation: Array,
    origin: Array,
    twists: Array,
    bias: Array,
    field: Array,
    rows: Array,
    H: Array,
    h: Array,
) -> None:
    """Add M_a to H and C_a v, less what the air's own motion takes away, to h.

    Args:
        mass: (5, 6) of the links, see `factored`.
        table: (5, 4) of the tree: joint, parent link, first velocity, 0 shoulder or 1 elbow.
        axis: (5, 3) of the joints, in their links' frames.
        liMi: (njoints, 12) placements in the parents.
        rotation: (5, 3, 3) links to body.
        origin: (5, 3) of the links in the body's frame.
        twists: (5, 6) of the links against the air, at and in their own frames.
        bias: (njoints, 6) accelerations of the links under v alone, less gravity's: `data.a_gf` after the bias.
        field: (3, 3) rows in body axes: gravity's acceleration upward, velocity of the air, its rate.
        rows: (3, 8) scratch: n of the base, of the parent's joint and of the link's own.
        H: (nv, nv) inertia, added to.
        h: (nv,) bias, added to.
    """
    for link in range(table.shape[0]):
        if mass[link, 0] == 0.0:
            continue
        x, y, skew = mass[link, 3], mass[link, 4], mass[link, 5]
        R, p = rotation[link], origin[link]
        qx = p[0] + R[0, 0] * x + R[0, 1] * y
        qy = p[1] + R[1, 0] * x + R[1, 1] * y
        qz = p[2] + R[2, 0] * x + R[2, 1] * y
        zx, zy, zz = R[0, 2], R[1, 2], R[2, 2]
        rows[0, 0], rows[0, 1], rows[0, 2] = zx, zy, zz
        rows[0, 3], rows[0, 4], rows[0, 5] = qy * zz - qz * zy, qz * zx - qx * zz, qx * zy - qy * zx
        for i in range(3):
            rows[1, 3 + i], rows[2, 3 + i] = R[i, 0] + skew * R[i, 1], R[i, 1]
        joint, parent, own, above = table[link, 0], table[link, 1], table[link, 2], 0
        size = 6
        if link > 0:
            rows[0, 6] = axis[link, 0] * y - axis[link, 1] * x
            rows[1, 6], rows[2, 6] = axis[link, 0] + skew * axis[link, 1], axis[link, 1]
            size = 7
        if parent > 0:
            P, a = liMi[joint], axis[parent]
            above = table[parent, 2]
            wx, wy = P[0] * a[0] + P[1] * a[1] + P[2] * a[2], P[3] * a[0] + P[4] * a[1] + P[5] * a[2]
            lift = (
                P[6] * (a[1] * P[11] - a[2] * P[10])
                + P[7] * (a[2] * P[9] - a[0] * P[11])
                + P[8] * (a[0] * P[10] - a[1] * P[9])
            )
            rows[0, 7], rows[1, 7], rows[2, 7] = lift + wx * y - wy * x, wx + skew * wy, wy
            size = 8
        # Accelerations that v alone brings about, against the air.
        turning = twists[link]
        along = R[0, 0] * field[1, 0] + R[1, 0] * field[1, 1] + R[2, 0] * field[1, 2]
        across = R[0, 1] * field[1, 0] + R[1, 1] * field[1, 1] + R[2, 1] * field[1, 2]
        rise = bias[joint, 2] + turning[3] * across - turning[4] * along
        for i in range(3):
            rise -= R[i, 2] * (field[0, i] + field[2, i])
        spin, tilt = bias[joint, 3], bias[joint, 4]
        rise, spin = mass[link, 0] * (rise + y * spin - x * tilt), mass[link, 1] * (spin + skew * tilt)
        tilt *= mass[link, 2]
        for i in range(size):
            column = i if i < 6 else (own if i == 6 else above)
            first, second, third = mass[link, 0] * rows[0, i], 0.0, 0.0
            h[column] += rise * rows[0, i]
            if i > 2:
                second, third = mass[link, 1] * rows[1, i], mass[link, 2] * rows[2, i]
                h[column] += spin * rows[1, i] + tilt * rows[2, i]
            for j in range(i + 1):
                value = first * rows[0, j]
                if i > 2 and j > 2:
                    value += second * rows[1, j] + third * rows[2, j]
                other = column if i == j else (j if j < 6 else own)
                H[column, other] += value
                if i != j:
                    H[other, column] += value
