"""The estimate of one observer over a whole recording, on disk if it is long: appended and read block by block."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from dataclasses import replace
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np

from aerobat_pin.forces.deviations import DOUBT_STRETCH, ComponentSize, InnovationScore, worst_stretch
from aerobat_pin.numerics import Array
from aerobat_pin.observers import Estimate, Redundancy
from aerobat_pin.records import MOST_SAMPLED, Series, Spool, spread_stretches

ROWS_READ = 50_000  # intervals that are read at once
TIME_CONSTANTS_TO_SETTLE = 5.0  # time constants after which an estimate counts as settled
RISEN = 3.0  # times its median: a larger deviation at the start says that the observer knows nothing yet


class StoredEstimate:
    """Blocks of intervals in time order, with sizes over all of them.

    The judgements on the whole record are: of the identifiability, the worst block's; of what no force explains, the
    mean of the squares over the blocks; of a filter's whiteness, the mean.

    Attributes:
        head: what all blocks have in common, without intervals.
        start: (m,) starts of the intervals [s].
        ends: (m,) their ends [s].
        holes: ends [s] of intervals that no other one follows at once.
    """

    def __init__(self, spool: Spool) -> None:
        self.start, self.ends = Series(spool), Series(spool)
        self.holes: list[float] = []
        self._spool = spool
        self._columns: dict[str, Series] = {}
        self._counts: list[int] = []
        self._blocks: list[Redundancy] = []
        self._innovations: list[tuple[float, float]] = []  # mean and whiteness
        self.head: Estimate

    @classmethod
    def of(cls, estimate: Estimate) -> StoredEstimate:
        """Return an estimate of a whole record."""
        stored = cls(Spool())
        stored.append(estimate)
        return stored

    def append(self, block: Estimate) -> None:
        """Append the intervals of a block, which begins where the last one ended or after a hole."""
        columns = {"components": block.components, "residual": block.residual, "unexplained": block.unexplained}
        nis = None if block.innovation is None else block.innovation.nis
        optional = {name: getattr(block, name) for name in ("standard_deviation", "seen", "doubt")} | {"nis": nis}
        columns |= {name: rows for name, rows in optional.items() if rows is not None}
        empty = some_intervals(block, slice(0, 0))
        if not self._counts:
            self._least, self._most = np.full((2, block.components.shape[1]), np.inf) * [[1.0], [-1.0]]
            self._sum, self._squares, self._shown = np.zeros((3, block.components.shape[1]))
            self._doubt, self._judged, self._worst = 0.0, 0, (0.0, float(block.time[0]))
            self._columns = {name: Series(self._spool, *rows.shape[1:]) for name, rows in columns.items()}
            self.head = empty
        judged = self.head.identifiability, block.identifiability
        worst = min(judged, key=lambda each: (each.rank, -each.condition))
        self.head = replace(self.head, innovation=empty.innovation, identifiability=worst)
        for name, series in self._columns.items():
            series.append(columns[name])
        if self._counts and block.time[0] > self.end:
            self.holes.append(self.end)
        self.start.append(block.time[:-1])
        self.ends.append(block.time[1:])
        self._counts.append(len(block.components))
        self._blocks.append(block.redundancy)
        if block.innovation is not None:
            self._innovations.append((block.innovation.mean, block.innovation.whiteness))
        shown = block.shown
        self._shown += shown.sum(axis=0)
        self._least = np.minimum(self._least, np.where(shown, block.components, np.inf).min(axis=0))
        self._most = np.maximum(self._most, np.where(shown, block.components, -np.inf).max(axis=0))
        components = np.where(shown, block.components, 0.0)
        self._sum += components.sum(axis=0)
        self._squares += np.sum(components**2, axis=0)
        if block.doubt is not None:
            self._doubt += float(np.nansum(block.doubt))
            self._judged += int(np.sum(np.isfinite(block.doubt)))
            first = max(self.borders[-2], self.start.index(block.time[0] - DOUBT_STRETCH))
            time = np.append(self.start[first:], block.time[-1])
            self._worst = max(self._worst, worst_stretch(time, self._columns["doubt"][first:]))

    def __len__(self) -> int:
        """Return the number of intervals."""
        return len(self.start)

    @property
    def end(self) -> float:
        """End of the last interval [s]."""
        return float(self.ends[-1])

    def index(self, time: float) -> int:
        """Return the index of the first interval that does not start before a time [s]."""
        return self.start.index(time - 1e-9)

    def between(self, first: int, last: int) -> Estimate:
        """Return the intervals from `first` to `last` (exclusive)."""
        rows = slice(first, last)
        columns: dict[str, Any] = {name: series[rows] for name, series in self._columns.items()}
        if self.head.innovation is not None:
            columns["innovation"] = replace(self.head.innovation, nis=columns.pop("nis"))
        return replace(self.head, time=np.concatenate([self.start[rows], self.ends[rows][-1:]]), **columns)

    def blocks(self) -> Iterator[Estimate]:
        """Yield all intervals, at most `ROWS_READ` at once."""
        for first in range(0, len(self), ROWS_READ):
            yield self.between(first, min(first + ROWS_READ, len(self)))

    @property
    def borders(self) -> list[int]:
        """Indices of the first interval, of each behind a hole, and behind the last one."""
        return [0, *map(self.index, self.holes), len(self)]

    def stretches(self) -> Iterator[Estimate]:
        """Yield all intervals as `blocks`, but none together with another one over a hole."""
        for begin, end in pairwise(self.borders):
            for first in range(begin, end, ROWS_READ):
                yield self.between(first, min(first + ROWS_READ, end))

    def whole(self) -> Estimate:
        """Return all intervals at once, in memory.

        The time of an interval's end is that of the next interval's start, also across a hole between two parts.
        """
        return self.between(0, len(self))

    @property
    def mean(self) -> Array:
        """Mean (c,) of each component where it is seen; NaN where it never is."""
        return self._over_shown(self._sum)

    @property
    def rms(self) -> Array:
        """Root mean square (c,) of each component where it is seen; NaN where it never is."""
        return np.asarray(np.sqrt(self._over_shown(self._squares)))

    @property
    def extremes(self) -> tuple[Array, Array]:
        """The least (c,) and the largest (c,) of each component where it is seen; NaN where it never is."""
        never = self._shown == 0.0
        return np.where(never, np.nan, self._least), np.where(never, np.nan, self._most)

    @property
    def seen(self) -> Array | None:
        """Share (c,) of the intervals in which each component is seen; None if no force was expected."""
        return None if self.head.seen is None else np.asarray(self._shown / len(self))

    @cached_property
    def deviation(self) -> Array | None:
        """Median (c,) of the stated deviations of each component where it is seen; None if none are stated.

        Of a long record it is that of a sample spread over it. A median, as an observer that knows nothing yet states a
        hundred times what it states ever after.
        """
        if "standard_deviation" not in self._columns:
            return None
        parts = [self.between(first, last) for first, last in spread_stretches(len(self), MOST_SAMPLED)]
        stated = [np.where(part.shown, np.asarray(part.standard_deviation), np.nan) for part in parts]
        with warnings.catch_warnings(action="ignore", category=RuntimeWarning):  # of a component that is never seen
            return np.asarray(np.nanmedian(np.concatenate(stated), axis=0))

    @property
    def time_constant(self) -> float:
        """The largest 1/K [s]; 0 without a gain."""
        gain = float(np.min(np.diagonal(self.head.gain) if self.head.gain.ndim == 2 else self.head.gain))
        return 1.0 / gain if gain > 0.0 else 0.0

    @cached_property
    def risen(self) -> float:
        """Start [s] of the first interval at which the estimate no longer rises from what it began with.

        That is 5 time constants after the first, or, where deviations are stated, once all are at most `RISEN` times
        their medians.
        """
        if self.deviation is None:
            at = self.index(self.start[0] + TIME_CONSTANTS_TO_SETTLE * self.time_constant)
        else:
            stated = self.between(0, min(len(self), ROWS_READ)).standard_deviation
            assert stated is not None
            at = int(np.argmax(~np.any(stated > RISEN * self.deviation, axis=1)))
        return float(self.start[at if at < len(self) else 0])

    @property
    def doubt(self) -> float | None:
        """Mean k: how many times as large as stated the squared errors of the rows are.

        None if half of the intervals or more have no row to spare that shows it.
        """
        return self._doubt / self._judged if 2 * self._judged > len(self) else None

    @property
    def worst_doubt(self) -> tuple[float, float] | None:
        """Largest k over `DOUBT_STRETCH`, and the time at which it begins [s]; see `doubt`."""
        return None if self.doubt is None else self._worst

    @property
    def redundancy(self) -> Redundancy:
        """What no force explains."""
        mean: dict[str, Any] = {
            name: float(np.sqrt(self._average([getattr(block, name) ** 2 for block in self._blocks])))
            for name in ("rms", "sensors", "belief", "allowed")
        }
        return replace(self._blocks[0], **mean)

    @property
    def innovation(self) -> InnovationScore | None:
        """How well a filter predicts the samples; None for other observers."""
        parts = zip(*self._innovations, strict=True)
        return InnovationScore(*(self._average(list(part)) for part in parts)) if self._innovations else None

    def component_sizes(self) -> tuple[ComponentSize, ...]:
        """Return size and deviation of each component."""
        identifiability = self.head.identifiability
        sure: list[float | None] = [None] * len(self._sum)
        if self.deviation is not None:
            sure = [float(size) if np.isfinite(size) else None for size in self.deviation]
        seen: list[float | None] = [None] * len(sure) if self.seen is None else self.seen.tolist()
        unseen = np.isinf(identifiability.deviation).tolist() if self.seen is None else [share == 0.0 for share in seen]
        rms = [float(size) if np.isfinite(size) else None for size in self.rms]
        return tuple(map(ComponentSize, identifiability.components, rms, self.head.units, sure, unseen, seen))

    def _over_shown(self, sums: Array) -> Array:
        return np.divide(sums, self._shown, out=np.full_like(sums, np.nan), where=self._shown > 0.0)

    def _average(self, values: list[float]) -> float:
        return float(np.average(values, weights=self._counts))


def some_intervals(estimate: Estimate, inside: slice) -> Estimate:
    """Return some intervals of an estimate, as arrays of their own."""
    innovation = estimate.innovation
    names = ("components", "residual", "unexplained", "standard_deviation", "seen", "doubt")
    given = {name: getattr(estimate, name) for name in names}
    columns: dict[str, Any] = {name: None if rows is None else rows[inside].copy() for name, rows in given.items()}
    return replace(
        estimate,
        **columns,
        time=estimate.time[inside.start : inside.stop + 1],
        innovation=None if innovation is None else replace(innovation, nis=innovation.nis[inside].copy()),
    )
