"""Quasi-steady strips, compiled: a flapping fruit fly's force coefficients instead of the lifting line.

    CL = 0.225 + 1.58 sin(2.13 a - 7.2 deg)          CD = 1.92 - 1.55 cos(2.04 a - 9.82 deg)          a in degrees

Source: Dickinson, Lehmann & Sane 1999, Science 284: a robotic wing in oil, translation at constant velocity, 0 to 90
degrees. Outside that range the wing is its own mirror image: a = atan2(|w|, |u|), lift follows the sign of w, and drag
the flow. The fit has CL = 0.027 at 0 and 0.101 at 90 degrees, where symmetry wants 0: over one degree it is led there.

Velocity is taken and the force acts where `strip_forces` does both. No state, no downwash, no suction apart from these.
"""

from __future__ import annotations

import numpy as np

from aerobat_pin.aerodynamics.strip_forces import StripLoads, Strips, gather, sections
from aerobat_pin.numerics import Array, inner

DEGREE = np.pi / 180.0
BLEND = 1.0  # [deg] of incidence over which the fit is led to zero


@inner
def coefficients(incidence: float) -> tuple[float, float]:
    """Return CL and CD at an incidence of 0 to 90 degrees [deg]."""
    lift = 0.225 + 1.58 * np.sin((2.13 * incidence - 7.2) * DEGREE)
    drag = 1.92 - 1.55 * np.cos((2.04 * incidence - 9.82) * DEGREE)
    return lift * min(incidence / BLEND, (90.0 - incidence) / BLEND, 1.0), drag


@inner
def quasi_steady_loads(strips: Strips, twists: Array, wrenches: Array, rows: StripLoads) -> float:
    """Compute the strips' loads; arguments as of `strips.strip_loads`. Return the downwash on the centre line: none.

    `circulation` is the bound one of the lift, U c CL / 2, and `effective_velocity` the normal velocity w.
    """
    sections(strips, twists, rows)
    factor, per_semichord, us, ws, speeds = strips.force_factor, strips.per_semichord, rows.u, rows.w, rows.airspeed
    downwash, circulation, effective = rows.downwash, rows.circulation, rows.effective_velocity
    force_x, force_z = rows.force_x, rows.force_z
    for i in range(factor.shape[0]):
        u, w, speed = us[i], ws[i], speeds[i]
        lift, drag = coefficients(np.arctan2(abs(w), abs(u)) / DEGREE)
        push = factor[i] * speed
        downwash[i], effective[i] = 0.0, w
        circulation[i] = np.sign(w) * lift * speed / per_semichord[i]
        force_x[i] = push * (np.sign(u) * lift * abs(w) - drag * u)
        force_z[i] = push * (np.sign(w) * lift * abs(u) + drag * w)
    gather(strips, rows, wrenches)
    return 0.0
