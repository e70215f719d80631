"""From a record to estimated forces, findings and scores."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache, partial

from aerobat_pin.errors import ObserverError
from aerobat_pin.estimation.calibration.calibration import Calibration, CalibrationWatch
from aerobat_pin.estimation.calibration.check_model import CheckedModel, check_model
from aerobat_pin.estimation.calibration.error_bar import noise_where_known
from aerobat_pin.estimation.checks.efforts import efforts_and_friction
from aerobat_pin.estimation.checks.motion import record_findings
from aerobat_pin.estimation.checks.result import result_findings
from aerobat_pin.estimation.checks.untold_forces import untested_findings
from aerobat_pin.estimation.findings import Finding, refuse_if_certain
from aerobat_pin.estimation.online import OnlineEstimator
from aerobat_pin.estimation.result import Result
from aerobat_pin.forces import (
    Instants,
    KnownForces,
    ModelCheck,
    StoredEstimate,
    fit_beside_forces,
    fitted_forces,
    inputs_between,
    knows_friction,
    motion_of,
    observers_of,
    run_observers,
    sensor_references,
)
from aerobat_pin.numerics import guarded
from aerobat_pin.observers import Expected, Observer
from aerobat_pin.records import Record

WITHOUT_FRICTION = (
    "it knows no friction, but this record shows some, which was found beside the forces; contacts are not sought. "
    'Calibrate again with friction = {law = "coulomb+viscous"} under [joints]'
)
WITH_SOME = "{}, so it was found beside the forces; contacts are not sought. Calibrate with all joints in motion"
ShareDone = Callable[[float], None]


@guarded()
def estimate(
    record: Record,
    observers: Sequence[str | Observer] = (),
    calibration: Calibration | None = None,
    *,
    trust: bool = False,
    progress: ShareDone | None = None,
) -> Result:
    """Estimate the unknown forces of a record.

    Args:
        record: the record, of whatever source.
        observers: names of observers, observers, or both; those that its map names when empty.
        calibration: what other records showed; its values are used in place of the map's fits.
        trust: estimate also what the checks would refuse; the findings stay.
        progress: called with the share that is done.

    Raises:
        CalibrationError: the calibration belongs to another robot, or to a map that means something else.
        LogError, MapError: log and map do not fit together, or a check is certain that the map is wrong.
        ObserverError, FrameNotFoundError: an observer cannot be built for this robot, or two have one name.
    """
    name = record.title if record.log is None else str(record.log.path)
    record = record if calibration is None else calibration.applied(record)
    findings = list(record_findings(record))
    if not trust:
        refuse_if_certain(name, findings)

    given = fitted_forces(record) if calibration is None else calibration.forces(record)
    forces, expected, instants = _with_noise(given)
    beside = knows_friction(forces) and not knows_friction(given)  # found in this record, of which no calibration knew
    record = forces.record  # whose robot carries what was found
    inputs = as_known = inputs_between(record, forces)
    motion = cache(partial(motion_of, record))  # which several checks look at

    model = None
    if calibration is not None and not record.robot.smooths(record.channels):
        if beside and given.values.friction is not None:
            model = CheckedModel(ModelCheck(None, 0.0, 0.0, why=_unseen_before(given, forces)), inputs, lambda _: None)
            calibration = replace(calibration, detection=None)
        elif beside:  # what the calibration expects has friction in it, as what it is compared with
            model = check_model(calibration, given, inputs_between(record, given))
            calibration = replace(calibration, detection=None)
        else:
            model = check_model(calibration, forces, inputs)
            inputs = model.inputs
    errors_known = model is not None and model.check is not None and not beside
    running, notes = _chosen_observers(record, observers, expected, errors_known=errors_known)

    watch = None if calibration is None else CalibrationWatch(calibration, None if model is None else model.check)
    smoothed = record.robot.motion_from(record.times(*record.parts[0]), record.channels, running, progress)
    if smoothed is not None:
        stored = {name: StoredEstimate.of(estimate) for name, estimate in smoothed.estimates.items()}
        sources, use = smoothed.block.source, None if calibration is None else calibration.use_of_extras
    else:
        if record.robot.measures_effort:
            findings += efforts_and_friction(given, forces, as_known, findings, instants, expected, motion)
        errors = None if model is None else model.deviations
        stored = run_observers(record, inputs, running, progress, watch, expected, errors)
        first, last = record.parts[0]
        sources = inputs(first, last if record.robot.remembers else first + 1).source
        use = None if watch is None else watch.use()

    result = Result(
        name=record.title,
        title=str(record),
        robot=record.robot.title,
        mass=record.robot.mass,
        dt=record.dt,
        stored=stored,
        references=(*record.references, *sensor_references(record)),
        calibration=use,
        notes=(*record.notes, *notes),
        inputs=sources,
        record=record,
        forces=forces,
        smoothed=smoothed,
    )
    if smoothed is None:
        findings += result_findings(result, partial(motion, as_known), expected)
        findings += untested_findings(forces, instants, expected, next(iter(stored.values())))
    findings += () if calibration is None else calibration.findings(record)
    if calibration is not None and beside:
        text = WITHOUT_FRICTION if given.values.friction is None else WITH_SOME.format(_unseen_before(given, forces))
        findings.append(Finding("calibration", "warning", text))
    if not trust:
        refuse_if_certain(name, findings)
    return replace(result, findings=tuple(findings))


@guarded()
def stream_of(record: Record) -> OnlineEstimator:
    """Return a stream by a record's map that expects of forces and rows what the whole record shows.

    Raises:
        MapError: the map needs a whole record.
    """
    forces, expected, _ = _with_noise(fitted_forces(record))
    return OnlineEstimator(record.map, record.folder, expected=expected, values=forces.values)


def _with_noise(forces: KnownForces) -> tuple[KnownForces, Expected | None, Instants | None]:
    """Return known forces with the errors of the rows where nothing touches, or else as the record tells them.

    And what is expected of the record, and its instants; None for a robot that expects forces of any size.
    """
    if not forces.record.robot.limits_forces:
        return forces, None, None
    noise = forces.values.row_noise or noise_where_known(forces)
    return fit_beside_forces(replace(forces, values=replace(forces.values, row_noise=noise)))


def _unseen_before(given: KnownForces, forces: KnownForces) -> str:
    """Return in words of which joints a calibration did not show friction that a record does."""
    joints = [joint for joint in forces.values.joints if joint not in given.values.joints]
    return f"the calibration's recording did not show friction of {', '.join(joints)}"


def _chosen_observers(
    record: Record, chosen: Sequence[str | Observer], expected: Expected | None, *, errors_known: bool
) -> tuple[list[Observer], tuple[str, ...]]:
    """Return observers that were chosen by name, else those of the map, and ready ones; and notes on their rows."""
    names, notes = [each for each in chosen if isinstance(each, str)], tuple[str, ...]()
    ready = [each for each in chosen if isinstance(each, Observer)]
    if names or not chosen:
        built, notes = observers_of(record, names, expected, errors_known=errors_known)
        ready = [*built, *ready]
    if len({observer.name for observer in ready}) < len(ready):
        raise ObserverError(f"estimate: observers = {[each.name for each in ready]}: different ones were expected")
    return ready, notes
