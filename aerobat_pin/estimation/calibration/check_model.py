"""Is the belief still that of its calibration? What no force explains, over what the calibration predicts for it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from aerobat_pin.estimation.calibration.calibration import Calibration
from aerobat_pin.estimation.calibration.checked_part import CheckedPart, error_factors, part_to_check, slice_of_part
from aerobat_pin.estimation.calibration.name_cause import Named, cause_corrected, named_cause
from aerobat_pin.forces import KnownForces, KnownInputs, ModelCheck, RowGeometry, blocks_of, points_of
from aerobat_pin.numerics import Array
from aerobat_pin.observers import Observer
from aerobat_pin.records import Record

InputsAt = Callable[[int, int], KnownInputs]
MOST_STEPS = 4  # of a search for the size of a cause
SETTLED_SHARE = 0.9  # of what the step before left: a step that leaves more is the last
MOST_JUDGED = 60_000  # intervals of a part of a record from whose beginning the belief is judged


@dataclass(frozen=True)
class CheckedModel:
    """The belief about a record beside its calibration."""

    check: ModelCheck | None  # the verdict
    inputs: InputsAt  # of the observers between two indices, with the named cause corrected if that was asked for
    # gives S (m, nv, r) of such inputs, S S^T the covariance of what is left; None if that is unknown
    factors: Callable[[KnownInputs], Array | None]
    growth: Array | None = None  # (m,) factor of its deviation in each interval of the record; that of `check` if None

    def deviations(self, observer: Observer, inputs: KnownInputs) -> Array | None:
        """Return by how much (m, c) errors of the belief may spoil each component, one standard deviation."""
        factors = self.factors(inputs) if observer.applications.components else None
        if factors is None or self.check is None:
            return None
        growth = self.check.factor if self.growth is None else self.growth[: len(inputs.tau), None]
        return growth * RowGeometry.of(observer, inputs).deviations(factors)


def check_model(calibration: Calibration, forces: KnownForces, inputs: InputsAt) -> CheckedModel:
    """Compare what no force explains of a record with what the calibration that was applied predicts; name a change."""
    record, series = forces.record, calibration.series

    def factors(given: KnownInputs) -> Array | None:
        return error_factors(calibration, record, given)

    if not points_of(record.map):
        why = "no force is sought (robot.points = []), and a push would look like a change"
        return CheckedModel(ModelCheck(None, 0.0, 0.0, why=why), inputs, factors)
    if series is None or len(record.parts) > 1 or not record.robot.remembers:
        return CheckedModel(_check_of_blocks(calibration, record, inputs), inputs, factors)
    whole = inputs(*record.parts[0])
    part = part_to_check(calibration, record, whole)
    if part is None or part.check.ratio is None:
        return CheckedModel(None if part is None else part.check, inputs, factors)
    learnt, named = part.factors, named_cause(part, series, forces)
    if named is None:
        return CheckedModel(part.check, inputs, lambda _: learnt, part.growth)

    def with_cause(cause: Named) -> CheckedPart:
        factors = np.concatenate([learnt, cause.factors], axis=2)
        return slice_of_part(record, cause_corrected(whole, cause, forces), factors)

    better = with_cause(named)
    for _ in range(MOST_STEPS):
        nearer = named_cause(better, series, forces, named)
        trial = None if nearer is None else with_cause(nearer)
        if nearer is None or trial is None or trial.check.size >= better.check.size:
            break
        settled = trial.check.size > SETTLED_SHARE * better.check.size
        named, better = nearer, trial
        if settled:
            break
    remaining = better.check.size / max(part.check.size, 1e-12) if calibration.correct else 1.0  # of the cause's effect
    spread = np.concatenate([better.factors, remaining * named.force[:, :, None]], axis=2)
    if not calibration.correct:
        return CheckedModel(replace(part.check, cause=named.cause), inputs, lambda _: spread, better.growth)
    check, changed, begin = replace(better.check, cause=named.cause, corrected=True), better.inputs, record.parts[0][0]
    return CheckedModel(
        check, lambda first, last: changed.between(first - begin, last - begin), lambda _: spread, better.growth
    )


def _check_of_blocks(calibration: Calibration, record: Record, inputs: InputsAt) -> ModelCheck | None:
    """Return the verdict on a record by blocks, in which each instant counts by what was expected at it.

    A joint that rests may rub in any way: what was expected then must not hide what is left while all joints move.
    """
    checks = []
    for first, last in record.parts:
        for begin, end in blocks_of(first, min(last, first + MOST_JUDGED)):
            part = part_to_check(calibration, record, inputs(begin, end))
            if part is None or part.check.ratio is None:
                return None if part is None else part.check
            checks.append((part.check.expected**2, float(np.mean(part.near**2)), end - begin))
    squares, shares, counts = np.array(checks).T
    expected, ratio = (float(np.sqrt(np.average(values, weights=counts))) for values in (squares, shares))
    return ModelCheck(ratio, ratio * expected, expected)
