"""Project each interval's mean force first, then filter the force itself."""

from __future__ import annotations

from aerobat_pin.arrays import Array
from aerobat_pin.observers.base import Observer, Sample


class ForceLevelObserver(Observer):
    """f <- exp(-K dt) f + (1 - exp(-K dt)) J^T+ phi, J in the middle of the interval.

    On a flapping wing J turns faster than a slow filter follows. Filtering in world axes leaves that turn out of the
    filter, so this order is better than the paper's at low gain; at high gain the two meet.
    """

    name = "force_level"

    @property
    def _filtered_size(self) -> int:
        return 3 * len(self.points.frames)

    def _observe(self, decay: Array, phi: Array, q_middle: Array) -> Sample:
        force = self.points.project(q_middle, phi).ravel()
        self._filtered = force + decay * (self._filtered - force)
        residual = self.points.jacobian(q_middle).T @ self._filtered
        return Sample(self._filtered.reshape(-1, 3).copy(), residual)
