"""What is expected of a record's forces and rows: from what was learnt where nothing touched, else from its efforts."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
import pinocchio as pin

from aerobat_pin.forces.contacts import END_SHARE, walks_on
from aerobat_pin.forces.instants import Instants, column_rms
from aerobat_pin.forces.known_forces import FittedValues
from aerobat_pin.forces.run_observers import believed_rows, points_of
from aerobat_pin.numerics import Array
from aerobat_pin.observers import (
    SHARE_OF_WEIGHT,
    Application,
    Applications,
    Expected,
    Rows,
    as_others_rub,
    effort_limits,
    robot_length,
    row_names,
    scale_of_forces,
    with_record,
)
from aerobat_pin.records import PlainRobot, Record

EFFORT_ERROR = 0.1  # of the rms of a row's effort, or of what its motion needs: its error if nothing better is known
LEAST_ROW_ERROR = 1e-3  # of the weight that rows move (moments: times the robot's length): none is known better ...
LEAST_MEASURED = 1e-3  # ... unless it was measured where nothing touched; then, of what the row carries
LEAST_CARRIED = 1e-3  # of what the whole robot weighs: no row counts as carrying less
LEAST_LIFTED = 10  # of these, with a foot in the air
CARRIES = 0.5  # of the weight: known forces from which they may be what carries the robot
FOOT_SHARE = 0.15  # of the weight: a point that never holds so much is no foot
SLIDES_AT = 0.76  # of Coulomb friction that has set in: a joint that never shows as much hardly moves
REWEIGHTED = 20  # rounds by which least squares become least absolute errors
LEAST_ABSOLUTE = 1e-3  # of a row's rms: an error counts as no smaller
STRETCHES = 4  # of a record, each of which may have a push of its own
STRAIGHT_LEG = 0.1  # least over largest singular value of a leg's Jacobian: below, it does not show a force along it


def expected_of(record: Record, instants: Instants, values: FittedValues) -> Expected:
    """Return what is expected of a record, by its instants and what was learnt of the rows' errors and of friction.

    A force is expected to be a third of the weight, or larger if that makes the record more likely. Where no row is to
    spare, nothing tells friction that nobody knows from a force: what it can explain of a row counts among its errors.
    """
    robot, points, rows = record.robot, points_of(record.map), believed_rows(record)
    expected = expected_from(robot, rows, values, points, instants.effort, instants.needed)
    if not points or not len(instants.rows):
        return expected
    unknown = [name not in values.row_noise for name in row_names(robot.model)]
    expected = replace(expected, row_error=np.hypot(expected.row_error, np.where(unknown, instants.noise, 0.0)))
    if values.friction is None and not values.row_noise and instants.jacobians.shape[1] >= len(instants.kept):
        expected = replace(expected, row_error=np.hypot(expected.row_error, _rubbed(robot, instants)))
    some = instants.weighed
    v, residual, jacobians = instants.v[some], instants.rows[some], instants.jacobians[some]
    if stands(record, instants) and not values.row_noise:
        lifted = lifted_errors(robot.model, residual, jacobians, robot.weight)
        expected = replace(expected, row_error=np.hypot(expected.row_error, lifted))
    weighed = with_record(expected, rows, robot.model, v, residual, jacobians)
    return replace(weighed, doubt=max(weighed.doubt, values.doubt))


def stands(record: Record, instants: Instants) -> bool:
    """Return whether points of a robot may be feet that hold it up: not if known forces carry it."""
    if not walks_on(record.robot, record.map):
        return False
    known = sum(instants.known.values(), np.zeros_like(instants.rows))
    return float(np.linalg.norm(column_rms(known[:, :3]))) <= CARRIES * record.robot.weight


def _rubbed(robot: PlainRobot, instants: Instants) -> Array:
    """Return the rms (nv,) of what friction, which resists, explains of each row; joints at rest rub as the others.

    By least absolute errors beside offsets, as a push, which is short or constant, hardly moves these. The larger of
    what one offset leaves to friction, which takes half a record's push for friction of any size, and one of each
    stretch, which takes friction of a joint that goes one way there for a push.
    """
    at, rubbed = [instants.kept[k] for k in instants.at], np.zeros(robot.model.nv)
    once = np.ones((len(instants.rows), 1))
    each = np.repeat(np.eye(STRETCHES), -(-len(once) // STRETCHES), axis=0)[: len(once)]
    for k, row in zip(instants.at, at, strict=True):
        y, friction = instants.rows[:, row], instants.columns[:2, :, k].T
        explained = max(column_rms(friction @ _rubs(y, friction, offsets)) for offsets in (once, each))
        rubbed[row] = min(explained, instants.effort[row])  # which overcomes the friction
    slides = np.abs(instants.sliding[:, instants.at]).max(axis=0, initial=0.0) > SLIDES_AT
    rubbed[at] = as_others_rub(rubbed[at], slides, effort_limits(robot.model, at))
    return rubbed


def _rubs(y: Array, friction: Array, offsets: Array) -> Array:
    """Return the factors (2,), not negative, of friction (m, 2) in a row y (m,) by least absolute errors.

    Beside any factors of offsets (m, k).
    """
    from scipy.optimize import nnls

    x, weight = np.column_stack([friction, offsets, -offsets]), np.ones(len(y))
    for _ in range(REWEIGHTED):
        b = nnls(x * weight[:, None], y * weight)[0]
        weight = np.maximum(np.abs(y - x @ b), LEAST_ABSOLUTE * column_rms(y) + np.finfo(float).tiny) ** -0.5
    return np.asarray(b[:2])


def expected_from(
    robot: PlainRobot,
    rows: Rows,
    values: FittedValues,
    points: Sequence[str | Application],
    effort: Array,
    needed: Array,
) -> Expected:
    """Return what is expected of a robot whose efforts, and what its motion needs, have some rms (nv,) [N or N m].

    In an orbit a force may be as large as what moves it.
    """
    model, weight = robot.model, scale_of_forces(robot.model)
    error = EFFORT_ERROR * np.where(effort > 0.0, effort, needed)
    error, measured = np.maximum(error, least_row_error(model, rows)), LEAST_MEASURED * carried_by_rows(model)
    for k, name in enumerate(row_names(model)):
        error[k] = max(values.row_noise[name], measured[k]) if name in values.row_noise else error[k]
    applications = Applications(model, points)
    lever = np.array([1.0 if unit == "N" else robot_length(model) for unit in applications.units])
    size = SHARE_OF_WEIGHT * weight
    if robot.free and robot.weightless:
        size = max(size, float(np.linalg.norm(needed[:3])))
    return Expected(size * lever, error, *values.stiction(robot))


def lifted_feet(rows: Array, jacobians: Array, weight: float) -> tuple[Array, Array, Array]:
    """Return which foot is in the air (m, n), which rows (n, nv) its leg alone moves, what it seems to carry (n,).

    A foot is in the air where its own joints say that it carries nothing: it is then free of unknown forces. A point
    that never holds up the robot is no foot: a hand may be pushed by less than what counts as nothing at a foot. And a
    straight leg does not show what it carries. A foot with less than `END_SHARE` of the weight [N] is in the air; what
    it seems to carry then is the median there [N]: noise, friction, and what it carries just before it lands. Rows
    (m, nv) are behind the observer's low-pass; Jacobians (m, c, nv) have three components for each foot.
    """
    moved = np.any(jacobians != 0.0, axis=0).reshape(-1, 3, rows.shape[1]).any(axis=1)  # which foot, by which row
    legs = moved & (moved.sum(axis=0) == 1)
    lifted, usual = np.zeros((len(rows), len(legs)), bool), np.zeros(len(legs))
    for foot, leg in enumerate(legs):
        J = jacobians[:, 3 * foot : 3 * foot + 3][:, :, leg]
        if not leg.any():
            continue
        force = (np.linalg.pinv(np.swapaxes(J, 1, 2)) @ rows[:, leg, None])[..., 0]
        size, shown = np.linalg.norm(force, axis=1) / weight, np.linalg.svd(J, compute_uv=False)
        bent = shown[:, -1] > STRAIGHT_LEG * shown[:, 0]
        lifted[:, foot] = up = bent & (size < END_SHARE) & (size.max(initial=0.0) > FOOT_SHARE)
        usual[foot] = weight * np.median(size[up]) if up.any() else 0.0
    return lifted, legs, usual


def lifted_errors(model: pin.Model, rows: Array, jacobians: Array, weight: float) -> Array:
    """Return the rms (nv,) of the rows of each leg while its foot carries nothing; 0 where no leg shows it.

    They show friction and noise, however small the efforts are. Legs whose feet never seem to be in the air, as those
    whose friction looks like what they carry, rub as the others.
    """
    errors, (lifted, legs, _) = np.zeros(rows.shape[1]), lifted_feet(rows, jacobians, weight)
    shown = legs[lifted.sum(axis=0) >= LEAST_LIFTED].any(axis=0)
    for up, leg in zip(lifted.T, legs, strict=True):
        if up.sum() >= LEAST_LIFTED:
            errors[leg] = column_rms(rows[up][:, leg])
    every = np.flatnonzero(legs.any(axis=0)).tolist()
    errors[every] = as_others_rub(errors[every], shown[every], effort_limits(model, every))
    return errors


def row_scale(model: pin.Model) -> Array:
    """Return what makes a force [N] the size of each row (nv,): 1, or for a moment the robot's length [m]."""
    length = robot_length(model)
    return np.array([1.0 if unit == "N" else length for unit in row_names(model).values()])


