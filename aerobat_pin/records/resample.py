"""The one rule by which channels of different rates come to common times.

The common times are evenly spaced, at the rate of the pose or of the joints (or at `log.rate`), over the time in which
every channel has samples. At these times, positions, velocities and commands are interpolated linearly between the two
samples around them, and quaternions likewise and made unit length again. Torques and measured forces are means over
each interval: the exact integral of the straight lines between samples. Rates that are not measured are the slopes of
parabolas (Savitzky & Golay 1964) over a stated window. An interval with a hole longer than `log.longest_gap` in any
column is not used. An angle that jumps by a full turn between neighbouring samples goes on instead, before all that.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable
from typing import Any, TypeVar

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from aerobat_pin.numerics import Array, runs_of_true
from aerobat_pin.records.spool import EXTENT, Series, typical_spacing

Hole = TypeVar("Hole", bound=tuple[Any, ...])
FINEST = 8  # even times for each uneven one, at most
HOLE = 2.5  # usual steps of a channel, which a hole is longer than
CONJUGATE = np.array([-1.0, -1.0, -1.0, 1.0])  # times a unit quaternion x, y, z, w: the inverse turn
HOLES_TOLD = 3  # holes that are told one by one
FAILED_AWAY, FAILED_STEPS = 0.25, 20.0  # of a joint's range, usual steps: from which a jump away and back is no motion
FASTEST_TURNS = 5.0  # a second, faster than which no joint turns away and back
FAILED_AT_ONCE, MOST_FAILED = 3, 0.1  # equal samples of such a reading, and share of all, at most
NEAR_TURN = 0.25  # of a turn: a joint turns less from sample to sample, and a jump by a full turn is as near to one


def sampled(time: Array, values: Array, wanted: Array) -> Array:
    """Interpolate samples (n, k) at times (n,) linearly at times (m,) [s]; returns (m, k)."""
    return np.stack([np.interp(wanted, time, column) for column in values.T], axis=1)


def sampled_turns(time: Array, quaternions: Array, wanted: Array) -> Array:
    """Interpolate unit quaternions (n, 4) at times (m,) [s]; returns unit quaternions (m, 4) without jumps of sign."""
    turns = continuous(quaternions)
    turned = sampled(time, turns, wanted)
    return np.asarray(turned / np.linalg.norm(turned, axis=1, keepdims=True))


def continuous(quaternions: Array) -> Array:
    """Return quaternions (n, 4) with the signs that make neighbours close; q and -q are the same attitude."""
    flips = np.sum(quaternions[1:] * quaternions[:-1], axis=1) < 0.0
    signs = np.concatenate([[1.0], np.where(np.cumsum(flips) % 2 == 1, -1.0, 1.0)])
    return np.asarray(quaternions * signs[:, None])


def quaternion_product(first: Array, second: Array) -> Array:
    """Return the products (n, 4) of quaternions x, y, z, w, each (n, 4) or (4,): the second turns before the first."""
    (x, y, z, w), (a, b, c, d) = first.T, second.T
    vector = (w * a + x * d + y * c - z * b, w * b + y * d + z * a - x * c, w * c + z * d + x * b - y * a)
    return np.stack([*vector, w * d - x * a - y * b - z * c], axis=1)


def line_means(time: Array, values: Array, wanted: Array) -> Array:
    """Return the means (m, k) over intervals between times (m + 1,) [s] of the line through samples (n, k)."""
    steps = np.diff(time)[:, None]
    sums = np.concatenate([np.zeros((1, values.shape[1])), np.cumsum(0.5 * steps * (values[1:] + values[:-1]), axis=0)])
    at = np.clip(np.searchsorted(time, wanted, side="right") - 1, 0, len(time) - 2)
    into = np.clip(wanted, time[0], time[-1]) - time[at]
    slope = (values[at + 1] - values[at]) / steps[at]
    integral = sums[at] + into[:, None] * (values[at] + 0.5 * slope * into[:, None])
    return np.asarray(np.diff(integral, axis=0) / np.diff(wanted)[:, None])


def slopes(values: Array, dt: float, window: float) -> Array:
    """Return the derivative (m, k) of evenly spaced values: slopes of parabolas over a window [s].

    Args:
        values: (m, k) values.
        dt: spacing [s].
        window: length of the parabolas [s]; an odd number of samples, at least three.
    """
    count = min(max(3, 2 * round(0.5 * window / dt) + 1), (len(values) - 1) // 2 * 2 + 1)
    if count < 3:
        return np.zeros_like(values)
    half = count // 2  # as scipy's savgol_filter, whose import would take longer than a short flight
    places = np.arange(-half, half + 1.0) / half
    fit = np.linalg.pinv(np.vander(places, 3, increasing=True))  # (3, count): from values to coefficients of a parabola
    inner = np.stack([np.convolve(column, fit[1, ::-1], "valid") for column in values.T], axis=1)
    first, last = (fit[1] @ end + 2.0 * places[:, None] * (fit[2] @ end) for end in (values[:count], values[-count:]))
    return np.concatenate([first[:half], inner, last[half + 1 :]]) / (half * dt)


def uneven_slopes(time: Array, values: Array, window: float) -> Array:
    """Return `slopes` (m, k) of values at uneven times (m,) [s]: those of the lines through them at even times.

    These have the values' usual step, and so are at the values' own times where these are even.
    """
    steps = np.round((time[-1] - time[0]) / np.median(np.diff(time)))  # stamps rise
    even = np.linspace(time[0], time[-1], int(np.clip(steps + 1, len(time), FINEST * len(time))))
    return sampled(even, slopes(sampled(time, values, even), float(even[1] - even[0]), window), time)


def neighbour_rates(model: pin.Model, time: Array, q: Array) -> Array:
    """Return the velocities (m, nv) of configurations (m, nq) at uneven times (m,) [s], differentiated numerically.

    At each sample it is the weighted mean of the rates over the two neighbouring intervals: the shorter one has the
    larger weight (the length of the other). Samples with the same time have the same velocity.
    """
    stamps, first, index = np.unique(time, return_index=True, return_inverse=True)
    v, dt = np.zeros((len(stamps), model.nv)), np.diff(stamps)
    if len(dt):
        rates = np.array([pin.difference(model, a, b) for a, b in itertools.pairwise(q[first])]) / dt[:, None]
        v[0], v[-1] = rates[0], rates[-1]
        v[1:-1] = (dt[1:, None] * rates[:-1] + dt[:-1, None] * rates[1:]) / (dt[1:] + dt[:-1])[:, None]
    return v[index]


def turn_rates(quaternions: Array, dt: float, window: float) -> Array:
    """Return the angular velocity (m, 3) [rad/s] in body axes of evenly spaced quaternions (m, 4) x, y, z, w.

    The quaternion's derivative is the slope of parabolas; the rate is twice the vector part of conj(q) q'.
    """
    turns = continuous(quaternions)
    return 2.0 * quaternion_product(turns * CONJUGATE, slopes(turns, dt, window))[:, :3]


def without_turns(time: Series, values: Series, turn: float, longest: float) -> tuple[Series, int]:
    """Return angles (n,) without jumps by a full turn between neighbouring samples, and how many there were.

    Stamps (n,) more than `longest` [s] and `HOLE` usual steps apart are no neighbours. A full turn is `turn` in the
    unit of the angles; steps between a joint's own and a full turn's are those of another unit, and no jumps.
    """
    longest, count = max(longest, HOLE * typical_spacing(time)), len(values)
    rows, signs = [np.zeros(0, int)], [np.zeros(1)]
    for first in range(0, count - 1, EXTENT):
        steps, spaces = np.diff(values[first : first + EXTENT + 1]), np.diff(time[first : first + EXTENT + 1])
        jumps = (np.abs(np.abs(steps) - turn) < NEAR_TURN * turn) & (spaces <= longest)
        for begin, end in runs_of_true(jumps):
            beside = [*steps[max(begin - 1, 0) : begin], *steps[end : end + 1]]
            jumps[begin:end] = np.all(np.abs(beside) < NEAR_TURN * turn)
        rows.append(first + 1 + np.flatnonzero(jumps))
        signs.append(-np.sign(steps[jumps]))
    at, shifts = np.concatenate(rows), turn * np.cumsum(np.concatenate(signs))
    if not len(at):
        return values, 0
    whole = Series(values.spool)
    for first in range(0, count, EXTENT):
        piece = values[first : first + EXTENT]
        whole.append(piece + shifts[np.searchsorted(at, np.arange(first, first + len(piece)), side="right")])
    return whole, len(at)


def failed_readings(values: Array, turn: float, spacing: float) -> NDArray[np.intp]:
    """Return the rows of angles (n,) at which a joint jumps away and at once back: a reading that failed.

    It jumps faster than joints turn, between samples of a spacing [s]. Jumps by a full turn, `turn` in the unit of the
    angles, are none; a joint that slides has 0, and no such rows. Equal neighbours count as one sample.
    """
    filled = np.flatnonzero(np.isfinite(values))
    runs = np.flatnonzero(np.diff(values[filled], prepend=np.nan) != 0.0)
    places, last = values[filled][runs], np.append(runs[1:], len(filled))
    if len(places) < 4 or not turn:
        return runs[:0]
    steps = np.diff(places)
    steps -= turn * np.round(steps / turn)
    least = max(FAILED_AWAY * float(np.ptp(places)), FAILED_STEPS * float(np.median(np.abs(steps))))
    least = max(least, FASTEST_TURNS * spacing * turn)
    away = np.minimum(np.abs(steps[:-1]), np.abs(steps[1:])) > least
    away &= np.abs(steps[:-1] + steps[1:]) < FAILED_AWAY * np.abs(steps[:-1])
    away &= (last - runs)[1:-1] <= FAILED_AT_ONCE
    rows = [filled[runs[k] : last[k]] for k in (1 + np.flatnonzero(away)).tolist()]
    return np.concatenate(rows) if 0 < sum(map(len, rows)) <= MOST_FAILED * len(filled) else runs[:0]


def holes(time: Series, longest: float) -> list[tuple[float, float]]:
    """Return the holes in stamps (n,) that are longer than `longest` [s]: their start and end.

    It is also longer than `HOLE` of the samples' usual steps, which may be about as long.
    """
    longest = max(longest, HOLE * typical_spacing(time))
    gaps, before = [], float(time[0])
    for piece in time.pieces():
        stamps = np.concatenate([[before], piece])
        gaps += [(float(stamps[i]), float(stamps[i + 1])) for i in np.flatnonzero(np.diff(stamps) > longest)]
        before = float(stamps[-1])
    return gaps


def longest_holes(gaps: Iterable[Hole]) -> tuple[list[Hole], int]:
    """Return the `HOLES_TOLD` longest of holes (start, end [s], ...) in their order, and how many others there are."""
    told = sorted(gaps, key=lambda gap: gap[0] - gap[1])
    return sorted(told[:HOLES_TOLD]), len(told[HOLES_TOLD:])


def rate_beside_holes(time: Series, longest: float) -> float:
    """Return the mean rate [1/s] of stamps (n,), which have none in holes that are longer than `longest` [s]."""
    lost = [end - begin for begin, end in holes(time, longest)]
    return (len(time) - 1 - len(lost)) / float(time[-1] - time[0] - sum(lost))
