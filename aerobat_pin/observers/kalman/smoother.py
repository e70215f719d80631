"""A smoother for whole records: every interval is estimated from all earlier and later samples."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NoReturn

import numpy as np
from numpy.typing import ArrayLike

from aerobat_pin.errors import ObserverError
from aerobat_pin.numerics import Array
from aerobat_pin.observers.kalman.kalman import KalmanObserver
from aerobat_pin.observers.kalman.memory import step_size
from aerobat_pin.observers.kalman.smoother_kernels import smooth_all


class SmootherObserver(KalmanObserver):
    """The Kalman filter run forward over a record, then a smoother run backward; the estimate has no lag.

    The smoother is Rauch-Tung-Striebel's in the form of Bryson and Frazier. The arguments are those of
    `KalmanObserver`. Only `run` works; `update` raises an error.
    """

    name = "smoother"

    def update(
        self, time: float, q: ArrayLike, v: ArrayLike, tau: ArrayLike, known: Mapping[str, ArrayLike] | None = None
    ) -> NoReturn:
        """Raise an error: the smoother needs a whole record and cannot take single samples.

        Raises:
            ObserverError: always.
        """
        raise ObserverError("observer smoother needs a whole record: use run, or the observer kalman for a stream")

    def _run(self, time: Array, q: Array, v: Array, u: Array, known: Mapping[str, ArrayLike]) -> tuple[Array, Array]:
        steps = np.empty((len(u), step_size(self._kalman.step)))
        out, samples = self._filtered(time, q, v, u, known, steps)
        smooth_all(time, self._memory, steps, out)
        for k in np.flatnonzero(np.diff(time) == 0.0):
            out[k] = out[k - 1] if k > 0 else 0.0
        return out, samples
