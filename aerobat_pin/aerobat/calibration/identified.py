"""Parameters that were identified from free flights: values, covariance, and what they explain."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from aerobat_pin.aerobat.calibration.parameters import PARAMETERS
from aerobat_pin.numerics import Array

UNSURE = 0.5  # of the deviation expected beforehand: a parameter that is known less well is not identifiable
SAME_EFFECT = 0.8  # correlation from which two parameters are said to do the same
BEYOND = 3.0  # expected deviations: a larger change is taken for the error of something else


@dataclass(frozen=True)
class Identified:
    """Result of an identification; changes as in `changes`, errors in N per row with moments over 50 mm.

    Attributes:
        names: (n,) parameters.
        values: (n,) their changes.
        covariance: (n, n) of the changes.
        kept: whether the calibration uses them.
        before: rms of what the belief leaves unexplained, in the flights' first part and in the part held out.
        after: the same with the changed parameters.
        allowed: largest error that counts as explained.
    """

    names: tuple[str, ...]
    values: Array
    covariance: Array
    kept: bool
    before: tuple[float, float]
    after: tuple[float, float]
    allowed: float

    @property
    def used(self) -> Mapping[str, float]:
        """Parameter -> change, as the calibration uses it."""
        return dict(zip(self.names, self.values.tolist(), strict=True)) if self.kept else {}

    @property
    def deviations(self) -> Array:
        """Standard deviations (n,) of the changes."""
        return np.asarray(np.sqrt(np.diag(self.covariance)))

    @property
    def explains(self) -> bool:
        """Whether the changes explain the part of the flights that was held out."""
        return self.after[1] <= self.allowed

    @property
    def unidentifiable(self) -> dict[str, list[str]]:
        """Parameter that the flights do not show -> those that do the same."""
        deviations = self.deviations
        alike = np.abs(self.covariance) / np.outer(deviations, deviations) > SAME_EFFECT
        return {
            name: [other for j, other in enumerate(self.names) if j != i and alike[i, j]]
            for i, name in enumerate(self.names)
            if deviations[i] > UNSURE * PARAMETERS[name].expected
        }

    @property
    def fudge(self) -> list[str]:
        """Parameters that took up the error of something else: all of them unless they explain, else the far ones."""
        sizes = np.abs(self.values) / [PARAMETERS[name].expected for name in self.names]
        return [name for name, size in zip(self.names, sizes, strict=True) if size > BEYOND or not self.explains]

    def describe(self) -> list[str]:
        """Return the result in lines of text."""
        lines = [
            f"belief off by {_both(self.before)}; with other parameters {_both(self.after)} "
            f"({1e3 * self.allowed:.2g} mN count as explained)"
        ]
        hidden = self.unidentifiable
        for name, value, deviation in zip(self.names, self.values, self.deviations, strict=True):
            unit, factor = ("mm", 1e3) if PARAMETERS[name].unit == "m" else ("%", 1e2)
            line = f"  {name:<15} {factor * value:+8.2f} {unit:<2}  deviation {factor * deviation:.2g} {unit}"
            if name in hidden:
                line += "   not identifiable" + (f": {', '.join(hidden[name])} does the same" if hidden[name] else "")
            lines.append(line)
        if not self.explains:
            lines.append(
                "  these numbers do not explain the flights: they are fudge for an error of another kind, and are "
                + ("used because they were asked for by name" if self.kept else "not used")
            )
        elif self.fudge:
            lines.append(f"  far from what was expected, so perhaps fudge for another error: {', '.join(self.fudge)}")
        return lines


def _both(errors: tuple[float, float]) -> str:
    return f"{1e3 * errors[0]:.2g} mN a row, {1e3 * errors[1]:.2g} mN where held out"
