"""The paper's observer and its variants: low-passes before or after the projection, and a sliding mode after it."""

from __future__ import annotations

from collections.abc import Sequence

import pinocchio as pin
from numpy.typing import ArrayLike

from aerobat_pin.errors import ObserverError
from aerobat_pin.numerics import LARGEST_REAL, guarded
from aerobat_pin.observers.applications import Application
from aerobat_pin.observers.expected import Expected
from aerobat_pin.observers.kernels.filters import SECOND_ORDER, SUPER_TWISTING
from aerobat_pin.observers.observer import DEFAULT_GAIN, Observer
from aerobat_pin.observers.rows import Rows


class MomentumObserver(Observer):
    """The paper's observer, r' = -K r + K u_f; its integral form is r = K (p - int(tau + C^T v - g + r) - p0).

    The exact solution over one interval, r <- exp(-K dt) r + (1 - exp(-K dt)) phi, is stable for every K dt. The forces
    are computed from r by projection with the Jacobian in the middle of the interval.
    """

    name = "momentum"
    project_first = False


class ForceLevelObserver(Observer):
    """An observer that projects each interval's mean onto the force points, then filters the components.

    f <- exp(-K dt) f + (1 - exp(-K dt)) J^T+ phi with J in the middle of the interval. On a flapping wing J turns
    faster than a slow filter can follow. Forces in world axes do not turn with the wing, so filtering these forces
    avoids the problem. At high gain the forces equal those of `momentum`.
    """

    name = "force_level"


class SecondOrderObserver(Observer):
    """An observer that projects first, then filters with a critically damped second-order low-pass.

    f'' + 2 w f' + w^2 f = w^2 J^T+ phi with w = 2.146 K, integrated exactly over each interval. A step rises to 63 %
    in 1/K, as in the first-order filter, but high-frequency noise falls with the square of its frequency.
    """

    name = "second_order"
    kind = SECOND_ORDER


class SuperTwistingObserver(Observer):
    """A super-twisting observer with linear terms, applied to the impulse of each component.

    The linear terms are those of `second_order`; through them the estimate follows steps. The sliding terms
    (k1 = 1.5 sqrt(slope), k3 = 1.1 slope; Levant 1998, Moreno & Osorio 2012) make it follow a force that changes no
    faster than `slope`. The implicit Euler method avoids chattering at any step size.

    Args:
        model, applications, gain, rows, expected: as in `Observer`.
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
        expected: Expected | None = None,
        *,
        slope: float = 1.0,
    ) -> None:
        """Prepare the filter; `reset` starts it."""
        if not 0.0 < slope <= LARGEST_REAL:
            raise ObserverError(f"slope = {slope}: a finite positive number in N/s was expected")
        self.slope, self._settings = float(slope), {"slope": slope}
        super().__init__(model, applications, gain, rows, expected)
