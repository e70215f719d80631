"""A recording as columns: every name in a log with its samples, on the clock of the table or topic it came from."""

from __future__ import annotations

import re
from bisect import bisect_right
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from aerobat_description.reading import did_you_mean
from aerobat_pin.errors import LogError
from aerobat_pin.numerics import Array
from aerobat_pin.records.spool import EXTENT, Series, Spool, series_of

FEW = 10  # rows whose stamps do not fit between their neighbours': they are left out
LONG_STEP = 10.0  # usual steps; a longer one ends a stretch of rows, as the clock may have been set
ROUNDED_FROM = 1.5  # rows per stamp from which stamps may be rounded
SAME_COUNT = 0.9  # share of rounded stamps at even distances, and with as many rows as others, or one more or less
OTHER_EPOCH = 3600.0  # [s] from all others, of a single first or last stamp that is left out
SPELLINGS = {r"s-(?=[12]$)": "/s", r"/s1$": "/s", r"degrees?": "deg", r"radians?": "rad"}  # as others spell -> as here


def same_unit(text: str, unit: str) -> bool:
    """Return whether a text names a unit: `N·m` and `N.m` are `N m`, and `degrees s-1` are `deg/s`."""
    plain = re.sub(r"[·.*^\s]", "", text).replace("²", "2")
    for pattern, short in SPELLINGS.items():
        plain = re.sub(pattern, short, plain)
    return plain == unit.replace(" ", "")


@dataclass(frozen=True)
class Clock:
    """The stamps of one table or topic.

    Attributes:
        time: (n,) stamps [s], increasing.
        repeated: number of samples whose stamp was that of the sample before, which they are merged with.
        differing: number of these that had another value in a column; the first value stays.
        off: number of rows left out as they have no stamp, or one that does not fit between their neighbours'.
        backward: number of rows left out because they go back to times that have samples already.
        set_back: how often rows stand before earlier ones, as the clock was set back between them.
        reordered: number of rows behind later ones, of sensors whose samples came late.
        rounded_to: [s] what the stamps seem to be rounded to; 0 if they do not.
        late: (n,) recorder's stamp minus the sensor's [s]; None where there is only one of them.
    """

    time: Series
    repeated: int = 0
    differing: int = 0
    off: int = 0
    backward: int = 0
    set_back: int = 0
    reordered: int = 0
    rounded_to: float = 0.0
    late: Series | None = None

    @property
    def not_used(self) -> str:
        """How many rows were not used, in words that follow a number of samples; empty if all were."""
        counts = {"repeat the stamp before": self.repeated, "have no stamp or an earlier one": self.off + self.backward}
        words = ", ".join(f"{count} rows {what}" for what, count in counts.items() if count)
        return f"; {words} (log.time: are stamps rounded, or rows in another order?)" if words else ""


@dataclass(frozen=True)
class Columns:
    """Columns of a log that were read.

    Attributes:
        path: the log.
        names: all names that the log has, read or not.
        clocks: clock -> stamps; a table has one clock, a bag one for each topic.
        clock_of: name -> its clock, for the names that were read.
        values: name -> (n,) samples; NaN where a row has none.
        kinds: topic -> type of its messages, for a bag.
        stamps: which stamps a bag's clocks are; empty for a table.
        units: name -> unit that the header of a table states, as in `x [m]`.
        of_arrays: names of columns of an array, whose unit those of another kind do not have, as a pose's quaternion.
        notes: what was left out, in words.
    """

    path: Path
    names: tuple[str, ...]
    clocks: dict[str, Clock]
    clock_of: dict[str, str]
    values: dict[str, Series]
    kinds: dict[str, str] = field(default_factory=dict)
    stamps: str = ""
    units: dict[str, str] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    of_arrays: frozenset[str] = frozenset()

    def series(self, name: str, key: str) -> tuple[Series, Series]:
        """Return stamps (n,) [s] and samples (n,) of a column, without empty cells, that a key of the map asks for.

        Raises LogError if there is no such column, or if it has less than two samples.
        """
        if name not in self.values:
            raise self.missing(name, key)
        clock, values = self.clocks[self.clock_of[name]], self.values[name]
        time = clock.time
        if not values.finite:
            full = in_step(time, values)
            time, values = Series(time.spool), Series(time.spool)
            for stamps, samples in full:
                finite = np.isfinite(samples)
                time.append(stamps[finite])
                values.append(samples[finite])
        if len(time) < 2:
            count = f"{len(time)} samples: two or more were expected{clock.not_used}"
            if key == "joints.effort" and not clock.not_used:
                count += "; if nobody measures it, take it out and name its joint in robot.rows.ignore"
            raise LogError(f"log {self.path}: '{name}' ({key}) has {count}")
        return time, values

    def sample(self, name: str) -> Array:
        """Return samples (n,) of a column, NaN included; of a long one a sample spread over it."""
        return np.concatenate(self.values[name].spread())

    def missing(self, name: str, key: str) -> LogError:
        """Return the error for a name that the log does not have, or only as its time, or without numbers."""
        if name in self.names:
            return LogError(f"log {self.path}: '{name}', which {key} of the map names, is the time, or has no numbers")
        what = "topic" if self.kinds and "." not in name else "column"
        hint = did_you_mean(name, list(self.kinds) if what == "topic" else self.names, "there are")
        return LogError(f"log {self.path}: no {what} '{name}', which {key} of the map names: {hint}")


