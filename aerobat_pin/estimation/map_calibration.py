"""What one recording shows about a robot, for other recordings by the same map: friction, efforts, thrust, mass.

`aerobat calibrate LOG --map map.toml` fits what the map's own keys name (`joints.friction`, `known.NAME.fit`), by the
code that `aerobat estimate` runs, but takes the whole recording as one without unknown forces, or with those that
`joints.friction.to` names. `aerobat estimate OTHER --map map.toml --calibration FILE` then uses the values.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from aerobat_pin.errors import CalibrationError, MapError
from aerobat_pin.estimation.checks import effort_findings, fit_findings, motion_findings, sample_findings
from aerobat_pin.estimation.findings import Finding, refuse_if_certain
from aerobat_pin.estimation.fit_joint_friction import fit_mass
from aerobat_pin.estimation.fit_known_forces import fitted_forces, given_forces
from aerobat_pin.estimation.known_forces import FittedValues, KnownForces
from aerobat_pin.estimation.run_observers import inputs_between, observers_of, rms_in, run_observers
from aerobat_pin.estimation.sensor_scores import compared
from aerobat_pin.numerics import guarded
from aerobat_pin.observers import FRICTION_COEFFICIENTS
from aerobat_pin.records import KnownSection, Map, PlainRobot, Record, factor_of, open_record

FITTED_SHARE = 0.75  # of the recording, if the map does not say where to fit; the rest tests the fit
MASS_NAME = "mass"  # what --identify takes of the recordings of any robot


@dataclass(frozen=True)
class MapCalibration:
    """What was learnt from one recording.

    Attributes:
        robot: title of the robot.
        fingerprint: a number made of all values of the robot that the map gave.
        torque_per_unit: joint -> torque per unit of its effort's column, as the map had it.
        laws: name of a thrust -> what its coefficients multiply, in words.
        values: coefficients, friction, factors of efforts and the mass.
        error_bar: component -> rms error without and with the values [N, N m], where they were not fitted.
        log: name of the recording.
        notes: what was found, in words.
    """

    robot: str
    fingerprint: str
    torque_per_unit: Mapping[str, float]
    laws: Mapping[str, str]
    values: FittedValues
    error_bar: Mapping[str, tuple[float, float]]
    log: str
    notes: tuple[str, ...] = ()

    def refuse_other(self, chosen: Map, robot: PlainRobot, joints: Sequence[str]) -> None:
        """Raise CalibrationError if the values do not mean the same with this map, robot and joints with channels."""
        name = f"the calibration from {self.log}"
        if robot.fingerprint() != self.fingerprint:
            same = " with other values" if robot.title == self.robot else f", not to {robot.title}"
            raise CalibrationError(f"{name} belongs to the robot {self.robot}{same}: calibrate this one again")
        lost = [joint for joint in self.values.joints if joint not in joints]
        if lost:
            raise CalibrationError(f"{name} has friction of {lost[0]}, which has no channel in this map")
        own = efforts_of(chosen, self.values.joints)
        for joint, torque in own.items():
            if torque != self.torque_per_unit[joint]:
                raise CalibrationError(
                    f"{name} was learnt with {self.torque_per_unit[joint]:g} N m per unit of the effort of {joint}: "
                    f"not {torque:g}"
                )
        for key, law in self.laws.items():
            found = law_of(chosen.known[key]) if key in chosen.known else "nothing of that name"
            if found != law:
                raise CalibrationError(f"{name} was learnt with known.{key} = {law}: not {found}")

    def applied(self, record: Record) -> Record:
        """Return a record with the learnt mass, whose map has the learnt coefficients of thrust and fits no friction.

        Raises:
            CalibrationError: the calibration belongs to another robot, or to a map that means something else.
        """
        self.refuse_other(record.map, record.robot, record.joints)
        known = dict(record.map.known)
        for name, found in self.values.coefficients.items():
            known[name] = known[name].model_copy(update={"coefficients": tuple(found.tolist()), "fit": None})
        joints = record.map.joints
        if self.values.friction is not None:
            joints = joints.model_copy(update={"friction": None})
        chosen = record.map.model_copy(update={"known": known, "joints": joints})
        return replace(record, map=chosen, robot=record.robot.heavier(self.values.mass))

    def forces(self, record: Record) -> KnownForces:
        """Return the known forces of a record that `applied` returned: what the map still fits, and what was learnt."""
        forces = fitted_forces(record)
        own, fits = forces.values, tuple(replace(fit, log=fit.log or self.log) for fit in self.values.fits)
        if self.values.friction is not None:
            own = replace(own, joints=self.values.joints, friction=self.values.friction, scale=self.values.scale)
        return replace(forces, values=replace(own, mass=self.values.mass, fits=(*fits, *own.fits)))

    def finding(self) -> Finding:
        """Return what a report says about the calibration."""
        return Finding("calibration", "note", f"learnt from {self.log}; {_bar_words(self.error_bar)}")


@guarded()
def calibrate_recording(
    log: Path, chosen: Map, folder: Path, identify: Sequence[str] = (), trust: bool = False
) -> MapCalibration:
    """Learn from a recording without unknown forces what its map asks for.

    Args:
        log: a table, a NetCDF file, an MCAP file, or the folder of a bag.
        chosen: the map. `joints.friction.fit` and `known.NAME.fit` say what is fitted; without a stretch, friction is
            fitted on the first three quarters.
        folder: where relative paths of the map begin.
        identify: `mass` for a factor of all masses and inertias.
        trust: calibrate also what the checks would refuse; the findings stay among the notes.

    Raises:
        LogError, MapError: log and map do not fit together, a check is certain that the map is wrong, or the map asks
            for nothing.
    """
    wrong = [name for name in identify if name != MASS_NAME]
    if wrong:
        raise MapError(
            f"calibrate: --identify {wrong[0]}: of recordings by a map `mass` can be identified; friction, factors of "
            "efforts and thrust are keys of the map: joints.friction, known.NAME.fit"
        )
    asked = chosen.joints.friction is not None or any(known.fit is not None for known in chosen.known.values())
    if not (asked or identify):
        raise MapError("calibrate: nothing to learn: joints.friction or known.NAME.fit in the map, or --identify mass")
    record = open_record(log, chosen, folder)
    end = record.parts[-1][1] * record.dt
    record = replace(record, map=_all_free(record.map, end))
    findings = [*sample_findings(record), *motion_findings(record)]
    if not trust:
        refuse_if_certain(str(log), findings)
    friction, fingerprint = record.map.joints.friction, record.robot.fingerprint()
    fit = (0.0, FITTED_SHARE * end) if friction is None or friction.fit is None else friction.fit
    values, plain = FittedValues(), given_forces(record) if not _fits_thrust(chosen) else None
    if identify:
        found = fit_mass(record, given_forces(record), fit)
        values = FittedValues(mass=found.values["times"], fits=(found,))
        record = replace(record, robot=record.robot.heavier(values.mass))
    forces = fitted_forces(record)
    forces = replace(forces, values=replace(forces.values, mass=values.mass, fits=(*values.fits, *forces.values.fits)))
    findings += [*effort_findings(record, inputs_between(record, forces), findings), *fit_findings(forces)]
    bar = _error_bar(record, forces, plain, (fit[1], end) if fit[1] < end else (0.0, end))
    values, to_sensor = forces.values, friction is not None and friction.to is not None
    values = _without_offset(values) if to_sensor else values
    unseen = _unseen_friction(values, inertia=friction is not None and friction.law.endswith("inertia"))
    notes = [
        f"{record.robot.title}, {record.robot.mass:.4g} kg; {record.duration:.4g} s of {log.name}",
        *record.notes,
        *(f"!! {finding}" for finding in findings if finding.warns),
        *(f"fit: {one}" for one in values.fits),
        *(["offsets against a sensor are this recording's own: not kept"] if to_sensor else []),
        *([f"not seen in this recording, taken as zero: {', '.join(unseen)}"] if unseen else []),
        _bar_words(bar),
    ]
    laws = {name: law_of(known) for name, known in chosen.known.items() if known.fit is not None}
    return MapCalibration(
        robot=record.robot.title,
        fingerprint=fingerprint,
        torque_per_unit=efforts_of(chosen, values.joints),
        laws=laws,
        values=replace(values, coefficients={name: values.coefficients[name] for name in laws}),
        error_bar=bar,
        log=log.name,
        notes=tuple(notes),
    )


def _without_offset(values: FittedValues) -> FittedValues:
    """Return values for other recordings: the offset against a sensor is also its tare, and friction at rest."""
    assert values.friction is not None
    fits = [replace(one, values=one.values | dict.fromkeys(one.values.keys() & {"offset"}, 0.0)) for one in values.fits]
    return replace(values, friction=replace(values.friction, offset=np.zeros(len(values.joints))), fits=tuple(fits))


def _unseen_friction(values: FittedValues, *, inertia: bool) -> list[str]:
    """Return which coefficients that were sought the recording does not show, such as `coulomb of knee`."""
    if values.friction is None or values.friction.deviation is None:
        return []
    return [
        f"{FRICTION_COEFFICIENTS[k]} of {values.joints[joint]}"
        for joint, k in np.argwhere(np.isinf(values.friction.deviation))
        if inertia or FRICTION_COEFFICIENTS[k] != "inertia"
    ]


def efforts_of(chosen: Map, joints: Sequence[str]) -> dict[str, float]:
    """Return joint -> torque [N m] per unit of its effort's column."""
    section = chosen.joints.effort
    factor = 1.0 if section is None else factor_of("joints.effort", section.unit, "torque")
    return {joint: 1.0 if section is None else factor * section.torque_of(joint) for joint in joints}


