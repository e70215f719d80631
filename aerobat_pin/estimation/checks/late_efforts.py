"""Check when the efforts are recorded against the motion: late or early by a clock, a filter or a driver.

The balance is solved with the efforts a time s later, beside friction and rotors, whose columns are X:

    needed - reach effort(t + s) = X b + e

Gauss-Newton finds the s that leaves least. A filter of first order acts as a delay of its time constant. Errors of
masses and of friction follow the motion and its rate, and leave as much at any s.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from aerobat_pin.estimation.findings import Finding
from aerobat_pin.forces import Balance
from aerobat_pin.numerics import LATEST_SHIFT, SHIFT_STEPS
from aerobat_pin.records import LARGEST_DELAY, Record

LEFT_BY_SHIFT = 0.7  # of the square sum that friction and rotors leave: a shift that leaves more is not named
SETTLED_STEP = 0.1  # of a sample, or of the shift: the search has ended


def late_efforts(record: Record, balance: Balance, least: float) -> Finding | None:
    """Return that efforts fit the motion far better at another time, and than what leaves a share `least`; or None.

    It is None for a record at its own times, whose channels cannot be shifted.
    """
    by = before = left = 0.0
    for round_ in range(SHIFT_STEPS if record.knots is None else 0):
        left, step = _left_and_step(record, balance, by)
        before = left if round_ == 0 else before
        if abs(step) < SETTLED_STEP * max(record.dt, abs(by)) or abs(by + step) > LATEST_SHIFT:
            break
        by += step
    if left > min(LEFT_BY_SHIFT * before, least) or abs(by) < max(LARGEST_DELAY, record.dt):
        return None
    leaves = f"{100.0 * left**0.5:.2g} % of what weight and motion need, as mapped {100.0 * before**0.5:.2g} %"
    return late_finding(by, leaves)


def late_finding(by: float, leaves: str) -> Finding:
    """Return that efforts come a time [s] after the motion, or, if it is negative, the motion after them."""
    early, late, parts = "the motion", "joints.effort", "effort"
    if by < 0.0:
        early, late, parts = late, early, "position and joints.velocity"
    text = (
        f"{late} comes {1e3 * abs(by):.0f} ms after {early}: shifted by that, beside friction, it leaves {leaves}: a "
        f"clock, a filter or a slow sensor (in a map: delay = {abs(by):.3f} under joints.{parts})"
    )
    return Finding("late efforts", "warning", text, by, "s")


def _left_and_step(record: Record, balance: Balance, by: float) -> tuple[float, float]:
    """Return which share of what is needed efforts a time [s] later leave, and by how much later they leave less."""
    apart = 2.0 * record.dt
    earlier, later = (balance.later(by + offset) for offset in (-apart, apart))
    slope = ((later - earlier) / (2.0 * apart))[balance.at]
    shifted = replace(balance, effort=balance.later(by))
    others = np.column_stack([balance.rubbing, balance.reach * balance.a[balance.at]])
    both = np.column_stack([others, -np.sum(balance.reach * slope, axis=1)])
    left = shifted.residual + others @ shifted.explained_by(others)
    return float(left @ left) / balance.size, float(shifted.explained_by(both)[-1])
