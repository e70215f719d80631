"""Body, tail and fin in quasi-steady flow, compiled.

The tail is a flat plate, rho/2 S a |u| w with a = 2 pi / (1 + 2 / aspect ratio), in the wing's centre-line downwash
times a factor; the fin a vertical one, -rho/2 S a |u| v against its lateral velocity v; the body a drag area at its
centre of mass.
"""

from __future__ import annotations

import numpy as np

from aerobat_pin.aerodynamics.strips import Surfaces
from aerobat_pin.numerics import Array, inner


@inner
def add_surfaces(surfaces: Surfaces, density: float, base: Array, centre_downwash: float, body: Array) -> None:
    """Add the wrench of body drag, tail and fin.

    Args:
        surfaces: constants.
        density: of the air [kg/m3].
        base: (6,) twist of the body against the air, in its axes.
        centre_downwash: of the wing, on its centre line [m/s].
        body: (6,) wrench on the body, added to.
    """
    speed = np.sqrt(base[0] ** 2 + base[1] ** 2 + base[2] ** 2)
    for k in range(3):
        body[k] -= 0.5 * density * surfaces.drag_area[()] * speed * base[k]
    x, y, z = surfaces.tail[0], surfaces.tail[1], surfaces.tail[2]
    cosine, sine = surfaces.tail_cosine[()], surfaces.tail_sine[()]
    u = base[0] + base[4] * z - base[5] * y
    w = -(base[2] + base[3] * y - base[4] * x) - surfaces.downwash_factor[()] * centre_downwash
    force = density * surfaces.tail_lift[()] * abs(u * cosine - w * sine) * (u * sine + w * cosine)
    fx, fz = -force * sine, force * cosine
    body[0] += fx
    body[2] += fz
    body[3] += y * fz
    body[4] += z * fx - x * fz
    body[5] -= y * fx
    x, y, z = surfaces.fin[0], surfaces.fin[1], surfaces.fin[2]
    u = base[0] + base[4] * z - base[5] * y
    fy = -density * surfaces.fin_lift[()] * abs(u) * (base[1] + base[5] * x - base[3] * z)
    body[1] += fy
    body[3] -= z * fy
    body[5] += x * fy
