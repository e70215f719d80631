"""What a stream gives: the estimate of an interval, and what became of the samples."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from aerobat_pin.estimation import stream_rings as ring_kernels
from aerobat_pin.forces import MISFIT, belief_words
from aerobat_pin.numerics import Array
from aerobat_pin.observers import DOUBTFUL, Observer


class OnlineSample:
    """The estimate of one interval by one observer.

    Attributes:
        observer: name of the observer.
        start: start of the interval [s].
        end: its end [s].
        settled: whether the observer has run for `TIME_CONSTANTS_TO_SETTLE` / K since it started, or since a channel
            was stuck.
        k: how many times as large as stated the squared errors of the rows have been in the last seconds, by the first
            observer that is no filter; NaN if there is none, or no row is to spare.
    """

    __slots__ = ("_expected", "_labels", "_sample", "end", "k", "observer", "settled", "start")

    def __init__(
        self,
        observer: Observer,
        start: float,
        end: float,
        settled: bool,
        components: Array,
        deviation: Array | None,
        of_rows: Array | None,
        k: float,
    ) -> None:
        self.observer, self.start, self.end, self.settled = observer.name, start, end, settled
        self.k = k
        self._labels, self._sample = observer.applications.components, (components, deviation, of_rows)
        self._expected = observer.expected

    def _named(self, values: Array | None) -> dict[str, float]:
        return {} if values is None else dict(zip(self._labels, values.tolist(), strict=True))

    @property
    def components(self) -> dict[str, float]:
        """Label -> estimate [N or N m], such as `FL_FOOT.Fz`; world axes."""
        return self._named(self._sample[0])

    @property
    def deviation(self) -> dict[str, float]:
        """Label -> its standard deviation; that of an expected force where the pose does not show it."""
        return self._named(self._sample[1])

    @property
    def seen(self) -> dict[str, float]:
        """Label -> share of its expected square that the rows settle [-]; empty where no force was expected."""
        of_rows = self._sample[2]
        if of_rows is None or self._expected is None:
            return {}
        return self._named(self._expected.seen(of_rows))

    def __repr__(self) -> str:
        values = ", ".join(f"{label} {value:.4g}" for label, value in self.components.items())
        return f"OnlineSample({self.start:.4f} to {self.end:.4f} s: {values})"


@dataclass(frozen=True)
class StreamHealth:
    """What became of the samples of a stream.

    Attributes:
        estimates: number of intervals that were estimated.
        starts: how often the observers started: once, and again behind each hole and each step of a clock.
        skipped: number of times without an estimate, inside holes of a channel.
        failed: number of intervals whose residual was not finite, behind which the observers started again.
        samples: channel -> what became of its samples -> their number: `taken`, `inserted` (late, but in time),
            `refused` (NaN, infinite, huge, a quaternion without length one), `duplicate` (the first was kept), `late`
            (an estimate had passed), `outlier` (a stamp more than 1 s off, or where samples of before leave no room
            for it), `clock_step` (the third that agrees: the clock was set, and all that came before is forgotten).
        stalled: channels without a sample for `STALL` [s].
        stuck: channels that changed once, and have repeated one value for `STUCK` [s] while others change.
        settled: whether the observers have run for long enough since they started, or since a channel was stuck.
        k: that of the newest estimate, see `OnlineSample`.
        obstacles: a line about each reason why samples cannot become estimates.
    """

    estimates: int
    starts: int
    skipped: int
    failed: int
    samples: Mapping[str, Mapping[str, int]]
    stalled: tuple[str, ...]
    stuck: tuple[str, ...]
    settled: bool
    k: float
    obstacles: tuple[str, ...]

    def count(self, fate: str) -> int:
        """Return the number of samples of all channels of which something became, such as `refused`."""
        return sum(tally[fate] for tally in self.samples.values())

    def __str__(self) -> str:
        """Say the counts in a line."""
        tallies = {fate for tally in self.samples.values() for fate in tally} - {"taken", "inserted"}
        lost = [f"{self.count(fate)} {fate}" for fate in sorted(tallies) if self.count(fate)]
        left_out = f"; samples left out: {', '.join(lost)}" if lost else ""
        return "; ".join([f"{self.estimates} estimates, {self.starts} starts{left_out}", *self.obstacles, *self.doubts])

    @property
    def doubts(self) -> tuple[str, ...]:
        """A line about the belief if no force explains the rows; else none."""
        return (f"{belief_words(self.k)}: {MISFIT}",) if self.k > DOUBTFUL else ()


def stream_health(
    rings: ring_kernels.Rings,
    keys: Sequence[str],
    counts: tuple[int, int, int],
    wait: float,
    k: float,
    obstacles: Iterable[str],
) -> StreamHealth:
    """Return the health by the rings of channels, in order, with `counts` of estimates, of starts and of failures.

    Observers have settled `wait` [s] after they started; `obstacles` are those that the rings do not show.
    """
    newest = {
        key: float(rings.time[c, (rings.head[c] + rings.filled[c] - 1) % ring_kernels.LENGTH])
        for c, key in enumerate(keys)
        if rings.filled[c]
    }
    latest, now = max(newest.values(), default=0.0), rings.now
    stalled = [key for key in keys if key not in newest or latest - newest[key] > ring_kernels.STALL]
    common = min(newest.values(), default=0.0) - rings.setting[1]
    full = np.flatnonzero((rings.filled == ring_kernels.LENGTH) & (rings.time.min(axis=1) > common)).tolist()
    if full:
        obstacles = [
            *obstacles,
            f"{', '.join(keys[c] for c in full)}: {ring_kernels.LENGTH} samples are kept, "
            f"{np.ptp(rings.time[full[0]]):.2g} s, less than by how much the slowest channel and the wait are behind",
        ]
    tallies = (dict(zip(ring_kernels.FATES, tally, strict=True)) for tally in rings.tally.tolist())
    return StreamHealth(
        estimates=counts[0],
        starts=counts[1],
        skipped=int(rings.skipped[0]),
        failed=counts[2],
        samples=dict(zip(keys, tallies, strict=True)),
        stalled=tuple(stalled) if newest else (),
        stuck=tuple(key for key, stuck in zip(keys, rings.stuck.tolist(), strict=True) if stuck),
        settled=bool(now[ring_kernels.LAST] - now[ring_kernels.BEGAN] >= wait),  # False while they are NaN
        k=k,
        obstacles=tuple(obstacles),
    )
