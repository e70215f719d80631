"""The mean external generalised force of one sample interval: what every momentum observer starts from.

With p = M v and Mdot = C + C^T, a robot under known generalised forces u and unknown ones u_f obeys
p' = u + u_f + C^T v - g. Over an interval [k, k+1]

    phi = (p_{k+1} - p_k) / dt - mean(u) - mean(C^T v - g)

is the mean of u_f. Known forces come as interval means; C^T v - g is averaged by the trapezoid of its ends.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from aerobat_pin.arrays import Array, checked
from aerobat_pin.errors import ObserverError

Known = Mapping[str, ArrayLike]


class IntervalResidual:
    """Remembers the last sample and turns the next one into phi."""

    def __init__(self, model: pin.Model) -> None:
        """Start without a sample: `reset` gives the first one."""
        self.model = model
        self.data = model.createData()
        self.time = float("nan")
        self.q: Array = np.empty(0)
        self._momentum: Array = np.empty(0)
        self._drift: Array = np.empty(0)

    def reset(self, q: ArrayLike, v: ArrayLike, time: float) -> None:
        """Take the first sample; the momentum p0 starts here, in flight as well as at rest."""
        self.q = checked(q, self.model.nq, "q")
        self.time = float(time)
        self._momentum, self._drift = self._momentum_and_drift(self.q, checked(v, self.model.nv, "v"))

    def advance(
        self, time: float, q: ArrayLike, v: ArrayLike, tau: ArrayLike, known: Known
    ) -> tuple[float, Array, Array] | None:
        """Take the next sample.

        Args:
            time: of the sample [s].
            q: (nq,) configuration at that time.
            v: (nv,) velocity at that time.
            tau: (nv,) measured joint torque, mean since the last sample.
            known: name -> (nv,) other known generalised forces, means since the last sample.

        Returns:
            Length of the interval [s], phi (nv,) and the configuration (nq,) in its middle; None for a repeated stamp.

        Raises:
            ObserverError: no reset before, or time runs backwards.
            ShapeError: an array does not fit the model or is not finite.
        """
        if not self.q.size:
            raise ObserverError("reset(q, v) must come before the first update")
        dt = float(time) - self.time
        if dt == 0.0:
            return None
        if not dt > 0.0:
            raise ObserverError(f"time went from {self.time} s to {time} s: stamps must not decrease")
        q = checked(q, self.model.nq, "q")
        momentum, drift = self._momentum_and_drift(q, checked(v, self.model.nv, "v"))
        phi = (momentum - self._momentum) / dt - 0.5 * (drift + self._drift) - checked(tau, self.model.nv, "tau")
        for name, force in known.items():
            phi -= checked(force, self.model.nv, name)
        middle = pin.interpolate(self.model, self.q, q, 0.5)
        self.time, self.q, self._momentum, self._drift = float(time), q, momentum, drift
        return dt, phi, middle

    def _momentum_and_drift(self, q: Array, v: Array) -> tuple[Array, Array]:
        """Return p = M v and C^T v - g, both (nv,)."""
        model, data = self.model, self.data
        momentum = pin.crba(model, data, q) @ v
        drift = pin.computeCoriolisMatrix(model, data, q, v).T @ v
        return momentum, drift - pin.computeGeneralizedGravity(model, data, q)
