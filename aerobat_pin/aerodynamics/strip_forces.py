"""Unsteady strips on the links, compiled: from link twists to link wrenches and rates of the aerodynamic state.

A strip lies on one link, or across a joint on two: it is then divided into pieces, one on each link, with shares by
length. A piece is fixed to its link's frame: chord along x, normal along z. A strip's velocity is the mean of its
pieces' velocities, and each piece carries its share of the strip's force, so force times velocity is the power.
Spanwise flow is ignored. At mid-chord the strip moves forward through the air at u, and the air passes it upward at
w_m. With U = hypot(u, w_m), the cosine of the flow direction is c = u / U. For c = 1 the front edge leads, for c = -1
the rear edge. In between, the number

    lead = c (3 - c^2) / 2            flat at both ends: 1 - 3/8 incidence^4

moves the 1/4- and 3/4-chord points, which lie lead chord / 4 before and behind mid-chord, and scales the suction. So no
force jumps when the flow meets the strip broadside, and flow from behind gives the mirror image of flow from ahead.

    w_n = w |u| / U,  w at the 3/4 chord             lift and drag act at the 1/4 chord; equations in `lifting_line`
    f_x = lead suction - rho/2 chord cd0 U u         per span
    f_z = lift + rho/2 chord cd0 U w
    couple = -pi/2 rho b^3 lead u omega_y            Theodorsen's pitch-rate force, moved from mid-chord to 3/4 chord

`flapping_wing.fly` differs: there the input of the lifting line is w itself, as in potential flow. In steady flow both
laws give the normal force of an attached plate, a0 rho b |u| w, at any incidence. But here the suction is scaled by
lead c^2, so a plate has drag. The two laws agree up to incidence^2. At larger incidence, and wing tips exceed 40 to 60
degrees, this law lies between attached and stalled flow; docs/section_law.md compares it with measurements.

If a limit of the lift coefficient is set, w_eff is first reduced to w_eff / (1 + r^4)^(1/4), r = a0 w_eff / (U limit).
At half the limit this is 1.5 % less, and the lift coefficient never exceeds the limit.

Body, tail and fin are quasi-steady. The tail is a flat plate of area S with force rho/2 S a |u| w, a = 2 pi / (1 + 2 /
aspect ratio), in the wing's mean downwash over the tail's span, times a factor. The fin is a vertical plate with side
force -rho/2 S a |u| v at lateral velocity v. The body is a drag area at its centre of mass.
"""

from __future__ import annotations

from typing import Annotated, Any, NamedTuple

import numpy as np

from aerobat_pin.aerodynamics.lifting_line import JONES_EPS, JONES_PSI, PHI0
from aerobat_pin.numerics import Array, Integers, guarded, inner

EPS1, EPS2 = JONES_EPS
LAG1, LAG2 = JONES_PSI[0] * EPS1, JONES_PSI[1] * EPS2

Scalar = Any  # an array () as a view of a kernel's memory, a number as a value to be filled in


class Strips(NamedTuple):
    """The strips, each field (N,).

    `quarter_chord` is a quarter of the chord [m]; `per_semichord` is 1 / semichord [1/m]; `force_factor` is density
    chord width / 2 [kg/m].
    """

    quarter_chord: Annotated[Array, "n"]
    per_semichord: Annotated[Array, "n"]
    force_factor: Annotated[Array, "n"]


class Pieces(NamedTuple):
    """The strips' pieces on the links, each field (P,), ordered by strip.

    `strip` and `link` are indices, the latter into `LINKS`; `x`, `y`, `z` is the mid-chord point in the link's frame
    [m]; `share` is the share of the strip; `pitch_damping` times lead u omega_y is the couple [kg m].
    """

    strip: Annotated[Integers, "p"]
    link: Annotated[Integers, "p"]
    x: Annotated[Array, "p"]
    y: Annotated[Array, "p"]
    z: Annotated[Array, "p"]
    share: Annotated[Array, "p"]
    pitch_damping: Annotated[Array, "p"]


