"""What forces and crank do between samples, and how it is chosen."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from aerobat_pin.numerics import Array
from aerobat_pin.scenario import RawSection

Flags = np.ndarray[Any, np.dtype[np.bool_]]
TICK = 1.0e-3  # [s]: the white force is stated as a mean over so long
FIRST_WALK, FIRST_BEND, FIRST_WHITE, FIRST_JERK = 0.1, 50.0, 0.02, 10.0  # of the weight (three), rad/s^2.5


@dataclass(frozen=True)
class Tuning:
    """What the forces and the crank do between samples.

    Attributes:
        walk: (3,) change of each force in a second, world axes [N/sqrt(s)].
        bend: (3,) change of each force's slope in a second, world axes [N/s^1.5].
        white: (3,) force noise, mean over `TICK`, world axes [N].
        alike: (3,) changes that the forces have in common over those in which they differ; 1 if they are independent.
        jerk: white noise of the crank's jerk [rad/s^2.5].
    """

    walk: Array
    bend: Array
    white: Array
    alike: Array
    jerk: float

    def by_mode(self, each: Array, points: int) -> Array:
        """Return the changes of the slow states (3 points,), of changes (3,) that each force has; see `Layout.modes`.

        Each force's variance is the mean over the modes: that of the first is alike^2 times that of the others.
        """
        others = each * np.sqrt(points / (self.alike**2 + points - 1.0))
        return np.concatenate([self.alike * others, np.tile(others, points - 1)])

    def to_logs(self) -> Array:
        """Return the logarithms (13,): walk, bend, white, alike, jerk."""
        return np.asarray(np.log(np.concatenate([self.walk, self.bend, self.white, self.alike, [self.jerk]])))

    @classmethod
    def from_logs(cls, logs: Array) -> Tuning:
        """Return the tuning with these logarithms."""
        values = np.exp(logs)
        return cls(values[:3], values[3:6], values[6:9], values[9:12], float(values[12]))

    def stated(self) -> dict[str, Any]:
        """Return the tuning as entries of the table `observers.raw`."""
        return {
            "walk": tuple(self.walk.tolist()),
            "bend": tuple(self.bend.tolist()),
            "white": tuple(self.white.tolist()),
            "alike": tuple(self.alike.tolist()),
            "crank_jerk": self.jerk,
        }

    def __str__(self) -> str:
        """Return the tuning in words."""
        walk, bend, white = (
            " ".join(f"{value:.3g}" for value in 1e3 * values) for values in (self.walk, self.bend, self.white)
        )
        alike = " ".join(f"{value:.2g}" for value in self.alike)
        return (
            f"walk {walk} mN/sqrt(s), bend {bend} mN/s^1.5, white {white} mN, common over differing changes {alike}, "
            f"crank's jerk {self.jerk:.3g} rad/s^2.5"
        )


def first_tuning(settings: RawSection, weight: float) -> Tuning:
    """Return the stated tuning; what is left out is where the search by likelihood begins. `weight` is in N."""
    walk = np.full(3, FIRST_WALK * weight) if settings.walk is None else np.array(settings.walk)
    bend = np.full(3, FIRST_BEND * weight) if settings.bend is None else np.array(settings.bend)
    white = np.full(3, FIRST_WHITE * weight) if settings.white is None else np.maximum(settings.white, 1e-4 * weight)
    alike = np.ones(3) if settings.alike is None else np.array(settings.alike)
    return Tuning(walk, bend, white, alike, FIRST_JERK if settings.crank_jerk is None else settings.crank_jerk)


def free_logs(settings: RawSection) -> Flags:
    """Return which of the logarithms (13,) are left out of the settings, to be chosen by likelihood."""
    each = (settings.walk, settings.bend, settings.white, settings.alike)
    return np.array([value is None for value in each for _ in range(3)] + [settings.crank_jerk is None])


def white_variance(tuning: Tuning, dt: Array) -> Array:
    """Return the variances (m, 3) [N2] of the white force's mean over intervals dt (m,) [s]."""
    return np.asarray(tuning.white**2 * TICK / dt[:, None])
