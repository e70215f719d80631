"""Name what changed after a calibration, from what no force explains.

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

from dataclasses import dataclass, replace

import numpy as np

from aerobat_pin.estimation.calibration.checked_part import CheckedPart
from aerobat_pin.estimation.calibration.free_run import residual_at_once
from aerobat_pin.forces import (
    DAILY,
    LEAST_EXPECTED,
    Cause,
    KnownForces,
    KnownInputs,
    LearntError,
    alone,
    inputs_of_block,
    shares,
)
from aerobat_pin.numerics import Array
from aerobat_pin.observers import slow_part

SURE_OF_CAUSE = 4.0  # z from which a cause is named
PHASES = 24  # of what is left against a cause, over a cycle


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
