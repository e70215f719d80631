"""Find friction, and the errors of rows, while unknown forces push: in a record of which nothing else tells them.

    y = J^T f + X b + e,    f ~ N(0, S^2),    b ~ N(0, B^2),    e ~ N(0, r R + stiction)

At some instants y are the rows behind the observer's low-pass, X b Coulomb and viscous friction of the driven joints,
and their rotors' inertia if that leaves smaller errors, behind the same, and R is what is expected of the rows' errors
without a record. Those b and r that make the rows most likely, whatever the forces are, follow by expectation
maximisation (Dempster, Laird and Rubin 1977). Rows to spare tell errors from forces; without any a force would pass for
an error, and nothing is sought.

A foot in the air carries nothing, S = 0: its leg shows friction and errors whatever the other feet do. Only then are
factors of efforts sought, too: else what pushes elsewhere than at the points would pass for them. They are found first,
beside feet that carry anything: smaller efforts need smaller forces, which a finite S takes for likelier. An
accelerometer with an offset, which looks like a tilt, moves b; that counts as an error of the rows. Without rows of the
base, factors follow from the weight (`factors_by_balance`).

Where no foot lifts, what pushes elsewhere than at the points passes for errors. So the mean of r is handed on as the
least k, which the output judges, and the sizes of the rows over it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from aerobat_pin.forces.balance import factors_by_balance
from aerobat_pin.forces.deviations import tilt_of
from aerobat_pin.forces.expected_of_record import (
    EFFORT_ERROR,
    SLIDES_AT,
    expected_of,
    lifted_feet,
    no_less,
    row_scale,
    stands,
)
from aerobat_pin.forces.explanations import FEWEST_INDEPENDENT, coefficient_covariance, independent, row_variance
from aerobat_pin.forces.instants import Instants, column_rms, instants_of
from aerobat_pin.forces.known_forces import BESIDE, FRICTION_SHOWN, Fit, FittedValues, KnownForces, share_left
from aerobat_pin.forces.row_errors import shared_error, spare_share
from aerobat_pin.forces.run_observers import ignored_rows, inputs_between, points_of
from aerobat_pin.numerics import Array
from aerobat_pin.observers import Expected, JointFriction, as_others_rub, effort_limits, rotation_matrices, row_names

FEWEST_INSTANTS = 50  # that are weighed
EXPECTATION_ROUNDS = 30  # of expectation and maximisation; what a record tells has settled by then
UNLIKELY_FACTOR = 0.5  # error of an effort's factor that nobody believes: something else explains the rows
UNKNOWN_SPEED = 1.0  # [m/s] that a robot may gain over a record
NEXT_TO_NOTHING = 1e-6  # of what forces are expected to make of the rows
LEAST_SIZE = 1e-9  # of r: of a joint that carries nothing all rows are 0
HARDLY_MOVES = (
    "hardly moves: it is taken to rub as the others do, in proportion to the efforts that joints can bear, and up "
    "to its Coulomb friction it counts as unknown"
)
CHECKED = 0.02  # of a row's error that other rows show at least: else a force passes for it, and it is as expected
HARDLY_RUBS = (1.0 - FRICTION_SHOWN**2) ** 0.5  # of rows' known errors: less friction cannot make them so much smaller
UNKNOWN_SIZE = 30.0  # times what is expected of a force, beside factors: smaller efforts need smaller ones, likelier
BLOW, BLOW_ROUNDS = 3.0, 5  # of what is expected of a force: one that is larger is what the rows show of it
ROTORS_SOUGHT = 0.5  # of what is expected of the rows' errors, geometric mean, from which they may show rotors
ROTORS_SHOWN = 0.75  # of the errors of rows, geometric mean: where rotors leave more, errors cover them all the same
AT_BOUND = 1e-14  # of the largest coefficient, all of size 1: what is left of one at its bound
LEAST_SHOWN = 1e-9  # share of a coefficient's information that is added to it: one that the record does not show is 0


def fit_beside_forces(forces: KnownForces) -> tuple[KnownForces, Expected | None, Instants | None]:
    """Return known forces with the friction of a record's joints and the errors of its rows, if it tells them.

    And what is then expected of the record, and its instants, with the friction; None if it is too short.

    Errors of rows that are known count where friction is known, too, or where friction and errors by the record itself
    are no smaller: what was learnt without friction, where nothing touches, has it among the errors.
    """
    record, values = forces.record, forces.values
    measured = bool(points_of(record.map)) and "joints.effort" in record.channels
    sought = measured and not knows_friction(forces)
    instants = instants_of(record, inputs_between(record, forces), values, closely=sought)
    if instants is None:
        return forces, None, None
    expected = expected_of(record, instants, values)
    fitted = _shown_values(forces, instants, expected) if sought else None
    if fitted is None:
        if measured and not sought and len(instants.rows):  # friction is known
            expected = replace(expected, shared=shared_error(record.robot.model, instants, expected).deviation)
        return forces, expected, instants
    law, n = fitted.friction, len(instants.joints)
    assert law is not None
    b = np.stack([law.coulomb, law.viscous, law.inertia, fitted.scale - 1.0])[:, -n:]
    smooth = instants.without(b)
    expected = expected_of(record, smooth, fitted)
    shared = shared_error(record.robot.model, instants, expected)
    expected = replace(expected, shared=shared.by_weight if np.any(fitted.scale != 1.0) else shared.deviation)
    return replace(forces, values=fitted), expected, instants


def _shown_values(forces: KnownForces, instants: Instants, expected: Expected) -> FittedValues | None:
    """Return what instants tell of friction and of the errors of the rows; None if they tell nothing."""
    record, values, law = forces.record, forces.values, forces.values.friction
    if len(instants.rows) < FEWEST_INSTANTS or not instants.joints:
        return None
    if law is not None and np.abs(instants.sliding[:, instants.at]).max() < SLIDES_AT:
        return None  # what a calibration did not see move does not move here, either
    y, J, robot = instants.rows[:, instants.kept], instants.jacobians[:, :, instants.kept], record.robot
    force = np.broadcast_to(expected.force, J.shape[:2])
    wide, lifts = force, False  # of a foot in the air, what it seems to carry there: it may be about to land
    if stands(record, instants):
        lifted, _, usual = lifted_feet(y, J, robot.weight)
        in_air, lifts = np.repeat(lifted, 3, axis=1), bool(lifted.any())
        force, wide = np.where(in_air, 0.0, force), np.where(in_air, np.repeat(usual, 3), UNKNOWN_SIZE * force)
    if y.size <= np.count_nonzero(force):
        return None
    force, loose = with_blows(force, y, J), with_blows(wide, y, J) if lifts else None
    fitted, names = _fitted(forces, instants, expected, force, loose, rotors=False), list(row_names(robot.model))
    if _errors_over(fitted, {names[row]: expected.row_error[row] for row in instants.kept}) > ROTORS_SOUGHT:
        turning = _fitted(forces, instants, expected, force, loose, rotors=True)
        fitted = turning if _errors_over(turning, _errors(fitted)) < ROTORS_SHOWN else fitted
    if np.abs(fitted.scale - 1.0).max(initial=0.0) > UNLIKELY_FACTOR:
        fitted = _fitted(forces, instants, expected, np.broadcast_to(expected.force, J.shape[:2]), None, rotors=False)
    floored = replace(fitted, row_noise=no_less(record, fitted.row_noise))  # what is compared is not
    if law is not None:
        return values.joined(floored)
    if values.row_noise and not values.row_noise.keys() & {names[instants.kept[k]] for k in instants.at}:
        return replace(floored, row_noise={**floored.row_noise, **values.row_noise})  # it did not see any joint slide
    no_smaller = _errors_over(fitted, values.row_noise) >= FRICTION_SHOWN  # if any are known
    errors = np.array([values.row_noise.get(names[instants.kept[k]], 0.0) for k in instants.at])
    return None if no_smaller or np.all(_rubbing(fitted, instants) < HARDLY_RUBS * errors) else floored


def _rubbing(fitted: FittedValues, instants: Instants) -> Array:
    """Return how large (n,) friction and rotors of the joints are, rms."""
    law = fitted.friction
    assert law is not None
    b = np.stack([law.coulomb, law.viscous, law.inertia])
    return column_rms(np.einsum("kn,kmn->mn", b, instants.columns[:3][:, :, instants.at]))


def with_blows(force: Array, y: Array, J: Array) -> Array:
    """Return sizes (m, c) of forces: where rows show a force beyond `BLOW` times its size, what they show.

    It would pass for an error of the rows, for that of all times. Before anything else is known, errors are as large as
    the rows (m, k). The arguments are those of `most_likely`.
    """
    least = LEAST_SIZE + NEXT_TO_NOTHING * np.max(force[..., None] * np.abs(J))  # of a robot in a plane some rows are 0
    size = np.maximum(column_rms(y), least)
    for _ in range(BLOW_ROUNDS):
        B = force[..., None] * J
        cov = np.swapaxes(B, 1, 2) @ B + np.diag(size**2)
        shown = np.abs(force * (B @ np.linalg.solve(cov, y[..., None]))[..., 0])
        force = np.where(shown > BLOW * force, shown, force)
    return force


def knows_friction(forces: KnownForces) -> bool:
    """Return whether a map or a calibration says what friction the joints have whose rows are believed."""
    record, values = forces.record, forces.values
    joints = set(record.driven) - set(ignored_rows(record))
    return record.map.joints.friction is not None or (values.friction is not None and joints <= {*values.joints})


def _errors(fitted: FittedValues) -> dict[str, float]:
    """Return row -> deviation of its errors that was found beside the forces."""
    return {row: fitted.doubt**0.5 * size for row, size in fitted.row_noise.items()}


def _errors_over(fitted: FittedValues, known: Mapping[str, float]) -> float:
    """Return the geometric mean of rows' errors beside friction over those that are known; NaN if none is."""
    return share_left((size, known.get(row, 0.0)) for row, size in _errors(fitted).items())


