"""Fit friction, factors of efforts, and the mass where nothing touches the robot, or a force sensor says what does.

Of each joint's row  m n(q, v, a) = c tau + tau_f + known  everything but friction tau_f, the factor c of its effort and
the factor m of all masses is measured or computed (n: what the motion needs, Pinocchio's rnea). Factors come first
(`fit_gains.py`), then friction joint by joint. The mass is common to all believed rows: what friction can explain of a
row is taken out of it and of n first, and rows count by what is left over of each.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from aerobat_pin.errors import MapError, ObserverError
from aerobat_pin.forces.fit_gains import Gains, fit_gains
from aerobat_pin.forces.gain_regression import explained, fitted_blocks, friction_columns, rms_or_nan
from aerobat_pin.forces.inverse_dynamics import SMOOTHING, accelerations, required_torque
from aerobat_pin.forces.known_forces import Fit, KnownForces
from aerobat_pin.forces.run_observers import ignored_rows
from aerobat_pin.numerics import Array
from aerobat_pin.observers import FRICTION_COEFFICIENTS, SMOOTH_RATE, AllBut, fit_friction
from aerobat_pin.records import FrictionSection, Record

COULOMB_RATES = (0.01, SMOOTH_RATE, 0.05, 0.1, 0.2)  # [rad/s, m/s] from which one is chosen, see `_coulomb_rate`
FOLDS, LEAST_DROP = 4, 0.01  # parts of the stretch, each predicted from the others; [-] of the error, for another rate
UNSURE_MASS = 0.05  # standard deviation of the factor of the mass from which a record does not show it


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
    section, payload = record.map.joints.friction, record.map.payload
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
    rate, plain = _coulomb_rate(section, inside), outside
    forces = replace(forces, values=replace(forces.values, joints=joints, scale=np.ones(len(joints))))
    gains = Gains(forces, {}, {})
    if section.scale or (payload is not None and payload.com is None):
        gains = fit_gains(forces, section.fit, rate)
        forces = gains.forces
        inside, outside = _fitted_samples(forces.record, forces, rows, section.fit)
    try:
        residual = inside.needed - inside.given - inside.tau
        friction = fit_friction(inside.q, inside.v, _rotor(section, inside), residual, rate)
    except ObserverError as error:
        raise MapError(f"map: joints.friction.fit = {list(section.fit)}: {error}") from error
    residuals = [
        part.needed - part.given - part.tau - friction.torque(part.v, _rotor(section, part))
        for part in (inside, outside)
    ]
    fits = []
    for k, joint in enumerate(joints):
        before = rms_or_nan((plain.needed - plain.given - plain.tau)[:, k])
        coefficients = {name: float(getattr(friction, name)[k]) for name in FRICTION_COEFFICIENTS} | {"rate": rate}
        if section.scale:
            coefficients |= {"effort times": float(forces.values.scale[k])}
        if joint in gains.deviations:
            coefficients |= {"deviation of the factor": gains.deviations[joint]}
        unit = "N" if record.robot.slides(joint) else "N m"
        within, beyond = (rms_or_nan(residual[:, k]) for residual in residuals)
        words = gains.untold.get(joint, "")
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
    along, power, lines = 0.0, 0.0, []
    for k, row in enumerate(rows):
        needed, target = inside.needed[:, k], (inside.tau + inside.given - inside.needed)[:, k]
        if section is not None and row in joint_rows:
            columns = friction_columns(section.law, inside.v[:, k], inside.a[:, k], SMOOTH_RATE)
            columns = np.column_stack([columns, inside.tau[:, k]]) if section.scale else columns
            explained = np.linalg.lstsq(columns, np.column_stack([needed, target]), rcond=None)[0]
            needed, target = (np.column_stack([needed, target]) - columns @ explained).T
        square = float(needed @ needed)
        if square <= 1e-12 * float(inside.needed[:, k] @ inside.needed[:, k]) or square == 0.0:
            continue
        residual = target - needed * float(needed @ target) / square
        variance = max(float(residual @ residual), 1e-12 * square) / len(target)
        along, power = along + float(needed @ target) / variance, power + square / variance
        lines.append(k)
    repeats = max(1.0, SMOOTHING * record.rate)  # samples that the window of the accelerations ties together
    change, deviation = (along / power, (repeats / power) ** 0.5) if power else (0.0, np.inf)
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


def _coulomb_rate(section: FrictionSection, rows: _Rows) -> float:
    """Return the rate at which Coulomb friction sets in: the one whose fit predicts what it did not see best.

    Where friction sets in too early, noise of the rate makes it a coin; too late, and a viscous part stands in for it,
    which is too large at other speeds. The stretch is cut into parts; each is predicted by the fit to the others.
    """
    needed = rows.needed - rows.given
    errors = np.zeros((len(COULOMB_RATES), needed.shape[1]))
    for (i, rate), k in product(enumerate(COULOMB_RATES), range(needed.shape[1])):
        target = [needed[:, k], rows.tau[:, k]] if section.scale else [needed[:, k] - rows.tau[:, k]]
        table = np.column_stack([friction_columns(section.law, rows.v[:, k], rows.a[:, k], rate), *target])
        squares = np.stack([part.T @ part for part in np.array_split(table, FOLDS)])
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
