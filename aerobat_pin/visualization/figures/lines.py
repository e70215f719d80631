"""Long series as lines of a figure, by the extremes of each stretch; limits that show small errors."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from matplotlib.axes import Axes

from aerobat_pin.forces import StoredEstimate
from aerobat_pin.numerics import Array
from aerobat_pin.observers import Estimate

MOST_DRAWN = 4000  # of a line; a longer one is drawn by the extremes of each of its stretches
READ = 50_000  # samples that are read at once
Lines = tuple[Array, Array]
MARGIN = 0.05  # above and below what is drawn, of its height
HIDDEN = 0.2  # of the largest error: smaller ones would be flat lines on its scale


def thinned(count: int, read: Callable[[int, int], Lines]) -> Lines:
    """Return times (m,) and values (m, k) of a long series by the extremes of its stretches, of a short one as it is.

    `read` returns times (n,) and values (n, k) of the samples from one index to another (exclusive).
    """
    if count <= MOST_DRAWN:
        return read(0, count)
    size = -(-count // (MOST_DRAWN // 2))
    times, values = [], []
    for first in range(0, count, size * max(1, READ // size)):
        time, rows = read(first, min(first + size * max(1, READ // size), count))
        starts = np.arange(0, len(time), size)
        low, high = np.fmin.reduceat(rows, starts), np.fmax.reduceat(rows, starts)
        times.append(np.repeat(time[np.minimum(starts + size // 2, len(time) - 1)], 2))
        values.append(np.stack([low, high], axis=1).reshape(2 * len(starts), -1))
    return np.concatenate(times), np.concatenate(values)


def estimate_lines(
    estimate: StoredEstimate, values_of: Callable[[Estimate, int], Array], begin: float = -np.inf, end: float = np.inf
) -> Lines:
    """Return values (n, k) of an estimate over the middles (n,) [s] of its intervals that start in [begin, end) [s].

    `values_of` returns the values (n, k) of some intervals, given these and the index of the first.
    """
    low, high = estimate.index(begin), estimate.index(end)

    def read(first: int, last: int) -> Lines:
        rows = slice(low + first, low + last)
        middle = 0.5 * (estimate.start[rows] + estimate.ends[rows])
        return middle, values_of(estimate.between(rows.start, rows.stop), rows.start)

    return broken(*thinned(high - low, read), estimate.holes)


def broken(time: Array, values: Array, holes: Sequence[float]) -> Lines:
    """Return lines (m,), (m, k) with NaN at a moment [s] in each hole, so that they do not go over it."""
    at = np.searchsorted(time, holes)
    at = at[(at > 0) & (at < len(time))]
    return np.insert(time, at, np.nan), np.insert(values, at, np.nan, axis=0)


def fit_errors(rows: Sequence[Sequence[Axes]], begin: float = -np.inf) -> None:
    """Fit rows of panels of errors; all get one scale, unless it hides those of a row."""
    sizes = [fit_to_drawn(axes, begin) for axes in rows]
    if min(sizes) > HIDDEN * max(sizes):
        panels = [axis for axes in rows for axis in axes]
        lows, highs = zip(*(panel.get_ylim() for panel in panels), strict=True)
        for panel in panels:
            panel.set_ylim(min(lows), max(highs))


def fit_to_drawn(axes: Sequence[Axes], begin: float = -np.inf) -> float:
    """Give panels the limits that fit all that is drawn in them from a time [s] on; return the height of that."""
    ends = []
    for axis in axes:
        places = [line.get_xydata() for line in axis.lines]
        places += [path.vertices for band in axis.collections for path in band.get_paths() if band.get_hatch() is None]
        drawn = np.concatenate([np.empty((0, 2)), *(np.asarray(points, float) for points in places)])
        drawn = drawn[np.all(np.isfinite(drawn), axis=1)]
        late = drawn[drawn[:, 0] >= begin]
        ends += [late if len(late) else drawn] if len(drawn) else []
    if not ends:
        return 0.0
    low, high = (float(extreme(np.concatenate(ends)[:, 1])) for extreme in (np.min, np.max))
    margin = MARGIN * (high - low) or 1e-6
    for axis in axes:
        axis.set_ylim(low - margin, high + margin)
    return high - low
