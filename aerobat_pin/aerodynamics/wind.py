"""Wind: a velocity of the air that is the same everywhere and may change with time.

v_air(t) = wind + amplitude (1 - cos(2 pi (t - start) / duration)) / 2          during the gust
"""

from __future__ import annotations

import numpy as np

from aerobat_pin.numerics import Array
from aerobat_pin.scenario import AirSection


def wind_field(air: AirSection, time: Array) -> Array:
    """Return velocity of the air and its rate (n, 2, 3), world axes [m/s, m/s2], at times (n,) [s]."""
    field = np.zeros((len(time), 2, 3))
    field[:, 0] = air.wind
    if air.gust is not None:
        phase = 2.0 * np.pi * np.clip((time - air.gust.start) / air.gust.duration, 0.0, 1.0)
        rate = np.pi / air.gust.duration * np.sin(phase)
        field += np.stack([0.5 * (1.0 - np.cos(phase)), rate], axis=1)[:, :, None] * np.array(air.gust.amplitude)
    return field


def drift(air: AirSection, time: Array) -> Array:
    """Return how far the air has moved since t = 0, (n, 3) in world axes [m], at times (n,) [s]."""
    moved = np.outer(time, air.wind)
    if air.gust is not None:
        for sign, at in ((1.0, np.asarray(time)), (-1.0, np.zeros_like(time))):
            blown = np.clip(at - air.gust.start, 0.0, air.gust.duration)
            turn = 2.0 * np.pi / air.gust.duration
            moved += sign * np.outer(0.5 * (blown - np.sin(turn * blown) / turn), air.gust.amplitude)
    return np.asarray(moved)
