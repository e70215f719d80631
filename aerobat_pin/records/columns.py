"""A recording as columns: every name in a log with its samples, on the clock of the table or topic it came from."""

from __future__ import annotations

import difflib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from aerobat_pin.errors import LogError
from aerobat_pin.numerics import Array
from aerobat_pin.records.spool import EXTENT, Series, Spool

MOST_NAMES = 40  # of the log that an error message lists


def same_unit(text: str, unit: str) -> bool:
    """Return whether a text names a unit: `N·m` and `Nm` are `N m`."""
    return text.strip().replace("·", "").replace(" ", "") == unit.replace(" ", "")


@dataclass(frozen=True)
class Clock:
    """The stamps of one table or topic.

    Attributes:
        time: (n,) stamps [s], increasing; what was not is dropped.
        repeated: number of samples whose stamp was that of the sample before.
        backward: number of samples that went back in time.
        late: (n,) recorder's stamp minus the sensor's [s]; None where there is only one of them.
    """

    time: Series
    repeated: int = 0
    backward: int = 0
    late: Series | None = None


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
    """

    path: Path
    names: tuple[str, ...]
    clocks: dict[str, Clock]
    clock_of: dict[str, str]
    values: dict[str, Series]
    kinds: dict[str, str] = field(default_factory=dict)
    stamps: str = ""
    units: dict[str, str] = field(default_factory=dict)

    def series(self, name: str, key: str) -> tuple[Series, Series]:
        """Return stamps (n,) [s] and samples (n,) of a column, without empty cells.

        Args:
            name: name in the log.
            key: key of the map that asks for it, for the message.

        Raises:
            LogError: there is no such column, or it has less than two samples.
        """
        if name not in self.values:
            raise self.missing(name, key)
        time, values = self.clocks[self.clock_of[name]].time, self.values[name]
        if not values.finite:
            full = in_step(time, values)
            time, values = Series(time.spool), Series(time.spool)
            for stamps, samples in full:
                there = np.isfinite(samples)
                time.append(stamps[there])
                values.append(samples[there])
        if len(time) < 2:
            raise LogError(f"log {self.path}: '{name}' ({key}) has {len(time)} samples: two or more were expected")
        return time, values

    def sample(self, name: str) -> Array:
        """Return samples (n,) of a column, NaN included; of a long one a sample spread over it."""
        return np.concatenate(self.values[name].spread())

    def missing(self, name: str, key: str) -> LogError:
        """Return the error for a name that the log does not have."""
        close = difflib.get_close_matches(name, self.names, n=1)
        guess = f" (did you mean '{close[0]}'?)" if close else ""
        what = "topic" if self.kinds and name in (name.split(".")[0],) else "column"
        listed = ", ".join((list(self.kinds) if what == "topic" else list(self.names))[:MOST_NAMES])
        return LogError(f"log {self.path}: no {what} '{name}', which {key} of the map names{guess}; there are {listed}")


class GrowingTable:
    """The columns of one clock while they are read, piece by piece.

    A column that begins late, or that a piece does not have, is NaN there.

    Args:
        spool: where the columns go.
    """

    def __init__(self, spool: Spool) -> None:
        self.columns: dict[str, Series] = {}
        self._spool = spool
        self._time, self._late = Series(spool), Series(spool)
        self._largest, self._last = -np.inf, np.nan
        self._repeated, self._backward = 0, 0

    def add(self, time: Array, columns: Mapping[str, Array], late: Array | None = None) -> None:
        """Append rows, without those whose stamp is not later than all before.

        Args:
            time: (n,) stamps [s].
            columns: name -> (n,) samples.
            late: (n,) recorder's stamp minus the sensor's [s]; None if unknown.
        """
        keep, repeated, backward = increasing(time, self._largest, self._last)
        self._largest, self._last = max(self._largest, float(np.max(time))), float(time[-1])
        self._repeated, self._backward = self._repeated + repeated, self._backward + backward
        for name in columns:
            if name not in self.columns:
                self.columns[name] = Series(self._spool)
                for piece in self._time.pieces():
                    self.columns[name].append(np.full(len(piece), np.nan))
        count = int(np.sum(keep))
        for name, series in self.columns.items():
            series.append(columns[name][keep] if name in columns else np.full(count, np.nan))
        self._time.append(time[keep])
        if late is not None:
            self._late.append(late[keep])

    def __len__(self) -> int:
        """Return the number of rows so far, those left out included."""
        return len(self._time) + self._repeated + self._backward

    def clock(self, *, late: bool = False) -> Clock:
        """Return the clock, with the delays of its stamps if these are worth something."""
        delays = self._late if late and len(self._late) == len(self._time) else None
        return Clock(self._time, self._repeated, self._backward, delays)


def increasing(time: Array, largest: float = -np.inf, last: float = np.nan) -> tuple[NDArray[np.bool_], int, int]:
    """Return which stamps (n,) are later than all before, how many repeat the one before, and how many go back.

    Args:
        time: stamps [s].
        largest: the latest stamp of the rows before these.
        last: the stamp of the row before these.
    """
    keep = time > np.maximum.accumulate(np.concatenate([[largest], time[:-1]]))
    repeated = int(np.sum(np.diff(time, prepend=last) == 0.0))
    return keep, repeated, int(np.sum(~keep)) - repeated


def in_step(time: Series, *others: Series) -> Iterator[tuple[Array, ...]]:
    """Yield pieces of stamps and of further series with as many rows."""
    for first in range(0, len(time), EXTENT):
        rows = slice(first, first + EXTENT)
        yield time[rows], *(other[rows] for other in others)
