"""The air on Aerobat: a lifting line whose strips ride on the links, a quasi-steady tail, and the body's drag.

A strip lives in its link's frame: chord along x, normal along z. It sees the velocity of its own 3/4-chord point
against still air, u forward and w upward relative to the section, U = hypot(u, w), w_n = w |u| / U; spanwise flow is
ignored. At its 1/4-chord point act, per span, the lift along +z, the suction toward the leading edge, and the profile
drag rho/2 c cd0 U (-u, w). The tail is a flat plate, rho/2 S a |u| w with a = 2 pi / (1 + 2 / aspect ratio), in the
wing's centre-line downwash times a factor; the fin a vertical one, -rho/2 S a |u| v against its lateral velocity v; the
body a drag area at its centre of mass.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from aerobat_pin.aerodynamics.lifting_line import JONES_EPS, JONES_PSI, PHI0, LiftingLine
from aerobat_pin.arrays import Array, shaped
from aerobat_pin.jit import kernel
from aerobat_pin.wing import LINKS, Wing

EPS1, EPS2 = JONES_EPS
LAG1, LAG2 = JONES_PSI[0] * EPS1, JONES_PSI[1] * EPS2


@dataclass(frozen=True)
class StripLoads:
    """What each strip does, all (N,).

    Incidence [rad], effective velocity w_eff [m/s], circulation [m2/s], and the force [N] along the link's x (suction
    less drag) and z (lift plus drag).
    """

    incidence: Array
    effective_velocity: Array
    circulation: Array
    force_x: Array
    force_z: Array


class AirArrays(NamedTuple):
    """Constants of the air for the kernel.

    `strips` (N, 8): 1/4-chord point x, y, z and 3/4-chord point x, y, z in the link's frame, chord, width [m].
    `link` (N,): index into `LINKS`. `downwash` (N + 1, N): the operator D, and the centre line's row below it [1/m].
    `numbers` (6,): density, lift slope, cd0, body drag area, tail's downwash factor, tail's lift per rho |u| w [m2].
    `tail` (9,): the tail's centre x, y, z, cosine and sine of its incidence, the fin's centre, and its lift per
    rho |u| v [m2].
    """

    strips: Array
    link: NDArray[np.intp]
    downwash: Array
    numbers: Array
    tail: Array


@kernel
def air_loads(air: AirArrays, twists: Array, state: Array, wrenches: Array, rates: Array, loads: Array) -> None:
    """Compute the loads on the links and the rates of the air's state; equations in this module and `lifting_line`.

    Args:
        air: constants.
        twists: (5, 6) of the links, at and in their own frames.
        state: (3N,) zeta_1, zeta_2, circulation.
        wrenches: (5, 6) written: on the links, at and in their own frames, force first.
        rates: (3N,) written: of the state.
        loads: (5, N) written: u and w of the section, w_eff, force along x and along z.
    """
    count = air.link.shape[0]
    density, slope, cd0 = air.numbers[0], air.numbers[1], air.numbers[2]
    zeta1, zeta2, circulation = state[:count], state[count : 2 * count], state[2 * count :]
    wrenches[:] = 0.0
    for i in range(count):
        strip, link = air.strips[i], air.link[i]
        twist, wrench = twists[link], wrenches[link]
        qx, qy, qz, tx, ty, tz, chord, width = strip
        u = twist[0] + twist[4] * tz - twist[5] * ty
        w = -(twist[2] + twist[3] * ty - twist[4] * tx)
        speed = np.sqrt(u * u + w * w)
        wash = 0.0
        for j in range(count):
            wash += air.downwash[i, j] * circulation[j]
        w_total = (w * abs(u) / speed if speed > 0.0 else 0.0) - wash
        rate = 2.0 * speed / chord
        w_eff = PHI0 * w_total + rate * (LAG1 * zeta1[i] + LAG2 * zeta2[i])
        rates[i] = w_total - EPS1 * rate * zeta1[i]
        rates[count + i] = w_total - EPS2 * rate * zeta2[i]
        rates[2 * count + i] = -speed / chord * circulation[i] + 0.5 * slope * speed * w_eff
        pressure = 0.5 * density * chord * width
        drag = pressure * cd0 * speed
        suction = pressure * slope * w_eff * w_eff * np.sign(u)
        fx = suction - drag * u
        fz = pressure * slope * speed * w_eff + drag * w
        wrench[0] += fx
        wrench[2] += fz
        wrench[3] += qy * fz
        wrench[4] += qz * fx - qx * fz
        wrench[5] -= qy * fx
        loads[0, i], loads[1, i], loads[2, i], loads[3, i], loads[4, i] = u, w, w_eff, fx, fz

    base, body = twists[0], wrenches[0]
    speed = np.sqrt(base[0] ** 2 + base[1] ** 2 + base[2] ** 2)
    for k in range(3):
        body[k] -= 0.5 * density * air.numbers[3] * speed * base[k]
    centre = 0.0
    for j in range(count):
        centre += air.downwash[count, j] * circulation[j]
    x, y, z, cosine, sine = air.tail[:5]
    u = base[0] + base[4] * z - base[5] * y
    w = -(base[2] + base[3] * y - base[4] * x) - air.numbers[4] * centre
    force = density * air.numbers[5] * abs(u * cosine - w * sine) * (u * sine + w * cosine)
    fx, fz = -force * sine, force * cosine
    body[0] += fx
    body[2] += fz
    body[3] += y * fz
    body[4] += z * fx - x * fz
    body[5] -= y * fx
    x, y, z, lift = air.tail[5:]
    u = base[0] + base[4] * z - base[5] * y
    fy = -density * lift * abs(u) * (base[1] + base[5] * x - base[3] * z)
    body[1] += fy
    body[3] -= z * fy
    body[5] += x * fy


class RobotAir:
    """Unsteady aerodynamics of the robot, a pure function of link twists and aerodynamic state.

    Args:
        wing: the planform along the links.
        strips: number of strips over the full span.
        air_density: [kg/m3].
    """

    def __init__(self, wing: Wing, *, strips: int = 16, air_density: float = 1.225) -> None:
        """Place the strips on the links."""
        shape = wing.morphology
        self.line = line = LiftingLine(wing.span, wing.chord, strips=strips, air_density=air_density)
        self.link, origin = wing.attach(line.y)
        x = wing.leading_edge(line.y)
        quarter, three_quarter = (origin.copy() for _ in range(2))
        quarter[:, 0] += x - 0.25 * line.chord
        three_quarter[:, 0] += x - 0.75 * line.chord
        self.quarter_chord, self.three_quarter_chord = quarter, three_quarter  # (N, 3) [m] in the links' frames
        tail, drag = shape.tail, shape.aerodynamics
        lift = (
            0.0 if tail is None else 0.5 * tail.span * tail.chord * line.lift_slope / (1 + 2 * tail.chord / tail.span)
        )
        place = (0.0, 0.0, 0.0) if tail is None else tail.position
        tilt = 0.0 if tail is None else tail.incidence
        numbers = (
            air_density,
            line.lift_slope,
            drag.profile_drag,
            drag.body_drag_area,
            drag.tail_downwash_factor,
            lift,
        )
        fin = shape.fin
        blade = (0.0, 0.0, 0.0, 0.0) if fin is None else (*fin.position, 0.5 * fin.area * fin.lift_slope)
        self.arrays = AirArrays(
            strips=np.column_stack([quarter, three_quarter, line.chord, line.width]),
            link=self.link,
            downwash=np.vstack([line.downwash, line.centre_downwash]),
            numbers=np.array(numbers),
            tail=np.array([*place, np.cos(tilt), np.sin(tilt), *blade]),
        )

    @property
    def state_size(self) -> int:
        """Number of aerodynamic states."""
        return 3 * self.line.strips

    def evaluate(self, twists: Array, state: Array) -> tuple[Array, Array, StripLoads]:
        """Compute loads and state rates.

        Args:
            twists: (5, 6) twist of each link of `LINKS` at and in its own frame, linear first [m/s, rad/s].
            state: (3N,) aerodynamic state.

        Returns:
            Wrenches (5, 6) on the links at and in their own frames, force first [N, N m]; state rates (3N,); strips.

        Raises:
            ShapeError: an array does not fit.
        """
        twists, state = shaped(twists, (len(LINKS), 6), "twists"), shaped(state, (self.state_size,), "state")
        wrenches, rates = np.empty((len(LINKS), 6)), np.empty(self.state_size)
        loads = np.empty((5, self.line.strips))
        air_loads(self.arrays, twists, state, wrenches, rates, loads)
        u, w, w_eff, force_x, force_z = loads
        circulation = self.line.split(state)[2].copy()
        return wrenches, rates, StripLoads(np.arctan2(w, u), w_eff, circulation, force_x, force_z)
