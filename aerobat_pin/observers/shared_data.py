"""All observers by their names; and several of one model on one `pin.Data`.

Pinocchio then computes each sample once for all that need the same.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import pinocchio as pin

from aerobat_pin.errors import ObserverError
from aerobat_pin.numerics import Array, fields_of
from aerobat_pin.observers.estimate import Sample
from aerobat_pin.observers.kalman.kalman import KalmanObserver, SmootherObserver
from aerobat_pin.observers.kalman.noisy_sample import inertias_at
from aerobat_pin.observers.kernels import posterior
from aerobat_pin.observers.kernels.observer_state import ObserverState
from aerobat_pin.observers.momentum import (
    ForceLevelObserver,
    MomentumObserver,
    SecondOrderObserver,
    SuperTwistingObserver,
)
from aerobat_pin.observers.observer import Observer

OBSERVERS: dict[str, type[Observer]] = {  # as scenarios and the command line choose them
    kind.name: kind
    for kind in (
        MomentumObserver,
        ForceLevelObserver,
        SecondOrderObserver,
        SuperTwistingObserver,
        KalmanObserver,
        SmootherObserver,
    )
}


class ObserversTogether:
    """Observers that take the same samples.

    Args:
        observers: of one model, one or more; from now on they read Pinocchio's results in shared data.

    Raises:
        ObserverError: there is none, or their models differ in size.
    """

    def __init__(self, observers: Sequence[Observer]) -> None:
        if len({(int(observer.model.nq), int(observer.model.nv)) for observer in observers}) != 1:
            raise ObserverError(f"{len(observers)} observers together: one or more of the same model were expected")
        self.observers = tuple(observers)
        self.model = observers[0].model
        self.data = self.model.createData()
        groups: dict[Callable[..., Any], list[tuple[int, Observer]]] = {}
        for k, observer in enumerate(observers):
            observer.reset(pin.neutral(self.model), np.zeros(self.model.nv))  # compiles
            observer.data = self.data
            if isinstance(observer, KalmanObserver):
                observer._look_at(self.data, observer._kalman.observer)
                observer._kalman.filter.inertias[:] = inertias_at(observer.model, self.data)
            else:
                observer._look_at(self.data, fields_of(observer._memory, ObserverState))
            groups.setdefault(observer._compute, []).append((k, observer))
        self._groups = tuple(groups.items())
        self._levels, self.judge = np.zeros(3), 0
        for k, observer in reversed(list(enumerate(observers))):
            if observer.expected is not None and not isinstance(observer, KalmanObserver):
                state, self.judge = fields_of(observer._memory, ObserverState), k
                self._levels, self._newest = state.posterior[posterior.LEVELS], state.newest
                self._samples = state.samples

    @property
    def recent_k(self) -> float:
        """Mean k in the last seconds by the first observer that is no filter, see `Expected`; NaN if none shows it."""
        return float(self._levels[1]) if self._levels[2] > 0.0 else math.nan

    def last_interval(self, u: Array, dt: float) -> tuple[Array, Array]:
        """Return the mean velocity and the generalised force (nv,) of the newest interval, behind no filter."""
        after, before = self._samples[self._newest[0]], self._samples[1 - self._newest[0]]
        momentum, drift, velocity = after[0] - before[0], 0.5 * (before[1] + after[1]), 0.5 * (before[2] + after[2])
        return velocity, momentum / dt - drift - u

    def start(self, q: Array, v: Array) -> None:
        """Start all observers again, as `Observer.reset` does, at a sample that has been checked."""
        for compute, observers in self._groups:
            compute(self.model, self.data, q, v)
            for _, observer in observers:
                observer._start(v)

    def take(self, q: Array, v: Array, u: Array, dt: float) -> list[Sample | None]:
        """Take the next sample as `Observer.update` does.

        Args:
            q: (nq,) configuration.
            v: (nv,) velocity.
            u: (nv,) sum of all known generalised forces, mean over the interval.
            dt: its length [s].

        Returns:
            The estimate of each observer; None if the sample is no configuration or the residual is not finite.
        """
        samples: list[Sample | None] = [None] * len(self.observers)
        for compute, observers in self._groups:
            compute(self.model, self.data, q, v)
            for k, observer in observers:
                out = np.empty(observer._width)
                if observer._update(observer._memory, q, v, u, dt, out):
                    samples[k] = observer._result(out, observer._nv, observer._count)
        return samples
