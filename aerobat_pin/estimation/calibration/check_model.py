"""Is the belief still that of its calibration? What no force explains, over what the calibration predicts for it.

What changed is named by

    x = N L^T (R - e), low-passed     G = dx/dtheta     theta = -(G^T G)^-1 G^T x     C = H^T Cov(e) H + sums

R - e is the residual that the calibration leaves, theta the parameters of one cause, dx/dtheta a finite difference of
the whole belief, H = G (G^T G)^-1; a few steps of Gauss and Newton, as effects are not linear. What the calibration
does not know of e has its covariance there. What else is left enters by sums over whole cycles, in which it is hardly
correlated, and, as errors may repeat themselves with the cycle, by sums at other phases than its own, at which theta
was fitted and nothing is left. A cause can be told from what the calibration leaves if z = sqrt(theta^T C^-1 theta / p)
is above 4; of several the one that explains most is named, as z favours causes that the calibration happens to know
well. Forces at the points do not enter x.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from aerobat_pin.estimation.calibration.calibration import Calibration
from aerobat_pin.estimation.calibration.free_run import AT_ONCE, residual_at_once
from aerobat_pin.forces import (
    DAILY,
    LEAST_EXPECTED,
    Cause,
    KnownForces,
    KnownInputs,
    LearntError,
    ModelCheck,
    RowGeometry,
    alone,
    blocks_of,
    inputs_of_block,
    points_of,
    shares,
)
from aerobat_pin.numerics import Array
from aerobat_pin.observers import Estimate, ForceLevelObserver, Observer, row_names, slow_part, typical_step
from aerobat_pin.records import Record

NEAR_TIME = 0.1  # [s] over which errors near an instant are averaged
SURE_OF_CAUSE = 4.0  # z from which a cause is named
PHASES = 24  # of what is left against a cause, over a cycle
InputsAt = Callable[[int, int], KnownInputs]
MOST_STEPS = 4  # of a search for the size of a cause
SETTLED_SHARE = 0.9  # of what the step before left: a step that leaves more is the last
MOST_JUDGED = 60_000  # intervals of a part of a record from whose beginning the belief is judged


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
    start: float  # of the record [s]

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
        peak, when = float(self.near[most]), float(self.inputs.time[most]) - self.start
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
    return CheckedPart(inputs, estimate, RowGeometry.of(observer, inputs), factors, record.start)


@dataclass(frozen=True)
class Named:
    """A cause, with what it does to the generalised force."""

    cause: Cause  # name and size
    values: Array  # (p,) its parameters [SI]
    force: Array  # (m, nv) error of the generalised force that it explains, to be added to the known forces
    factors: Array  # (m, nv, p), whose squares are the covariance of `force`


def named_cause(
    part: CheckedPart, series: LearntError, forces: KnownForces, before: Named | None = None
) -> Named | None:
    """Return what changed in a whole part of a record; None if nothing that the robot knows of explains it.

    Of a cause `before`, which the part is corrected by, the size is found more exactly: its effect is not linear.
    """
    estimate = part.estimate
    small = before is None and estimate.redundancy.belief < LEAST_EXPECTED * estimate.weight
    if part.inputs.condition is None or small:
        return None
    names = forces.record.robot.suspects() if before is None else (before.cause.name,)
    causes = [_cause_of(name, part, series, forces, before) for name in names]
    return max(filter(None, causes), key=lambda named: named.cause.share, default=None)


def _cause_of(
    name: str, part: CheckedPart, series: LearntError, forces: KnownForces, before: Named | None
) -> Named | None:
    """Return what a cause explains of a part; None if its parameters cannot be told apart, or from what is left."""
    time, geometry, group = part.inputs.time, part.geometry, forces.record.robot.suspects()[name]
    x = slow_part(time, part.estimate.unexplained[:, : geometry.projector.shape[1]])
    start, steps = np.zeros(len(group)) if before is None else before.values, np.diag([each.step for each in group])
    here, *stepped = (_residual_with(part.inputs, forces, name, values) for values in (start, *(start + steps)))
    slopes = np.stack([(after - here) / step.sum() for after, step in zip(stepped, steps, strict=True)], axis=2)
    G = np.stack([slow_part(time, geometry.unexplained(slope)) for slope in np.moveaxis(slopes, 2, 0)], axis=2)
    normal = np.einsum("nkp,nkq->pq", G, G)
    if np.linalg.matrix_rank(normal) < len(group):
        return None
    H = G @ np.linalg.inv(normal)
    change = -np.einsum("nkp,nk->p", H, x)
    remainder, theta = x + G @ change, start + change
    covariance = _covariance(part, series, H) + _of_remainder(part, H, remainder)
    if np.sqrt(theta @ np.linalg.solve(covariance, theta) / len(group)) < SURE_OF_CAUSE:
        return None
    factors = np.array([suspect.factor for suspect in group])
    cause = Cause(
        name=name,
        estimate=tuple((factors * theta).tolist()),
        deviation=tuple((factors * np.sqrt(np.diag(covariance))).tolist()),
        labels=tuple(suspect.label for suspect in group),
        units=tuple(suspect.unit for suspect in group),
        share=1.0 - float(np.sum(remainder**2) / np.sum(x**2)) if before is None else before.cause.share,
    )
    force = -slopes @ theta
    if group[0].inertial:
        force = np.subtract(*(_residual_with(part.inputs, forces, name, values) for values in (0.0 * theta, theta)))
    return Named(cause, theta, force, slopes @ np.linalg.cholesky(covariance))


def cause_corrected(inputs: KnownInputs, named: Named, forces: KnownForces) -> KnownInputs:
    """Return the inputs of a whole part as they are with the cause: another motion, or one more known force."""
    name, record = named.cause.name, forces.record
    block = record.block(*record.parts[0])
    if record.robot.suspected(name, named.values, block)[1] is not block:  # it changes the motion, and not the robot
        inputs = _changed_inputs(inputs, forces, name, named.values)
    else:
        inputs = replace(inputs, known={**inputs.known, "correction": named.force})
    return replace(inputs, source={**inputs.source, "correction": name})


def _changed_inputs(inputs: KnownInputs, forces: KnownForces, name: str, values: Array) -> KnownInputs:
    """Return the inputs of a whole part as they would be with a cause that is not of the inertias."""
    record = forces.record
    robot, block = record.robot.suspected(name, values, record.block(*record.parts[0]))
    forces = replace(forces, record=replace(record, robot=robot))
    if forces.series is not None and robot.suspects()[name][0].of_error:
        forces = replace(forces, series=forces.series.times(1.0 + float(values[0])))
    return inputs_of_block(forces.record, block, forces, inputs.rows)


def _residual_with(inputs: KnownInputs, forces: KnownForces, name: str, values: Array) -> Array:
    """Return R - e (m, nv) of a whole part as it would be with a cause."""
    robot = forces.record.robot
    inertial = all(suspect.inertial for suspect in robot.suspects()[name])
    if np.any(values):
        robot, _ = robot.suspected(name, values, forces.record.block(*forces.record.parts[0]))
        inputs = inputs if inertial else _changed_inputs(inputs, forces, name, values)
    return residual_at_once(robot.model, inputs)


def _covariance(part: CheckedPart, series: LearntError, H: Array) -> Array:
    """Return the covariance (p, p) of theta that the calibration's own covariance gives."""
    condition, geometry, time = part.inputs.condition, part.geometry, part.inputs.time
    assert condition is not None
    count, k, p = H.shape
    back = slow_part(time, H[::-1].reshape(count, -1))[::-1].reshape(count, k, p)
    at = np.searchsorted(geometry.at, np.arange(count), "right") - 1
    onto = geometry.rows[at] @ (geometry.projector[at] @ back)
    terms, width = series.regressors(condition), 2 * series.order + 1
    of_flight = DAILY**2 * shares(series.order)
    covariance = np.zeros((p, p))
    for i in series.learnt_rows:
        row = condition.spread(alone(np.ones((count, onto.shape[1])), i))
        along = terms.T @ np.einsum("nv,nvp->np", row, onto)
        covariance += along.T @ series.covariance[i] @ along
        covariance += series.size[i] ** 2 * (along[:width].T * of_flight) @ along[:width]
    return covariance


def _of_remainder(part: CheckedPart, H: Array, remainder: Array) -> Array:
    """Return the covariance (p, p) of theta by what is left: of its sums over each cycle, and at other phases."""
    condition = part.inputs.condition
    assert condition is not None
    cycle = np.floor((condition.phase - condition.phase[0]) / (2.0 * np.pi)).astype(int)
    cycle -= cycle.min()
    sums = np.zeros((cycle.max() + 1, H.shape[2]))
    np.add.at(sums, cycle, np.einsum("nkp,nk->np", H, remainder))
    shifts = np.round(len(remainder) / max(condition.turns, 1.0) * np.arange(1, PHASES) / PHASES).astype(int)
    shifted = np.stack([np.einsum("nkp,nk->p", H, np.roll(remainder, shift, axis=0)) for shift in shifts])
    return np.asarray(sums.T @ sums + shifted.T @ shifted / len(shifts))


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
