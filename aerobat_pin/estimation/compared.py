"""An estimate beside a reference, interval by interval, and its scores: the same for a truth and for a sensor."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from aerobat_pin.estimation.scores import Moments, Score, lag
from aerobat_pin.estimation.stored_estimate import StoredEstimate
from aerobat_pin.numerics import Array
from aerobat_pin.records import EXTENT, Reference, Series

MOST_LAGGED = 30_000  # intervals of which the lag is found
FORGOTTEN = 7.0  # periods of the filter after which e^-30 of a value is left: e^(-4.4 f t)


@dataclass(frozen=True, eq=False)
class Compared:
    """An estimate and its reference at the same intervals, behind the same filter if the reference has one.

    Attributes:
        reference: what it is compared with.
        start: (m,) starts of the intervals [s].
        estimate: (m, k) estimated components, in the order of the reference's labels.
        dt: typical length of an interval [s].
    """

    reference: Reference
    start: Series
    estimate: Series
    dt: float

    @classmethod
    def of(cls, estimate: StoredEstimate, reference: Reference, dt: float) -> Compared | None:
        """Return an estimate beside a reference of its intervals; None if it does not estimate what this shows."""
        known = estimate.head.identifiability.components
        wanted = [f"{reference.frame}.{label}" for label in reference.labels]
        if not set(wanted) <= set(known):
            return None
        columns, found = [known.index(label) for label in wanted], Series(estimate.start.spool, len(wanted))
        margin = 0 if reference.filter is None else int(np.ceil(FORGOTTEN / (reference.filter * dt)))
        for first, last in reference.stretches or ((0, len(estimate)),):
            for begin in range(first, last, EXTENT):
                end = min(begin + EXTENT, last)
                low, high = max(first, begin - margin), min(last, end + margin)
                own = estimate.between(low, high).components[:, columns]
                found.append(low_passed(own, reference.filter, dt)[begin - low : end - low])
        return cls(reference, estimate.start, found, dt)

    def pieces(self) -> Iterator[tuple[Array, ...]]:
        """Yield starts (n,), estimate, reference and the reference without noise (n, k), piece by piece."""
        values, clean = self.reference.values, self.reference.noise_free
        for first in range(0, len(self.start), EXTENT):
            rows = slice(first, first + EXTENT)
            yield (
                self.start[rows],
                self.estimate[rows],
                values[rows],
                values[rows] if clean is None else clean[rows],
            )

    def sample(self, most: int) -> tuple[Array, Array]:
        """Return estimate and reference without noise (n, k) of the first `most` intervals that are scored."""
        found: list[Array] = []
        truth: list[Array] = []
        for start, one, _, other in self.pieces():
            counts = self.reference.scored(start)
            found.append(one[counts])
            truth.append(other[counts])
            if sum(map(len, found)) >= most:
                break
        return np.concatenate(found)[:most], np.concatenate(truth)[:most]

    def scores(self) -> dict[str, Score]:
        """Return component -> scores; the lag is that of the first `MOST_LAGGED` intervals."""
        reference, width = self.reference, len(self.reference.labels)
        whole, noise_free, outside = (Moments(width) for _ in range(3))
        fitted = False
        for start, found, truth, clean in self.pieces():
            counts, used = reference.scored(start), reference.used(start)
            whole.add(found[counts], truth[counts])
            noise_free.add(found[counts], clean[counts])
            outside.add(found[counts & ~used], truth[counts & ~used])
            fitted = fitted or bool(used.any())
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
            )
            for k, label in enumerate(reference.labels)
        }

    @property
    def liveliest(self) -> int:
        """Index of the component of which the reference varies most."""
        return int(np.argmax(self.sample(MOST_LAGGED)[1].std(axis=0)))


def low_passed(values: Array, frequency: float | None, dt: float) -> Array:
    """Return series (m, k) behind a zero-phase Butterworth low-pass of second order [Hz]; unchanged without one."""
    if frequency is None or 2.0 * frequency * dt >= 1.0 or len(values) < 20:
        return values
    from scipy.signal import butter, filtfilt  # slow to import

    return np.asarray(filtfilt(*butter(2, 2.0 * frequency * dt), values, axis=0))
