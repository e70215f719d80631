"""Fit the known forces of a recording where its map asks for it: thrust here, friction in `fit_joint_friction.py`.

The coefficients of a thrust are fitted by least squares to the mass times the accelerometer's component along its
direction, over a share of the used record; how well the rest is met is reported.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from aerobat_pin.errors import MapError
from aerobat_pin.estimation.fit_gains import fit_gains
from aerobat_pin.estimation.fit_joint_friction import fit_joint_friction
from aerobat_pin.estimation.gain_regression import MOST_FITTED, rms_or_nan
from aerobat_pin.estimation.inverse_dynamics import mean_in
from aerobat_pin.estimation.known_forces import Fit, FittedValues, KnownForces, command_sum, unit_direction
from aerobat_pin.numerics import Array
from aerobat_pin.records import KnownSection, PayloadSection, Record


def fitted_forces(record: Record, learnt: FittedValues | None = None) -> KnownForces:
    """Fit what the map asks for, and return all known forces of the record, whose robot then carries what was found.

    Args:
        record: the record.
        learnt: friction, factors of efforts and the mass, if they are known; the map then fits no friction.

    Raises:
        MapError: a fit lacks what it is fitted to.
    """
    forces = given_forces(record)
    coefficients, fits = dict(forces.values.coefficients), list[Fit]()
    for name, section in record.map.known.items():
        if section.fit is not None:
            coefficients[name], fit = _fit_thrust(record, name, section)
            fits.append(fit)
    values = replace(learnt or FittedValues(), coefficients=coefficients, fits=tuple(fits))
    forces, payload = replace(forces, values=values), record.map.payload
    if payload is not None and payload.com is None:
        _refuse_the_untellable(record, payload)
    if record.map.joints.friction is not None:
        return fit_joint_friction(forces)
    if payload is None or payload.com is not None:
        return forces
    stretch = payload.fit or record.map.use.free
    if stretch is None:
        raise MapError("map: payload.fit: from and to [s], where nothing else touches the robot, was expected")
    return fit_gains(forces, stretch).forces


def _refuse_the_untellable(record: Record, payload: PayloadSection) -> None:
    """Raise MapError if a payload that is sought looks like something else that is sought."""
    friction = record.map.joints.friction
    fitted = [name for name, section in record.map.known.items() if section.fit is not None]
    if payload.mass is None and friction is not None and friction.scale:
        raise MapError(
            "map: payload has no mass, and joints.friction.scale = true: a heavier payload and smaller factors look "
            "alike, only their ratio is seen; payload.mass was expected, or factors by --calibration FILE"
        )
    if fitted:
        raise MapError(
            f"map: known.{fitted[0]}.fit takes the mass as given, so the payload's mass and com were expected"
        )


def given_forces(record: Record) -> KnownForces:
    """Return the known forces without any fit. Raises MapError where a stretch without force has no sample."""
    known = record.map.known
    coefficients = {name: np.array(section.coefficients, float) for name, section in known.items() if section.powers}
    tare = {
        name: mean_in(record, f"known.{name}", section.tare)
        for name, section in known.items()
        if not section.powers and section.tare is not None
    }
    return KnownForces(record, FittedValues(coefficients), tare)


def _fit_thrust(record: Record, name: str, section: KnownSection) -> tuple[Array, Fit]:
    """Fit a thrust's polynomial to mass times accelerometer."""
    if "check.specific_force" not in record.channels:
        raise MapError(f"map: known.{name}.fit.to = check.specific_force, but check.specific_force has no columns")
    assert section.fit is not None
    direction = unit_direction(section)
    commands, targets = [], []
    for first, last in record.spread(MOST_FITTED):
        time = record.times(first, last)
        commands.append(command_sum(record, name, time))
        targets.append(record.robot.mass * record.means("check.specific_force", time) @ direction)
    u, target = np.concatenate(commands), np.concatenate(targets)
    low, high = (round(share * len(u)) for share in section.fit.part)
    inside = np.zeros(len(u), bool)
    inside[low:high] = True
    if inside.sum() < 10 * len(section.powers):
        raise MapError(f"map: known.{name}.fit.part = {list(section.fit.part)}: {inside.sum()} samples are too few")
    table = np.stack([u**p for p in section.powers], axis=1)
    coefficients = np.linalg.lstsq(table[inside], target[inside], rcond=None)[0]
    residual = target - table @ coefficients
    held_out = ~inside
    values = {f"of power {p}": float(c) for p, c in zip(section.powers, coefficients, strict=True)}
    spread = target[held_out] if held_out.any() else target
    before, within, beyond = map(rms_or_nan, (spread - spread.mean(), residual[inside], residual[held_out]))
    return coefficients, Fit(f"known.{name}", values, "N", before, within, beyond)
