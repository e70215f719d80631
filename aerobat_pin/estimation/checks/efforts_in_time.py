"""Efforts of a fixed robot that come at another time than its motion.

How fast they change is what a short delay does to the rows. Where that makes them likelier, efforts are taken so much
later and the rows formed anew. Friction, which turns with the motion, hides most of what is left of the delay; how much
of it follows from how it falls (secant method).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from aerobat_pin.estimation.checks.changes import LEFT_BY_CHANGE, Change, Formed
from aerobat_pin.estimation.checks.late_efforts import SETTLED_STEP, late_finding
from aerobat_pin.estimation.findings import Finding
from aerobat_pin.forces import EffortRows, Explanation, InputsBetween, KnownInputs, later_efforts, most_likely_with
from aerobat_pin.numerics import LATEST_SHIFT, SHIFT_STEPS, Array
from aerobat_pin.records import LARGEST_DELAY, Record

LEFT_BY_DELAY = 1.0 / 3.0  # of what is left, in squares: what is no delay, or another one, leaves more
LEAST_SEEN_REST = 0.05  # share of what is left of a delay that is seen at least


def change_of_time(
    record: Record,
    inputs: InputsBetween,
    rows: EffortRows,
    without: Explanation,
    as_mapped: Callable[[], EffortRows],
    formed: Formed,
) -> Change:
    """Return a delay of the efforts; the channels of a record at its own times cannot be shifted.

    `formed` returns the rows of other inputs, `as_mapped` those as mapped at the same instants.
    """
    short = Change(partial(_delay_told, record, 0.0), _changing(rows), leaves=LEFT_BY_CHANGE)
    gain, found = short.likely(rows, without)
    rest = move = float(found.size[0])
    if record.knots is not None or abs(rest) < _least_delay(record) or gain * found.independent < short.price:
        return short
    at, by, shifted = [record.robot.v_index(joint) for joint in record.driven], 0.0, rows

    def between(first: int, last: int) -> KnownInputs:
        given = inputs(first, last)
        tau = given.tau.copy()
        tau[:, at] = later_efforts(record, given.time, tau[:, at], by)
        return replace(given, tau=tau)

    for _ in range(SHIFT_STEPS):
        if abs(by + move) > LATEST_SHIFT:
            break
        by, before = by + move, rest
        shifted, _ = formed(between)
        rest = float(most_likely_with(shifted, _changing(shifted), without).size[0])
        move = rest / max((before - rest) / move, LEAST_SEEN_REST)
        if abs(move) < SETTLED_STEP * max(record.dt, abs(by)):
            break
    anew = (as_mapped(), shifted, _changing(shifted))
    return Change(partial(_delay_told, record, by), anew=lambda: anew, leaves=LEFT_BY_DELAY)


def _changing(rows: EffortRows) -> Array:
    """Return (m, k, 1) how fast the efforts of driven joints change [N/s, N m/s]."""
    return np.asarray((rows.rates[:, :, None] * np.eye(rows.y.shape[1])[:, rows.driven]).sum(axis=2, keepdims=True))


def _least_delay(record: Record) -> float:
    return max(LARGEST_DELAY, record.dt)


def _delay_told(record: Record, shifted: float, found: Explanation, left: str) -> Sequence[Finding]:
    by = shifted + float(found.size[0])
    return [] if abs(by) < _least_delay(record) else [late_finding(by, left)]
