"""What an observer is given of a whole flight, and what its channels show of themselves."""

from dataclasses import replace

from aerobat_pin.aerobat import AerobatRobot, FlightLog, flight_record
from aerobat_pin.estimation import Calibration, CalibrationWatch, Finding, record_findings
from aerobat_pin.forces import KnownForces, KnownInputs, inputs_of
from aerobat_pin.records import Record


def flight_inputs(record: Record, calibration: Calibration | None) -> KnownInputs:
    """Return the inputs of an observer of a whole flight, with a calibration that was `applied` to it, or without."""
    forces, rows = KnownForces(record) if calibration is None else calibration.forces(record), record.robot.rows()
    assert rows is not None
    inputs = inputs_of(record, *record.parts[0], forces, rows)
    if calibration is None:
        return inputs
    watch = CalibrationWatch(calibration)
    watch.take(record, inputs, slice(0, len(inputs.tau)), ends=True)
    return replace(inputs, calibration=watch.use())


def flight_findings(log: FlightLog, robot: AerobatRobot) -> list[Finding]:
    """Return what a log shows of itself."""
    return list(record_findings(flight_record(log, robot)))
