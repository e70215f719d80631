"""All observers by their names, as scenarios and the command line choose them."""

from __future__ import annotations

from aerobat_pin.observers.kalman.kalman import KalmanObserver, SmootherObserver
from aerobat_pin.observers.momentum import (
    ForceLevelObserver,
    MomentumObserver,
    SecondOrderObserver,
    SuperTwistingObserver,
)
from aerobat_pin.observers.observer import Observer

OBSERVERS: dict[str, type[Observer]] = {
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
