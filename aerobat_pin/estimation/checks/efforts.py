"""Check the efforts against what the motion and the weight need: units, signs, places, delays, mounting, zeros, loads.

What forces, friction and constants leave of a fixed robot's rows is explained by one change of the map or of the robot,
if any: the one that makes the rows most likely (`explanations`). Feet of a free robot carry more than its motion needs,
so that a factor of all efforts looks like other forces: there `free_efforts` compares what no force explains.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import cache, partial

import numpy as np

from aerobat_pin.estimation.checks.changes import (
    Change,
    changes_of_efforts,
    changes_of_robot,
    driven_rows,
    no_names,
    sliding_rows,
)
from aerobat_pin.estimation.checks.free_efforts import GOOD, UNEXPLAINED, left_unexplained, of_free
from aerobat_pin.estimation.checks.misread_channels import change_of_time, changes_of_known, changes_of_reading
from aerobat_pin.estimation.findings import Finding
from aerobat_pin.forces import (
    EffortRows,
    Explanation,
    FittedValues,
    InputsBetween,
    Instants,
    KnownForces,
    MotionOf,
    effort_rows,
    expected_of,
    inputs_between,
    instants_of,
    most_likely_with,
    motion_of,
    points_of,
    row_scale,
    screened,
)
from aerobat_pin.observers import Applications, Expected
from aerobat_pin.records import Record

ENOUGH = 6.0  # gain of the logarithm of the likelihood from which a change is named
AS_LIKELY = 3.0  # loss of it with which a change explains about as well as the likeliest
MOST_OF_IT = 2.0 / 3.0  # of the gain of factors of all efforts, that one factor brings
TRIED = 6  # changes of which the likelihood is found, after a first look at all
ANY_FORCE = 10.0  # times what is expected of a force: no change need explain a steady one
MISPLACED = 0.05**2  # share of what is needed, in squares, from which joints may have another zero or sense
READINGS = {"joint zero", "joint sense", "swapped joints"}
WHITE = 0.5  # share of instants that are independent, from which what is left is noise
HARMLESS = frozenset(  # warnings that leave the motion as it is, but for some ms
    "unit of joints.effort, held channel, interpolated channel, late channel, gap, repeated stamps, time goes back, "
    "recorder clock, duplicate file, accelerometer against gravity".split(", ")
)


def effort_findings(
    record: Record,
    inputs: InputsBetween,
    before: Sequence[Finding],
    instants: Instants | None = None,
    expected: Expected | None = None,
    motion: MotionOf | None = None,
) -> Iterator[Finding]:
    """Yield how well efforts fit the motion, and what change of the map or the robot explains what they leave.

    Efforts are not compared with a motion that is misread by what was found before. Instants of the record, what is
    expected of it, and the motion of a free robot with such inputs are given if something keeps them.
    """
    misread = [each for each in before if each.warns and each.check not in HARMLESS]
    beyond = bool(misread) and all(each.check == "joint limits" and each.verdict == "warning" for each in misread)
    if "joints.effort" not in record.channels or (misread and not beyond):
        return
    if record.robot.free:
        yield from of_free(record, motion(inputs) if motion else motion_of(record, inputs), beyond=beyond)
        return
    testing = _testing_instants(record, inputs, instants, expected)
    if testing is None:
        how = "" if record.map.use.free else "; use.free names a stretch without contact"
        yield Finding("effort against motion", "note", f"unknown forces leave no row to check efforts by{how}")
        return
    explained = partial(_explained, record, inputs, *testing, beyond)
    share, independent, causes, hidden = explained()
    text = f"forces and friction leave {100.0 * np.sqrt(share):.1f} % of what weight and motion need"
    if beyond and share < GOOD:
        text += ": they fit the angles as they are, also those of joints beyond their limits"
    yield Finding("effort against motion", "good" if share < GOOD else "note", text, float(np.sqrt(share)), "1")
    if hidden:
        causes = explained(rotors=True, before=share)[2] or causes
    if causes:
        most = max(gain for gain, _ in causes)
        likeliest = [findings for gain, findings in causes if gain > most - AS_LIKELY]
        named = _as_likely(next((findings for findings in likeliest if findings), ()), likeliest)
        yield from named if all(likeliest) else map(_in_doubt, named)
        if named:
            return
    if beyond or share < UNEXPLAINED or independent > WHITE:
        return
    yield left_unexplained("no factors, delay or places", 100.0 * share**0.5)


def _testing_instants(
    record: Record, inputs: InputsBetween, instants: Instants | None, expected: Expected | None
) -> tuple[Instants, Expected] | None:
    """Return instants by which efforts are checked, and what is expected of them; None if forces leave no row."""
    free = record.map.use.free
    if free is None and not points_of(record.map):
        return None  # a force that is not sought may be in every row
    if free or instants is None:
        instants = instants_of(record, inputs, FittedValues(), between=free)
    if instants is None or not len(instants.rows):
        return None
    expected = expected or expected_of(record, instants, FittedValues())
    rows, _ = _effort_rows(record, instants, expected)
    return (instants, expected) if rows.driven and rows.forces.shape[1] < rows.y.shape[1] else None


def _explained(
    record: Record,
    inputs: InputsBetween,
    instants: Instants,
    expected: Expected,
    beyond: bool,
    *,
    rotors: bool = False,
    before: float | None = None,
) -> tuple[float, float, list[tuple[float, Sequence[Finding]]], bool]:
    """Return what forces and friction leave, and by how much each change that explains it makes the rows likelier.

    The share of what is needed, in squares; that of the instants that are independent; changes with what they name; and
    whether rotors alone, which every geared arm has, are far likelier than what else explains it: beside them, if they
    are looked for, another change may be; then `before` is what was left without them.
    """
    free = record.map.use.free
    rows, instants = _effort_rows(record, instants, expected, rotors)
    without, scale = most_likely_with(rows), row_scale(record.robot.model)[instants.kept]

    def formed(inputs: InputsBetween) -> tuple[EffortRows, Instants]:
        """Return the rows of other inputs."""
        seen = instants_of(record, inputs, FittedValues(), between=free)
        assert seen is not None  # as the record was
        return _effort_rows(record, seen, expected, rotors, instants.kept)

    as_mapped = cache(lambda: formed(inputs)[0])  # the rows as mapped, at the instants of those of other inputs
    needed = max(float(np.sum((rows.needed / scale) ** 2)), 1e-300)

    def share_of(explanation: Explanation) -> float:
        """Return the share of what is needed that is left, in squares; moments count over the robot's length."""
        return float(np.sum((explanation.errors / scale) ** 2)) / needed

    share = share_of(without)
    changes = list[Change]()
    if not beyond:  # whose efforts say nothing of factors or places before that is settled
        changes += [*changes_of_efforts(record, instants, rows, without), *changes_of_robot(record, instants)]
        changes += changes_of_known(record, instants, rows, without)
        changes.append(change_of_time(record, inputs, rows, without, as_mapped, formed))
    if share > MISPLACED and sliding_rows(instants).any():  # one pose fits many
        changes += changes_of_reading(record, inputs, instants, rows, without, as_mapped, formed)
    explaining, too_much = list[tuple[float, Sequence[Finding], Change, float]](), list[tuple[float, float]]()
    for gain, explanation, change, lasts in _likely(rows, without, changes):
        after, mapped = share_of(explanation), min(share, before or share)
        leaves = f"{100.0 * after**0.5:.3g} % of what is needed, as mapped {100.0 * (before or share) ** 0.5:.3g} %"
        findings = change.findings_of(explanation, leaves) if lasts else []
        if findings and after >= mapped:
            findings = []  # it only makes constants smaller
        if findings is not None and after < change.enough(explanation) * mapped:
            explaining.append((gain, findings, change, after))
        elif findings:
            too_much.append((gain, after))
    tried = [  # what is likelier and leaves less, if too much to be named, is not passed over for what is worse
        (gain, [] if any(gain < likelier and left < after for likelier, left in too_much) else findings, change)
        for gain, findings, change, after in explaining
    ]
    by_name = {change: gain for gain, findings, change in tried if findings}
    said = {change.findings_of for change in by_name}  # the same change of what is needed with and without the forces
    causes = [  # too many factors to name are one of all, where that explains most of what they do
        (gain, findings)
        for gain, findings, change in tried
        if findings
        or (
            change.findings_of not in said
            and max((by_name.get(case, 0.0) for case in change.cases[:1]), default=0.0) < MOST_OF_IT * gain
        )
    ]
    most = max((gain for gain, _ in causes), default=0.0)
    rotating = any(change.findings_of is no_names and gain > most - AS_LIKELY for gain, _, change in tried)
    hidden = rotating and not any(findings for gain, findings in causes if gain > most - AS_LIKELY)
    return share, without.independent, causes, hidden


