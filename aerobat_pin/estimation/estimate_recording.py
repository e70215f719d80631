"""From a recording and its map to estimated forces, findings and scores."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from aerobat_pin.estimation.checks.balance import effort_findings
from aerobat_pin.estimation.checks.kinematics import motion_findings
from aerobat_pin.estimation.checks.result import result_findings
from aerobat_pin.estimation.checks.stamps import stamp_findings
from aerobat_pin.estimation.findings import refuse_if_certain
from aerobat_pin.estimation.fit_known_forces import fitted_forces
from aerobat_pin.estimation.map_calibration import MapCalibration
from aerobat_pin.estimation.result import Result
from aerobat_pin.estimation.run_observers import observers_of, run_observers
from aerobat_pin.estimation.sensor_reference import sensor_references
from aerobat_pin.numerics import guarded
from aerobat_pin.records import Map, open_record

ShareDone = Callable[[float], None]


@guarded()
def estimate_recording(
    log: Path,
    chosen: Map,
    folder: Path,
    progress: ShareDone | None = None,
    trust: bool = False,
    calibration: MapCalibration | None = None,
) -> Result:
    """Estimate the unknown forces of a recording.

    Args:
        log: a table, a NetCDF file, an MCAP file, or the folder of a bag.
        chosen: the map.
        folder: where relative paths of the map begin.
        progress: called with the share of the record that is estimated.
        trust: estimate also what the checks would refuse; the findings stay.
        calibration: what another recording showed; its values are used in place of the map's fits.

    Raises:
        CalibrationError: the calibration belongs to another robot, or to a map that means something else.
        LogError, MapError: log and map do not fit together, or a check is certain that the map is wrong.
        ObserverError, FrameNotFoundError: an observer cannot be built for this robot.
    """
    record, columns = open_record(log, chosen, folder)
    if calibration is not None:
        record = calibration.applied(record)
    observers, notes = observers_of(record)
    findings = [*stamp_findings(record, columns), *motion_findings(record)]
    del columns
    if not trust:
        refuse_if_certain(str(log), findings)
    forces = fitted_forces(record) if calibration is None else calibration.forces(record)
    findings += effort_findings(record, forces)
    references = sensor_references(record)
    stored = run_observers(record, forces, observers, progress)
    result = Result(
        name=log.name,
        title=f"{log.name}: {record.robot.title}, {record.robot.mass:.4g} kg; {record.duration:.4g} s in "
        f"{'one part' if len(record.parts) == 1 else f'{len(record.parts)} parts'} at {record.rate:.4g} Hz",
        robot=record.robot.title,
        mass=record.robot.mass,
        dt=record.dt,
        stored=stored,
        references=references,
        notes=(*record.notes, *notes),
        inputs={key: "measured" for key in record.channels if not key.startswith("check.")},
        record=record,
        forces=forces,
        folder=folder,
    )
    findings += result_findings(result)
    if calibration is not None:
        findings.append(calibration.finding())
    if not trust:
        refuse_if_certain(str(log), findings)
    return replace(result, findings=tuple(findings))
