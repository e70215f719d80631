"""The paper's observer: filter the generalised residual, then project it onto the force points."""

from __future__ import annotations

from aerobat_pin.observers.observer import Observer


class MomentumObserver(Observer):
    """The paper's: r' = -K r + K u_f, in its integral form r = K (p - int(tau + C^T v - g + r) - p0).

    Over one interval, exactly: r <- exp(-K dt) r + (1 - exp(-K dt)) phi, stable for every K dt. The force is r
    projected with the Jacobian in the middle of the interval.
    """

    name = "momentum"
    project_first = False
