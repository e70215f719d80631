"""Two series of a record that must agree, whatever forces act: what geometry ties to each other."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from aerobat_pin.numerics import Array

LARGEST_DELAY = 0.8e-3  # [s] between two channels; a millisecond costs an R2 of 0.1


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
