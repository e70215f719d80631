"""Fit factors of efforts, or a payload, by regressing the efforts on what the motion needs.

    i = g (n(pi) + Y dpi + Y_L pi_L - given) + friction,      dpi ~ 10 % of each link's mass, 3 cm of its centre

with i the effort of a row as the map gives it, n what the motion needs, Y its regressor, `given` all known forces, pi_L
the payload's parameters and 1/g the factor of the effort. The reverse, n on i, makes factors too small by the noise of
the efforts. Errors of the links are fitted beside them and then left out: they widen the deviations.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from aerobat_pin.errors import MapError
from aerobat_pin.forces.gain_regression import Regression, fits_to_sensor, link_errors, regression
from aerobat_pin.forces.known_forces import Fit, FittedValues, KnownForces
from aerobat_pin.forces.run_observers import ignored_rows
from aerobat_pin.numerics import Array
from aerobat_pin.observers import SMOOTH_RATE, AllBut
from aerobat_pin.records import PayloadSection

FACTOR_ERROR = 0.2  # expected of each effort's factor, where a record tells nothing [-]
UNSURE_FACTOR = 0.1  # deviation of a factor from which a record does not tell it
UNSEEN = 3.0  # deviations: a lighter payload is not shown by the record
CERTAIN = 1e-3  # deviation of a factor that is known


@dataclass(frozen=True)
class Gains:
    """What `fit_gains` found.

    Attributes:
        forces: known forces with it; their record's robot has corrected links, and carries what was sought.
        deviations: joint -> deviation of the factor of its effort, of those that are told.
        untold: joint -> why its factor is not, of the others.
    """

    forces: KnownForces
    deviations: Mapping[str, float]
    untold: Mapping[str, str]


def fit_gains(forces: KnownForces, fit: tuple[float, float], rate: float = SMOOTH_RATE) -> Gains:
    """Fit factors of the efforts and errors of the links, if the map asks for factors, and what it seeks of a payload.

    Args:
        forces: known forces of a record, with what a calibration learnt.
        fit: from and to [s] after the start, where nothing else touches the robot, or a sensor says what does.
        rate: at which Coulomb friction sets in.

    Raises:
        MapError: the record does not show the payload.
    """
    record, robot, values = forces.record, forces.record.robot, forces.values
    section, payload, ignored = record.map.joints.friction, record.map.payload, ignored_rows(record)
    joints = tuple(joint for joint in record.driven if joint not in ignored)
    rows, n = [robot.v_index(joint) for joint in joints], len(joints)
    sought = payload if payload is not None and payload.com is None else None
    if sought is not None:
        rows += [row for row in AllBut(*ignored).kept(robot.model) if row not in rows]
    inside, outside = regression(forces, rows, fit, rate, None if sought is None else sought.frame)
    if not inside.samples:
        raise MapError(f"map: fit = {list(fit)}: no used part of the record is there in which a low-pass settles")
    precision, mass = _precision(values, joints, len(rows), inside.errors), None if sought is None else sought.mass
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
    return Gains(replace(forces, record=replace(record, robot=robot), values=values), deviations, untold)


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
