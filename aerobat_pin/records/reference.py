"""What a record is compared with: a force that the estimate never sees, and series that must agree whatever acts."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from aerobat_pin.numerics import Array
from aerobat_pin.records.spool import Series

Which = Callable[[Array], NDArray[np.bool_]]  # of the starts (n,) [s] of intervals
LARGEST_DELAY = 0.8e-3  # [s] between two channels; a millisecond costs an R2 of 0.1


def _all(start: Array) -> NDArray[np.bool_]:
    return np.ones(len(start), bool)


def _none(start: Array) -> NDArray[np.bool_]:
    return np.zeros(len(start), bool)


@dataclass(frozen=True, eq=False)
class Reference:
    """A force, in the m intervals of a record.

    Attributes:
        frame: where it acts.
        kind: `truth` of a simulation, or `sensor`.
        labels: (k,) components, such as `Fz`.
        values: (m, k) interval means, world axes [N, N m].
        noise_free: (m, k) the same without noise; None for a sensor.
        filter: cutoff of the zero-phase low-pass behind which the values are, and the estimate is to be [Hz]; or None.
        stretches: (first, last), exclusive, of intervals that follow each other; empty if all do.
        scored: whether an interval counts in scores.
        used: whether a fit used the values there.
    """

    frame: str
    kind: Literal["truth", "sensor"]
    labels: tuple[str, ...]
    values: Series | Array
    noise_free: Series | Array | None = None
    filter: float | None = None
    stretches: tuple[tuple[int, int], ...] = ()
    scored: Which = _all
    used: Which = _none


@dataclass(frozen=True)
class TrueEvent:
    """An event of the true forces: its name, frames, start [s] and end [s], which is infinite if it does not end."""

    name: str
    frames: tuple[str, ...]
    start: float
    end: float


@dataclass(frozen=True)
class Agreement:
    """Two series of c columns at common times that must agree.

    Attributes:
        check: name of its findings, such as `position against velocity`.
        names: what the two series are called.
        time: (m,) increasing times [s], not necessarily even.
        first: (m, c) series.
        second: (m, c) series: equal to the first, or its rate.
        kind: `values` if they must be equal, `rates` if the second is the rate of the first.
        labels: (c,) where each column is, such as `along x`.
        unit: of the first.
        floor: rms difference in `unit` up to which a column agrees; of rates over windows of 0.1 s.
        expected: what was expected, or is to be checked, in words.
        latest: largest delay between the two [s].
        share: of the first's own motion, up to which a column agrees.
        apart: whether each column is a sensor of its own, as those of joints are.
    """

    check: str
    names: tuple[str, str]
    time: Array
    first: Array
    second: Array
    kind: Literal["values", "rates"]
    labels: tuple[str, ...]
    unit: str
    floor: float
    expected: str
    latest: float = LARGEST_DELAY
    share: float = 0.3
    apart: bool = False