def _fitted(
    forces: KnownForces, instants: Instants, expected: Expected, force: Array, wide: Array | None, *, rotors: bool
) -> FittedValues:
    """Return friction, errors of rows and, where feet lift, factors of efforts, for forces (m, c) of a size.

    Factors are those beside forces of a size so wide that it says nothing of them. Rotors have inertia, or not.
    """
    record, robot, kept, at, n = forces.record, forces.record.robot, instants.kept, instants.at, len(instants.at)
    y, J, error = instants.rows[:, kept], instants.jacobians[:, :, kept], expected.row_error[kept]
    offset = float(np.linalg.norm(robot.model.gravity.linear)) * tilt_of(record.map)  # [m/s2] of an accelerometer
    by_base = wide is not None and kept[0] == 0  # rows of the base are believed, and tell factors
    limits, kinds = effort_limits(robot.model, [kept[k] for k in at]), [0, 1, 2] if rotors else [0, 1]
    expected_of_kind = np.array([np.inf, np.inf, np.inf, EFFORT_ERROR])

    def likely(rows: Array, size: Array, kinds: list[int]) -> tuple[Array, Array, Array, Array]:
        x, known = instants.columns[kinds][:, :, at], expected_of_kind[kinds]
        series = rows[:, kept], x, known, J, at, instants.sliding
        return most_likely(*series, size, error, offset=robot.mass * offset * by_base, limits=limits)[:4]

    factors: Array = np.zeros(n)
    unsure: Array = np.zeros(len(kept))
    rows = instants.rows
    if wide is not None and by_base:
        (*_, factors), _, unsure, _ = likely(rows, wide, [*kinds, 3])
        rows = instants.without(np.stack([*np.zeros((3, n)), factors])).rows
    b, size, unsure_of_friction, error_rms = likely(rows, force, kinds)
    unsure = np.maximum(unsure, unsure_of_friction)
    coulomb, viscous, inertia = b if rotors else (*b, np.zeros(n))
    if wide is not None and not by_base:
        rows = instants.without(np.stack([coulomb, viscous, inertia, factors])).rows
        acceleration = UNKNOWN_SPEED / (len(y) * instants.every * record.dt) + offset
        least = robot.mass * row_scale(robot.model)[:6] * acceleration
        SJ = force[..., None] ** 2 * J
        G = SJ @ np.linalg.inv(np.swapaxes(J, 1, 2) @ SJ + np.diag(size * error**2))
        efforts, attitude = instants.columns[3], rotation_matrices(instants.q[:, 3:7])
        d, sigma = factors_by_balance(rows, instants.jacobians, G, kept, efforts, attitude, least, EFFORT_ERROR)
        unsure, factors = unsure + np.mean((efforts * sigma) ** 2, axis=0), d[at]
    level = 1.0 if wide is not None else max(1.0, float(np.mean(size)))
    noise = np.sqrt((size * error**2 + unsure) / level)
    before, slid = column_rms(y), np.abs(instants.sliding[:, at]).max(axis=0)
    fits = [
        Fit(
            f"friction of {joint}{BESIDE}",
            {"coulomb": float(coulomb[i]), "viscous": float(viscous[i]), "inertia": float(inertia[i])}
            | ({"effort times": float(1.0 + factors[i])} if wide is not None else {}),
            "N" if robot.slides(joint) else "N m",
            float(before[at[i]]),
            float(error_rms[at[i]]),
            float("nan"),
            untold="" if slid[i] > SLIDES_AT else f"{joint} {HARDLY_MOVES}",
        )
        for i, joint in enumerate(instants.joints)
    ]
    names = list(row_names(robot.model))
    return replace(
        forces.values,
        joints=tuple(instants.joints),
        friction=JointFriction(coulomb, viscous, inertia, np.zeros(n), float(expected.stiction_rate.max())),
        scale=1.0 + factors,
        row_noise=dict(zip([names[row] for row in kept], noise.tolist(), strict=True)),
        doubt=level,
        fits=(*forces.values.fits, *fits),
    )


