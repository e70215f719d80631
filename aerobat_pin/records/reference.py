"""What an estimate is compared with and never sees: the truth of a simulation, or a force sensor."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from aerobat_pin.numerics import Array
from aerobat_pin.records.spool import Series

Which = Callable[[Array], NDArray[np.bool_]]  # of the starts (n,) [s] of intervals


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
