"""Unsteady strips on the links, compiled: from the links' twists to their wrenches and the rates of the air's state.

A strip lives in its link's frame: chord along x, normal along z. Spanwise flow is ignored. With the mid-chord point's
velocity against the air, u forward and w_m upward relative to the section, U = hypot(u, w_m) and the flow's cosine
c = u / U. The edge that leads is the front one where c = 1 and the rear one where c = -1; in between

    lead = c (3 - c^2) / 2            flat at both ends: 1 - 3/8 incidence^4

carries the 3/4- and 1/4-chord points, c/4 behind and before mid-chord as the flow sees it, from one edge to the other,
and scales the suction. So nothing jumps in broadside flow, and flow from behind is flow from ahead seen in a mirror.

    w_n = w |u| / U,  w at the 3/4 chord             lift and drag act at the 1/4 chord; equations in `lifting_line`
    f_x = lead suction - rho/2 c cd0 U u             per span
    f_z = lift + rho/2 c cd0 U w

This is not the law of `flapping_wing.fly`, which drives the line with w itself, as potential flow has it. With
w |u| / U the steady normal force a0 rho b |u| w is the attached plate's at any incidence, in both; but suction here
falls with lead c^2, so that a plate drags. The two agree up to incidence^2; beyond, this law lies between attached and
stalled flow, for tips that pass 40 to 60 degrees (docs/design/0006-added-mass.md, docs/lifting_line.md).

A limit of the lift coefficient, where one is set, bends w_eff before anything uses it: with r = a0 w_eff / (U limit),
w_eff / (1 + r^4)^(1/4) is 1.5 % less at half the limit and never passes it.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from aerobat_pin.aerodynamics.lifting_line import JONES_EPS, JONES_PSI, PHI0
from aerobat_pin.numerics import Array, Integers, inner

EPS1, EPS2 = JONES_EPS
LAG1, LAG2 = JONES_PSI[0] * EPS1, JONES_PSI[1] * EPS2

Scalar = Any  # an array without axes where it lies in a kernel's memory, a number where it is filled in


class Strips(NamedTuple):
    """The strips on the links, each field (N,).

    `link` is the index into `LINKS`; `x`, `y`, `z` the mid-chord point in the link's frame [m]; `quarter_chord` a
    quarter of the chord [m]; `per_semichord` [1/m]; `force_factor` half of density, chord and width [kg/m].
    """

    link: Integers
    x: Array
    y: Array
    z: Array
    quarter_chord: Array
    per_semichord: Array
    force_factor: Array


class Surfaces(NamedTuple):
    """Body, tail and fin: numbers () and points (3,) of the body [m].

    `drag_area` of the body [m2]; `downwash_factor` of the wing's downwash at the tail; `tail` its centre, cosine and
    sine of its incidence, `tail_lift` per rho |u| w [m2]; `fin` its centre, `fin_lift` per rho |u| v [m2].
    """

    drag_area: Scalar
    downwash_factor: Scalar
    tail: Array
    tail_cosine: Scalar
    tail_sine: Scalar
    tail_lift: Scalar
    fin: Array
    fin_lift: Scalar


class AirConstants(NamedTuple):
    """What does not change of the air on a robot.

    Numbers (): `quasi_steady` 1 for the quasi-steady model and 0 for the lifting line, `density` [kg/m3],
    `lift_slope` [1/rad], `profile_drag` coefficient, `slope_over_limit` of the lift coefficient, 0 for no limit.
    `downwash` (N, N) is the operator D [1/m], `centre_downwash` (N,) its row on the centre line.
    """

    quasi_steady: Scalar
    density: Scalar
    lift_slope: Scalar
    profile_drag: Scalar
    slope_over_limit: Scalar
    strips: Strips
    downwash: Array
    centre_downwash: Array
    surfaces: Surfaces


class StripLoads(NamedTuple):
    """What the strips do, each field (..., N): the rows of their loads (..., 9, N), which kernels write.

    `u` forward and `w` upward [m/s], the flow at mid-chord and at the 3/4 chord; `airspeed` at mid-chord in the strip's
    plane [m/s]; share `lead` of the edge that leads, 1 the front one and -1 the rear one; `downwash` [m/s];
    `circulation` [m2/s]; `effective_velocity` w_eff [m/s]; the force [N] along the link's x (suction less drag) and z
    (lift plus drag), which acts lead c/4 before mid-chord.
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
        """Incidence at the 3/4 chord [rad]; 0 at rest, whatever the sign of the zeros."""
        return np.asarray(np.arctan2(self.w + 0.0, self.u + 0.0))


