"""Three dyads in a row: from the crank angle to every bar and pin."""

from __future__ import annotations

import numpy as np

from aerobat_description.morphology_tables import LinkageLengths
from aerobat_pin.linkage.arms import bent_arms
from aerobat_pin.linkage.moving import Angle, Pin, bar_angle, meet, still
from aerobat_pin.numerics import Array


def close_dyads(bars: LinkageLengths, crank_angle: Array) -> tuple[dict[str, Angle], dict[str, Pin]]:
    """Close the dyads at J4, J7 and J10 one after the other.

    Args:
        bars: bar lengths and pivots.
        crank_angle: absolute t1, any shape [rad].

    Returns:
        The angles of the bars, and the pins. If a dyad cannot close, its values and all that follow are NaN.
    """
    arm = bent_arms(bars)
    t1 = Angle(crank_angle[()], np.ones_like(crank_angle)[()], np.zeros_like(crank_angle)[()])
    j1, j5, j8 = (still(complex(*pivot), crank_angle) for pivot in (bars.P1, bars.P5, bars.P8))
    with np.errstate(invalid="ignore"):
        j2 = j1 + t1.carry(bars.L1)
        j4 = meet(j2, bars.L2a, j5, abs(arm.J5_J4))
        t2, t5 = bar_angle(j2, j4, bars.L2a), bar_angle(j5, j4, arm.J5_J4)
        j3 = j2 + t2.carry(arm.J2_J3)
        j7 = meet(j3, bars.L4, j8, abs(arm.J8_J7))
        t3, t8 = bar_angle(j3, j7, bars.L4), bar_angle(j8, j7, arm.J8_J7)
        j9 = j8 + t8.carry(arm.J8_J9)
        j6 = j5 + t5.carry(arm.J5_J6)
        j10 = meet(j9, bars.L6, j6, abs(arm.J6_J10))
        t9, t6 = bar_angle(j9, j10, bars.L6), bar_angle(j6, j10, arm.J6_J10)
    angles = {"t1": t1, "t2": t2, "t3": t3, "t5": t5, "t6": t6, "t8": t8, "t9": t9}
    pins = {"J1": j1, "J2": j2, "J3": j3, "J4": j4, "J5": j5, "J6": j6, "J7": j7, "J8": j8, "J9": j9, "J10": j10}
    return angles, pins
