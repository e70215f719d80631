"""The unsteady strips on the links, compiled: from the links' twists to their wrenches and the air's rates.

A strip lives in its link's frame: chord along x, normal along z. Spanwise flow is ignored. With the mid-chord point's
velocity against the air, u forward and w_m upward relative to the section, U = hypot(u, w_m) and the flow's cosine
c = u / U. The edge that leads is the front one where c = 1 and the rear one where c = -1; in between

    lead = c (3 - c^2) / 2            flat at both ends: 1 - 3/8 incidence^4

carries the 3/4- and 1/4-chord points, c/4 behind and before mid-chord as the flow sees it, from one edge to the other,
and scales the suction. So nothing jumps in broadside flow, and flow from behind is flow from ahead seen in a mirror.

    w_n = w |u| / U,  w at the 3/4 chord             lift and drag act at the 1/4 chord; equations in `lifting_line`
    f_x = lead suction - rho/2 c cd0 U u             per span
    f_z = lift + rho/2 c cd0 U w

This is not the law of `stroke.fly`, which drives the line with w itself, as potential flow has it. With w |u| / U the
steady normal force a0 rho b |u| w is the attached plate's at any incidence, in both; but suction here falls with lead
c^2, so that a plate drags. The two agree up to incidence^2; beyond, this law lies between attached and stalled flow,
for tips that pass 40 to 60 degrees (docs/design/0006-added-mass.md, docs/lifting_line.md).

A limit of the lift coefficient, where one is set, bends w_eff before anything uses it: with r = a0 w_eff / (U limit),
w_eff / (1 + r^4)^(1/4) is 1.5 % less at half the limit and never passes it.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from aerobat_pin.aerodynamics.lifting_line import JONES_EPS, JONES_PSI, PHI0
from aerobat_pin.numerics import Array, inner

EPS1, EPS2 = JONES_EPS
LAG1, LAG2 = JONES_PSI[0] * EPS1, JONES_PSI[1] * EPS2
U, W, SPEED, LEAD, DOWNWASH, CIRCULATION, EFFECTIVE, FORCE_X, FORCE_Z = range(9)  # rows of the strips' loads
LOADS = 9


class AirArrays(NamedTuple):
    """Constants of the air for the kernels.

    `strips` (6, N): mid-chord x, y, z in the link's frame [m], quarter of the chord [m], one over the semichord [1/m],
    half of density, chord and width [kg/m]. `link` (N,): index into `LINKS`. `downwash` (N + 1, N): the operator D, and
    the centre line's row below it [1/m]. `numbers` (7,): density, lift slope, cd0, body drag area, tail's downwash
    factor, tail's lift per rho |u| w [m2], lift slope over the limit of the lift coefficient, or 0 for no limit.
    `tail` (9,): the tail's centre x, y, z, cosine and sine of its incidence, the fin's centre, its lift per rho |u| v
    [m2].
    """

    strips: Array
    link: NDArray[np.intp]
    downwash: Array
    numbers: Array
    tail: Array


@inner
def sections(air: AirArrays, twists: Array, loads: Array) -> None:
    """Write the flow at each strip: the rows U, W (at the 3/4 chord), SPEED and LEAD of `loads`."""
    count = air.link.shape[0]
    x, y, z, quarter = air.strips[0], air.strips[1], air.strips[2], air.strips[3]
    u, w, speed, lead, turn = loads[U], loads[W], loads[SPEED], loads[LEAD], loads[FORCE_X]
    for i in range(count):
        link = air.link[i]
        u[i] = twists[link, 0] + twists[link, 4] * z[i] - twists[link, 5] * y[i]
        w[i] = -(twists[link, 2] + twists[link, 3] * y[i] - twists[link, 4] * x[i])
        turn[i] = twists[link, 4] * quarter[i]
    for i in range(count):
        speed[i] = np.sqrt(u[i] * u[i] + w[i] * w[i])
        cosine = u[i] / speed[i] if speed[i] > 0.0 else 0.0
        lead[i] = 0.5 * cosine * (3.0 - cosine * cosine)
        w[i] -= lead[i] * turn[i]


@inner
def gather(air: AirArrays, loads: Array, wrenches: Array) -> None:
    """Write the links' wrenches (5, 6) of the strips' forces at their 1/4 chords."""
    wrenches[:] = 0.0
    x, y, z, quarter = air.strips[0], air.strips[1], air.strips[2], air.strips[3]
    for i in range(air.link.shape[0]):
        wrench = wrenches[air.link[i]]
        fx, fz = loads[FORCE_X, i], loads[FORCE_Z, i]
        wrench[0] += fx
        wrench[2] += fz
        wrench[3] += y[i] * fz
        wrench[4] += z[i] * fx - (x[i] + loads[LEAD, i] * quarter[i]) * fz
        wrench[5] -= y[i] * fx


@inner
def strip_loads(air: AirArrays, twists: Array, state: Array, wrenches: Array, rates: Array, loads: Array) -> float:
    """Compute the strips' loads and the rates of the air's state; returns the downwash on the centre line [m/s].

    Args:
        air: constants.
        twists: (5, 6) of the links against the air, at and in their own frames.
        state: (3N,) zeta_1, zeta_2, circulation.
        wrenches: (5, 6) written: on the links, at and in their own frames, force first.
        rates: (3N,) written: of the state.
        loads: (9, N) written: in the rows U, W, SPEED, LEAD, DOWNWASH, CIRCULATION, EFFECTIVE, FORCE_X, FORCE_Z.
    """
    count = air.link.shape[0]
    slope, cd0, limit = air.numbers[1], air.numbers[2], air.numbers[6]
    zeta1, zeta2, circulation = state[:count], state[count : 2 * count], state[2 * count :]
    rate1, rate2, growth = rates[:count], rates[count : 2 * count], rates[2 * count :]
    per_semichord, pressure = air.strips[4], air.strips[5]
    sections(air, twists, loads)
    u, w, speed, lead, wash = loads[U], loads[W], loads[SPEED], loads[LEAD], loads[DOWNWASH]
    w_eff, fx, fz = loads[EFFECTIVE], loads[FORCE_X], loads[FORCE_Z]
    for i in range(count):
        total = 0.0
        for j in range(count):
            total += air.downwash[i, j] * circulation[j]
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
        drag = pressure[i] * cd0 * speed[i]
        lift = pressure[i] * slope * w_eff[i]
        loads[CIRCULATION, i] = circulation[i]
        fx[i] = lead[i] * lift * w_eff[i] - drag * u[i]
        fz[i] = lift * speed[i] + drag * w[i]
    gather(air, loads, wrenches)
    centre = 0.0
    for j in range(count):
        centre += air.downwash[count, j] * circulation[j]
    return centre
