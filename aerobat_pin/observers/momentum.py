"""The paper's observer and its relatives: a linear low-pass, before or after the projection onto the force points."""

from __future__ import annotations

from aerobat_pin.observers.kernels.filters import SECOND_ORDER
from aerobat_pin.observers.observer import Observer


class MomentumObserver(Observer):
    """The paper's: r' = -K r + K u_f, in its integral form r = K (p - int(tau + C^T v - g + r) - p0).

    Over one interval, exactly: r <- exp(-K dt) r + (1 - exp(-K dt)) phi, stable for every K dt. The force is r
    projected with the Jacobian in the middle of the interval.
    """

    name = "momentum"
    project_first = False


class ForceLevelObserver(Observer):
    """Projects each interval's mean onto the force points, then filters the force in world axes.

    f <- exp(-K dt) f + (1 - exp(-K dt)) J^T+ phi, J in the middle of the interval. On a flapping wing J turns faster
    than a slow filter follows. Filtering in world axes leaves that turn out of the filter. At high gain the forces
    equal those of `momentum`.
    """

    name = "force_level"


class SecondOrderObserver(Observer):
    """Projects first, then filters by a critically damped second-order low-pass.

    f'' + 2 w f' + w^2 f = w^2 J^T+ phi with w = 2.146 K, advanced exactly over each interval. Noise falls with the
    square of its frequency, at the same rise of 63 % in 1/K.
    """

    name = "second_order"
    kind = SECOND_ORDER
