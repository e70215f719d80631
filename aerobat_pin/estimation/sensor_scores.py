"""Score an estimate against a force sensor that the map names, `[check] wrench`."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from aerobat_pin.errors import MapError
from aerobat_pin.estimation.inverse_dynamics import frame_axes, sensor_force, sensor_point
from aerobat_pin.estimation.run_observers import blocks_of, settled
from aerobat_pin.estimation.scores import NO_SIGNAL, lag
from aerobat_pin.estimation.stored_estimate import StoredEstimate
from aerobat_pin.numerics import Array
from aerobat_pin.records import Record, Series, in_step

Which = Callable[[Array], NDArray[np.bool_]]

MOST_LAGGED = 30_000  # intervals of which the lag is found
FORGOTTEN = 7.0  # periods of the filter after which e^-30 of a value is left: e^(-4.4 f t)
WRENCH_AXES = ("Fx", "Fy", "Fz", "Mx", "My", "Mz")


@dataclass(frozen=True)
class SensorScore:
    """Scores of one component against the sensor; None where the sensor hardly varies or nothing is left to score.

    Attributes:
        r2: R2 on everything that is compared.
        rmse: rms of the difference [N or N m].
        r2_outside_fit: R2 on what no fit to the sensor used; None without such a fit.
        rmse_outside_fit: rms of the difference there.
        factor: sensor per estimate, least squares about the means.
        offset: mean of the estimate minus mean of the sensor.
        lag_s: delay of the sensor's series that fits the estimate best.
    """

    r2: float | None
    rmse: float
    r2_outside_fit: float | None
    rmse_outside_fit: float | None
    factor: float | None
    offset: float
    lag_s: float | None


@dataclass(frozen=True)
class Compared:
    """Estimate and sensor at the same intervals, as they are scored: both behind the same filter, if the map has one.

    Attributes:
        point: frame of the sensor.
        labels: components, such as `Fz`.
        start: (m,) starts of the intervals [s].
        estimate: (m, k) estimated components.
        sensor: (m, k) the sensor's.
        scored: function of starts (n,): whether an interval counts.
        fitted: function of starts (n,): whether a fit used the sensor there.
    """

    point: str
    labels: tuple[str, ...]
    start: Series
    estimate: Series
    sensor: Series
    scored: Which
    fitted: Which

    def pieces(self) -> Iterator[tuple[Array, ...]]:
        """Yield starts (n,), estimate (n, k) and sensor (n, k) of all intervals, piece by piece."""
        yield from in_step(self.start, self.estimate, self.sensor)

    def sample(self, most: int) -> tuple[Array, Array]:
        """Return estimate and sensor (n, k) of the first `most` intervals that are scored."""
        found: list[Array] = []
        truth: list[Array] = []
        for start, one, other in self.pieces():
            counts = self.scored(start)
            found.append(one[counts])
            truth.append(other[counts])
            if sum(map(len, found)) >= most:
                break
        return np.concatenate(found)[:most], np.concatenate(truth)[:most]

    def scores(self, dt: float) -> dict[str, SensorScore]:
        """Return component -> scores; the lag is that of the first `MOST_LAGGED` intervals."""
        middle = self.sample(1000)[1].mean(axis=0) if len(self.start) else np.zeros(len(self.labels))
        whole, outside = _Sums(middle), _Sums(middle)
        some_fitted = False
        for start, found, truth in self.pieces():
            counts, fitted = self.scored(start), self.fitted(start)
            whole.add(found[counts], truth[counts])
            outside.add(found[counts & ~fitted], truth[counts & ~fitted])
            some_fitted = some_fitted or bool(fitted.any())
        if whole.count < 3:
            raise MapError("map: check.wrench.part: less than three intervals are left to compare")
        apart = some_fitted and outside.count > 2
        sample, true_sample = self.sample(MOST_LAGGED)
        return {
            label: SensorScore(
                r2=whole.r2[k],
                rmse=float(whole.rmse[k]),
                r2_outside_fit=outside.r2[k] if apart else None,
                rmse_outside_fit=float(outside.rmse[k]) if apart else None,
                factor=whole.factor[k],
                offset=float(whole.offset[k]),
                lag_s=lag(sample[:, k], true_sample[:, k], dt) if whole.count > 20 else None,
            )
            for k, label in enumerate(self.labels)
        }

    @property
    def liveliest(self) -> int:
        """Index of the component of which the sensor varies most."""
        return int(np.argmax(self.sample(MOST_LAGGED)[1].std(axis=0)))


class _Sums:
    """Sums over pairs of series, for scores that need no series.

    Args:
        middle: (k,) a value near the means, which is taken off both for the sake of rounding.
    """

    def __init__(self, middle: Array) -> None:
        self._middle, self.count = middle, 0
        self._found, self._truth, self._power, self._true_power, self._along, self._error = np.zeros((6, len(middle)))

    def add(self, found: Array, truth: Array) -> None:
        """Add rows (n, k) of both series."""
        one, other = found - self._middle, truth - self._middle
        self.count += len(one)
        self._found += one.sum(axis=0)
        self._truth += other.sum(axis=0)
        self._power += np.sum(one**2, axis=0)
        self._true_power += np.sum(other**2, axis=0)
        self._along += np.sum(one * other, axis=0)
        self._error += np.sum((one - other) ** 2, axis=0)

    @property
    def r2(self) -> list[float | None]:
        """R2 of each component; None where the truth hardly varies."""
        swing = self._true_power - self._truth**2 / max(self.count, 1)
        dull = np.sqrt(np.maximum(swing, 0.0) / max(self.count, 1)) < NO_SIGNAL
        return [None if still else float(1.0 - e / s) for still, e, s in zip(dull, self._error, swing, strict=True)]

    @property
    def rmse(self) -> Array:
        """Root mean square of the difference."""
        return np.asarray(np.sqrt(self._error / self.count))

    @property
    def offset(self) -> Array:
        """Mean of the estimate minus that of the truth."""
        return np.asarray((self._found - self._truth) / self.count)

    @property
    def factor(self) -> list[float | None]:
        """Truth per estimate, least squares about the means."""
        power = self._power - self._found**2 / self.count
        along = self._along - self._found * self._truth / self.count
        return [float(a / p) if p > 0.0 else None for a, p in zip(along, power, strict=True)]


def compared(record: Record, estimate: StoredEstimate) -> Compared | None:
    """Return estimate and sensor side by side; None if the map names no sensor."""
    section = record.map.check.wrench
    if section is None or "check.wrench" not in record.channels:
        return None
    point, known = sensor_point(record), estimate.head.identifiability.components
    columns = [known.index(f"{point}.{axis}") for axis in WRENCH_AXES if f"{point}.{axis}" in known]
    count = min(len(columns), record.channels["check.wrench"].values.shape[1])
    spool = estimate.start.spool
    found, truth = Series(spool, count), Series(spool, count)
    margin = 0 if section.filter is None else int(np.ceil(FORGOTTEN / section.filter * record.rate))
    for first, last in record.parts:
        offset = estimate.index(record.start + first * record.dt) - first
        for begin, end in blocks_of(first, last):
            low, high = max(first, begin - margin), min(last, end + margin)
            time, inside = record.times(low, high), slice(begin - low, end - low)
            axes = frame_axes(record, record.block(low, high), point) if section.axes == "frame" else None
            measured = _smooth(sensor_force(record, time, axes), section.filter, record.dt)
            own = estimate.between(offset + low, offset + high).components[:, columns]
            truth.append(measured[inside, :count])
            found.append(_smooth(own, section.filter, record.dt)[inside, :count])
    friction = record.map.joints.friction

    def scored(start: Array) -> NDArray[np.bool_]:
        when, counts = start - record.start, settled(record, start)
        if section.part is not None:
            counts &= (when >= section.part[0]) & (when <= section.part[1])
        return counts

    def fitted(start: Array) -> NDArray[np.bool_]:
        if friction is None or friction.to != "check.wrench" or friction.fit is None:
            return np.zeros(len(start), bool)
        when = start - record.start
        return np.asarray((when >= friction.fit[0]) & (when < friction.fit[1]))

    return Compared(point, WRENCH_AXES[:count], estimate.start, found, truth, scored, fitted)


def _smooth(values: Array, frequency: float | None, dt: float) -> Array:
    """Return series (m, k) behind a zero-phase Butterworth low-pass of second order [Hz]; unchanged without one."""
    if frequency is None or 2.0 * frequency * dt >= 1.0 or len(values) < 20:
        return values
    from scipy.signal import butter, filtfilt  # slow to import

    return np.asarray(filtfilt(*butter(2, 2.0 * frequency * dt), values, axis=0))
