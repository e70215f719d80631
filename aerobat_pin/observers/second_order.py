"""Project each interval's mean force first, then filter it by a critically damped second-order low-pass."""

from __future__ import annotations

from aerobat_pin.observers.kernels.filters import SECOND_ORDER
from aerobat_pin.observers.observer import Observer


class SecondOrderObserver(Observer):
    """Low-pass of second order: rolls off noise with the square of frequency, at the same 63 % rise time 1/K.

    f'' + 2 w f' + w^2 f = w^2 J^T+ phi with w = 2.146 K, advanced exactly over each interval.
    """

    name = "second_order"
    kind = SECOND_ORDER
