"""What a log of Aerobat shows of itself, by the checks of any record."""

from __future__ import annotations

from aerobat_pin.aerobat.flight_log import FlightLog
from aerobat_pin.aerobat.flight_record import flight_record
from aerobat_pin.aerobat.robot import AerobatRobot
from aerobat_pin.estimation import Finding, KnownInputs, effort_findings, record_findings


def flight_findings(log: FlightLog, robot: AerobatRobot, inputs: KnownInputs | None = None) -> list[Finding]:
    """Return what the measured channels of a log show of themselves, and of what is believed.

    Args:
        log: the flight log.
        robot: the assumed robot.
        inputs: of the observers, with which the motor's torques are compared; None compares none.

    Raises:
        LinkageError: the assumed linkage cannot close at a recorded crank angle.
    """
    record = flight_record(log, robot)
    found = list(record_findings(record))
    if inputs is not None and robot.kind == "measured" and not log.is_raw:
        found += effort_findings(record, inputs.between, found)
    return found
