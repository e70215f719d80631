"""A contradiction between the channels of a log."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Contradiction:
    """Two channels of a log that do not fit, or one that cannot be a sensor's.

    Attributes:
        name: name of the kind of contradiction.
        text: one sentence that begins with the name and says what is wrong and what to check.
        figure: the measured figure.
        unit: its unit.
        threshold: the value of the figure from which on the log is called contradictory.
    """

    name: str
    text: str
    figure: float
    unit: str
    threshold: float

    def __str__(self) -> str:
        return self.text