class Surfaces(NamedTuple):
    """Constants of body, tail and fin; points (3,) are in the body's frame [m].

    `drag_area` is that of the body [m2]. `downwash_factor` times the wing's mean downwash over the tail's span is the
    downwash at the tail. `tail` is the centre of the tail, `tail_cosine` and `tail_sine` give its incidence;
    `tail_lift` is its lift divided by rho |u| w [m2]. `fin` is the centre of the fin, `fin_lift` is its side force
    divided by rho |u| v [m2].
    """

    drag_area: Annotated[Scalar, ""]
    downwash_factor: Annotated[Scalar, ""]
    tail: Annotated[Array, "3"]
    tail_cosine: Annotated[Scalar, ""]
    tail_sine: Annotated[Scalar, ""]
    tail_lift: Annotated[Scalar, ""]
    fin: Annotated[Array, "3"]
    fin_lift: Annotated[Scalar, ""]


class AirConstants(NamedTuple):
    """Constants of the aerodynamic model of a robot.

    Numbers (): `quasi_steady` is 1 for the quasi-steady model and 0 for the lifting line, `density` [kg/m3],
    `lift_slope` [1/rad], `profile_drag` is the coefficient cd0, `slope_over_limit` is the lift slope divided by the
    limit of the lift coefficient, 0 for no limit. `downwash` (N, N) is the operator D [1/m], `tail_downwash` (N,)
    its mean over the tail's span.
    """

    quasi_steady: Annotated[Scalar, ""]
    density: Annotated[Scalar, ""]
    lift_slope: Annotated[Scalar, ""]
    profile_drag: Annotated[Scalar, ""]
    slope_over_limit: Annotated[Scalar, ""]
    strips: Strips
    pieces: Pieces
    downwash: Annotated[Array, "n, n"]
    tail_downwash: Annotated[Array, "n"]
    surfaces: Surfaces


class StripLoads(NamedTuple):
    """Flow and force at the strips, each field (..., N): the named rows of an array (..., 9, N) that kernels write.

    `u` is the forward speed through the air at mid-chord, `w` the upward velocity of the air at the 3/4 chord [m/s].
    `airspeed` is that at mid-chord in the strip's plane [m/s]. `lead` is 1 if the front edge leads, -1 if the rear edge
    leads, and in between otherwise. `downwash` [m/s], `circulation` [m2/s], `effective_velocity` w_eff [m/s].
    `force_x` (suction minus drag) and `force_z` (lift plus drag) [N] are along the link's x and z axes and act
    lead chord / 4 before mid-chord.
    """

    u: Array
    w: Array
    airspeed: Array
    lead: Array
    downwash: Array
    circulation: Array
    effective_velocity: Array
    force_x: Array
    force_z: Array

    @property
    def incidence(self) -> Array:
        """Incidence at the 3/4 chord [rad]; 0 at rest, even if u and w are negative zeros."""
        return np.asarray(np.arctan2(self.w + 0.0, self.u + 0.0))


STRIP_ROWS = len(StripLoads._fields)


@guarded(loads=(..., STRIP_ROWS, "n"))
def strips_of(loads: Array) -> StripLoads:
    """Return the rows of strip loads (..., 9, N) as named fields."""
    return StripLoads(*np.moveaxis(loads, -2, 0))


@inner
def strip_rows(loads: Array) -> StripLoads:
    """Return the rows of strip loads (9, N) as named fields, in a kernel."""
    return StripLoads(loads[0], loads[1], loads[2], loads[3], loads[4], loads[5], loads[6], loads[7], loads[8])


@inner
def sections(air: AirConstants, twists: Array, rows: StripLoads) -> None:
    """Write the rows `u`, `w`, `airspeed` and `lead` of each strip, and omega_y chord / 4 into the row `force_x`."""
    strip_of, link_of, x, y, z = air.pieces.strip, air.pieces.link, air.pieces.x, air.pieces.y, air.pieces.z
    share, quarter = air.pieces.share, air.strips.quarter_chord
    u, w, speed, lead, turn = rows.u, rows.w, rows.airspeed, rows.lead, rows.force_x
    u[:] = 0.0
    w[:] = 0.0
    turn[:] = 0.0
    for p in range(strip_of.shape[0]):
        i, link = strip_of[p], link_of[p]
        u[i] += share[p] * (twists[link, 0] + twists[link, 4] * z[p] - twists[link, 5] * y[p])
        w[i] -= share[p] * (twists[link, 2] + twists[link, 3] * y[p] - twists[link, 4] * x[p])
        turn[i] += share[p] * twists[link, 4] * quarter[i]
    for i in range(quarter.shape[0]):
        speed[i] = np.sqrt(u[i] * u[i] + w[i] * w[i])
        cosine = u[i] / speed[i] if speed[i] > 0.0 else 0.0
        lead[i] = 0.5 * cosine * (3.0 - cosine * cosine)
        w[i] -= lead[i] * turn[i]


