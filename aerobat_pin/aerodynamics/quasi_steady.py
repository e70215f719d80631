"""Quasi-steady strips, compiled: a flapping fruit fly's force coefficients instead of the lifting line.

    CL = 0.225 + 1.58 sin(2.13 a - 7.2 deg)          CD = 1.92 - 1.55 cos(2.04 a - 9.82 deg)          a in degrees

Source: Dickinson, Lehmann & Sane 1999, Science 284: a robotic wing in oil, translation at constant velocity, 0 to 90
degrees. Outside that range the coefficients are mirrored: a = atan2(|w|, |u|), the lift changes sign with w, and the
drag acts along the flow. The fit gives CL = 0.027 at 0 and 0.101 at 90 degrees, where symmetry requires 0: over the
last degree at both ends CL goes linearly to 0.

Velocity is evaluated and force acts at the same points as in `strip_forces`. The model has no state, no downwash, and
no suction besides CL and CD.
"""

from __future__ import annotations

import numpy as np

from aerobat_pin.aerodynamics.strip_forces import AirConstants, StripLoads, gather, sections
from aerobat_pin.numerics import Array, inner

DEGREE = np.pi / 180.0
BLEND = 1.0  # [deg] range of incidence over which CL goes to zero, at both ends


@inner
def coefficients(incidence: float) -> tuple[float, float]:
    """Return CL and CD at an incidence of 0 to 90 degrees [deg]."""
    lift = 0.225 + 1.58 * np.sin((2.13 * incidence - 7.2) * DEGREE)
    drag = 1.92 - 1.55 * np.cos((2.04 * incidence - 9.82) * DEGREE)
    return lift * min(incidence / BLEND, (90.0 - incidence) / BLEND, 1.0), drag


@inner
def quasi_steady_loads(air: AirConstants, twists: Array, wrenches: Array, rows: StripLoads) -> float:
    """Compute the strips' loads, with the arguments of `strip_loads`; return the downwash at the tail, always 0.

    The row `circulation` is the bound circulation of this lift, U chord CL / 2; `effective_velocity` is the normal
    velocity w.
    """
    sections(air, twists, rows)
    factor, per_semichord = air.strips.force_factor, air.strips.per_semichord
    us, ws, speeds = rows.u, rows.w, rows.airspeed
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
    gather(air, twists, rows, wrenches)
    return 0.0
