"""Fit friction, factors of efforts, payload and mass where nothing touches the robot, or a force sensor says what does.

Of each joint's row  m n(q, v, a) = c tau + tau_f + known  everything but friction tau_f, the factor c of its effort and
the factor m of all masses is measured or computed (n: what the motion needs, Pinocchio's rnea). Factors and payload
come first, by regressing the efforts on what the motion needs,

    i = g (n(pi) + Y dpi + Y_L pi_L - known) + friction,      dpi ~ 10 % of each link's mass, 3 cm of its centre

with i the effort of a row as the map gives it, Y the regressor of n, pi_L the payload's parameters and 1/g the factor
of the effort. The reverse, n on i, makes factors too small by the noise of the efforts. Errors of the links are fitted
beside them and then left out: they widen the deviations. Then comes friction, joint by joint, behind two low-passes, as
noise of accelerations makes inertias too small. The mass, too, which is common to all believed rows: what friction can
explain of a row is taken out of it and of n first, and rows count by what is left over of each.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from aerobat_pin.errors import MapError, ObserverError
from aerobat_pin.forces.gain_regression import (
    Regression,
    explained,
    fits_to_sensor,
    fitted_blocks,
    friction_columns,
    link_errors,
    regression,
    regression_gain,
    rms_or_nan,
)
from aerobat_pin.forces.inverse_dynamics import SMOOTHING, accelerations, required_torque
from aerobat_pin.forces.known_forces import Fit, FittedValues, KnownForces
from aerobat_pin.forces.run_observers import ignored_rows
from aerobat_pin.numerics import Array
from aerobat_pin.observers import FRICTION_COEFFICIENTS, SMOOTH_RATE, AllBut, fit_friction, repeats, twice_low_passed
from aerobat_pin.records import FrictionSection, PayloadSection, Record

FACTOR_ERROR = 0.2  # expected of each effort's factor, where a record tells nothing [-]
UNSURE_FACTOR = 0.1  # deviation of a factor from which a record does not tell it
UNSEEN = 3.0  # deviations: a lighter payload is not shown by the record
CERTAIN = 1e-3  # deviation of a factor that is known
COULOMB_RATES = (0.01, SMOOTH_RATE, 0.05, 0.1, 0.2)  # [rad/s, m/s] from which one is chosen, see `_coulomb_rate`
FOLDS, LEAST_DROP = 4, 0.01  # parts of the stretch, each predicted from the others; [-] of the error, for another rate
UNSURE_MASS = 0.05  # standard deviation of the factor of the mass from which a record does not show it


def fit_gains(
    forces: KnownForces, fit: tuple[float, float], rate: float = SMOOTH_RATE
) -> tuple[KnownForces, dict[str, float], dict[str, str]]:
    """Fit factors of the efforts and errors of the links, if the map asks for factors, and what it seeks of a payload.

    `fit` is from and to [s] after the start, where nothing else touches the robot, or a sensor says what does. Coulomb
    friction sets in at the rate.

    Returns:
        Known forces, whose record's robot has corrected links and carries what was sought; joint -> deviation of the
        factor of its effort, of those that are told; joint -> why its factor is not, of the others.

    Raises:
        MapError: the record does not show the payload.
    """
    record, robot, values = forces.record, forces.record.robot, forces.values
    section, sought, ignored = record.map.joints.friction, record.map.sought_payload, ignored_rows(record)
    joints = tuple(joint for joint in record.driven if joint not in ignored)
    rows, n = [robot.v_index(joint) for joint in joints], len(joints)
    frame = mass = None
    if sought is not None:
        frame, mass = sought.frame, sought.mass
        rows += [row for row in AllBut(*ignored).kept(robot.model) if row not in rows]
    inside, outside = regression(forces, rows, fit, rate, frame)
    if not inside.samples:
        raise MapError(f"map: fit = {list(fit)}: no used part of the record is there in which a low-pass settles")
    precision = _precision(values, joints, len(rows), inside.errors)
    identified, deviations, untold = np.ones(n, bool), dict[str, float](), dict[str, str]()
    scaled = section is not None and section.scale
    if scaled:
        precision[range(n), range(n)] = 1.0 / FACTOR_ERROR**2
        x, covariance = inside.solve(precision, mass, robot.mass)
        unsure = np.sqrt(np.diag(covariance)[:n]) / x[:n] ** 2
        identified = unsure < UNSURE_FACTOR
        precision[range(n), range(n)] = np.where(identified, 0.0, 1.0 / FACTOR_ERROR**2)
    x, covariance = inside.solve(precision, mass, robot.mass, learn=scaled)
    if scaled:
        scale, at = np.where(identified, 1.0 / x[:n], 1.0), [*range(n), *range(len(rows), len(rows) + inside.errors)]
        values = replace(values, joints=joints, scale=scale)
        if not fits_to_sensor(record.map):  # whose own errors the links would take up
            links = np.einsum("kij,kj->ki", link_errors(robot.stated_model), x[at[n:]].reshape(-1, 10))
            turn = np.append(scale, np.ones(inside.errors))
            spread = covariance[np.ix_(at, at)] * np.outer(turn, turn)
            values, robot = replace(values, links=links, gain_covariance=spread), robot.with_links(links)
        exact = np.sqrt(np.diag(covariance)[:n]) * scale**2
        deviations = {joint: float(exact[k]) for k, joint in enumerate(joints) if identified[k]}
        units = ["N" if robot.slides(joint) else "N m" for joint in joints]
        untold = {
            joint: f"factor of {joint} cannot be told, it stays 1: its deviation would be {unsure[k]:.3g}, "
            f"{UNSURE_FACTOR:g} was expected; the motion needs {inside.needed(k):.2g} {units[k]} rms of it"
            for k, joint in enumerate(joints)
            if not identified[k]
        }
    if sought is not None:
        loaded, fitted = _payload(sought, inside, outside, x, covariance[-10:-6, -10:-6])
        values, robot = replace(values, fits=(*values.fits, fitted)), robot.carrying(loaded)
    return replace(forces, record=replace(record, robot=robot), values=values), deviations, untold


def _precision(values: FittedValues, joints: Sequence[str], rows: int, errors: int) -> Array:
    """Return the inverse covariance of factors of rows, first those of joints, and of errors of links."""
    precision = np.diag([1.0 / CERTAIN**2] * rows + [1.0] * errors)
    if len(values.gain_covariance):
        chosen = [joint for joint in joints if joint in values.joints]
        links = range(len(values.joints), len(values.gain_covariance))
        source = [*map(values.joints.index, chosen), *links]
        target = [*map(joints.index, chosen), *range(rows, rows + errors)]
        known = np.linalg.pinv(values.gain_covariance[np.ix_(source, source)], rcond=1e-14, hermitian=True)
        precision[np.ix_(target, target)] = known
    return precision


def _payload(
    sought: PayloadSection, inside: Regression, outside: Regression, x: Array, covariance: Array
) -> tuple[PayloadSection, Fit]:
    """Return a payload that was sought as a known one, and how well it explains the rows. Raises MapError if unseen."""
    mass, moments, placement = x[-10], x[-9:-6], inside.payload
    assert placement is not None
    back = placement.rotation.T
    centre = back @ (moments / mass - placement.translation)
    slopes = np.zeros((4, 4))  # of mass and centre with respect to mass and moments
    slopes[0, 0] = 1.0
    slopes[1:] = back @ np.column_stack([-moments / mass**2, np.eye(3) / mass])
    deviation = np.sqrt(np.diag(slopes @ covariance @ slopes.T))
    if mass < UNSEEN * deviation[0]:
        raise MapError(
            f"map: payload: the record does not show one at {sought.frame}: {mass:.3g} kg with a deviation of "
            f"{deviation[0]:.2g} kg{': is the robot lighter there than its file says?' if mass < 0.0 else ''}"
        )
    without = x.copy()
    without[-10:] = 0.0
    names = ("mass", "x", "y", "z")
    values = dict(zip(names, (float(mass), *centre.tolist()), strict=True))
    values |= {f"deviation of {name}": float(error) for name, error in zip(names, deviation, strict=True)}
    known = sought.model_copy(update={"mass": float(mass), "com": tuple(centre.tolist())})
    rms = outside.rms(without), inside.rms(x), outside.rms(x)
    return known, Fit(f"payload at {sought.frame}", values, "N, N m", *rms)


@dataclass(frozen=True)
class _Rows:
    """Samples of some rows of the equations of motion, (m, n) each."""

    q: Array  # angles of the joints; 0 for rows of the base
    v: Array  # rates
    a: Array  # accelerations
    needed: Array  # generalised force that the motion needs
    given: Array  # that of known forces and of the sensor, without the efforts
    tau: Array  # efforts


def fit_joint_friction(forces: KnownForces) -> KnownForces:
    """Fit friction, and gains if the map asks for them, where it says that no unknown force acts, or a known one.

    Raises:
        MapError: efforts or the stretch of the fit are missing, or too short.
    """
    record = forces.record
    section = record.map.joints.friction
    assert section is not None
    if "joints.effort" not in record.channels:
        raise MapError("map: joints.friction needs joints.effort")
    ignored = ignored_rows(record)
    joints = tuple(joint for joint in record.driven if joint not in ignored)
    if section.fit is None:
        raise MapError(
            "map: joints.friction.fit: from and to [s], where nothing touches the robot, was expected; or "
            "--calibration FILE, which `aerobat calibrate` writes from another recording"
        )
    rows = [record.robot.v_index(joint) for joint in joints]
    inside, outside = _fitted_samples(record, forces, rows, section.fit)
    rate, plain = _coulomb_rate(section, inside, _share_taken(record)), outside
    forces = replace(forces, values=replace(forces.values, joints=joints, scale=np.ones(len(joints))))
    deviations, untold = dict[str, float](), dict[str, str]()
    if section.scale or record.map.sought_payload is not None:
        forces, deviations, untold = fit_gains(forces, section.fit, rate)
        inside, outside = _fitted_samples(forces.record, forces, rows, section.fit)
        plain = plain if section.scale else outside  # what a payload explains is no friction
    try:
        residual = inside.needed - inside.given - inside.tau
        friction = fit_friction(inside.q, inside.v, _rotor(section, inside), residual, rate, _share_taken(record))
    except ObserverError as error:
        raise MapError(f"map: joints.friction.fit = {list(section.fit)}: {error}") from error
    residuals = [
        part.needed - part.given - part.tau - friction.torque(part.v, _rotor(section, part))
        for part in (inside, outside)
    ]
    fits, reach = list[Fit](), max(1, round(SMOOTHING * record.rate))  # samples that accelerations tie together
    for k, joint in enumerate(joints):
        before = rms_or_nan((plain.needed - plain.given - plain.tau)[:, k])
        coefficients = {name: float(getattr(friction, name)[k]) for name in FRICTION_COEFFICIENTS} | {"rate": rate}
        if section.scale:
            coefficients |= {"effort times": float(forces.values.scale[k])}
        if joint in deviations:
            coefficients |= {"deviation of the factor": deviations[joint]}
        unit = "N" if record.robot.slides(joint) else "N m"
        within, beyond = (rms_or_nan(residual[:, k]) for residual in residuals)
        changes = residuals[1][reach:, k] - residuals[1][:-reach, k]
        coefficients |= {"noise": rms_or_nan(changes) / 2**0.5} if len(changes) else {}
        words = untold.get(joint, "")
        fits.append(Fit(f"friction of {joint}", coefficients, unit, before, within, beyond, untold=words))
    values = replace(forces.values, friction=friction, fits=(*forces.values.fits, *fits))
    return replace(forces, values=values)


def fit_mass(record: Record, forces: KnownForces, stretch: tuple[float, float]) -> Fit:
    """Fit the factor of all masses and inertias over all believed rows, by known forces without friction.

    No unknown force acts in the stretch, from and to [s] after the start.

    Raises:
        MapError: the record does not show the mass, or something pushes there.
    """
    section, robot = record.map.joints.friction, record.robot
    if section is not None and section.scale and section.to is None:
        raise MapError(
            "calibrate: the mass, and factors of all efforts (joints.friction.scale = true), cannot be told apart: one "
            "of them was expected"
        )
    fitted = [name for name, known in record.map.known.items() if known.fit is not None]
    if fitted:
        raise MapError(f"calibrate: known.{fitted[0]}.fit takes the mass as given: its coefficients were expected")
    rows = AllBut(*ignored_rows(record)).kept(robot.model)
    joint_rows = {robot.v_index(joint) for joint in record.joints}
    inside, outside = _fitted_samples(record, forces, rows, stretch)
    along, power, lines, share = 0.0, 0.0, [], _share_taken(record)
    for k, row in enumerate(rows):
        needed, given, tau = twice_low_passed(
            np.stack([inside.needed, inside.given, inside.tau], axis=2)[:, k], share
        ).T
        target = tau + given - needed
        if section is not None and row in joint_rows:
            columns = twice_low_passed(
                friction_columns(section.law, inside.v[:, k], inside.a[:, k], SMOOTH_RATE), share
            )
            columns = np.column_stack([columns, tau]) if section.scale else columns
            explained = np.linalg.lstsq(columns, np.column_stack([needed, target]), rcond=None)[0]
            needed, target = (np.column_stack([needed, target]) - columns @ explained).T
        square = float(needed @ needed)
        if square <= 1e-12 * float(inside.needed[:, k] @ inside.needed[:, k]) or square == 0.0:
            continue
        residual = target - needed * float(needed @ target) / square
        variance = max(float(residual @ residual), 1e-12 * square) / len(target)
        along, power = along + float(needed @ target) / variance, power + square / variance
        lines.append(k)
    change, deviation = (along / power, (repeats(share) / power) ** 0.5) if power else (0.0, np.inf)
    if deviation > UNSURE_MASS:
        raise MapError(
            f"calibrate: the record does not show the mass (standard deviation {deviation:.2g}, {UNSURE_MASS:g} was "
            "expected): move joints that carry weight, or leave --identify mass out"
        )
    if change <= -1.0:
        raise MapError(
            f"calibrate: the record wants {1.0 + change:.2f} times the mass: something pushes on the robot from "
            f"{stretch[0]:g} to {stretch[1]:g} s, or its efforts are wrong; a stretch in which nothing touches it was "
            "expected"
        )
    before, inside_rms, outside_rms = (
        rms_or_nan(np.ravel((part.tau + part.given - factor * part.needed)[:, lines]))
        for part, factor in ((outside, 1.0), (inside, 1.0 + change), (outside, 1.0 + change))
    )
    return Fit("mass", {"times": 1.0 + change, "deviation": deviation}, "N, N m", before, inside_rms, outside_rms)


def _share_taken(record: Record) -> float:
    """Return the share of a new interval in the low-passes behind which rows are regressed."""
    return float(-np.expm1(-regression_gain(record) * record.dt))


def _coulomb_rate(section: FrictionSection, rows: _Rows, share: float) -> float:
    """Return the rate at which Coulomb friction sets in: the one whose fit predicts what it did not see best.

    Where friction sets in too early, noise of the rate makes it a coin; too late, and a viscous part stands in for it,
    which is too large at other speeds. The stretch is cut into parts; each is predicted by the fit to the others.
    """
    needed = rows.needed - rows.given
    errors = np.zeros((len(COULOMB_RATES), needed.shape[1]))
    for (i, rate), k in product(enumerate(COULOMB_RATES), range(needed.shape[1])):
        target = [needed[:, k], rows.tau[:, k]] if section.scale else [needed[:, k] - rows.tau[:, k]]
        table = np.column_stack([friction_columns(section.law, rows.v[:, k], rows.a[:, k], rate), *target])
        squares = np.stack([part.T @ part for part in np.array_split(twice_low_passed(table, share), FOLDS)])
        for fold in squares:
            others = squares.sum(axis=0) - fold
            coefficients = np.append(np.linalg.lstsq(others[:-1, :-1], others[:-1, -1], rcond=None)[0], -1.0)
            errors[i, k] += coefficients @ fold @ coefficients
    size = np.mean(0.5 * np.log(np.maximum(errors, np.finfo(float).tiny)), axis=1)
    usual = COULOMB_RATES.index(SMOOTH_RATE)
    best = int(np.argmin(size))
    return COULOMB_RATES[best if size[best] < size[usual] - LEAST_DROP else usual]


def _rotor(section: FrictionSection, rows: _Rows) -> Array:
    """Return the accelerations (m, n) that the law knows: zero if it has no inertia of the rotors."""
    return rows.a if section.law.endswith("inertia") else np.zeros_like(rows.a)


def _fitted_samples(
    record: Record, forces: KnownForces, rows: Sequence[int], fit: tuple[float, float]
) -> tuple[_Rows, _Rows]:
    """Return the samples of rows of the velocity for a fit, and those that test it."""
    inside: list[Array] = []
    held_out: list[Array] = []
    places = {record.robot.v_index(joint): record.robot.q_index(joint) for joint in record.joints}
    for block, fitted, tested in fitted_blocks(record, fit):
        a = accelerations(block, record)
        q = np.zeros_like(block.tau)
        q[:, list(places)] = 0.5 * (block.q[1:] + block.q[:-1])[:, list(places.values())]
        v = 0.5 * (block.v[1:] + block.v[:-1])
        needed, given = required_torque(record, block, a), explained(record, forces, block)
        table = np.stack([q, v, a, needed, given, forces.torque(block)])[:, :, list(rows)]
        inside.append(table[:, fitted])
        held_out.append(table[:, tested])
    if not sum(part.shape[1] for part in inside):
        raise MapError(f"map: joints.friction.fit = {list(fit)}: no used part of the record is there")
    return _Rows(*np.concatenate(inside, axis=1)), _Rows(*np.concatenate(held_out, axis=1))
