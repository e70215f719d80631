"""What forces and crank do between samples, stated or chosen by the likelihood of the innovations.

The log-likelihood has the derivative (sum l^2 - sum N) / 2 by a variance that noise adds to a state before every knot,
with l the adjoint and N its variance (`recursion`; S. J. Koopman and N. Shephard, Exact score for time series models in
state space form, Biometrika 79, 1992). Where the likelihood is highest, sum l^2 = sum N; until then their ratio is the
factor by which the variance is changed. One smoothing of the record serves all parameters.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from aerobat_pin.aerobat.raw.layout import CRANK_ERROR, Layout
from aerobat_pin.aerobat.raw.recursion import Flags, Smoothed
from aerobat_pin.numerics import Array
from aerobat_pin.scenario import RawSection

TICK = 1.0e-3  # [s]: the white force is stated as a mean over so long
FIRST_WALK, FIRST_BEND, FIRST_WHITE, FIRST_JERK = 0.1, 50.0, 0.02, 10.0  # of the weight (three), rad/s^2.5
LEAST = np.log([1e-3] * 3 + [1e-2] * 3 + [1e-4] * 3)  # of the weight
MOST = np.log([50.0] * 3 + [1e4] * 3 + [1.0] * 3)
ALIKE_LIMITS = np.log([0.2, 5.0])
JERK_LIMITS = np.log([1.0, 1e6])
TURNS = (0.004, 0.005, 0.006, 0.007, 0.008, 0.011, 0.016)  # [s]: walks of so many times the bend, smallest first
LONGEST_CLIMB = 1.5  # of a logarithm in one round
JUMP = 0.5  # of the robot's weight: deviation of a jump
LEAST_JUMP_GAIN = 10.0  # of the log-likelihood: one in 20,000 knots is taken to have a jump
APART = 0.02  # [s] between two jumps that are found at once


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
        each = {name: tuple(getattr(self, name).tolist()) for name in ("walk", "bend", "white", "alike")}
        return {**each, "crank_jerk": self.jerk}

    def __str__(self) -> str:
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


def free_logs(settings: RawSection, points: int) -> Flags:
    """Return which of the logarithms (13,) are left out of the settings, to be chosen by likelihood.

    A force at one point alone has nothing in common with others: its `alike` does nothing.
    """
    each = (settings.walk, settings.bend, settings.white, settings.alike if points > 1 else ())
    return np.array([value is None for value in each for _ in range(3)] + [settings.crank_jerk is None])


def white_variance(tuning: Tuning, dt: Array) -> Array:
    """Return the variances (m, 3) [N2] of the white force's mean over intervals dt (m,) [s]."""
    return np.asarray(tuning.white**2 * TICK / dt[:, None])


def likelier_tuning(
    tuning: Tuning, free: Flags, smoothed: Smoothed, dt: Array, layout: Layout, weight: float
) -> tuple[Tuning, float]:
    """Return a tuning under which the samples are likelier, and how much the log-likelihood gains, to first order.

    The record was `smoothed` with scores; its intervals are `dt` (m,) [s], and `free` (13,) says which logarithms may
    change.
    """

    def sums(states: slice, each: Array) -> Array:
        """Return sums (2, c) of l^2 and of N, each times its variance (c,) [per s]."""
        return np.stack([each**2 * (dt @ part[1:, states]) for part in (smoothed.pulls**2, smoothed.informations)])

    def summed(states: slice, each: Array) -> tuple[Array, Array]:
        """Return these sums for what the forces have in common (2, 3), and for how they differ."""
        by_point = sums(states, tuning.by_mode(each, layout.points)).reshape(2, layout.points, 3)
        return by_point[:, 0], by_point[:, 1:].sum(axis=1)

    (walk, walk_apart), (bend, bend_apart) = summed(layout.walk, tuning.walk), summed(layout.slope, tuning.bend)
    white = sums(layout.white, np.tile(tuning.white / dt.mean() * TICK**0.5, layout.points))
    white = white.reshape(2, layout.points, 3).sum(axis=1)
    jerk = sums(slice(CRANK_ERROR.stop - 1, CRANK_ERROR.stop), np.array([tuning.jerk]))
    common, apart = walk + bend, walk_apart + bend_apart
    sizes = walk + walk_apart, bend + bend_apart, white
    steps = np.concatenate([*map(_log_ratio, sizes), _log_ratio(common) - _log_ratio(apart), _log_ratio(jerk)])
    slopes = np.concatenate([pulls - informations for pulls, informations in (*sizes, common, jerk)])
    logs = tuning.to_logs()
    least = np.concatenate([LEAST + np.log(weight), [ALIKE_LIMITS[0]] * 3, JERK_LIMITS[:1]])
    most = np.concatenate([MOST + np.log(weight), [ALIKE_LIMITS[1]] * 3, JERK_LIMITS[1:]])
    wanted = np.clip(logs + np.clip(0.5 * steps, -LONGEST_CLIMB, LONGEST_CLIMB), least, most)
    following = np.where(free, wanted, logs)
    return Tuning.from_logs(following), float(slopes @ (following - logs))


def simpler_tuning(score: Callable[[Tuning], float], tuning: Tuning, free: Flags, weight: float) -> Tuning:
    """Return the tuning with forces that walk without a slope, along each axis where the samples are likelier so.

    Walk and slope each have a likelihood with a top of its own, and a climb from a slope does not come to the walk's.
    The smallest walk that is likelier is taken: about one that is too large, the motion is linearised in the wrong
    place.
    """
    best = score(tuning)
    least = LEAST[3:6] + np.log(weight)
    for axis in np.flatnonzero(free[:3] & free[3:6] & (tuning.to_logs()[3:6] > least + 1e-9)).tolist():
        for seconds in TURNS:
            logs = tuning.to_logs()
            logs[axis], logs[3 + axis] = logs[3 + axis] + np.log(seconds), least[axis]
            tried = Tuning.from_logs(logs)
            if (likelihood := score(tried)) > best:
                best, tuning = likelihood, tried
                break
    return tuning


def _log_ratio(sums: Array) -> Array:
    """Return the logarithm of the first of two sums (2, c) over the second; 0 where there is neither."""
    return np.asarray(np.log((sums[0] + 1e-300) / (sums[1] + 1e-300)))


def jump_gains(smoothed: Smoothed, forces: slice, variance: float) -> Array:
    """Return what a jump in each interval (m,) would gain in log-likelihood."""
    pull, information = smoothed.pulls[1:, forces], smoothed.inside[1:]
    size = np.eye(pull.shape[1])
    answer = np.linalg.solve(information + size / variance, pull[:, :, None])[:, :, 0]
    return np.asarray(
        0.5 * np.einsum("ki,ki->k", pull, answer) - 0.5 * np.linalg.slogdet(size + variance * information)[1]
    )


def more_jumps(smoothed: Smoothed, forces: slice, time: Array, jumps: Array, weight: float) -> Array:
    """Return the variances of jumps (m,) with those added that the samples still ask for; see `LinearRecord.jumps`."""
    variance = (JUMP * weight) ** 2
    gains, added = jump_gains(smoothed, forces, variance), jumps.copy()
    gains[jumps > 0.0] = 0.0
    while np.max(gains) > LEAST_JUMP_GAIN:
        k = int(np.argmax(gains))
        added[k] = variance
        gains[np.abs(time[:-1] - time[k]) < APART] = 0.0
    return added
