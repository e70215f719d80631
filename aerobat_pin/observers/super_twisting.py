"""A sliding-mode observer: follows ramps up to a given slope without lag, and settles in finite time."""

from __future__ import annotations

from collections.abc import Sequence

import pinocchio as pin
from numpy.typing import ArrayLike

from aerobat_pin.errors import ObserverError
from aerobat_pin.numerics import LARGEST_REAL, guarded
from aerobat_pin.observers.applications import Application
from aerobat_pin.observers.kernels.filters import SUPER_TWISTING
from aerobat_pin.observers.observer import DEFAULT_GAIN, Observer
from aerobat_pin.observers.rows import Rows


class SuperTwistingObserver(Observer):
    """A super-twisting observer with linear terms, applied to the impulse of each component.

    The linear terms are those of `second_order`; through them the estimate follows steps. The sliding terms
    (k1 = 1.5 sqrt(slope), k3 = 1.1 slope; Levant 1998, Moreno & Osorio 2012) make it follow a force that changes no
    faster than `slope`. The implicit Euler method avoids chattering at any step size.

    Args:
        model, applications, gain, rows: as in `Observer`.
        slope: largest rate of change of a force that is followed exactly [N/s].

    Raises:
        ObserverError: for the same reasons as `Observer`, or the slope is not finite and positive.
    """

    name = "super_twisting"
    kind = SUPER_TWISTING

    @guarded(gain="any", rows="free", slope="any")
    def __init__(
        self,
        model: pin.Model,
        applications: Sequence[str | Application] = (),
        gain: ArrayLike = DEFAULT_GAIN,
        rows: Rows = "all",
        *,
        slope: float = 1.0,
    ) -> None:
        """Prepare the filter; `reset` starts it."""
        if not 0.0 < slope <= LARGEST_REAL:
            raise ObserverError(f"slope = {slope}: a finite positive number in N/s was expected")
        self.slope, self._settings = float(slope), {"slope": slope}
        super().__init__(model, applications, gain, rows)
