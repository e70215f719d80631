"""Fit the known forces of a recording where its map asks for it: thrusts, friction, factors of efforts, a payload.

Thrusts are fitted to the accelerometer, all of them together, as it shows no more than their sum:

    m a = sum_i d_i sum_k c_k U_i^p_k

in the base's axes, with the mass m, the accelerometer a, and of each thrust its direction d_i and its commands U_i.
Those that point one way by the same law share the coefficients c_k: where rotors hover they turn alike, and their sum
does not tell them apart. Forces of which the map says how large they are, are taken off before.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from aerobat_pin.errors import MapError
from aerobat_pin.forces.fit_joint_friction import fit_gains, fit_joint_friction
from aerobat_pin.forces.gain_regression import MOST_FITTED, rms_or_nan
from aerobat_pin.forces.inverse_dynamics import mean_in
from aerobat_pin.forces.known_forces import (
    CALIBRATION,
    FRICTION,
    Fit,
    FittedValues,
    KnownForces,
    command_sum,
    frame_wrench,
    unit_direction,
)
from aerobat_pin.numerics import Array
from aerobat_pin.records import KnownSection, PayloadSection, Record, body_turn

ONE_WAY = 0.7  # cosine of the angle between thrusts from which they count as rotors of one kind
FEWEST_SAMPLES = 10  # for each coefficient
TESTED_PIECES, CALM = 20, 0.25  # of the rest, and the share of them that nothing need push for the fit to be tested


def fitted_forces(record: Record, learnt: FittedValues | None = None) -> KnownForces:
    """Fit what the map asks for, and return all known forces of the record, whose robot then carries what was found.

    Where friction, factors of efforts and the mass were learnt, the map fits no friction. Raises MapError if a fit
    lacks what it is fitted to.
    """
    forces = given_forces(record)
    coefficients, fits = _fit_thrusts(forces)
    values = replace(learnt or FittedValues(), coefficients=forces.values.coefficients | coefficients, fits=fits)
    forces, payload = replace(forces, values=values), record.map.sought_payload
    if payload is not None:
        _refuse_the_untellable(record, payload)
    if record.map.joints.friction is not None:
        return fit_joint_friction(forces)
    if payload is None:
        return forces
    stretch = payload.fit or record.map.use.free
    if stretch is None:
        raise MapError("map: payload.fit: from and to [s], where nothing else touches the robot, was expected")
    return fit_gains(forces, stretch)[0]


def _refuse_the_untellable(record: Record, payload: PayloadSection) -> None:
    """Raise MapError if a payload that is sought looks like something else that is sought."""
    friction = record.map.joints.friction
    fitted = [name for name, section in record.map.known.items() if section.fit is not None]
    if payload.mass is None and friction is not None and friction.scale:
        raise MapError(
            "map: payload has no mass, and joints.friction.scale = true: a heavier payload and smaller factors look "
            "alike, only their ratio is seen; payload.mass was expected, or factors by --calibration FILE"
        )
    if friction is not None and friction.fit is not None and payload.fit not in (None, friction.fit):
        raise MapError(
            f"map: payload.fit = {list(payload.fit)}: the payload is sought with the friction, so that of "
            f"joints.friction, {list(friction.fit)}, or none was expected"
        )
    if fitted:
        raise MapError(
            f"map: known.{fitted[0]}.fit takes the mass as given, so the payload's mass and com were expected"
        )


def given_forces(record: Record) -> KnownForces:
    """Return the known forces without any fit.

    Raises MapError where a stretch without force has no sample, or a name is that of a force that is learnt.
    """
    known = record.map.known
    if taken := {CALIBRATION, FRICTION}.intersection(known):
        raise MapError(f"map: known.{taken.pop()}: another name was expected, this is that of a force that is learnt")
    coefficients = {name: np.array(section.coefficients, float) for name, section in known.items() if section.powers}
    tare = {
        name: mean_in(record, f"known.{name}", section.tare)
        for name, section in known.items()
        if not section.powers and section.tare is not None
    }
    return KnownForces(record, FittedValues(coefficients), tare)


def _fit_thrusts(given: KnownForces) -> tuple[dict[str, Array], tuple[Fit, ...]]:
    """Return thrust -> coefficients of its powers [N] where the map asks for a fit, and how well it holds along each.

    Raises:
        MapError: there is no accelerometer, too little of it, or thrusts are to be fitted in different parts.
    """
    record = given.record
    thrusts = {name: section for name, section in record.map.known.items() if section.fit is not None}
    if not thrusts:
        return {}, ()
    if "check.specific_force" not in record.channels:
        name = next(iter(thrusts))
        raise MapError(f"map: known.{name}.fit.to = check.specific_force, but check.specific_force has no columns")
    part = _common_part(thrusts)
    target, along, commands = _thrust_samples(given, thrusts)
    inside = np.zeros(len(target), bool)
    low, high = (round(share * len(target)) for share in part)
    inside[low:high] = True
    kinds = _kinds(thrusts, {name: directions.mean(axis=0) for name, directions in along.items()})
    columns = [
        sum((along[name] * commands[name][:, None] ** power for name in kind), np.zeros_like(target))
        for kind in kinds
        for power in thrusts[kind[0]].powers
    ]
    if inside.sum() < FEWEST_SAMPLES * len(columns):
        names = ", ".join(f"known.{name}" for name in thrusts)
        raise MapError(f"map: {names}: fit.part = {list(part)}: {inside.sum()} samples are too few")
    table = np.stack(columns, axis=2)
    solution = np.linalg.lstsq(table[inside].reshape(-1, len(columns)), target[inside].ravel(), rcond=None)[0]
    residual, counts = target - table @ solution, [len(thrusts[kind[0]].powers) for kind in kinds]
    shared = zip(kinds, np.split(solution, np.cumsum(counts)[:-1]), strict=True)
    coefficients, fits = {name: values for kind, values in shared for name in kind}, []
    for name, section in thrusts.items():
        shown, remainder = (np.sum(along[name] * force, axis=1) for force in (target, residual))
        spread = shown if inside.all() else shown[~inside]
        values = {f"of power {p}": float(c) for p, c in zip(section.powers, coefficients[name], strict=True)}
        before, within = map(rms_or_nan, (spread - spread.mean(), remainder[inside]))
        fits.append(Fit(f"known.{name}", values, "N", before, within, _calm_rms(remainder[~inside])))
    return {name: coefficients[name] for name in thrusts}, tuple(fits)


def _calm_rms(residual: Array) -> float:
    """Return the rms of a calm piece of what is left (m,): a push, which is sought, lasts for a part of it at most."""
    pieces = np.array_split(residual, min(TESTED_PIECES, max(len(residual), 1)))
    return float(np.quantile([rms_or_nan(piece) for piece in pieces], CALM))


def _common_part(thrusts: Mapping[str, KnownSection]) -> tuple[float, float]:
    """Return the share of the record in which all thrusts are fitted. Raises MapError if they differ."""
    parts = {name: section.fit.part for name, section in thrusts.items() if section.fit is not None}
    first, *others = parts
    for name in others:
        if parts[name] != parts[first]:
            raise MapError(
                f"map: known.{first}.fit.part = {list(parts[first])}, known.{name}.fit.part = {list(parts[name])}: the "
                "accelerometer shows the sum of all thrusts, so the same part was expected"
            )
    return parts[first]


def _thrust_samples(
    given: KnownForces, thrusts: Mapping[str, KnownSection]
) -> tuple[Array, dict[str, Array], dict[str, Array]]:
    """Return what thrusts should make (m, 3) [N], and of each its direction (m, 3) and commands (m,), in base axes."""
    record, targets = given.record, list[Array]()
    along: dict[str, list[Array]] = {name: [] for name in thrusts}
    commands: dict[str, list[Array]] = {name: [] for name in thrusts}
    for first, last in record.spread(MOST_FITTED):
        block = record.block(first, last)
        target = record.robot.mass * record.means("check.specific_force", block.time) @ body_turn(record.map).T
        for name, section in record.map.known.items():
            if name in thrusts:
                unit = np.zeros((len(block.tau), 6))
                unit[:, :3] = unit_direction(section)
                turned = frame_wrench(record, section, block, unit) if record.robot.free else unit
                along[name].append(turned[:, :3])
                commands[name].append(command_sum(record, name, block.time))
            elif record.robot.free:  # else its support carries it
                target = target - given.force_of(name, section, block)[:, :3]
        targets.append(target)
    directions, sums = ({name: np.concatenate(pieces) for name, pieces in table.items()} for table in (along, commands))
    return np.concatenate(targets), directions, sums


def _kinds(thrusts: Mapping[str, KnownSection], along: Mapping[str, Array]) -> list[list[str]]:
    """Return the names of thrusts that share their coefficients: the same powers, and they point one way."""
    kinds: list[list[str]] = []
    for name, section in thrusts.items():
        for kind in kinds:
            cosine = along[kind[0]] @ along[name] / (np.linalg.norm(along[kind[0]]) * np.linalg.norm(along[name]))
            if section.powers == thrusts[kind[0]].powers and cosine > ONE_WAY:
                kind.append(name)
                break
        else:
            kinds.append([name])
    return kinds
