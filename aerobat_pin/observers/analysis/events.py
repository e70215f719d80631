"""Onset and end of events in an estimate, with a threshold that keeps a stated rate of false alarms.

A detector watches a statistic: the deviation from the bias (`LevelDetector`), or the impulse gathered beyond a drift
(`CusumDetector`). Every stretch above the statistic's floor is one excursion, however long the filter makes it;
excursions are independent where samples are not. The maxima of a free run's excursions have an exponential tail: their
squares for a level, they themselves for a CUSUM. A fit to the largest tenth gives the threshold for the stated rate,
even below one per free run: from a minute of filtered noise, one false alarm per minute was met within a factor of two,
one per 100 s within three (tests/observers/test_events.py).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from aerobat_pin.errors import ObserverError, ShapeError
from aerobat_pin.numerics import Array
from aerobat_pin.observers.analysis.bias import bias_of

FEWEST = 100  # excursions of a free run that is long enough
TAIL = 0.1  # share of them whose maxima are the tail


@dataclass(frozen=True)
class Event:
    """Something that pushed.

    Attributes:
        onset: when the series left its ordinary range [s]; the force began up to the detector's `delay` earlier. A
            CUSUM with a small drift may have begun on the noise before.
        alarm: when the threshold was passed, the first moment at which this could be known [s].
        end: when it last was beyond the threshold [s]; None while the event goes on.
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
        bias: (c,) or a number, taken off the series.
        floor: of the statistic: below it all is ordinary.
        threshold: of the statistic.
        false_alarms: rate for which it was calibrated [1/s].
        delay: of the filter that made the series, 1/K [s].
    """

    bias: Array
    floor: float
    threshold: float
    false_alarms: float
    delay: float

    def statistic(self, time: ArrayLike, values: ArrayLike) -> Array:
        """Return the statistic (m,) of values (m,) or (m, c), means over the intervals of `time` (m + 1,)."""
        raise NotImplementedError

    def detect(self, time: ArrayLike, values: ArrayLike) -> list[Event]:
        """Find the events in a series.

        Args:
            time: (m + 1,) edges of the intervals [s], as of an `Estimate`.
            values: (m,) a component; or (m, c), whose norm is watched.

        Raises:
            ShapeError: arrays that do not fit, or numbers that are not finite.
        """
        edges, series = _series(time, values)
        if np.shape(self.bias) != series.shape[1:]:
            raise ShapeError(f"series of shape {series.shape}: the detector knows {np.size(self.bias)} components")
        statistic, size = self.statistic(edges, series), _deviation(series, self.bias)
        events = []
        for first, last in _excursions(statistic, self.floor):
            beyond = first + np.flatnonzero(statistic[first:last] >= self.threshold)
            if len(beyond):
                end = float(edges[beyond[-1] + 1]) if last < len(series) else None
                peak = float(size[first:last].max())
                events.append(Event(float(edges[first]), float(edges[beyond[0] + 1]), end, peak))
        return events


class LevelDetector(Detector):
    """Watches the deviation from the bias, or the norm of the components' deviations; the floor is its rms."""

    def statistic(self, time: ArrayLike, values: ArrayLike) -> Array:
        """Return |x - bias| (m,) [unit of the series]."""
        return _deviation(np.asarray(values, float), self.bias)

    def latency(self, step: float) -> float:
        """Return how long a step takes to pass the threshold through a first-order filter, without noise [s]."""
        return float(-self.delay * np.log1p(-self.threshold / step)) if step > self.threshold else float("inf")


@dataclass(frozen=True)
class CusumDetector(Detector):
    """Watches the impulse beyond a drift to either side: slower than a level for large steps, keener for small ones.

    s <- min(threshold, max(0, s + (|x - bias| - drift) dt)) for each sign of x - bias; the cap makes it forget as
    fast as it learned. The floor is zero.

    Attributes:
        drift: what is let pass [unit of the series]; half the smallest step that matters is best (Page 1954).
    """

    drift: float

    def statistic(self, time: ArrayLike, values: ArrayLike) -> Array:
        """Return the larger of both sides' impulses (m,) [unit of the series times s]."""
        dt = np.diff(np.asarray(time, float))
        change = np.asarray(values, float) - self.bias
        sides = []
        for side in (change, -change):
            total, gathered = 0.0, []
            for gain in ((side - self.drift) * dt).tolist():
                total = min(self.threshold, max(0.0, total + gain))
                gathered.append(total)
            sides.append(gathered)
        return np.asarray(np.max(sides, axis=0))

    def latency(self, step: float) -> float:
        """Return within what time a step is known, through a first-order filter and without noise [s]."""
        excess = step - self.drift
        return (self.threshold + step * self.delay) / excess if excess > 0.0 else float("inf")


