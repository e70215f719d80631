"""Score an estimate against a force sensor that the map names, `[check] wrench`."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from aerobat_pin.errors import MapError
from aerobat_pin.estimation.recordings.inverse_dynamics import frame_axes, sensor_force, sensor_point
from aerobat_pin.estimation.recordings.record import Record
from aerobat_pin.estimation.recordings.run_observers import settled
from aerobat_pin.estimation.scores import lag, r_squared
from aerobat_pin.numerics import Array
from aerobat_pin.observers import Estimate

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
        scored: (m,) whether an interval counts.
        fitted: (m,) whether a fit used the sensor there.
    """

    point: str
    labels: tuple[str, ...]
    start: Array
    estimate: Array
    sensor: Array
    scored: NDArray[np.bool_]
    fitted: NDArray[np.bool_]

    def scores(self, dt: float) -> dict[str, SensorScore]:
        """Return component -> scores."""
        return {label: self._score(k, dt) for k, label in enumerate(self.labels)}

    def _score(self, k: int, dt: float) -> SensorScore:
        all_of = self.scored
        found, truth = self.estimate[all_of, k], self.sensor[all_of, k]
        if len(found) < 3:
            raise MapError("map: check.wrench.part: less than three intervals are left to compare")
        outside = all_of & ~self.fitted
        apart = bool(self.fitted.any()) and int(outside.sum()) > 2
        rest, rest_truth = self.estimate[outside, k], self.sensor[outside, k]
        swing = found - found.mean()
        power = float(swing @ swing)
        return SensorScore(
            r2=r_squared(found, truth),
            rmse=float(np.sqrt(np.mean((found - truth) ** 2))),
            r2_outside_fit=r_squared(rest, rest_truth) if apart else None,
            rmse_outside_fit=float(np.sqrt(np.mean((rest - rest_truth) ** 2))) if apart else None,
            factor=float(swing @ (truth - truth.mean())) / power if power > 0.0 else None,
            offset=float(found.mean() - truth.mean()),
            lag_s=lag(found, truth, dt) if len(found) > 20 else None,
        )


def compared(record: Record, estimate: Estimate) -> Compared | None:
    """Return estimate and sensor side by side; None if the map names no sensor."""
    section = record.map.check.wrench
    if section is None or "check.wrench" not in record.channels:
        return None
    point = sensor_point(record)
    labels = [f"{point}.{axis}" for axis in WRENCH_AXES]
    columns = [
        estimate.identifiability.components.index(label)
        for label in labels
        if label in estimate.identifiability.components
    ]
    found, truth = [], []
    for first, last in record.parts:
        time = record.times(first, last)
        axes = frame_axes(record, record.block(first, last), point) if section.axes == "frame" else None
        truth.append(_smooth(sensor_force(record, time, axes), section.filter, record.dt))
        low = int(np.searchsorted(estimate.time[:-1], time[0] - 1e-9))
        found.append(_smooth(estimate.components[low : low + last - first][:, columns], section.filter, record.dt))
    start = estimate.time[:-1]
    when = start - record.start
    scored = settled(record, start)
    if section.part is not None:
        scored &= (when >= section.part[0]) & (when <= section.part[1])
    friction = record.map.joints.friction
    fitted = np.zeros(len(start), bool)
    if friction is not None and friction.to == "check.wrench":
        fitted = (when >= friction.fit[0]) & (when < friction.fit[1])
    count = min(len(columns), truth[0].shape[1])
    return Compared(
        point,
        WRENCH_AXES[:count],
        start,
        np.concatenate(found)[:, :count],
        np.concatenate(truth)[:, :count],
        scored,
        fitted,
    )


def _smooth(values: Array, frequency: float | None, dt: float) -> Array:
    """Return series (m, k) behind a zero-phase Butterworth low-pass of second order [Hz]; unchanged without one."""
    if frequency is None or 2.0 * frequency * dt >= 1.0 or len(values) < 20:
        return values
    from scipy.signal import butter, filtfilt  # slow to import

    return np.asarray(filtfilt(*butter(2, 2.0 * frequency * dt), values, axis=0))
