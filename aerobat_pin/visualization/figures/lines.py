"""Long series as lines of a figure: by the extremes of each stretch, so that no peak is lost."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from aerobat_pin.estimation import StoredEstimate
from aerobat_pin.numerics import Array
from aerobat_pin.observers import Estimate

MOST_DRAWN = 4000  # of a line; a longer one is drawn by the extremes of each of its stretches
READ = 50_000  # samples that are read at once
Lines = tuple[Array, Array]


def thinned(count: int, read: Callable[[int, int], Lines]) -> Lines:
    """Return a long series by the extremes of each of its stretches, or a short one as it is.

    Args:
        count: number of samples.
        read: function that returns times (n,) and values (n, k) of the samples from one index to another (exclusive).

    Returns:
        Times (m,) and values (m, k).
    """
    if count <= MOST_DRAWN:
        return read(0, count)
    size = -(-count // (MOST_DRAWN // 2))
    times, values = [], []
    for first in range(0, count, size * max(1, READ // size)):
        time, found = read(first, min(first + size * max(1, READ // size), count))
        starts = np.arange(0, len(time), size)
        low, high = np.minimum.reduceat(found, starts), np.maximum.reduceat(found, starts)
        times.append(np.repeat(time[np.minimum(starts + size // 2, len(time) - 1)], 2))
        values.append(np.stack([low, high], axis=1).reshape(2 * len(starts), -1))
    return np.concatenate(times), np.concatenate(values)


def estimate_lines(
    estimate: StoredEstimate, values_of: Callable[[Estimate, int], Array], begin: float = -np.inf, end: float = np.inf
) -> Lines:
    """Return values (n, k) of an estimate over the middles (n,) [s] of its intervals between two times [s].

    Args:
        estimate: the estimate.
        values_of: function that returns the values (n, k) of some intervals, given these and the index of the first.
        begin: time from which the intervals start.
        end: time before which they start.
    """
    low, high = estimate.index(begin), estimate.index(end)

    def read(first: int, last: int) -> Lines:
        part = estimate.between(low + first, low + last)
        return 0.5 * (part.time[1:] + part.time[:-1]), values_of(part, low + first)

    return thinned(high - low, read)
