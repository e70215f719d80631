"""Samples of one quantity on its own clock, and a stretch of a record at common times."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from aerobat_pin.numerics import Array
from aerobat_pin.observers import Estimate
from aerobat_pin.records.spool import Series


@dataclass(frozen=True)
class Channel:
    """Samples of one channel, on disk if they are many.

    Attributes:
        key: key of the map, such as `base.rate`.
        names: its columns in the log.
        time: (n,) stamps [s], the delay that the map states taken off.
        values: (n, k) samples in SI units.
        means: whether they are means over the intervals that begin at the stamps, of a record at its own times.
        deviation: standard deviation of a sample in SI units, as the log notes it; None if it does not.
        place: (3,) of the sensor from the base's centre of mass, base axes [m]; None where that has no meaning.
        turn: (3, 3) rotation matrix, sensor to base; None likewise.
        holes: from, to [s], and what has no sample there, for holes that split the record.
        turns: joint -> number of jumps by a full turn that were taken out of its reading.
    """

    key: str
    names: tuple[str, ...]
    time: Series
    values: Series
    means: bool = False
    deviation: float | None = None
    place: Array | None = None
    turn: Array | None = None
    holes: tuple[tuple[float, float, str], ...] = ()
    turns: Mapping[str, int] = field(default_factory=dict)

    def between(self, first: float, last: float, extra: int = 0) -> tuple[Array, Array]:
        """Return stamps and samples from a time to another [s], and `extra` more on either side."""
        rows = slice(max(0, self.time.index(first) - extra), self.time.index(last, "right") + extra)
        return self.time[rows], self.values[rows]


@dataclass(frozen=True)
class Block:
    """A stretch of a record at common times, ready for an observer.

    Attributes:
        time: (m + 1,) [s].
        q: (m + 1, nq) configurations.
        v: (m + 1, nv) velocities.
        tau: (m, nv) measured joint torques, interval means.
        extra: name -> samples (m + 1, ...) or interval means (m, ...) of what only the robot itself reads.
        measured: keys of the channels that the record has, such as `base.velocity`.
        source: quantity -> `measured`, `reconstructed` or `believed`, of what the robot completed.
    """

    time: Array
    q: Array
    v: Array
    tau: Array
    extra: Mapping[str, Array] = field(default_factory=dict)
    measured: frozenset[str] = frozenset()
    source: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class SmoothedMotion:
    """Motion and forces that a robot found together, from channels that are each on a clock of its own.

    Attributes:
        block: the motion, and the joint torques.
        known: name -> (m, nv) known generalised forces, interval means.
        estimates: observer -> estimate.
    """

    block: Block
    known: Mapping[str, Array]
    estimates: Mapping[str, Estimate]
