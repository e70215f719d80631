"""The paper's observer and two variants: a linear low-pass before or after the projection onto the force points."""

from __future__ import annotations

from aerobat_pin.observers.kernels.filters import SECOND_ORDER
from aerobat_pin.observers.observer import Observer


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
