"""Check the efforts without friction, as a fit of it takes up reversed ones, and drop what friction explains."""

from __future__ import annotations

from collections.abc import Sequence

from aerobat_pin.estimation.checks.efforts import effort_findings
from aerobat_pin.estimation.findings import Finding
from aerobat_pin.forces import KnownForces, inputs_between


def efforts_and_friction(given: KnownForces, forces: KnownForces, before: Sequence[Finding]) -> list[Finding]:
    """Return findings about efforts; without those that name friction, if with it they are gone.

    Args:
        given: the known forces without the friction that was found.
        forces: those with it.
        before: what was found before.
    """
    record = forces.record
    doubts = list(effort_findings(record, inputs_between(record, given), before))
    if forces is given or not any(map(_names_friction, doubts)):
        return doubts
    with_friction = effort_findings(record, inputs_between(record, forces), before)
    remaining = {finding.check for finding in with_friction if finding.warns}
    return [finding for finding in doubts if not _names_friction(finding) or finding.check in remaining]


def _names_friction(finding: Finding) -> bool:
    """Return whether a finding warns of what friction may explain."""
    return finding.warns and "friction" in finding.text
