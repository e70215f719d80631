"""How a second series follows a first one, however late it is, and what it lost on the way.

The second series is shifted in time until it follows the first best, whatever the factors of its columns: Gauss-Newton
from no shift, or, where that leaves too much, from the best of a row of shifts. Rates are compared by their integrals
over windows, so that noise and a small bias do not count.

Of values x with rates v, a step is r times as long as its stamps say where all columns moved on at once by r v dt. A
logger that loses samples and stamps those that it has evenly leaves whole numbers r: mostly 1, and some 2, 3, ...
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from aerobat_pin.numerics.arrays import Array

COMPARED_OVER = 0.1  # [s]: over which integrals are compared
LATEST_SHIFT = 0.3  # [s] that the search can find
SHIFT_STEPS = 8  # most Gauss-Newton steps of the shift
SMALLEST_SHIFT = 1e-5  # [s]: a smaller step ends the search
TRIED_EVERY = 4e-3  # [s]: distance of the shifts from which the search can begin
WIDEST_GAP = 3.0  # times the mean step; over a longer one no rate is integrated
FEWEST_POINTS = 8  # at which two series are compared, for otherwise they say nothing
MOST_POINTS = 4000  # at which two series are compared, and a tenth of them at each shift that is tried
SHIFT_GAIN = 1.2  # a shift counts if it makes the mean square difference smaller by this factor
EXPLAINED_BY_SHIFT = 0.25  # of the first's mean square, up to which what a shift leaves makes it certain
QUARTILE = 0.3186  # of the magnitude of noise of deviation 1, below which a quarter is
CLEAR_STEP = 15.0  # deviations of a step's noise by which its values move on, of the steps that count
OF_OTHER_LENGTH = 0.9  # share of the squares of a step that its rates explain, if it is of another length only
WHOLE_STEPS = 0.1  # median distance from whole numbers, of longer steps; those of any length are 0.25 away
FEWEST_LONGER = 4  # steps that tell whether they are whole
RIGHT_STEPS = 0.4  # share of the steps that are right, at least: else it is a unit that is wrong


@dataclass(frozen=True)
class CrossCorrelation:
    """How a second series (m, c) follows a first one.

    Attributes:
        lag: how late the second is [s]; 0 where no shift makes it fit better.
        certain: whether the lag explains the difference.
        sizes: (2, c) rms of both series.
        residual: (c,) rms of their difference after the shift.
        swings: (2, c) rms of both series about their means.
        unlike: (c,) rms about its mean of their difference.
        match: (c, c) correlation of each column of the first with each of the second, about their means.
        along: (c,) correlation of each column with its own, not about their means: that of steady motion.
    """

    lag: float
    certain: bool
    sizes: Array
    residual: Array
    swings: Array
    unlike: Array
    match: Array
    along: Array

    @property
    def correlation(self) -> Array:
        """(c,) correlation of each column with its own."""
        return np.array(np.diagonal(self.match))

    @property
    def factor(self) -> Array:
        """(c,) second per first, least squares about their means."""
        first, second = self.swings
        return np.asarray(self.correlation * _divided(second, first))

    def follows(self, column: int) -> tuple[float, float]:
        """Return factor and correlation of a column: about the means, unless steady motion says more."""
        along, about = float(self.along[column]), float(self.correlation[column])
        if abs(along) <= abs(about):
            return float(self.factor[column]), about
        return along * float(self.sizes[1, column] / self.sizes[0, column]), along

    @property
    def scaled(self) -> Array:
        """(c,) rms of what the best factor of each column leaves of the first."""
        return np.asarray(self.swings[0] * np.sqrt(np.maximum(1.0 - self.correlation**2, 0.0)))


def compare_rates(values: Array, rates: Array, time: Array) -> CrossCorrelation | None:
    """Compare values (m, c) with the integral of rates (m, c), both over windows."""
    step = float(time[-1] - time[0]) / (len(time) - 1)
    steps = 0.5 * (rates[1:] + rates[:-1]) * np.diff(time)[:, None]
    integral = np.concatenate([np.zeros((1, values.shape[1])), np.cumsum(steps, axis=0)])
    n = min(max(1, round(COMPARED_OVER / step)), len(time) // 3)
    gaps = np.concatenate([[0], np.cumsum(np.diff(time) > WIDEST_GAP * step)])
    whole = gaps[n:] == gaps[:-n]
    return compare_series((values[n:] - values[:-n])[whole], (integral[n:] - integral[:-n])[whole], time[n:][whole])


def compare_series(first: Array, second: Array, time: Array) -> CrossCorrelation | None:
    """Compare series (m, c) at increasing times (m,) [s]; None if they are too short."""
    if len(first) < FEWEST_POINTS:
        return None
    longest = min(LATEST_SHIFT, 0.125 * float(time[-1] - time[0]))
    inside = np.flatnonzero((time >= time[0] + longest) & (time <= time[-1] - longest))
    inside = inside[:: max(1, len(inside) // MOST_POINTS)]

    def shifted(by: float, rows: NDArray[np.intp]) -> tuple[Array, Array]:
        """Return the second series and its slope at some rows, both late by a time."""
        at = time[rows] - by
        after = np.clip(np.searchsorted(time, at, side="right"), 1, len(time) - 1)
        slope = (second[after] - second[after - 1]) / (time[after] - time[after - 1])[:, None]
        return second[after - 1] + slope * (at - time[after - 1])[:, None], slope

    def best_from(by: float) -> tuple[float, float]:
        """Return the best shift near one, and the mean square that it leaves of the first series."""
        a = centred(first[inside])
        for _ in range(SHIFT_STEPS):
            b, slope = (centred(series) for series in shifted(by, inside))
            factor = _best_factors(a, b)
            power = float(np.sum((factor * slope) ** 2))
            step = -float(np.sum((a - factor * b) * factor * slope)) / power if power > 0.0 else 0.0
            by = min(max(by + step, -longest), longest)
            if abs(step) < SMALLEST_SHIFT:
                break
        return by, left_by(by, inside)

    def left_by(by: float, rows: NDArray[np.intp]) -> float:
        a, b = centred(first[rows]), centred(shifted(by, rows)[0])
        return float(np.mean((a - _best_factors(a, b) * b) ** 2))

    power, before = float(np.mean(centred(first[inside]) ** 2)), left_by(0.0, inside)
    by, after = best_from(0.0)
    if after > EXPLAINED_BY_SHIFT * power:
        few = inside[::10] if len(inside) > 10 * FEWEST_POINTS else inside
        tried = np.arange(-longest, longest, TRIED_EVERY)
        other, remaining = best_from(float(tried[np.argmin([left_by(shift, few) for shift in tried])]))
        by, after = (other, remaining) if SHIFT_GAIN * remaining < after else (by, after)
    fits = before > SHIFT_GAIN * after
    a, b = first[inside], shifted(by if fits else 0.0, inside)[0]
    difference, about_mean = a - b, np.stack([centred(a), centred(b)])
    swings = _root_mean_square(about_mean)
    products = np.outer(*swings) * len(a)
    match = _divided(about_mean[0].T @ about_mean[1], products)
    return CrossCorrelation(
        lag=-by if fits else 0.0,
        certain=fits and after < EXPLAINED_BY_SHIFT * power,
        sizes=_root_mean_square(np.stack([a, b])),
        residual=_root_mean_square(difference),
        swings=swings,
        unlike=_root_mean_square(centred(difference)),
        match=match,
        along=_divided(np.mean(a * b, axis=0), np.prod(_root_mean_square(np.stack([a, b])), axis=0)),
    )


def centred(series: Array) -> Array:
    """Return a series (m, c) about its mean."""
    return np.asarray(series - series.mean(axis=0))


def _best_factors(a: Array, b: Array) -> Array:
    """Return the factors (c,) by which b (m, c) follows a best."""
    return _divided(np.sum(a * b, axis=0), np.sum(b * b, axis=0))


def _divided(a: Array, b: Array) -> Array:
    """Return a / b, and 0 where b is 0."""
    return np.asarray(np.divide(a, b, out=np.zeros_like(a), where=b > 0.0))


def _root_mean_square(series: Array) -> Array:
    return np.asarray(np.sqrt(np.mean(series**2, axis=-2)))


def lost_samples(values: Array, rates: Array, time: Array) -> float:
    """Return the share of the samples that are missing between values (m, c) with rates (m, c), at times (m,) [s].

    It is 0 where nothing is missing, and where noise hides it. A step with fewer than none counts against the longer
    ones, as values that wait for a slower sensor catch up.
    """
    expected = 0.5 * (rates[1:] + rates[:-1]) * np.diff(time)[:, None]
    actual = np.diff(values, axis=0)
    noise = np.quantile(np.abs(actual - expected), 0.25, axis=0) / QUARTILE
    noise = np.maximum(noise, 1e-6 * np.abs(expected).max(axis=0, initial=0.0))
    moved = noise > 0.0
    expected, actual = expected[:, moved] / noise[moved], actual[:, moved] / noise[moved]
    power = np.sum(expected**2, axis=1)
    clear = power > CLEAR_STEP**2
    expected, actual, power = expected[clear], actual[clear], power[clear]
    if not len(power):
        return 0.0
    length = np.sum(actual * expected, axis=1) / power
    explained = length**2 * power > OF_OTHER_LENGTH * np.sum(actual**2, axis=1)
    steps = np.round(length)
    longer, right = explained & (steps > 1.0), steps == 1.0
    if longer.sum() < FEWEST_LONGER or right.mean() < RIGHT_STEPS:
        return 0.0
    if np.median(np.abs(length - steps)[longer]) > WHOLE_STEPS:
        return 0.0
    missing = float(np.sum(steps[longer] - 1.0) - np.sum(steps < 1.0))
    return max(missing / (missing + len(steps)), 0.0)