def _as_likely(named: Sequence[Finding], likeliest: Sequence[Sequence[Finding]]) -> Sequence[Finding]:
    """Return what is named, with how else the joints may have to be read: two such mistakes can be the same.

    Of zeros the smallest: an encoder's slips by little.
    """
    zeros = [findings for findings in likeliest if findings and findings[0].check == "joint zero"]
    if named in zeros:
        named = min(zeros, key=lambda findings: abs(findings[0].value or 0.0))
    read = [finding for findings in likeliest for finding in findings[:1] if finding.check in READINGS]
    others = dict.fromkeys(finding.text.partition(", which")[0] for finding in read if finding not in named)
    if others and named[0] in read:
        return [replace(named[0], text=f"{named[0].text}; or {', or '.join(others)}")]
    return named


def _in_doubt(finding: Finding) -> Finding:
    text = f"perhaps, as errors too small to name explain the efforts about as well: {finding.text}"
    return replace(finding, verdict="note", text=text)


def _in_motion(instants: Instants, compared: Sequence[int] | None) -> Instants:
    """Return instants without the rows of joints that never slide, which stiction holds, if others do.

    Or with those that are compared: a joint that slides for a moment may do so between other instants.
    """
    slide = sliding_rows(instants) if compared is None else np.isin(instants.kept, compared)
    if not slide.any():
        return instants
    kept = [row for row, each in zip(instants.kept, slide.tolist(), strict=True) if each]
    series = {name: getattr(instants, name)[..., slide] for name in ("sliding", "columns", "rates", "around")}
    return replace(instants, kept=kept, **series)


