"""Project each interval's mean force first, then filter the force itself."""

from __future__ import annotations

from aerobat_pin.observers.observer import Observer


class ForceLevelObserver(Observer):
    """Projects each interval's mean onto the force points, then filters the force in world axes.

    f <- exp(-K dt) f + (1 - exp(-K dt)) J^T+ phi, J in the middle of the interval. On a flapping wing J turns faster
    than a slow filter follows. Filtering in world axes leaves that turn out of the filter; at high gain the two meet.
    """

    name = "force_level"
    project_first = True
