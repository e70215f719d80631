"""What forces and crank do between samples, chosen by the likelihood of the innovations.

The log-likelihood has the derivative (sum l^2 - sum N) / 2 by a variance that noise adds to a state before every knot,
with l the adjoint and N its variance (`recursion`; S. J. Koopman and N. Shephard, Exact score for time series models in
state space form, Biometrika 79, 1992). Where the likelihood is highest, sum l^2 = sum N; until then their ratio is the
factor by which the variance is changed. One smoothing of the record serves all parameters.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from aerobat_pin.aerobat.raw.layout import CRANK_ERROR, Layout
from aerobat_pin.aerobat.raw.recursion import Smoothed
from aerobat_pin.aerobat.raw.tuning import TICK, Flags, Tuning
from aerobat_pin.numerics import Array

LEAST = np.log([1e-3] * 3 + [1e-2] * 3 + [1e-4] * 3)  # of the weight
MOST = np.log([50.0] * 3 + [1e4] * 3 + [1.0] * 3)
ALIKE_LIMITS = np.log([0.2, 5.0])
JERK_LIMITS = np.log([1.0, 1e6])
TURNS = (0.004, 0.005, 0.006, 0.007, 0.008, 0.011, 0.016)  # [s]: walks of so many times the bend, smallest first
LONGEST_CLIMB = 1.5  # of a logarithm in one round
JUMP = 0.5  # of the robot's weight: deviation of a jump
LEAST_JUMP_GAIN = 10.0  # of the log-likelihood: one in 20,000 knots is taken to have a jump
APART = 0.02  # [s] between two jumps that are found at once


def likelier_tuning(
    tuning: Tuning, free: Flags, smoothed: Smoothed, dt: Array, layout: Layout, weight: float
) -> tuple[Tuning, float]:
    """Return a tuning under which the samples are likelier, and about how much the log-likelihood gains by it.

    Args:
        tuning: under which the record was smoothed.
        free: (13,) which logarithms may change.
        smoothed: the record, smoothed with scores.
        dt: (m,) intervals [s].
        layout: places of the states.
        weight: of the robot [N].

    Returns:
        The next tuning, and the gain to first order.
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
    steps = np.concatenate(
        [_log_ratio(walk + walk_apart), _log_ratio(bend + bend_apart), _log_ratio(white),
         _log_ratio(common) - _log_ratio(apart), _log_ratio(jerk)]
    )  # fmt: skip
    slopes = [
        pulls - informations for pulls, informations in (walk + walk_apart, bend + bend_apart, white, common, jerk)
    ]
    logs = tuning.to_logs()
    least = np.concatenate([LEAST + np.log(weight), [ALIKE_LIMITS[0]] * 3, JERK_LIMITS[:1]])
    most = np.concatenate([MOST + np.log(weight), [ALIKE_LIMITS[1]] * 3, JERK_LIMITS[1:]])
    wanted = np.clip(logs + np.clip(0.5 * steps, -LONGEST_CLIMB, LONGEST_CLIMB), least, most)
    following = np.where(free, wanted, logs)
    return Tuning.from_logs(following), float(np.concatenate(slopes) @ (following - logs))


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
