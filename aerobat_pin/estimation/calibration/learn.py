"""Learn a calibration from records of any robot in which no unknown force acts.

What the map asks for comes first (friction, factors of efforts, thrust, the mass), as no other force is known without
it; then the parameters that the robot knows, after which the map's fits are done again; then what repeats itself with
the robot's phase, what is normal where nothing pushes, and the error bar.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from aerobat_pin.errors import CalibrationError
from aerobat_pin.estimation.calibration.calibration import (
    EFFORT,
    ENCODER,
    TORQUE,
    Belief,
    Calibration,
    belief_of,
    ranges_of,
)
from aerobat_pin.estimation.calibration.detection import Detection, learn_detection
from aerobat_pin.estimation.calibration.error_bar import bar_words, error_bar, noise_where_known, row_noise
from aerobat_pin.estimation.calibration.free_run import FreeRun, free_runs, pushed_points, pushes, unexpected
from aerobat_pin.estimation.calibration.identify import Identified, identify
from aerobat_pin.estimation.checks.efforts import efforts_and_friction
from aerobat_pin.estimation.checks.motion import record_findings
from aerobat_pin.estimation.checks.result import fit_findings
from aerobat_pin.estimation.findings import HARMLESS_CHECKS, Finding, refuse_if_certain
from aerobat_pin.forces import (
    CALIBRATION,
    FRICTION,
    FittedValues,
    KnownForces,
    LearntError,
    fit_learnt_error,
    fit_notes,
    fits_anything,
    fits_thrust,
    fits_to_sensor,
    fitted_by_map,
    given_forces,
    inputs_between,
    kept_of,
    mean_motion,
    taken_as_free,
    unseen_notes,
    with_friction,
)
from aerobat_pin.numerics import guarded, shown
from aerobat_pin.observers import JointFriction, fit_friction, force_size, typical_step
from aerobat_pin.records import Condition, Record

HARMONICS, MOST_HARMONICS = 12, 40
FEWEST_TURNS = 3.0  # that a series over the phase can be learnt from
MASS_NAME = "mass"  # what can be identified of a robot that knows no parameters


@guarded()
def calibrate(
    records: Sequence[Record],
    *,
    harmonics: int = HARMONICS,
    parameters: Sequence[str] | None = None,
    trust: bool = False,
    progress: Callable[[float], None] | None = None,
) -> Calibration:
    """Learn from records without unknown forces what the belief about them gets wrong.

    Args:
        records: records without unknown forces, all with one belief. What their map asks for is fitted
            (`joints.friction`, `known.NAME.fit`), where it leaves the stretch out on the first three quarters.
        harmonics: highest harmonic of the error that is left, of a robot that has a phase; -1 learns nothing of it.
        parameters: parameters to identify, and `friction`; of a robot that knows no parameters `mass`. They are used
            even if they do not explain the records. When omitted, the usual parameters are sought where the belief is
            not consistent, and used only if they explain the records. Where a map names no friction of its joints, that
            is fitted, too, if one recording shows it; an empty sequence seeks nothing.
        trust: calibrate also what the checks would refuse, and flights in which something pushes; the calibration
            then says so.
        progress: called with the share that is done.

    Raises:
        CalibrationError: there is no record, one is too short, beliefs differ, a name is unknown, or something pushes.
        LogError, MapError: a check is certain that a map is wrong, or a fit lacks something.
    """
    if not records:
        raise CalibrationError("calibrate: records = []: one without unknown forces was expected, or several")
    belief, *others = (belief_of(record.map, record.robot, record.joints) for record in records)
    for other in others:
        belief.refuse_other(other)
    titles = tuple(record.title for record in records)
    free = [(record.times(*record.parts[0]), record.channels) for record in records]
    extras = records[0].robot.learn_extras(free, records[0].map.robot.points)
    if extras is not None and parameters:
        names = ", ".join(extras.values)
        raise CalibrationError(f"calibrate: '{parameters[0]}' cannot be learnt from these records: only {names} can")
    if extras is not None:
        return Calibration(belief, titles, extras=extras.values, notes=extras.notes)

    mass = _check_names(records, belief, harmonics, parameters)
    records, notes, warnings = [taken_as_free(record) for record in records], list[str](), list[str]()
    if parameters is None or parameters:
        records, notes, warnings = with_friction(records, mass=mass)
    findings = _findings(records, trust=trust)
    plain = [None if fits_thrust(record.map) else given_forces(record) for record in records]
    forces = [fitted_by_map(record, mass=mass) for record in records]
    fitted, to_sensor = fits_anything(records[0].map), fits_to_sensor(records[0].map)
    runs = [] if to_sensor else _runs_of(forces)
    for run in runs:
        if run.condition is not None and run.condition.turns < FEWEST_TURNS:
            turned = f"{run.record.title}: {run.condition.turns:.1f} turns of {run.condition.cycle}"
            raise CalibrationError(f"{turned}: {FEWEST_TURNS:g} or more were expected")
    if runs:
        notes.append(f"as {'fitted' if fitted else 'believed'}: {_sizes(runs)} unexplained")

    identified = _identified(runs, parameters, progress)
    if identified is not None:
        notes += identified.describe()
    if identified is not None and identified.kept:
        records = [replace(record, robot=record.robot.changed(identified.used)) for record in records]
        forces = [fitted_by_map(record, mass=mass) for record in records]
        runs = _runs_of(forces) if fitted else [run.with_values(identified.used) for run in runs]

    tested = runs  # as `runs`, but with what is learnt from all of them learnt without the part that tests it
    if FRICTION in (parameters or ()):
        friction, tested_friction = (_fit_to_residual(runs, held_out=held_out) for held_out in (False, True))
        notes += _friction_lines(friction, records[0].robot.joints)
        tested = [_with_friction(run, tested_friction) for run in runs]
        runs = [_with_friction(run, friction) for run in runs]
        forces = [_knowing(known, friction) for known in forces]

    series = tested_series = None
    if harmonics >= 0 and runs and all(run.condition is not None for run in runs):
        series = _learnt_error(runs, harmonics, held_out=False)
        tested_series = _learnt_error(tested, harmonics, held_out=True)
        before, runs, tested = _sizes(runs), _without(runs, series), _without(tested, tested_series)
        first = conditions_of(runs)[0]
        share = f"{series.share:+.1%} of the known force {' and '.join(first.doubted)}; " if first.doubted else ""
        notes.append(
            f"{share}{series.order} harmonics of {first.cycle}, half of them linear and a quarter quadratic in "
            f"{', '.join(series.states)}: {before} becomes {_sizes(runs)}"
        )
        warnings += _unless_pushed([line for run in runs for line in pushes(run)], findings, trust=trust)
        warnings += [line for run in runs for line in unexpected(run)]
    for known in () if to_sensor else forces:
        pushed, untold = pushed_points(known)
        warnings += [*_unless_pushed(pushed, findings, trust=trust), *untold]

    values, learnt = kept_of(records[0], forces[0].values), tested is not runs or identified is not None
    bar = error_bar([(raw, replace(known, series=tested_series)) for raw, known in zip(plain, forces, strict=True)])
    for raw, known in zip(plain, forces, strict=True):  # friction that is fitted first takes up a reversed effort
        scale = known.values.scale  # a factor that is fitted is no wrong unit
        given = known if raw is None or (np.any(scale != 1.0) and np.all(scale > 0.0)) else raw
        findings += efforts_and_friction(given, known, inputs_between(known.record, known), findings)
        findings += fit_findings(known)
    notes.append(f"as calibrated: {_sizes(runs)} unexplained" if runs else "contacts: not learnt, as something pushed")
    return Calibration(
        belief=_belief_that_counts(belief, records[0], values),
        records=titles,
        identified=identified,
        fitted=values,
        series=series,
        detection=_detection(runs, series),
        error_bar=bar,
        ranges=ranges_of(records),
        row_noise=noise_where_known(forces[0]) if to_sensor else row_noise(tested, learnt=learnt),
        warnings=(*(str(finding) for finding in findings if finding.warns), *warnings),
        notes=(
            *(
                f"{record.robot.title}, {record.robot.mass:.4g} kg; {record.duration:.4g} s of {record.title}"
                for record in (known.record for known in forces)
            ),
            *(line for record in records for line in record.notes),
            *fit_notes(records[0], values),
            *unseen_notes(records[0], forces[0].values),
            *notes,
            bar_words(bar),
        ),
    )


def _belief_that_counts(belief: Belief, record: Record, values: FittedValues) -> Belief:
    """Return a belief without what a map says of joints and thrusts from which nothing was learnt."""
    kept = {*record.robot.assumptions, *(f"known.{name}" for name in values.coefficients)}
    kept |= {f"{what}{joint}" for joint in values.joints for what in (EFFORT, ENCODER)}
    return replace(belief, settings={key: value for key, value in belief.settings.items() if key in kept})


def _check_names(records: Sequence[Record], belief: Belief, harmonics: int, parameters: Sequence[str] | None) -> bool:
    """Check what was asked for; return whether the mass is a fit by the map."""
    if not -1 <= harmonics <= MOST_HARMONICS:
        raise CalibrationError(f"calibrate: harmonics = {shown(harmonics)}: from -1 to {MOST_HARMONICS} was expected")
    names, robot = parameters or (), records[0].robot
    friction = [FRICTION] if robot.joints else []
    known = [*robot.parameters, *friction] if robot.parameters else [MASS_NAME]
    for name in names:
        if name not in known:
            keys = "" if robot.parameters else "; joints.friction and known.NAME.fit are keys of the map"
            raise CalibrationError(
                f"calibrate: parameters has '{name}': of {', '.join(known)} some were expected{keys}"
            )
    if FRICTION in names and belief.settings.get(TORQUE, "measured") != "measured":
        raise CalibrationError("calibrate: friction is seen in measured joint torques only: torque = measured expected")
    mass = MASS_NAME in names and not robot.parameters
    if len(records) > 1 and (mass or fits_anything(records[0].map)):
        raise CalibrationError(
            f"calibrate: {len(records)} recordings: what a map or the mass asks for is fitted to one"
        )
    return mass


def _runs_of(forces: Sequence[KnownForces]) -> list[FreeRun]:
    return [run for known in forces for run in free_runs(known.record, known)]


def _findings(records: Sequence[Record], *, trust: bool) -> list[Finding]:
    """Return what the checks find in recordings. Raises LogError where one is certain that the map is wrong."""
    findings: list[Finding] = []
    for record in records:
        if record.log is not None:
            of_record = list(record_findings(record))
            if not trust:
                refuse_if_certain(str(record.log.path), of_record)
            findings += of_record
    return findings


def _identified(
    runs: Sequence[FreeRun], names: Sequence[str] | None, progress: Callable[[float], None] | None
) -> Identified | None:
    """Identify what was asked for; without names, the usual parameters if the belief is not consistent."""
    known = runs[0].record.robot.parameters if runs else {}
    if names is not None:
        sought = {name: known[name] for name in names if name in known}
        return identify(runs, sought, always=True, progress=progress) if sought else None
    usual = {name: parameter for name, parameter in known.items() if parameter.usual}
    if not usual or all(run.judged().verdict == "consistent" for run in runs):
        return None
    return identify(runs, usual, always=False, progress=progress)


def _fit_to_residual(runs: Sequence[FreeRun], *, held_out: bool) -> JointFriction:
    """Fit the friction of all joints to what is left of their rows, without the part held out or with it."""
    parts = []
    for run in runs:
        robot = run.record.robot
        at_q, at_v = ([index(joint) for joint in robot.joints] for index in (robot.q_index, robot.v_index))
        motion = mean_motion(run.record, run.inputs.time, run.inputs.v[:, at_v])
        values = (run.inputs.q[:-1, at_q], *motion, run.residual[:, at_v])
        parts.append(tuple(series[run.fitted if held_out else slice(None)] for series in values))
    q, v, a, torque = (np.concatenate(values) for values in zip(*parts, strict=True))
    return fit_friction(q, v, a, torque)


def _with_friction(run: FreeRun, friction: JointFriction) -> FreeRun:
    rows = [run.record.robot.v_index(joint) for joint in run.record.robot.joints]
    force = np.zeros_like(run.residual)
    force[:, rows] = friction.torque(*mean_motion(run.record, run.inputs.time, run.inputs.v[:, rows]))
    return run.explained(FRICTION, force)


def _knowing(forces: KnownForces, friction: JointFriction) -> KnownForces:
    joints = forces.record.robot.joints
    values = replace(forces.values, joints=joints, friction=friction, scale=np.ones(len(joints)))
    return replace(forces, values=values)


def _friction_lines(friction: JointFriction, joints: Sequence[str]) -> list[str]:
    lines = [
        f"  friction of {joint}: Coulomb {1e3 * coulomb:.2f} mN m, viscous {1e3 * viscous:.3f} mN m s/rad, rotor "
        f"{1e9 * inertia:.3g} g mm2, offset {1e3 * offset:+.2f} mN m"
        for joint, coulomb, viscous, inertia, offset in zip(
            joints, friction.coulomb, friction.viscous, friction.inertia, friction.offset, strict=True
        )
    ]
    return lines + [f"  not seen: {', '.join(friction.unseen)}"] * bool(friction.unseen)


def conditions_of(runs: Sequence[FreeRun]) -> list[Condition]:
    """Return phase and state of runs of a robot that has a phase."""
    return [run.condition for run in runs if run.condition is not None]


def _learnt_error(runs: Sequence[FreeRun], order: int, *, held_out: bool) -> LearntError:
    """Return the error over phase and state, learnt from all that is left or from what is not held out."""
    parts = [run.fitted if held_out else slice(0, len(run.residual)) for run in runs]
    conditions = [condition.part(part) for condition, part in zip(conditions_of(runs), parts, strict=True)]
    residuals = [run.residual[part] for run, part in zip(runs, parts, strict=True)]
    known = [run.inputs.between(part.start, part.stop).known for run, part in zip(runs, parts, strict=True)]
    return fit_learnt_error(conditions, residuals, known, [typical_step(run.inputs.time) for run in runs], order)


def _without(runs: Sequence[FreeRun], series: LearntError) -> list[FreeRun]:
    expected = [
        series.force(condition, run.inputs.known) for condition, run in zip(conditions_of(runs), runs, strict=True)
    ]
    return [run.explained(CALIBRATION, force) for run, force in zip(runs, expected, strict=True)]


def _unless_pushed(pushed: list[str], findings: Sequence[Finding], *, trust: bool) -> list[str]:
    """Return what pushed, as warnings. Raises CalibrationError where something did, or may seem to, without `trust`."""
    if pushed and not trust:
        doubts = "; ".join(str(each) for each in findings if each.warns and each.check not in HARMLESS_CHECKS)
        why = [f"or it seems so because of what checks find: {doubts}"] if doubts else []
        raise CalibrationError("; ".join([*pushed, *why, "--trust calibrates nevertheless"]))
    return pushed


def _detection(runs: Sequence[FreeRun], series: LearntError | None) -> Detection | None:
    if not (runs and runs[0].frames):
        return None
    widened = [1.0 if series is None or run.condition is None else series.widened(run.condition) for run in runs]
    seen = [(run.record.robot.model, run.inputs, factor) for run, factor in zip(runs, widened, strict=True)]
    return learn_detection(runs[0].frames, seen)


def _sizes(runs: Sequence[FreeRun]) -> str:
    return f"{force_size(float(np.sqrt(np.mean([run.judged().belief ** 2 for run in runs]))))} a row"