STRIP_ROWS = len(StripLoads._fields)


def strips_of(loads: Array) -> StripLoads:
    """Name the rows of strip loads (..., 9, N)."""
    return StripLoads(*np.moveaxis(loads, -2, 0))


@inner
def strip_rows(loads: Array) -> StripLoads:
    """Name the rows of strip loads (9, N)."""
    return StripLoads(loads[0], loads[1], loads[2], loads[3], loads[4], loads[5], loads[6], loads[7], loads[8])


@inner
def sections(strips: Strips, twists: Array, rows: StripLoads) -> None:
    """Write the flow at each strip: `u`, `w` (at the 3/4 chord), `airspeed` and `lead`."""
    count = strips.link.shape[0]
    link_of, x, y, z, quarter = strips.link, strips.x, strips.y, strips.z, strips.quarter_chord
    u, w, speed, lead, turn = rows.u, rows.w, rows.airspeed, rows.lead, rows.force_x
    for i in range(count):
        link = link_of[i]
        u[i] = twists[link, 0] + twists[link, 4] * z[i] - twists[link, 5] * y[i]
        w[i] = -(twists[link, 2] + twists[link, 3] * y[i] - twists[link, 4] * x[i])
        turn[i] = twists[link, 4] * quarter[i]
    for i in range(count):
        speed[i] = np.sqrt(u[i] * u[i] + w[i] * w[i])
        cosine = u[i] / speed[i] if speed[i] > 0.0 else 0.0
        lead[i] = 0.5 * cosine * (3.0 - cosine * cosine)
        w[i] -= lead[i] * turn[i]


@inner
def gather(strips: Strips, rows: StripLoads, wrenches: Array) -> None:
    """Write the links' wrenches (5, 6) of the strips' forces at their 1/4 chords."""
    link, x, y, z, quarter = strips.link, strips.x, strips.y, strips.z, strips.quarter_chord
    force_x, force_z, lead = rows.force_x, rows.force_z, rows.lead
    wrenches[:] = 0.0
    for i in range(link.shape[0]):
        wrench = wrenches[link[i]]
        fx, fz = force_x[i], force_z[i]
        wrench[0] += fx
        wrench[2] += fz
        wrench[3] += y[i] * fz
        wrench[4] += z[i] * fx - (x[i] + lead[i] * quarter[i]) * fz
        wrench[5] -= y[i] * fx


@inner
def strip_loads(
    air: AirConstants, twists: Array, state: Array, wrenches: Array, rates: Array, rows: StripLoads
) -> float:
    """Compute the strips' loads and the rates of the air's state; return the downwash on the centre line [m/s].

    Args:
        air: constants.
        twists: (5, 6) of the links against the air, at and in their own frames.
        state: (3N,) zeta_1, zeta_2, circulation.
        wrenches: (5, 6) written: on the links, at and in their own frames, force first.
        rates: (3N,) written: of the state.
        rows: written: the strips' loads.
    """
    strips = air.strips
    count = strips.link.shape[0]
    slope, cd0, limit = air.lift_slope[()], air.profile_drag[()], air.slope_over_limit[()]
    zeta1, zeta2, circulation = state[:count], state[count : 2 * count], state[2 * count :]
    rate1, rate2, growth = rates[:count], rates[count : 2 * count], rates[2 * count :]
    per_semichord, factor = strips.per_semichord, strips.force_factor
    sections(strips, twists, rows)
    u, w, speed, lead, wash = rows.u, rows.w, rows.airspeed, rows.lead, rows.downwash
    w_eff, bound, fx, fz = rows.effective_velocity, rows.circulation, rows.force_x, rows.force_z
    downwash, centre_downwash = air.downwash, air.centre_downwash
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
        fx[i] = lead[i] * lift * w_eff[i] - drag * u[i]
        fz[i] = lift * speed[i] + drag * w[i]
    gather(strips, rows, wrenches)
    centre = 0.0
    for j in range(count):
        centre += centre_downwash[j] * circulation[j]
    return centre
