"""What a map's own keys ask a calibration to fit: friction, factors of efforts, thrust; and the mass of all bodies.

The code is that of `estimate` (`joints.friction`, `known.NAME.fit`), but the whole recording is taken as one without
unknown forces, or with those that `joints.friction.to` names.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from aerobat_pin.errors import MapError
from aerobat_pin.forces.fit_joint_friction import fit_mass
from aerobat_pin.forces.fit_known_forces import fitted_forces, given_forces
from aerobat_pin.forces.gain_regression import CENTRE_ERROR, MASS_ERROR, fits_to_sensor, in_stretch
from aerobat_pin.forces.known_forces import FRICTION_SHOWN, Fit, FittedValues, KnownForces, share_left
from aerobat_pin.forces.run_observers import ignored_rows
from aerobat_pin.numerics import Array
from aerobat_pin.observers import FRICTION_COEFFICIENTS
from aerobat_pin.records import FrictionSection, Map, Record

WITHOUT_ROTORS, WITH_ROTORS = "coulomb+viscous", "coulomb+viscous+inertia"  # laws that are tried where a map names none
FITTED = "the map names no friction of the joints; it was fitted, as the rest shows it (--identify none: without)"
NOT_FITTED = "friction of the joints is fitted to one recording, these are several: none was fitted"
FITTED_SHARE = 0.75  # of the recording, if the map does not say where to fit; the rest tests the fit


def fits_anything(chosen: Map) -> bool:
    """Return whether a map asks for a fit."""
    return chosen.sought_payload is not None or chosen.joints.friction is not None or fits_thrust(chosen)


def fits_thrust(chosen: Map) -> bool:
    """Return whether a map asks for the coefficients of a thrust."""
    return any(known.fit is not None for known in chosen.known.values())


def taken_as_free(record: Record) -> Record:
    """Return a record in which nothing unknown acts by its map, and friction is fitted somewhere."""
    chosen, friction = record.map, record.map.joints.friction
    if friction is not None:
        friction = friction.model_copy(update={"fit": fitted_stretch(record)})
    free = chosen.use.free if fits_to_sensor(chosen) else (0.0, _time_after(record, 1.0))
    joints, payload = chosen.joints.model_copy(update={"friction": friction}), chosen.payload
    if payload is not None and payload.fit is None:
        payload = payload.model_copy(update={"fit": fitted_stretch(record)})
    use = chosen.use.model_copy(update={"free": free})
    return replace(record, map=chosen.model_copy(update={"joints": joints, "payload": payload, "use": use}))


def with_friction(records: Sequence[Record], *, mass: bool) -> tuple[list[Record], list[str], list[str]]:
    """Return records whose map asks for friction where it names none and the record shows some, notes and warnings.

    That is one record in which nothing unknown acts, with measured efforts of joints whose rows are believed. A robot
    that knows parameters is asked for its friction by name.
    """
    first = records[0]
    effort, named = "joints.effort" in first.channels, first.map.joints.friction is not None
    if first.robot.parameters or named or not effort or not set(first.driven) - set(ignored_rows(first)):
        return [*records], [], []
    if len(records) > 1:
        return [*records], [], [NOT_FITTED]
    kept: tuple[Record, list[Fit]] | None = None
    for law in (WITHOUT_ROTORS, WITH_ROTORS):  # rotors may show without friction
        asking = _with_law(first, law, mass=mass)
        if asking is not None:
            less = [fit.before for fit in asking[1]] if kept is None else [fit.outside for fit in kept[1]]
            pairs = zip((fit.outside for fit in asking[1]), less, strict=True)
            kept = asking if share_left(pairs) < FRICTION_SHOWN else kept
    return ([first], [], []) if kept is None else ([kept[0]], [FITTED], [])


def _with_law(record: Record, law: str, *, mass: bool) -> tuple[Record, list[Fit]] | None:
    """Return a record whose map asks for friction of a law, and its fits; None where the record is too short to tell.

    Or where its other fits fail, as they did before.
    """
    friction = FrictionSection(law=law, fit=fitted_stretch(record))
    joints = record.map.joints.model_copy(update={"friction": friction})
    asking = replace(record, map=record.map.model_copy(update={"joints": joints}))
    try:
        fits = fitted_by_map(asking, mass=mass).values.fits
    except MapError:
        return None
    return asking, [fit for fit in fits if fit.name.startswith("friction")]


def fitted_stretch(record: Record) -> tuple[float, float]:
    """Return from where to where a record is fitted [s]: what the map says, or the first three quarters."""
    sections = record.map.joints.friction, record.map.sought_payload
    stated = (section.fit for section in sections if section is not None and section.fit is not None)
    return next(stated, (0.0, _time_after(record, FITTED_SHARE)))


def held_out_stretch(record: Record) -> tuple[float, float]:
    """Return from where to where a record tests the fits [s]; all of it if they left nothing."""
    fit, end = fitted_stretch(record), _time_after(record, 1.0)
    return (fit[1], end) if fit[1] < end else (0.0, end)


def used_by_fits(record: Record, values: FittedValues, time: Array) -> NDArray[np.bool_]:
    """Return which times (m,) [s] fits used that gave values, or are beyond where nothing unknown acts."""
    friction, when = record.map.joints.friction, time - record.start
    stretches = [] if friction is None or friction.fit is None else [friction.fit]
    stretches += [fitted_stretch(record)] if values.mass != 1.0 else []
    payload, free = record.map.sought_payload, record.map.use.free
    if payload is not None and friction is None:  # beside friction it is fitted with that
        stretches.append(payload.fit or free or (0.0, np.inf))
    shares = [known.fit.part for known in record.map.known.values() if known.fit is not None]
    stretches += [(_time_after(record, low), _time_after(record, high)) for low, high in shares]
    used = np.zeros(len(when), bool) if free is None or fits_to_sensor(record.map) else ~in_stretch(when, free)
    for stretch in stretches:
        used |= in_stretch(when, stretch)
    return used


def fitted_by_map(record: Record, *, mass: bool) -> KnownForces:
    """Return the known forces of a record with all that its map fits, and perhaps with the mass fitted before.

    Raises:
        MapError: a fit lacks what it is fitted to, or the record does not show the mass.
    """
    values = FittedValues()
    if mass:
        if record.map.payload is not None and record.map.payload.mass is None:
            raise MapError("calibrate: the mass of all bodies, and a payload without a mass: one of them was expected")
        fit = fit_mass(record, given_forces(record), fitted_stretch(record))
        values = FittedValues(mass=fit.values["times"], fits=(fit,))
        record = replace(record, robot=record.robot.heavier(values.mass))
    forces = fitted_forces(record)
    fits = (*values.fits, *forces.values.fits)
    return replace(forces, values=replace(forces.values, mass=values.mass, fits=fits))


def kept_of(record: Record, values: FittedValues) -> FittedValues:
    """Return the values that hold in other records: fitted coefficients, and no offset against a sensor.

    That offset is also the sensor's tare, and friction at rest. Of a joint that stood still nothing is
    kept: records in which it moves find its friction beside the forces.
    """
    fitted = [name for name, known in record.map.known.items() if known.fit is not None]
    values = _seen(replace(values, coefficients={name: values.coefficients[name] for name in fitted}))
    if not fits_to_sensor(record.map) or values.friction is None:
        return values
    fits = [replace(fit, values=fit.values | dict.fromkeys(fit.values.keys() & {"offset"}, 0.0)) for fit in values.fits]
    return replace(values, friction=replace(values.friction, offset=np.zeros(len(values.joints))), fits=tuple(fits))


def _seen(values: FittedValues) -> FittedValues:
    """Return values without joints of which no friction was seen; all of them where factors were sought."""
    law = values.friction
    if law is None or law.deviation is None or len(values.gain_covariance):
        return values
    kept = np.any(np.isfinite(law.deviation[:, :2]), axis=1)  # Coulomb or viscous
    if kept.all() or not kept.any():
        return values
    of_joints = {name: getattr(law, name)[kept] for name in (*FRICTION_COEFFICIENTS, "deviation")}
    joints = tuple(joint for joint, seen in zip(values.joints, kept, strict=True) if seen)
    return replace(values, joints=joints, scale=values.scale[kept], friction=replace(law, **of_joints))


def fit_notes(record: Record, values: FittedValues) -> Iterator[str]:
    """Yield what the fits found, what is not kept, and what the record does not show, in words."""
    yield from (f"fit: {fit}" for fit in values.fits)
    if fits_to_sensor(record.map):
        yield "offsets against a sensor are this recording's own: not kept"
    section = record.map.joints.friction
    if section is not None and section.scale and section.to is None and record.map.payload is None:
        yield (
            f"factors of the efforts and masses: only their ratio is seen; taken as masses within {MASS_ERROR:.0%} and "
            f"centres within {100.0 * CENTRE_ERROR:g} cm of what is believed. A known payload tells them apart"
        )


def unseen_notes(record: Record, values: FittedValues) -> Iterator[str]:
    """Yield what a record does not show of the friction that was fitted, in words."""
    friction, section = values.friction, record.map.joints.friction
    if friction is None or friction.deviation is None or section is None:
        return
    unseen = [
        f"{FRICTION_COEFFICIENTS[k]} of {values.joints[joint]}"
        for joint, k in np.argwhere(np.isinf(friction.deviation))
        if section.law.endswith("inertia") or FRICTION_COEFFICIENTS[k] != "inertia"
    ]
    if unseen:
        yield f"not seen in this recording: {', '.join(unseen)}; of joints that stood still nothing is kept"


def _time_after(record: Record, share: float) -> float:
    """Return the time after the start [s] by which a share of the samples used has passed."""
    remaining = share * sum(last - first for first, last in record.parts)
    for first, last in record.parts:
        if remaining <= last - first:
            break
        remaining -= last - first
    return record.after_start(first + remaining)
