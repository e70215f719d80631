"""Check the joints' positions against the limits that the robot's file states."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from aerobat_pin.estimation.findings import Finding
from aerobat_pin.numerics import Array
from aerobat_pin.records import Record

RARE = 0.05  # share of the samples on either side that may be a sensor's faults
SLIGHT = 0.25  # of the range: so far beyond its file's limits a real joint may be
A_TURN, TEN_RANGES = 2.0 * math.pi, 10.0  # [rad], ranges beyond them: no joint that has limits ever is there
UNLIMITED = 1e6  # [rad, m]: a wider range, as of a joint that turns on and on, is none
SMALLER = {"rad": ("deg", math.pi / 180.0), "m": ("mm", 1e-3)}  # unit -> what may have been meant


def limit_findings(record: Record, positions: Array) -> Iterator[Finding]:
    """Yield that joints are beyond their limits, and why that may be: refused where no joint ever is.

    Args:
        record: the record.
        positions: (m, n) positions of its joints [rad, m].
    """
    model, beyond, certain, meant = record.robot.model, [], False, True
    for joint, column in zip(record.joints, positions.T, strict=True):
        at, unit = record.robot.q_index(joint), "m" if record.robot.slides(joint) else "rad"
        low, high = float(model.lowerPositionLimit[at]), float(model.upperPositionLimit[at])
        least, most = np.quantile(column, (RARE, 1.0 - RARE))
        excess, span = float(max(low - least, most - high)), high - low
        if not 0.0 < span < UNLIMITED or excess <= SLIGHT * span:
            continue
        where = f"{joint} is at {least:.3g} to {most:.3g} {unit}, its limits are {low:.3g} to {high:.3g} {unit}"
        beyond.append((excess / span, joint, where, unit))
        certain |= excess > (A_TURN if unit == "rad" else TEN_RANGES * span)
        meant &= low <= least * SMALLER[unit][1] and most * SMALLER[unit][1] <= high
    if not beyond:
        return
    worst, first, where, unit = max(beyond)
    others = ", ".join(joint for _, joint, _, _ in beyond if joint != first)
    cause = f'unit = "{SMALLER[unit][0]}" for joints.position would leave all within them, or ' if meant else ""
    cause += (
        'another zero or gear (joints.offset, joints.factor), order or robot, or it turns on and on (type="continuous")'
    )
    text = f"{where}{'; beyond theirs, too: ' if others else ''}{others}; {cause}"
    yield Finding("joint limits", "refused" if certain else "warning", text, worst, "ranges")
