"""A recording as columns: every name in a log with its samples, on the clock of the table or topic it came from."""

from __future__ import annotations

import difflib
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from aerobat_pin.errors import LogError
from aerobat_pin.numerics import Array

MOST_NAMES = 40  # of the log that an error message lists


@dataclass(frozen=True)
class Clock:
    """The stamps of one table or topic.

    Attributes:
        time: (n,) stamps [s], increasing; what was not is dropped.
        repeated: number of samples whose stamp was that of the sample before.
        backward: number of samples that went back in time.
        late: (n,) recorder's stamp minus the sensor's [s]; empty where there is only one of them.
    """

    time: Array
    repeated: int = 0
    backward: int = 0
    late: Array = field(default_factory=lambda: np.empty(0))


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
    """

    path: Path
    names: tuple[str, ...]
    clocks: dict[str, Clock]
    clock_of: dict[str, str]
    values: dict[str, Array]
    kinds: dict[str, str] = field(default_factory=dict)
    stamps: str = ""

    def series(self, name: str, key: str) -> tuple[Array, Array]:
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
        there = np.isfinite(values)
        if not there.all():
            time, values = time[there], values[there]
        if len(time) < 2:
            raise LogError(f"log {self.path}: '{name}' ({key}) has {len(time)} samples: two or more were expected")
        return time, values

    def missing(self, name: str, key: str) -> LogError:
        """Return the error for a name that the log does not have."""
        close = difflib.get_close_matches(name, self.names, n=1)
        guess = f" (did you mean '{close[0]}'?)" if close else ""
        what = "topic" if self.kinds and name in (name.split(".")[0],) else "column"
        listed = ", ".join((list(self.kinds) if what == "topic" else list(self.names))[:MOST_NAMES])
        return LogError(f"log {self.path}: no {what} '{name}', which {key} of the map names{guess}; there are {listed}")


def increasing(time: Array) -> tuple[NDArray[np.bool_], int, int]:
    """Return which stamps (n,) are later than all before, how many repeat the one before, and how many go back."""
    largest = np.maximum.accumulate(np.concatenate([[-np.inf], time[:-1]]))
    keep = time > largest
    repeated = int(np.sum(np.diff(time) == 0.0))
    return keep, repeated, int(np.sum(~keep)) - repeated