def _effort_rows(
    record: Record,
    instants: Instants,
    expected: Expected,
    rotors: bool = False,
    compared: Sequence[int] | None = None,
) -> tuple[EffortRows, Instants]:
    """Return the rows of joints that slide, or of those compared, beside the forces sought; and instants of these."""
    instants = _in_motion(instants, compared)
    driven = [place for _, place in driven_rows(record, instants)]
    J = Applications(record.robot.model, points_of(record.map)).jacobian(instants.past[0][instants.weighed])
    forces = 0.0 if record.map.use.free else ANY_FORCE
    return effort_rows(instants, expected, driven, J, forces=forces, rotors=rotors), instants


def _likely(
    rows: EffortRows, without: Explanation, changes: list[Change]
) -> Iterator[tuple[float, Explanation, Change, bool]]:
    """Yield the changes that make the rows far more likely: by how much, what is likely then, and if that lasts.

    A push is in a part of the record, and what makes up for it says nothing.
    """
    anew = [each for each in changes if each.anew is not None]
    first = sorted((each for each in changes if each.anew is None), key=lambda each: each.shift is not None)
    columns = [each.columns for each in first if each.columns is not None]
    gains = screened(rows, without, columns, [each.shift for each in first if each.shift is not None])
    order = np.argsort([each.price - gain for each, gain in zip(first, gains.tolist(), strict=True)])
    chosen = [*(first[k] for k in sorted(order[:TRIED].tolist())), *anew]
    tried = [(*each.likely(rows, without), each) for each in chosen]
    if not tried:
        return
    independent = max(tried, key=lambda each: each[0])[1].independent
    gains_of = {change: gain * independent - change.price for gain, _, change in tried}
    for _, explanation, change in tried:
        gain = gains_of[change]
        if gain > max([ENOUGH, *(gains_of.get(case, ENOUGH) for case in change.cases)]):
            parts = (change.likely(rows, without, part)[0] * independent for part in change.parts)
            yield gain, explanation, change, all(part > change.price for part in parts)


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

    Known forces are `given` without the friction that was found, which takes up a reversed effort, and with it in
    `forces` and `inputs`. The rest as in `effort_findings`.
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
