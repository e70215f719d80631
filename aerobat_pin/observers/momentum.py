"""The paper's observer: filter the generalised residual, then project it onto the force points."""

from __future__ import annotations

import numpy as np

from aerobat_pin.arrays import Array
from aerobat_pin.observers.base import Observer, Sample


class MomentumObserver(Observer):
    """r' = -K r + K u_f, whose integral form is the paper's r = K (p - int(tau + C^T v - g + r) - p0).

    Over one interval, exactly: r <- exp(-K dt) r + (1 - exp(-K dt)) phi, stable for every K dt. The force is r
    projected with the Jacobian in the middle of the interval.
    """

    name = "momentum"

    @property
    def _filtered_size(self) -> int:
        return int(self.model.nv)

    def _observe(self, decay: Array, phi: Array, q_middle: Array) -> Sample:
        self._filtered = phi + decay * (self._filtered - phi)
        return Sample(self.points.project(q_middle, self._filtered), np.array(self._filtered))
