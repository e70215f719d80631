"""An estimate beside a reference, interval by interval, and its scores; the force sensor of a map as a reference."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from aerobat_pin.errors import MapError
from aerobat_pin.forces.inverse_dynamics import frame_axes, sensor_force, sensor_point
from aerobat_pin.forces.run_observers import blocks_of, settled
from aerobat_pin.forces.scores import Moments, Score, lag
from aerobat_pin.forces.stored_estimate import StoredEstimate
from aerobat_pin.numerics import Array
from aerobat_pin.records import EXTENT, Record, Reference, Series, Spool

MOST_LAGGED = 30_000  # intervals of which the lag is found
WRENCH_AXES = ("Fx", "Fy", "Fz", "Mx", "My", "Mz")
FORGOTTEN = 7.0  # periods of the filter after which e^-30 of a value is left: e^(-4.4 f t)


@dataclass(frozen=True, eq=False)
class PairedEstimate:
    """An estimate and its reference at the same intervals, behind the same filter if the reference has one."""

    reference: Reference  # what it is compared with
    start: Series  # (m,) starts of the intervals [s]
    estimate: Series  # (m, k) estimated components, in the order of the reference's labels
    dt: float  # typical length of an interval [s]
    shown: Series | None = None  # (m, k) 1 where a component is seen, else 0; None if no force was expected

    @classmethod
    def of(cls, estimate: StoredEstimate, reference: Reference, dt: float) -> PairedEstimate | None:
        """Return an estimate beside a reference of its intervals; None if it does not estimate what this shows."""
        known = estimate.head.identifiability.components
        wanted = [f"{reference.frame}.{label}" for label in reference.labels]
        if not set(wanted) <= set(known):
            return None
        columns = [known.index(label) for label in wanted]
        components, shown = (Series(estimate.start.spool, len(wanted)) for _ in range(2))
        margin = 0 if reference.filter is None else int(np.ceil(FORGOTTEN / (reference.filter * dt)))
        for first, last in reference.stretches or ((0, len(estimate)),):
            for begin in range(first, last, EXTENT):
                end = min(begin + EXTENT, last)
                low, high = max(first, begin - margin), min(last, end + margin)
                block, inside = estimate.between(low, high), slice(begin - low, end - low)
                components.append(zero_phase(block.components[:, columns], reference.filter, dt)[inside])
                shown.append(block.shown[inside][:, columns].astype(float))
        return cls(reference, estimate.start, components, dt, None if estimate.seen is None else shown)

    def pieces(self) -> Iterator[tuple[Array, ...]]:
        """Yield starts (n,), estimate, reference and the reference without noise (n, k), piece by piece."""
        values, clean = self.reference.values, self.reference.noise_free
        for first in range(0, len(self.start), EXTENT):
            rows = slice(first, first + EXTENT)
            truth = values[rows]
            yield self.start[rows], self.estimate[rows], truth, truth if clean is None else clean[rows]

    def sample(self, most: int) -> tuple[Array, Array]:
        """Return estimate and reference without noise (n, k) of the first `most` intervals that are scored."""
        estimates: list[Array] = []
        truth: list[Array] = []
        for start, estimate, _, clean in self.pieces():
            counts = self.reference.scored(start)
            estimates.append(estimate[counts])
            truth.append(clean[counts])
            if sum(map(len, estimates)) >= most:
                break
        return np.concatenate(estimates)[:most], np.concatenate(truth)[:most]

    def scores(self) -> dict[str, Score]:
        """Return component -> scores; the lag is that of the first `MOST_LAGGED` intervals."""
        reference, width = self.reference, len(self.reference.labels)
        whole, noise_free, outside = (Moments(width) for _ in range(3))
        fitted, at, seen = False, 0, [Moments(1) for _ in range(width)]
        for start, estimate, truth, clean in self.pieces():
            counts, used = reference.scored(start), reference.used(start)
            whole.add(estimate[counts], truth[counts])
            noise_free.add(estimate[counts], clean[counts])
            outside.add(estimate[counts & ~used], truth[counts & ~used])
            fitted = fitted or bool(used.any())
            shown = np.zeros(estimate.shape) if self.shown is None else self.shown[at : at + len(start)]
            for k in range(width):
                inside = counts & (shown[:, k] > 0.0)
                seen[k].add(estimate[inside, k : k + 1], truth[inside, k : k + 1])
            at += len(start)
        apart, sensed = fitted and outside.count > 2, reference.kind == "sensor"
        sample, true_sample = self.sample(MOST_LAGGED)
        return {
            label: Score(
                r2=whole.r2[k],
                r2_noise_free=None if reference.noise_free is None else noise_free.r2[k],
                rmse=whole.rmse[k],
                lag_s=lag(sample[:, k], true_sample[:, k], self.dt),
                r2_outside_fit=outside.r2[k] if apart else None,
                rmse_outside_fit=outside.rmse[k] if apart else None,
                factor=whole.factor[k] if sensed else None,
                offset=whole.offset[k] if sensed else None,
                r2_seen=seen[k].r2[0] if seen[k].count > 2 else None,
                rmse_seen=seen[k].rmse[0] if seen[k].count > 2 else None,
            )
            for k, label in enumerate(reference.labels)
        }

    @property
    def liveliest(self) -> int:
        """Index of the component of which the reference varies most."""
        return int(np.argmax(self.sample(MOST_LAGGED)[1].std(axis=0)))


def zero_phase(values: Array, frequency: float | None, dt: float) -> Array:
    """Return series (m, k) behind a zero-phase Butterworth low-pass of second order [Hz]; unchanged without one."""
    if frequency is None or 2.0 * frequency * dt >= 1.0 or len(values) < 20:
        return values
    from scipy.signal import butter, filtfilt  # slow to import

    return np.asarray(filtfilt(*butter(2, 2.0 * frequency * dt), values, axis=0))


def sensor_references(record: Record) -> tuple[Reference, ...]:
    """Return the sensor of a map as the only reference; empty if the map names none.

    Raises:
        MapError: the sensor is at no point of the map, or less than three intervals are left to compare.
    """
    section = record.map.check.wrench
    if section is None or "check.wrench" not in record.channels:
        return ()
    point, spool = sensor_point(record), Spool()
    known = 6 if point in record.map.robot.wrenches else 3
    count = min(known, record.channels["check.wrench"].values.shape[1])
    values, stretches, compared = Series(spool, count), [], 0
    friction = record.map.joints.friction

    def scored(start: Array) -> NDArray[np.bool_]:
        when, counts = start - record.start, settled(record, start)
        if section.part is not None:
            counts &= (when >= section.part[0]) & (when <= section.part[1])
        return counts

    def used(start: Array) -> NDArray[np.bool_]:
        if friction is None or friction.to != "check.wrench" or friction.fit is None:
            return np.zeros(len(start), bool)
        when = start - record.start
        return np.asarray((when >= friction.fit[0]) & (when < friction.fit[1]))

    if section.filter is not None and not 1.0 / max(record.duration, record.dt) <= section.filter < 0.5 * record.rate:
        raise MapError(
            f"map: check.wrench.filter = {section.filter:g} Hz: a period within the record's {record.duration:.3g} s, "
            f"and less than half its rate of {record.rate:g} Hz, were expected"
        )
    margin = 0 if section.filter is None else int(np.ceil(FORGOTTEN / section.filter * record.rate))
    for first, last in record.parts:
        stretches.append((len(values), len(values) + last - first))
        for begin, end in blocks_of(first, last):
            low, high = max(first, begin - margin), min(last, end + margin)
            time, inside = record.times(low, high), slice(begin - low, end - low)
            axes = frame_axes(record, record.block(low, high), point) if section.axes == "frame" else None
            values.append(zero_phase(sensor_force(record, time, axes), section.filter, record.dt)[inside, :count])
            compared += int(scored(time[:-1][inside]).sum())
    if compared < 3:
        raise MapError("map: check.wrench.part: less than three intervals are left to compare")
    labels = WRENCH_AXES[:count]
    return (Reference(point, "sensor", labels, values, None, section.filter, tuple(stretches), scored, used),)
