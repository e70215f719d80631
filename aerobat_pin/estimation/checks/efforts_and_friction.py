"""Check the efforts, with what was found of friction beside the forces, and drop what friction explains."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

from aerobat_pin.estimation.checks.efforts import effort_findings
from aerobat_pin.estimation.checks.free_efforts import of_free
from aerobat_pin.estimation.findings import Finding
from aerobat_pin.forces import InputsBetween, Instants, KnownForces, MotionOf, inputs_between, motion_of
from aerobat_pin.observers import Expected


def efforts_and_friction(
    given: KnownForces,
    forces: KnownForces,
    inputs: InputsBetween,
    before: Sequence[Finding],
    instants: Instants | None = None,
    expected: Expected | None = None,
    motion: MotionOf | None = None,
) -> list[Finding]:
    """Return findings about efforts; without those that name friction, if with it they are gone.

    Args:
        given: the known forces without the friction that was found, which takes up a reversed effort.
        forces: those with it.
        inputs: what an observer is given between two indices, with these.
        before: what was found before.
        instants: of the record, if it was looked at.
        expected: what is expected of it, if that is known.
        motion: of a free robot's record with such inputs, if something keeps it.
    """
    record = forces.record
    motion = motion or partial(motion_of, record)
    plain = inputs if forces is given else inputs_between(record, given)
    doubts = list(effort_findings(record, plain, before, instants, expected, motion))
    if forces is given or not record.robot.free or not any(map(_names_friction, doubts)):
        return doubts
    with_friction = of_free(record, motion(inputs), beyond=False, readings=False)  # none was told without it
    remaining = {finding.check for finding in with_friction if finding.warns}
    return [finding for finding in doubts if not _names_friction(finding) or finding.check in remaining]


def _names_friction(finding: Finding) -> bool:
    """Return whether a finding warns of what friction may explain."""
    return finding.warns and "friction" in finding.text
