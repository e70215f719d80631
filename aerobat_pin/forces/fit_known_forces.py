"""Fit the known forces of a recording where its map asks for it: thrusts, friction, factors of efforts, a payload."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from aerobat_pin.errors import MapError
from aerobat_pin.forces.fit_gains import fit_gains
from aerobat_pin.forces.fit_joint_friction import fit_joint_friction
from aerobat_pin.forces.fit_thrusts import fit_thrusts
from aerobat_pin.forces.inverse_dynamics import mean_in
from aerobat_pin.forces.known_forces import FittedValues, KnownForces
from aerobat_pin.records import PayloadSection, Record


def fitted_forces(record: Record, learnt: FittedValues | None = None) -> KnownForces:
    """Fit what the map asks for, and return all known forces of the record, whose robot then carries what was found.

    Args:
        record: the record.
        learnt: friction, factors of efforts and the mass, if they are known; the map then fits no friction.

    Raises:
        MapError: a fit lacks what it is fitted to.
    """
    forces = given_forces(record)
    coefficients, fits = fit_thrusts(forces)
    values = replace(learnt or FittedValues(), coefficients=forces.values.coefficients | coefficients, fits=fits)
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
