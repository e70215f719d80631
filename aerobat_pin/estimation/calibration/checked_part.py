"""A stretch of a record beside its calibration: what no force explains of it, and what the calibration predicts."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from aerobat_pin.estimation.calibration.calibration import Calibration
from aerobat_pin.estimation.calibration.free_run import AT_ONCE
from aerobat_pin.forces import LEAST_EXPECTED, KnownInputs, ModelCheck, RowGeometry, points_of
from aerobat_pin.numerics import Array
from aerobat_pin.observers import Estimate, ForceLevelObserver, row_names, slow_part, typical_step
from aerobat_pin.records import Record

NEAR_TIME = 0.1  # [s] over which errors near an instant are averaged


def error_factors(calibration: Calibration, record: Record, inputs: KnownInputs) -> Array | None:
    """Return S (m, nv, r), S S^T the covariance of what the calibration leaves of the rows; None if that is unknown."""
    if calibration.series is not None and inputs.condition is not None:
        return calibration.series.factors(inputs.condition)
    if not calibration.row_noise:
        return None
    noise = np.array([calibration.row_noise.get(row, 0.0) for row in row_names(record.robot.model)])
    stiction, rate = calibration.fitted.stiction(record.robot)
    at_rest = 1.0 - np.tanh(0.5 * (inputs.v[1:] + inputs.v[:-1]) / rate) ** 2
    return np.sqrt(noise**2 + stiction**2 / 3.0 * at_rest)[:, :, None] * np.eye(len(noise))


@dataclass(frozen=True)
class CheckedPart:
    """A stretch of a record, with what no force explains of it, and what was expected of that."""

    inputs: KnownInputs  # of an observer, with what was learnt among the known forces
    estimate: Estimate  # the forces at once, without a filter, and what they do not explain
    geometry: RowGeometry  # of rows and forces
    factors: Array  # (m, nv, r) of what the calibration leaves

    @cached_property
    def near(self) -> Array:
        """How many times as large as predicted (m,) what no force explains is, over `NEAR_TIME` about each interval."""
        redundancy, time = self.estimate.redundancy, self.inputs.time
        seen = np.sum(slow_part(time, self.estimate.unexplained) ** 2, axis=1)
        seen -= redundancy.redundant * redundancy.sensors**2
        least = redundancy.redundant * (LEAST_EXPECTED * self.estimate.weight) ** 2
        predicted = np.interp(np.arange(len(seen)), self.geometry.at, np.maximum(self._predicted, least))
        window = np.ones(min(max(1, round(NEAR_TIME / typical_step(time))), len(seen)))
        shares = np.convolve(seen, window, "same") / np.convolve(predicted, window, "same")
        return np.sqrt(np.maximum(shares, 0.0))

    @property
    def growth(self) -> Array:
        """How many times as large as predicted (m,) the errors are: over all of the stretch, or near each instant.

        What is wrong may look like a force at one instant and like none `NEAR_TIME` later: the largest ratio counts.
        """
        reach = round(NEAR_TIME / typical_step(self.inputs.time))
        about = np.lib.stride_tricks.sliding_window_view(np.pad(self.near, reach, "edge"), 2 * reach + 1)
        return np.asarray(np.maximum(self.check.factor, np.max(about, axis=1)))

    @property
    def check(self) -> ModelCheck:
        """The verdict on this stretch."""
        redundancy = self.estimate.redundancy
        if redundancy.redundant < 1:
            return ModelCheck(None, 0.0, 0.0, why="no row is to spare for the forces sought")
        expected = float(np.sqrt(np.mean(self._predicted) / redundancy.redundant))
        expected = max(expected, LEAST_EXPECTED * self.estimate.weight)
        most = int(np.argmax(self.near))
        peak, when = float(self.near[most]), float(self.inputs.time[most])
        return ModelCheck(redundancy.belief / expected, redundancy.belief, expected, peak, when)

    @cached_property
    def _predicted(self) -> Array:
        return self.geometry.unexplained_square(self.factors)


def part_to_check(calibration: Calibration, record: Record, inputs: KnownInputs) -> CheckedPart | None:
    """Return a stretch with what no force explains of it; None where the calibration does not say what it leaves."""
    factors = error_factors(calibration, record, inputs)
    return None if factors is None else slice_of_part(record, inputs, factors)


def slice_of_part(record: Record, inputs: KnownInputs, factors: Array) -> CheckedPart:
    """Return a stretch of whose rows something with these factors (m, nv, r) is left."""
    observer = ForceLevelObserver(record.robot.model, points_of(record.map), AT_ONCE, inputs.rows)
    estimate = observer.run(inputs.time, inputs.q, inputs.v, inputs.tau, inputs.known)
    return CheckedPart(inputs, estimate, RowGeometry.of(observer, inputs), factors)
