"""Where a frozen wake is."""

from __future__ import annotations

import numpy as np

from aerobat_pin.flight.shown import Wake


def wake_at(wake: Wake, time: float) -> tuple[np.ndarray, np.ndarray]:
    """Return where the k samples shed until a time [s] are then (k, N, 3), oldest first, with their circulation."""
    old = int(np.searchsorted(wake.time, time, side="right"))
    moved = wake.wind.drift(np.array([time])) - wake.wind.drift(wake.time[:old])
    return wake.position[:old] + moved[:, None], wake.bound[:old]