def calibrate_level(time: ArrayLike, free: ArrayLike, false_alarms: float, delay: float = 0.0) -> LevelDetector:
    """Set a level's threshold from a free run.

    Args:
        time: (m + 1,) edges of the intervals [s].
        free: (m,) or (m, c), while nothing unknown pushed.
        false_alarms: wanted rate [1/s].
        delay: of the filter that made the series, 1/K [s].

    Raises:
        ShapeError: arrays that do not fit, or numbers that are not finite.
        ObserverError: the free run is too short to tell, or the rate cannot be.
    """
    edges, series = _series(time, free)
    bias = bias_of(series).mean
    statistic = _deviation(series, bias)
    floor = float(np.sqrt(np.mean(statistic**2)))
    squared = _tail_level(
        _maxima(statistic, floor) ** 2, float(edges[-1] - edges[0]), false_alarms, "take a longer run"
    )
    return LevelDetector(bias, floor, float(np.sqrt(squared)), false_alarms, delay)


def calibrate_cusum(
    time: ArrayLike, free: ArrayLike, false_alarms: float, drift: float, delay: float = 0.0
) -> CusumDetector:
    """Set a two-sided CUSUM's threshold from a free run.

    Args:
        time: (m + 1,) edges of the intervals [s].
        free: (m,) a component, while nothing unknown pushed.
        false_alarms: wanted rate, of both sides together [1/s].
        drift: as in `CusumDetector`.
        delay: of the filter that made the series, 1/K [s].

    Raises:
        ShapeError, ObserverError: as `calibrate_level`; or the drift is not positive.
    """
    edges, series = _series(time, free)
    if series.ndim != 1:
        raise ShapeError(f"free run of shape {series.shape}: one component (m,) was expected")
    if not (np.isfinite(drift) and drift > 0.0):
        raise ObserverError(f"drift = {drift}: a finite positive number was expected")
    bias = bias_of(series).mean
    endless = CusumDetector(bias, 0.0, float("inf"), false_alarms, delay, drift)
    statistic = endless.statistic(edges, series)
    share = float(np.mean(statistic > 0.0))
    better = "smaller drift, or calibrate_level for steps far above the noise" if share < 0.5 else "larger drift"
    advice = f"they last {share:.0%} of the time: take a longer run, or a {better}"
    threshold = _tail_level(_maxima(statistic, 0.0), float(edges[-1] - edges[0]), false_alarms, advice)
    return CusumDetector(bias, 0.0, threshold, false_alarms, delay, drift)


def _deviation(series: Array, bias: Array) -> Array:
    return np.asarray(np.abs(series - bias) if series.ndim == 1 else np.linalg.norm(series - bias, axis=1))


def _excursions(statistic: Array, floor: float) -> list[tuple[int, int]]:
    """Return first and last + 1 of every stretch above the floor."""
    edges = np.diff(np.concatenate([[0], statistic > floor, [0]]).astype(int))
    return list(zip(np.flatnonzero(edges > 0).tolist(), np.flatnonzero(edges < 0).tolist(), strict=True))


def _maxima(statistic: Array, floor: float) -> Array:
    """Return the largest value of every excursion."""
    return np.array([statistic[first:last].max() for first, last in _excursions(statistic, floor)])


def _tail_level(maxima: Array, duration: float, rate: float, advice: str) -> float:
    """Return the level that maxima (n,) of a duration [s] pass at a rate [1/s], by an exponential tail.

    Raises ObserverError where there are too few of them, with advice on how to have more, or for no rate.
    """
    wanted = rate * duration
    if not (np.isfinite(rate) and rate > 0.0):
        raise ObserverError(f"false_alarms = {rate}: a finite positive rate in 1/s was expected")
    count = int(TAIL * len(maxima))
    found = f"the free run of {duration:.3g} s has {len(maxima)} excursions"
    if len(maxima) < FEWEST:
        raise ObserverError(f"{found}: {FEWEST} or more were expected; {advice}")
    if wanted > count:
        raise ObserverError(
            f"{found}: ten were expected for each of the {wanted:.3g} false alarms asked for; take a lower rate"
        )
    largest = np.sort(maxima)[::-1]
    return float(largest[count] + np.mean(largest[:count] - largest[count]) * np.log(count / wanted))


def _series(time: ArrayLike, values: ArrayLike) -> tuple[Array, Array]:
    """Return edges (m + 1,) and series. Raises ShapeError where they do not fit."""
    edges, series = np.asarray(time, float), np.asarray(values, float)
    if edges.ndim != 1 or series.ndim not in (1, 2) or len(series) != len(edges) - 1 or not len(series):
        raise ShapeError(f"series of shape {series.shape} on times of shape {edges.shape}: (m,) or (m, c) on (m + 1,)")
    if not (np.all(np.isfinite(series)) and np.all(np.isfinite(edges)) and np.all(np.diff(edges) >= 0.0)):
        raise ShapeError("series: finite numbers on times that do not decrease were expected")
    return edges, series