class GrowingTable:
    """The columns of one clock while they are read into a spool; one that a piece does not have is NaN there."""

    def __init__(self, spool: Spool) -> None:
        self._spool, self._columns = spool, dict[str, Series]()
        self._time, self._late = Series(spool), Series(spool)
        self._rises, self._last = True, -np.inf

    def add(self, time: Array, columns: Mapping[str, Array], late: Array | None = None) -> None:
        """Append rows: stamps (n,) [s], columns (n,) by name, and how much later the recorder's stamps are (n,) [s]."""
        for name in columns:
            if name not in self._columns:
                self._columns[name] = Series(self._spool)
                for piece in self._time.pieces():
                    self._columns[name].append(np.full(len(piece), np.nan))
        for name, series in self._columns.items():
            series.append(columns[name] if name in columns else np.full(len(time), np.nan))
        self._rises = self._rises and bool(np.all(np.diff(time, prepend=self._last) > 0.0))
        self._last = float(time[-1])
        self._time.append(time)
        if late is not None:
            self._late.append(late)

    def __len__(self) -> int:
        """Return the number of rows so far."""
        return len(self._time)

    def finished(self, *, late: bool = False) -> tuple[Clock, dict[str, Series]]:
        """Return clock and columns in the order of the stamps; `late`: with their delays, if these are worth something.

        Rows with one stamp are merged: each column keeps the first value that it has there.
        """
        delays = self._late if late and len(self._late) == len(self._time) else None
        if self._rises and not stands_alone(self._time[:2], self._time[len(self) - 2 :]):
            return Clock(self._time, late=delays), self._columns
        stamps = self._time[:]
        if not self._rises and self._columns_rise(stamps):
            late_rows = int(np.sum(stamps < np.maximum.accumulate(stamps)))
            rows, counts = np.argsort(stamps, kind="stable"), {"reordered": late_rows}
        else:
            rows, counts = in_order(stamps)
        new = np.diff(stamps[rows], prepend=-np.inf) > 0.0
        which, differing, columns = np.cumsum(new) - 1, np.zeros(len(rows), bool), {}
        for name, series in self._columns.items():
            values, first = series[:][rows], np.full(int(np.sum(new)), np.nan)
            filled = np.flatnonzero(np.isfinite(values))
            first[which[filled[::-1]]] = values[filled[::-1]]  # the first one is written last
            differing[filled] |= values[filled] != first[which[filled]]
            columns[name] = series_of(self._spool, first)
        delays = None if delays is None else series_of(self._spool, delays[:][rows[new]])
        repeated, differ, time = len(rows) - int(np.sum(new)), int(np.sum(differing)), stamps[rows[new]]
        rounded_to = _rounded_to(time, np.bincount(which)) if differ else 0.0
        clock = Clock(series_of(self._spool, time), repeated, differ, rounded_to=rounded_to, late=delays, **counts)
        return clock, columns

    def _columns_rise(self, stamps: Array) -> bool:
        """Return whether the stamps (n,) of each column's samples rise, as where some sensors come late."""
        times = (stamps[np.isfinite(series[:])] for series in self._columns.values())
        return bool(np.all(np.isfinite(stamps))) and all(np.all(np.diff(time) > 0.0) for time in times)


def _rounded_to(time: Array, rows: NDArray[np.intp]) -> float:
    """Return what stamps (n,) [s] seem to be rounded to: each has as many rows (n,), at even distances; else 0."""
    if len(rows) < FEW or float(np.mean(rows)) < ROUNDED_FROM:
        return 0.0
    steps, whole = np.diff(time), rows[1:-1]  # the first and the last stamp may have half as many rows
    usual = float(np.median(steps))
    alike = np.abs(steps - usual) < 0.5 * usual, np.abs(whole - np.mean(whole)) < 1.5  # a tie goes to either stamp
    return usual if min(map(np.mean, alike)) > SAME_COUNT else 0.0


def in_step(time: Series, *others: Series) -> Iterator[tuple[Array, ...]]:
    """Yield pieces of stamps and of further series with as many rows."""
    for first in range(0, len(time), EXTENT):
        rows = slice(first, first + EXTENT)
        yield time[rows], *(other[rows] for other in others)


def stands_alone(*pairs: Array) -> bool:
    """Return whether two neighbouring stamps (2,) [s] of a pair are so far apart that one is of another epoch."""
    return any(len(pair) == 2 and pair[1] - pair[0] > OTHER_EPOCH for pair in pairs)


def in_order(time: Array) -> tuple[NDArray[np.intp], dict[str, int]]:
    """Return the rows of stamps (n,) [s] that are used, by their stamps, which can repeat, and counts as of `Clock`.

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
        return finite[:0], {"off": len(time)}
    rows = np.concatenate(placed)
    first, last = (len(rows) > 2 and stands_alone(time[pair]) for pair in (rows[:2], rows[-2:]))
    used = rows[int(first) : len(rows) - int(last)]
    off, set_back = len(time) - fitting + len(rows) - len(used), int(np.sum(np.diff(used) < 0))
    return used, {"off": off, "backward": fitting - len(rows), "set_back": set_back}


def _placed(time: Array, stretches: list[Any]) -> list[Any]:
    """Return stretches of rows by their stamps, cut where these jump, without rows at times that are taken."""
    steps = np.concatenate([np.diff(time[rows]) for rows in stretches] or [np.zeros(0)])
    longest = LONG_STEP * float(np.median(steps[steps > 0.0])) if np.any(steps > 0.0) else np.inf
    firsts: list[float] = []  # and last stamps of what is found so far
    lasts: list[float] = []
    placed: list[Any] = []
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
                    placed.insert(k, piece)
    return placed