def most_likely(
    y: Array,
    x: Array,
    known: Array,
    J: Array,
    at: list[int],
    sliding: Array,
    force: Array,
    error: Array,
    *,
    offset: float = 0.0,
    limits: Array | None = None,
) -> tuple[Array, Array, Array, Array, Array]:
    """Return b (kinds, n), the sizes r (k,), what b's errors make of the rows (k,), squared, the errors' rms (k,).

    And the covariance of b (kinds n, kinds n). Its errors are those of coefficients that are not at their bounds, and
    those of an offset.

    Args:
        y: (m, k) rows.
        x: (kinds, m, n) what a coefficient of size 1 does in its own row: Coulomb friction, viscous friction, others.
        known: (kinds,) B; infinite for friction, which is positive, and at full slide no larger than its row ever is.
        J: (m, c, k) Jacobian of the components.
        at: these n rows.
        sliding: (m, k) tanh(v / v_s): at rest a row has stiction, and says nothing of its errors in motion. Of a joint
            that never slides they are as expected.
        force: (m, c) S.
        error: (k,) square roots of R.
        limits: (n,) efforts that joints can bear, in proportion to which those that never slide rub as the worst of
            the others; what their own rows show of friction when omitted.
        offset: force [N] that a base's accelerometer with an offset may find in each of the first three rows for ever.
    """
    k, (kinds, _, n) = y.shape[1], x.shape
    B, identity = force[..., None] * J, np.eye(J.shape[1])
    stiction, every, prior = np.zeros(k), range(kinds * n), np.repeat(known**-2.0, n)
    slid, shown = np.abs(sliding).max(axis=0), np.abs(x).max(axis=1) + LEAST_SHOWN
    largest = np.maximum(np.abs(y).max(axis=0), error)[at] * (slid[at] + LEAST_SHOWN) / shown  # of friction
    largest = np.where(np.isinf(known)[:, None], largest, np.inf).ravel()
    information = LEAST_SHOWN * largest**-2.0 + prior
    size = np.maximum((column_rms(y) / error) ** 2, LEAST_SIZE)  # from below they would hardly move
    slides = slid[at] > SLIDES_AT
    for _ in range(EXPECTATION_ROUNDS):
        R = size * error**2 + stiction**2 / 3.0 * (1.0 - sliding**2)
        Z = B / R[:, None]  # the rows' covariance has the inverse R^-1 - Z^T P (Woodbury)
        P = np.linalg.solve(identity + Z @ np.swapaxes(B, 1, 2), Z)
        normal = -np.tensordot(x[:, :, None] * Z[:, :, at], x[:, :, None] * P[:, :, at], axes=((1, 2), (1, 2)))
        normal[:, range(n), :, range(n)] += np.einsum("ami,bmi->iab", x / R[:, at], x)
        normal = normal.reshape(kinds * n, -1)
        normal[every, every] += LEAST_SHOWN * np.diag(normal) + information
        white = y / R - np.einsum("mck,mc->mk", Z, np.einsum("mck,mk->mc", P, y))
        target = np.einsum("ami,mi->ai", x, white[:, at]).ravel()
        b = _bounded(normal, target, largest).reshape(kinds, n)
        if limits is not None:
            b[0] = as_others_rub(b[0], slides, limits)
        stiction[at] = b[0]
        remainder = y.copy()
        remainder[:, at] -= np.einsum("ami,ai->mi", x, b)
        white = remainder / R - np.einsum("mck,mc->mk", Z, np.einsum("mck,mk->mc", P, remainder))
        mean = R * white  # of e, given the rows
        square = mean**2 + R**2 * np.sum(Z * P, axis=1)
        size = np.sum(sliding**2 * square, axis=0) / np.maximum(np.sum(sliding**2, axis=0), 1e-9) / error**2
        size = np.where(slid > SLIDES_AT, np.maximum(size, LEAST_SIZE), 1.0)
    count = np.maximum(independent(mean), FEWEST_INDEPENDENT)
    checked = spare_share(J, force, np.sqrt(size) * error) > CHECKED
    size *= count / (count - 2.0)  # Student's variance: r follows from so few
    size = np.where(checked, size, np.minimum(size, 1.0))
    seen = np.eye(k)[at, :3] / R[:, at, None] - np.swapaxes(Z[:, :, at], 1, 2) @ P[:, :, :3]
    pushed = np.einsum("ami,mio->aio", x, seen) * offset  # what an offset of each axis adds to the target
    change = np.linalg.solve(normal, pushed.reshape(kinds * n, -1)).reshape(kinds, n, -1)
    free = (b.ravel() > 0.0) & (b.ravel() < largest)
    scores = np.swapaxes(x * white[:, at], 0, 1).reshape(len(y), -1)
    covariance = coefficient_covariance(normal, scores, prior, np.isinf(largest) | free)
    unsure = np.zeros(k)
    unsure[at] = np.sum(np.mean(np.einsum("ami,aio->omi", x, change) ** 2, axis=1), axis=0)
    unsure[at] += row_variance(x, covariance)
    return b, size, unsure, column_rms(mean), covariance


def _bounded(normal: Array, target: Array, largest: Array) -> Array:
    """Return b (p,) that makes b^T N b / 2 - b^T t least, all at once, as they correlate; bounded are from 0 up."""
    from scipy.optimize import lsq_linear

    scale = np.diag(normal) ** -0.5
    L = np.linalg.cholesky(normal * scale * scale[:, None])
    low, high = np.where(np.isfinite(largest), 0.0, -np.inf), largest / scale
    t = np.linalg.solve(L, scale * target)
    x = np.linalg.solve(L.T, t)
    if np.any((x < low) | (x > high)):
        x = lsq_linear(L.T, t, (low, high), method="bvls").x
    return np.asarray(scale * np.where(np.abs(x) < AT_BOUND * np.abs(x).max(), 0.0, x))
