"""Onset and end of events in an estimate, with a threshold for a given rate of false alarms.

A detector computes a statistic: the deviation from the bias (`LevelDetector`), or the accumulated impulse beyond a
drift (`CusumDetector`). An excursion is an uninterrupted stretch of samples above the floor of the statistic. Samples
of a filtered series are correlated, but excursions are nearly independent of each other.

The threshold is calibrated in a free run, in which no unknown force acts. The maxima of its excursions have an
exponential tail: the squares of the maxima for a level, the maxima themselves for a CUSUM. A fit to the largest tenth
gives the threshold for the wanted rate, also for less than one false alarm per free run. With one minute of filtered
noise, a wanted rate of one false alarm per minute was met within a factor of two, and a rate of one per 100 s within a
factor of three (tests/observers/test_events.py).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from aerobat_pin.errors import ObserverError, ShapeError
from aerobat_pin.numerics import Array, guarded, runs_of_true
from aerobat_pin.observers.analysis.noise_and_lag import bias_of

FEWEST = 100  # smallest number of excursions in a free run that is long enough
TAIL = 0.1  # share of the excursions, those with the largest maxima, to which the tail is fitted


@dataclass(frozen=True)
class Event:
    """An event in a series, such as a push.

    Attributes:
        onset: time at which the statistic rose above its floor [s]. The force began up to the detector's `delay`
            earlier. With a CUSUM of small drift, the onset can lie too early, in the noise before the force.
        alarm: time at which the statistic passed the threshold, so that the event was first detected [s].
        end: last time at which the statistic was above the threshold [s]; None if the event has not ended.
        peak: largest deviation from the bias [unit of the series].
    """

    onset: float
    alarm: float
    end: float | None
    peak: float


@dataclass(frozen=True)
class Detector:
    """A statistic with its threshold; see `LevelDetector` and `CusumDetector`.

    Attributes:
        bias: (c,) or one number, subtracted from the series.
        floor: value of the statistic above which an excursion begins.
        threshold: value of the statistic at which an alarm is raised.
        delay: delay of the filter that produced the series, 1/K [s].
    """

    bias: Array
    floor: float
    threshold: float
    delay: float

    @guarded()
    def statistic(self, time: ArrayLike, values: ArrayLike) -> Array:
        """Return the statistic (m,) of values (m,) or (m, c), which are means over the intervals of `time` (m + 1,)."""
        return self._statistic(*self._series(time, values))

    @guarded()
    def detect(self, time: ArrayLike, values: ArrayLike) -> list[Event]:
        """Find the events in a series.

        Args:
            time: (m + 1,) edges of the intervals [s], such as `Estimate.time`.
            values: (m,) one component, or (m, c) several components of which the norm is used.

        Raises:
            ShapeError: arrays do not fit each other, or numbers are not finite.
        """
        edges, series = self._series(time, values)
        statistic, size = self._statistic(edges, series), _deviation(series, self.bias)
        events = []
        for first, last in runs_of_true(statistic > self.floor):
            beyond = first + np.flatnonzero(statistic[first:last] >= self.threshold)
            if len(beyond):
                end = float(edges[beyond[-1] + 1]) if last < len(series) else None
                peak = float(size[first:last].max())
                events.append(Event(float(edges[first]), float(edges[beyond[0] + 1]), end, peak))
        return events

    def _series(self, time: ArrayLike, values: ArrayLike) -> tuple[Array, Array]:
        """Return edges and series as arrays. Raises ShapeError if they do not fit each other or the calibration."""
        edges, series = _series(time, values, "values")
        if np.shape(self.bias) != series.shape[1:]:
            raise ShapeError(
                f"values of shape {series.shape}: the detector was calibrated with {np.size(self.bias)} components"
            )
        return edges, series

    def _statistic(self, edges: Array, series: Array) -> Array:
        raise NotImplementedError


class LevelDetector(Detector):
    """A detector whose statistic is |x - bias| [unit of the series], or its norm; the floor is its rms when free."""

    def _statistic(self, _: Array, series: Array) -> Array:
        return _deviation(series, self.bias)

    @guarded()
    def latency(self, step: float) -> float:
        """Return the time from a step to its alarm [s], through a first-order filter and without noise."""
        return float(-self.delay * np.log1p(-self.threshold / step)) if step > self.threshold else float("inf")


@dataclass(frozen=True)
class CusumDetector(Detector):
    """A detector whose statistic is the impulse beyond a drift, in either direction.

    It detects large steps later than a level does, but it detects smaller steps. The statistic [unit times s] is the
    larger of

        s <- min(threshold, max(0, s + (d - drift) dt))          d = x - bias, and d = bias - x

    The upper bound lets s fall again right after the force ends. The floor is zero.

    Attributes:
        drift: deviation that is ignored [unit of the series]; half the smallest step that matters is best (Page 1954).
    """

    drift: float

    def _statistic(self, edges: Array, series: Array) -> Array:
        dt, change = np.diff(edges), series - self.bias
        sides = []
        for side in (change, -change):
            total, gathered = 0.0, []
            for gain in ((side - self.drift) * dt).tolist():
                total = min(self.threshold, max(0.0, total + gain))
                gathered.append(total)
            sides.append(gathered)
        return np.asarray(np.max(sides, axis=0))

    @guarded()
    def latency(self, step: float) -> float:
        """Return the longest time from a step to its alarm [s], through a first-order filter and without noise."""
        excess = step - self.drift
        return (self.threshold + step * self.delay) / excess if excess > 0.0 else float("inf")


@guarded(delay="not negative", false_alarms="any")
def calibrate_level(time: ArrayLike, free: ArrayLike, false_alarms: float, delay: float = 0.0) -> LevelDetector:
    """Return a level detector, with its threshold calibrated in a free run.

    Args:
        time: (m + 1,) edges of the intervals [s].
        free: (m,) or (m, c) series of the free run, in which no unknown force acts.
        false_alarms: wanted rate of false alarms [1/s].
        delay: delay of the filter that produced the series, 1/K [s].

    Raises:
        ShapeError: arrays do not fit each other, or numbers are not finite.
        ObserverError: the free run is too short for this rate, or the rate is not finite and positive.
    """
    edges, series = _series(time, free, "free")
    bias = bias_of(series).mean
    statistic = _deviation(series, bias)
    floor = float(np.sqrt(np.mean(statistic**2)))
    squared = _tail_level(_maxima(statistic, floor) ** 2, edges, false_alarms, "take a longer run")
    return LevelDetector(bias, floor, float(np.sqrt(squared)), delay)


@guarded(delay="not negative", false_alarms="any", drift="any")
def calibrate_cusum(
    time: ArrayLike, free: ArrayLike, false_alarms: float, drift: float, delay: float = 0.0
) -> CusumDetector:
    """Return a two-sided CUSUM detector, with its threshold calibrated in a free run.

    Args:
        time: (m + 1,) edges of the intervals [s].
        free: (m,) one component in the free run, in which no unknown force acts.
        false_alarms: wanted rate of false alarms, of both directions together [1/s].
        drift: as in `CusumDetector`.
        delay: delay of the filter that produced the series, 1/K [s].

    Raises:
        ShapeError: for the same reasons as `calibrate_level`, or there is more than one component.
        ObserverError: for the same reasons as `calibrate_level`, or the drift is not finite and positive.
    """
    edges, series = _series(time, free, "free")
    if series.ndim != 1:
        raise ShapeError(f"free run of shape {series.shape}: one component (m,) was expected")
    if not (np.isfinite(drift) and drift > 0.0):
        raise ObserverError(f"drift = {drift}: a finite positive number was expected")
    bias = bias_of(series).mean
    statistic = CusumDetector(bias, 0.0, float("inf"), delay, drift)._statistic(edges, series)
    share = float(np.mean(statistic > 0.0))
    better = "smaller drift, or calibrate_level for steps far above the noise" if share < 0.5 else "larger drift"
    advice = f"they last {share:.0%} of the time: take a longer run, or a {better}"
    return CusumDetector(bias, 0.0, _tail_level(_maxima(statistic, 0.0), edges, false_alarms, advice), delay, drift)


def _deviation(series: Array, bias: Array) -> Array:
    return np.asarray(np.abs(series - bias) if series.ndim == 1 else np.linalg.norm(series - bias, axis=1))


def _maxima(statistic: Array, floor: float) -> Array:
    """Return the largest value of every excursion."""
    return np.array([statistic[first:last].max() for first, last in runs_of_true(statistic > floor)])


def _tail_level(maxima: Array, edges: Array, rate: float, advice: str) -> float:
    """Return the level that the maxima (n,) found in a free run exceed at a rate [1/s], by an exponential tail.

    Raises ObserverError if there are too few maxima, with `advice` on how to get more, or if the rate is not positive.
    """
    duration = float(edges[-1] - edges[0])
    wanted = rate * duration
    if not (np.isfinite(rate) and rate > 0.0):
        raise ObserverError(f"false_alarms = {rate}: a finite positive rate in 1/s was expected")
    count = int(TAIL * len(maxima))
    excursions = f"the free run of {duration:.3g} s has {len(maxima)} excursions"
    if len(maxima) < FEWEST:
        raise ObserverError(f"{excursions}: {FEWEST} or more were expected; {advice}")
    if wanted > count:
        raise ObserverError(
            f"{excursions}: ten were expected for each of the {wanted:.3g} false alarms asked for; take a lower rate "
            "false_alarms"
        )
    largest = np.sort(maxima)[::-1]
    return float(largest[count] + np.mean(largest[:count] - largest[count]) * np.log(count / wanted))


def _series(time: ArrayLike, values: ArrayLike, name: str) -> tuple[Array, Array]:
    """Return edges (m + 1,) and series (m,) or (m, c) as arrays. Raises ShapeError if they do not fit."""
    edges, series = np.asarray(time), np.asarray(values)
    if edges.ndim != 1 or series.ndim not in (1, 2) or len(series) != len(edges) - 1 or not len(series):
        raise ShapeError(
            f"{name} of shape {series.shape} on times of shape {edges.shape}: (m,) or (m, c) on (m + 1,) were expected"
        )
    if not np.all(np.diff(edges) >= 0.0):
        raise ShapeError("time: times that do not decrease were expected")
    return edges, series
