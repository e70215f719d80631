"""The checks of a record against itself and against its map; each names the measured figure."""

from aerobat_pin.estimation.checks.efforts import effort_findings, efforts_and_friction
from aerobat_pin.estimation.checks.motion import record_findings
from aerobat_pin.estimation.checks.result import fit_findings, result_findings
from aerobat_pin.estimation.checks.untold_forces import untested_findings

__all__ = [
    "effort_findings",
    "efforts_and_friction",
    "fit_findings",
    "record_findings",
    "result_findings",
    "untested_findings",
]