@inner
def gather(air: AirConstants, twists: Array, rows: StripLoads, wrenches: Array) -> None:
    """Write the wrenches (5, 6) on the links: the strips' forces at the 1/4 chords, the couples of their turning."""
    strip_of, link_of, x, y, z = air.pieces.strip, air.pieces.link, air.pieces.x, air.pieces.y, air.pieces.z
    share, damping, quarter = air.pieces.share, air.pieces.pitch_damping, air.strips.quarter_chord
    force_x, force_z, lead, u = rows.force_x, rows.force_z, rows.lead, rows.u
    wrenches[:] = 0.0
    for p in range(strip_of.shape[0]):
        i, link = strip_of[p], link_of[p]
        wrench = wrenches[link]
        fx, fz = share[p] * force_x[i], share[p] * force_z[i]
        wrench[0] += fx
        wrench[2] += fz
        wrench[3] += y[p] * fz
        wrench[4] += z[p] * fx - (x[p] + lead[i] * quarter[i]) * fz - damping[p] * lead[i] * u[i] * twists[link, 4]
        wrench[5] -= y[p] * fx


@inner
def strip_loads(
    air: AirConstants, twists: Array, state: Array, wrenches: Array, rates: Array, rows: StripLoads
) -> float:
    """Compute the strips' loads and the rates of the state; return the mean downwash over the tail's span [m/s].

    Args:
        air: aerodynamic constants.
        twists: (5, 6) twists of the links relative to the air, at the origin and in the axes of each link's frame.
        state: (3N,) zeta_1, zeta_2, circulation.
        wrenches: (5, 6) written: wrenches on the links, at the same points and in the same axes, force first.
        rates: (3N,) written: rates of `state`.
        rows: written: flow and force at the strips.
    """
    strips = air.strips
    count = strips.quarter_chord.shape[0]
    slope, cd0, limit = air.lift_slope[()], air.profile_drag[()], air.slope_over_limit[()]
    zeta1, zeta2, circulation = state[:count], state[count : 2 * count], state[2 * count :]
    rate1, rate2, growth = rates[:count], rates[count : 2 * count], rates[2 * count :]
    per_semichord, factor = strips.per_semichord, strips.force_factor
    sections(air, twists, rows)
    u, w, speed, lead, wash = rows.u, rows.w, rows.airspeed, rows.lead, rows.downwash
    w_eff, bound, fx, fz = rows.effective_velocity, rows.circulation, rows.force_x, rows.force_z
    downwash, tail_downwash = air.downwash, air.tail_downwash
    for i in range(count):
        total = 0.0
        for j in range(count):
            total += downwash[i, j] * circulation[j]
        wash[i] = total
    for i in range(count):
        w_total = (w[i] * abs(u[i]) / speed[i] if speed[i] > 0.0 else 0.0) - wash[i]
        rate = speed[i] * per_semichord[i]
        w_eff[i] = PHI0 * w_total + rate * (LAG1 * zeta1[i] + LAG2 * zeta2[i])
        rate1[i] = w_total - EPS1 * rate * zeta1[i]
        rate2[i] = w_total - EPS2 * rate * zeta2[i]
    if limit > 0.0:
        for i in range(count):
            ratio = limit * w_eff[i] / speed[i] if speed[i] > 0.0 else np.inf
            w_eff[i] /= np.sqrt(np.sqrt(1.0 + ratio * ratio * ratio * ratio))
    for i in range(count):
        growth[i] = 0.5 * speed[i] * (slope * w_eff[i] - per_semichord[i] * circulation[i])
        drag = factor[i] * cd0 * speed[i]
        lift = factor[i] * slope * w_eff[i]
        bound[i] = circulation[i]
        edge = w_eff[i] + lead[i] * fx[i]  # Garrick's velocity at the leading edge: w_eff - b/2 of the nose-up rate
        fx[i] = lead[i] * factor[i] * slope * edge * edge - drag * u[i]
        fz[i] = lift * speed[i] + drag * w[i]
    gather(air, twists, rows, wrenches)
    mean = 0.0
    for j in range(count):
        mean += tail_downwash[j] * circulation[j]
    return mean


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
