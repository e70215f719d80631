"""Wind: a velocity of the air that is the same everywhere and can change with time.

v_air(t) = velocity + amplitude (1 - cos(2 pi (t - start) / duration)) / 2 during the gust + sum a sin(w t + phase)

The sum is a wave, or turbulence. Dryden's spectra, one-sided in w [rad/s], of an air that is frozen and flown through
at a speed V, with a deviation s and a length L (MIL-F-8785C, 3.7.2.2):

along the flight        2 s^2 L / (pi V) / (1 + (w L / V)^2)
across it               s^2 L / (pi V) (1 + 3 (w L / V)^2) / (1 + (w L / V)^2)^2

`TONES` sines of equal amplitude stand for equal shares of the variance, each at a frequency that is drawn within its
share. So variance and autocorrelation are those of the spectrum up to `HIGHEST_TONE`, and velocity, rate and drift are
exact at any time.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from aerobat_pin.numerics import Array, guarded

LARGEST_AIRSPEED = 100.0  # [m/s]: Mach 0.3, where air stops to be incompressible; all models of this package take it so
TONES = 256  # of an axis
TIMES_AT_ONCE = 1000  # times at which tones are summed at once
HIGHEST_TONE = 30.0  # [Hz]: at 3 m/s, eddies of 0.1 m; smaller ones are not the same everywhere on a wing


@guarded(duration="positive")
@dataclass(frozen=True)
class Gust:
    """A single gust: largest velocity (3,) in world axes [m/s], start and duration [s]."""

    amplitude: tuple[float, float, float]
    start: float
    duration: float


@guarded(amplitude=("n", 3), rate=("n", 3), phase=("n", 3))
@dataclass(frozen=True)
class Tones:
    """Sums of n sines along the world axes (n, 3): amplitude [m/s], rate [rad/s], not 0, and phase [rad]."""

    amplitude: Array
    rate: Array
    phase: Array

    def at(self, time: Array) -> Array:
        """Return drift (up to a constant), velocity and rate of change (n, 3, 3) at times (n,): by kind, by axis."""
        values = np.empty((len(time), 3, 3))
        for rows in range(0, len(time), TIMES_AT_ONCE):
            turned = time[rows : rows + TIMES_AT_ONCE, None, None] * self.rate + self.phase
            for kind, factor in enumerate((-1.0 / self.rate, np.ones(1), self.rate)):
                wave = np.sin(turned) if kind == 1 else np.cos(turned)
                values[rows : rows + TIMES_AT_ONCE, kind] = np.einsum("ij,nij->nj", self.amplitude * factor, wave)
        return values


@guarded(length="positive", airspeed="positive")
def dryden(deviation: tuple[float, float, float], length: float, airspeed: float, seed: int) -> Tones:
    """Draw turbulence with Dryden's spectra up to `HIGHEST_TONE`.

    Args:
        deviation: (3,) along world x, the direction of the flight, and across it, y and z [m/s].
        length: scale of the eddies [m].
        airspeed: with which they are flown through [m/s].
        seed: of frequencies and phases.
    """
    rng = np.random.default_rng(seed)
    reduced = np.geomspace(1e-4, 1e6, 4001)  # w L / V
    turn = np.arctan(reduced)
    shares = [2.0 * turn / np.pi, *[(2.0 * turn - reduced / (1.0 + reduced**2)) / np.pi] * 2]
    amplitude, rate = np.empty((TONES, 3)), np.empty((TONES, 3))
    for axis, share in enumerate(shares):  # of the variance below a frequency
        kept = float(np.interp(2.0 * np.pi * HIGHEST_TONE * length / airspeed, reduced, share))
        drawn = kept * (np.arange(TONES) + rng.random(TONES)) / TONES
        rate[:, axis] = np.interp(drawn, share, reduced) * airspeed / length
        amplitude[:, axis] = deviation[axis] * np.sqrt(2.0 * kept / TONES)
    return Tones(amplitude, rate, rng.uniform(0.0, 2.0 * np.pi, (TONES, 3)))


@guarded()
@dataclass(frozen=True)
class Wind:
    """A steady velocity (3,) in world axes [m/s], and a gust and tones that are added to it."""

    velocity: tuple[float, float, float] = (0.0, 0.0, 0.0)
    gust: Gust | None = None
    tones: tuple[Tones, ...] = ()

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
        for tones in self.tones:
            field += tones.at(time)[:, 1:]
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
        for tones in self.tones:
            moved += tones.at(time)[:, 0] - tones.at(np.zeros(1))[:, 0]
        return moved
