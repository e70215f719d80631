"""Checks of a recording against itself and against its map; each names the measured figure."""

from aerobat_pin.estimation.checks.balance import effort_findings
from aerobat_pin.estimation.checks.kinematics import motion_findings
from aerobat_pin.estimation.checks.result import fit_findings, result_findings
from aerobat_pin.estimation.checks.stamps import stamp_findings

__all__ = ["effort_findings", "fit_findings", "motion_findings", "result_findings", "stamp_findings"]
