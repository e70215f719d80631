"""What forces and crank do between samples, and how it is chosen."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from aerobat_pin.estimation.raw.choose_walk import most_likely
from aerobat_pin.numerics import Array
from aerobat_pin.scenario import RawSection

TICK = 1.0e-3  # [s]: the white force is stated as a mean over so long
FIRST_WALK, FIRST_WHITE, FIRST_JERK = 0.33, 0.02, 100.0  # of the weight, of the weight, rad/s^2.5
LEAST = np.log([1e-3] * 3 + [1e-4] * 3)  # of the weight
MOST = np.log([50.0] * 3 + [1.0] * 3)
JERK_LIMITS = np.log([1.0, 1e6])


@dataclass(frozen=True)
class Tuning:
    """What the forces and the crank do between samples.

    Attributes:
        walk: (3,) change of each force in a second, world axes [N/sqrt(s)].
        white: (3,) force noise, mean over `TICK`, world axes [N].
        jerk: white noise of the crank's jerk [rad/s^2.5].
    """

    walk: Array
    white: Array
    jerk: float

    def to_logs(self) -> Array:
        """Return the logarithms (7,): walk, white, jerk."""
        return np.asarray(np.log(np.concatenate([self.walk, self.white, [self.jerk]])))

    @classmethod
    def from_logs(cls, logs: Array) -> Tuning:
        """Return the tuning with these logarithms."""
        values = np.exp(logs)
        return cls(values[:3], values[3:6], float(values[6]))

    def stated(self) -> dict[str, Any]:
        """Return the tuning as entries of the table `observers.raw`."""
        return {"walk": tuple(self.walk.tolist()), "white": tuple(self.white.tolist()), "crank_jerk": self.jerk}

    def __str__(self) -> str:
        """Return the tuning in words."""
        walk, white = (" ".join(f"{value:.3g}" for value in 1e3 * values) for values in (self.walk, self.white))
        return f"walk {walk} mN/sqrt(s), white {white} mN, crank's jerk {self.jerk:.3g} rad/s^2.5"


def first_tuning(settings: RawSection, weight: float) -> Tuning:
    """Return the stated tuning; what is left out is where the search by likelihood begins. `weight` is in N."""
    walk = np.full(3, FIRST_WALK * weight) if settings.walk is None else np.array(settings.walk)
    white = np.full(3, FIRST_WHITE * weight) if settings.white is None else np.maximum(settings.white, 1e-4 * weight)
    return Tuning(walk, white, FIRST_JERK if settings.crank_jerk is None else settings.crank_jerk)


def free_logs(settings: RawSection) -> Array:
    """Return which of the logarithms (7,) are left out of the settings, to be chosen by likelihood."""
    left_out = [settings.walk is None] * 3 + [settings.white is None] * 3 + [settings.crank_jerk is None]
    return np.array(left_out)


def likely_tuning(score: Callable[[Tuning], float], start: Tuning, free: Array, weight: float) -> Tuning:
    """Return the tuning of highest likelihood, as far as `likelihood.most_likely` climbs."""
    least = np.append(LEAST + np.log(weight), JERK_LIMITS[0])
    most = np.append(MOST + np.log(weight), JERK_LIMITS[1])
    begin = np.where(free, np.clip(start.to_logs(), least, most), start.to_logs())
    order = [i for i in (3, 4, 5, 0, 1, 2, 6) if free[i]]  # a walk chosen first would follow the white noise
    return Tuning.from_logs(most_likely(lambda logs: score(Tuning.from_logs(logs)), begin, order, least, most))


def white_variance(tuning: Tuning, dt: Array) -> Array:
    """Return the variances (m, 3) [N2] of the white force's mean over intervals dt (m,) [s]."""
    return np.asarray(tuning.white**2 * TICK / dt[:, None])
