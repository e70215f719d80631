"""Body, tail and fin in quasi-steady flow, compiled.

The tail is a flat plate of area S with force rho/2 S a |u| w, a = 2 pi / (1 + 2 / aspect ratio), in the wing's mean
downwash over the tail's span, times a factor. The fin is a vertical plate with side force -rho/2 S a |u| v at lateral
velocity v. The body is a drag area at its centre of mass.
"""

from __future__ import annotations

import numpy as np

from aerobat_pin.aerodynamics.strip_forces import Surfaces
from aerobat_pin.numerics import Array, inner


@inner
def add_surfaces(surfaces: Surfaces, density: float, base: Array, downwash: float, body: Array) -> None:
    """Add the wrench of body drag, tail and fin.

    Args:
        surfaces: constants of body, tail and fin.
        density: density of the air [kg/m3].
        base: (6,) twist of the body relative to the air, in body axes.
        downwash: mean downwash of the wing over the tail's span [m/s].
        body: (6,) wrench on the body; the forces are added in place.
    """
    tail, fin, drag_area = surfaces.tail, surfaces.fin, surfaces.drag_area[()]
    cosine, sine, tail_lift = surfaces.tail_cosine[()], surfaces.tail_sine[()], surfaces.tail_lift[()]
    factor, fin_lift = surfaces.downwash_factor[()], surfaces.fin_lift[()]
    speed = np.sqrt(base[0] ** 2 + base[1] ** 2 + base[2] ** 2)
    for k in range(3):
        body[k] -= 0.5 * density * drag_area * speed * base[k]
    x, y, z = tail[0], tail[1], tail[2]
    u = base[0] + base[4] * z - base[5] * y
    w = -(base[2] + base[3] * y - base[4] * x) - factor * downwash
    force = density * tail_lift * abs(u * cosine - w * sine) * (u * sine + w * cosine)
    fx, fz = -force * sine, force * cosine
    body[0] += fx
    body[2] += fz
    body[3] += y * fz
    body[4] += z * fx - x * fz
    body[5] -= y * fx
    x, y, z = fin[0], fin[1], fin[2]
    u = base[0] + base[4] * z - base[5] * y
    fy = -density * fin_lift * abs(u) * (base[1] + base[5] * x - base[3] * z)
    body[1] += fy
    body[3] -= z * fy
    body[5] += x * fy