def least_row_error(model: pin.Model, rows: Rows) -> Array:
    """Return the least error (nv,) [N or N m] of a row that was not measured where nothing touched."""
    return LEAST_ROW_ERROR * (scale_of_forces(model, rows) or scale_of_forces(model)) * row_scale(model)


def carried_by_rows(model: pin.Model) -> Array:
    """Return the weight [N] of what the joint of each row (nv,) carries; of moments, times its radius about the joint.

    In an orbit it is a hundredth of the weight on Earth. What hardly weighs anything counts as a share of the robot.
    """
    data, unit = model.createData(), np.array([*row_names(model).values()])
    pin.crba(model, data, pin.neutral(model), pin.Convention.LOCAL)
    carried = np.zeros((2, model.nv))
    for joint in model.joints.tolist()[1:]:
        borne = data.Ycrb[joint.id]
        squares = 0.5 * np.trace(borne.inertia) + borne.mass * borne.lever @ borne.lever
        carried[:, joint.idx_v : joint.idx_v + joint.nv] = [[borne.mass], [np.sqrt(borne.mass * squares)]]
    share = np.where(unit == "N", *carried) / max(sum(inertia.mass for inertia in model.inertias.tolist()[1:]), 1e-12)
    return np.asarray(scale_of_forces(model) * np.maximum(share, LEAST_CARRIED * row_scale(model)))


def no_less(record: Record, errors: Mapping[str, float]) -> dict[str, float]:
    """Return errors of rows [N or N m], found while unknown forces pushed, none of them less than `least_row_error`."""
    model = record.robot.model
    least = zip(row_names(model), least_row_error(model, believed_rows(record)).tolist(), strict=True)
    return {row: max(errors[row], size) for row, size in least if row in errors}
