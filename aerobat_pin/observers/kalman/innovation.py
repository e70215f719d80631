"""How well the Kalman filter predicts the next sample: the size of its innovations, and whether they are white."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from aerobat_pin.numerics import Array


@dataclass(frozen=True)
class Innovation:
    """Statistics of the innovations L^-1 e of a filter, with L L^T the covariance that it predicts for e.

    Attributes:
        nis: (m,) normalised innovation squared, e^T S^-1 e over the number of rows in use. Its mean is 1 if the filter
            errs as much as it says, smaller if it errs less.
        whiteness: correlation of neighbouring innovations, between -1 and 1: 0 if the filter uses all that a sample
            says about the next one, positive if it is too slow for the forces or a wrong model pushes steadily.
    """

    nis: Array
    whiteness: float

    @property
    def mean(self) -> float:
        """Mean of `nis`."""
        return float(np.mean(self.nis))


def innovation_of(whitened: Array, rows: int) -> Innovation:
    """Return the statistics of whitened innovations (m, nv) of which `rows` combinations carry information."""
    power = float(np.sum(whitened[:-1] ** 2))
    along = float(np.sum(whitened[1:] * whitened[:-1]))
    return Innovation(np.sum(whitened**2, axis=1) / rows, along / power if power > 0.0 else 0.0)