def law_of(known: KnownSection) -> str:
    """Return what the coefficients of a thrust multiply, in words."""
    supply = ""
    if known.supply is not None:
        supply = f", {'divided by' if known.supply.divide else 'times'} its supply"
    where = f"along {list(known.direction)} of {known.frame or 'the base'} in {known.axes} axes"
    return f"{known.law} of commands over {known.full_scale:g}{supply}, {where}"


def _fits_thrust(chosen: Map) -> bool:
    return any(known.fit is not None for known in chosen.known.values())


def _all_free(chosen: Map, end: float) -> Map:
    """Return a map by which nothing unknown acts in the whole recording, and friction is fitted somewhere."""
    friction = chosen.joints.friction
    if friction is not None and friction.fit is None:
        friction = friction.model_copy(update={"fit": (0.0, FITTED_SHARE * end)})
    free = chosen.use.free if friction is not None and friction.to is not None else (0.0, end)
    return chosen.model_copy(
        update={
            "joints": chosen.joints.model_copy(update={"friction": friction}),
            "use": chosen.use.model_copy(update={"free": free}),
        }
    )


def _error_bar(
    record: Record, forces: KnownForces, plain: KnownForces | None, where: tuple[float, float]
) -> dict[str, tuple[float, float]]:
    """Return component -> rms error without and with the fits, against the sensor if the fit knows its force.

    Args:
        record: the record.
        forces: known forces with the fits.
        plain: those without; None if there is no estimate without fits.
        where: from and to [s] after the start.
    """
    friction = record.map.joints.friction
    sizes: list[dict[str, float]] = []
    for known in (plain, forces):
        if known is None:
            continue
        estimate = next(iter(run_observers(known.record, known, observers_of(known.record)[0][:1]).values()))
        if friction is not None and friction.to is not None:
            side = compared(record, estimate)
            assert side is not None  # the fit had the sensor
            sizes.append(
                {
                    f"{side.point}.{label}": score.rmse if score.rmse_outside_fit is None else score.rmse_outside_fit
                    for label, score in side.scores(record.dt).items()
                }
            )
        else:
            rms = rms_in(record, estimate, where)
            if rms is None:
                return {}
            sizes.append(dict(zip(estimate.head.identifiability.components, rms.tolist(), strict=True)))
    return {label: (sizes[0][label] if len(sizes) > 1 else np.nan, size) for label, size in sizes[-1].items()}


def _bar_words(bar: Mapping[str, tuple[float, float]]) -> str:
    """Return the error bar in words."""
    if not bar:
        return "no error bar: the recording is too short for one"
    parts = []
    for label, (before, after) in bar.items():
        unit = "N m" if ".M" in label else "N"
        parts.append(f"{label} {after:.3g} {unit}" + (f" (without {before:.3g})" if np.isfinite(before) else ""))
    return f"error bar, rms where nothing was fitted: {', '.join(parts)}"
