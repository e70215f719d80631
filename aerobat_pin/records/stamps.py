"""The order of the samples of one clock, which may repeat a stamp, go back, be set anew, or be off for a moment."""

from __future__ import annotations

from bisect import bisect_right
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from aerobat_pin.numerics import Array

FEW = 10  # rows whose stamps do not fit between their neighbours': they are left out
LONG_STEP = 10.0  # usual steps; a longer one ends a stretch of rows, as the clock may have been set
OTHER_EPOCH = 3600.0  # [s] from all others, of a single first or last stamp that is left out


@dataclass(frozen=True)
class Order:
    """Which rows of a clock are used.

    Attributes:
        rows: (m,) their indices, in the order of their stamps, which can repeat.
        off: number of rows left out because their stamps do not fit between their neighbours'.
        backward: number of rows left out because they go back to times that have samples already.
        set_back: how often rows stand before earlier ones, as the clock was set back between them.
    """

    rows: NDArray[np.intp]
    off: int
    backward: int
    set_back: int


def stands_alone(*pairs: Array) -> bool:
    """Return whether two neighbouring stamps (2,) [s] of a pair are so far apart that one is of another epoch."""
    return any(len(pair) == 2 and pair[1] - pair[0] > OTHER_EPOCH for pair in pairs)


def in_order(time: Array) -> Order:
    """Return how the rows of stamps (n,) [s] are used.

    Where time goes back and only a few rows do not fit, before or behind, these are off. Otherwise the clock was set:
    each stretch stands where its stamps say, without the rows at whose times an earlier stretch has samples.
    """
    finite = np.flatnonzero(np.isfinite(time))
    stretches: list[Any] = []
    for rows in np.split(finite, np.flatnonzero(np.diff(time[finite]) < 0.0) + 1):
        while stretches and len(rows):
            before = stretches[-1]
            tail = len(before) - int(np.searchsorted(time[before], time[rows[0]], side="right"))
            head = int(np.searchsorted(time[rows], time[before[-1]]))
            if min(head, tail) >= FEW or tail == 0:
                break
            if head <= tail:
                rows = rows[head:]
            elif tail < len(before):
                stretches[-1] = before[: len(before) - tail]
            else:
                stretches.pop()
        if len(rows):
            stretches.append(rows)
    fitting = sum(map(len, stretches))
    placed = _placed(time, stretches)
    if not placed:
        return Order(finite[:0], len(time), 0, 0)
    rows = np.concatenate(placed)
    first, last = (len(rows) > 2 and stands_alone(time[pair]) for pair in (rows[:2], rows[-2:]))
    used = rows[int(first) : len(rows) - int(last)]
    return Order(used, len(time) - fitting + len(rows) - len(used), fitting - len(rows), int(np.sum(np.diff(used) < 0)))


def _placed(time: Array, stretches: list[Any]) -> list[Any]:
    """Return stretches of rows by their stamps, cut where these jump, without rows at times that are taken."""
    steps = np.concatenate([np.diff(time[rows]) for rows in stretches] or [np.zeros(0)])
    longest = LONG_STEP * float(np.median(steps[steps > 0.0])) if np.any(steps > 0.0) else np.inf
    firsts: list[float] = []  # and last stamps of what is found so far
    lasts: list[float] = []
    found: list[Any] = []
    for stretch in stretches:
        for rows in np.split(stretch, np.flatnonzero(np.diff(time[stretch]) > longest) + 1):
            stamps = time[rows]
            low, high = max(bisect_right(firsts, stamps[0]) - 1, 0), bisect_right(firsts, stamps[-1])
            at = np.searchsorted(firsts[low:high], stamps, side="right") - 1
            free = (at < 0) | (stamps > np.array([*lasts[low:high], np.inf])[at])
            for piece in np.split(rows[free], np.flatnonzero(np.diff(at[free])) + 1):
                if len(piece):
                    k = bisect_right(firsts, time[piece[0]])
                    firsts.insert(k, float(time[piece[0]]))
                    lasts.insert(k, float(time[piece[-1]]))
                    found.insert(k, piece)
    return found
