"""Wind: a velocity of the air that is the same everywhere and can change with time.

v_air(t) = velocity + amplitude (1 - cos(2 pi (t - start) / duration)) / 2          during the gust
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from aerobat_pin.numerics import Array, guarded

LARGEST_AIRSPEED = 100.0  # [m/s]: Mach 0.3, where air stops to be incompressible; all models of this package take it so


@guarded(duration="positive")
@dataclass(frozen=True)
class Gust:
    """A single gust: largest velocity (3,) in world axes [m/s], start and duration [s]."""

    amplitude: tuple[float, float, float]
    start: float
    duration: float


@guarded()
@dataclass(frozen=True)
class Wind:
    """A steady velocity (3,) in world axes [m/s], and a gust added to it or None."""

    velocity: tuple[float, float, float] = (0.0, 0.0, 0.0)
    gust: Gust | None = None

    @guarded(time=("n",))
    def field(self, time: Array) -> Array:
        """Return wind velocity and its rate of change (n, 2, 3), world axes [m/s, m/s2], at times (n,) [s]."""
        field = np.zeros((len(time), 2, 3))
        field[:, 0] = self.velocity
        if self.gust is not None:
            phase = 2.0 * np.pi * np.clip((time - self.gust.start) / self.gust.duration, 0.0, 1.0)
            rate = np.pi / self.gust.duration * np.sin(phase)
            shape = np.stack([0.5 * (1.0 - np.cos(phase)), rate], axis=1)
            field += shape[:, :, None] * np.array(self.gust.amplitude)
        return field

    @guarded(time=("n",))
    def drift(self, time: Array) -> Array:
        """Return how far the air has moved since t = 0, (n, 3) in world axes [m], at times (n,) [s]."""
        moved: Array = np.outer(time, np.array(self.velocity))
        if self.gust is not None:
            frequency = 2.0 * np.pi / self.gust.duration
            for sign, at in ((1.0, np.asarray(time)), (-1.0, np.zeros_like(time))):
                since = np.clip(at - self.gust.start, 0.0, self.gust.duration)
                moved += sign * np.outer(
                    0.5 * (since - np.sin(frequency * since) / frequency), np.array(self.gust.amplitude)
                )
        return moved
