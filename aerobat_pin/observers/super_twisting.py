"""A sliding-mode observer: follows ramps up to a slope without lag, and settles in finite time."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from aerobat_pin.errors import ObserverError
from aerobat_pin.observers.applications import Application
from aerobat_pin.observers.kernels.filters import SUPER_TWISTING
from aerobat_pin.observers.observer import DEFAULT_GAIN, Observer
from aerobat_pin.observers.rows import Rows, Tie


class SuperTwistingObserver(Observer):
    """Super-twisting with linear terms on each component's impulse, by implicit Euler: no chatter at any step.

    The linear terms are those of `second_order` and carry steps; the sliding terms (k1 = 1.5 sqrt(slope),
    k3 = 1.1 slope; Levant 1998, Moreno & Osorio 2012) carry what changes no faster than `slope`.

    Args:
        model, applications, gain, rows: as in `Observer`.
        slope: of the force that is followed exactly [N/s].

    Raises:
        ObserverError: as `Observer`; or the slope is not finite and positive.
    """

    name = "super_twisting"
    kind = SUPER_TWISTING

    def __init__(
        self,
        model: pin.Model,
        applications: Sequence[str | Application] = (),
        gain: ArrayLike = DEFAULT_GAIN,
        rows: Rows | Tie = "all",
        *,
        slope: float = 1.0,
    ) -> None:
        """Prepare the filter; `reset` starts it."""
        if not (np.isfinite(slope) and slope > 0.0):
            raise ObserverError(f"slope = {slope}: a finite positive number in N/s was expected")
        self.slope, self._settings = float(slope), {"slope": slope}
        super().__init__(model, applications, gain, rows)
