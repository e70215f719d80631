"""Fit the known forces of a recording where its map asks for it: thrust here, friction in `fit_joint_friction.py`.

The coefficients of a thrust are fitted by least squares to the mass times the accelerometer's component along its
direction, over a share of the used record; how well the rest is met is reported.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from aerobat_pin.errors import MapError
from aerobat_pin.estimation.fit_joint_friction import MOST_FITTED, fit_joint_friction, rms_or_nan
from aerobat_pin.estimation.inverse_dynamics import mean_in
from aerobat_pin.estimation.known_forces import Fit, FittedValues, KnownForces, command_sum, unit_direction
from aerobat_pin.numerics import Array
from aerobat_pin.records import KnownSection, Record


def fitted_forces(record: Record) -> KnownForces:
    """Fit what the map asks for, and return all known forces.

    Raises:
        MapError: a fit lacks what it is fitted to.
    """
    forces = given_forces(record)
    coefficients, fits = dict(forces.values.coefficients), []
    for name, section in record.map.known.items():
        if section.fit is not None:
            coefficients[name], fit = _fit_thrust(record, name, section)
            fits.append(fit)
    forces = replace(forces, values=FittedValues(coefficients, fits=tuple(fits)))
    if record.map.joints.friction is None:
        return forces
    friction = fit_joint_friction(record, forces)
    return replace(forces, values=replace(friction, coefficients=coefficients, fits=(*fits, *friction.fits)))


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
    found = np.linalg.lstsq(table[inside], target[inside], rcond=None)[0]
    left = target - table @ found
    rest = ~inside
    values = {f"of power {p}": float(c) for p, c in zip(section.powers, found, strict=True)}
    spread = target[rest] if rest.any() else target
    outside = rms_or_nan(left[rest]) if rest.any() else float("nan")
    return found, Fit(
        f"known.{name}",
        values,
        "N",
        rms_or_nan(spread - spread.mean()),
        rms_or_nan(left[inside]),
        outside,
    )
