"""What a check found about a record: a measured figure; and what the record says, in one sentence.

That is what pushed, how much, how sure that is, and what could not be seen, by the first observer, which the sentence
names, whether or not another one is nearer to the truth: on a real robot nobody knows which one is.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from aerobat_pin.errors import LogError
from aerobat_pin.forces import (
    ModelCheck,
    ObserverScores,
    Push,
    StoredEstimate,
    contact_push,
    place_of,
    pushes_of,
    quantity,
    short_label,
)

UNTESTED, LOST_SAMPLES = "untested forces", "lost samples"  # names of checks, whose words the verdict repeats
WOULD_LOOK = "a wrong sign, order, mass, mounting or friction would look like this force"
FindingVerdict = Literal["good", "note", "warning", "refused"]
JUST_BELOW = 0.8  # of what would stand out: a push that is said to be below that
CROSSTALK = 0.02  # share of the largest force that its estimate leaves elsewhere
SAID_AT_MOST = 2  # pushes, or components, that a sentence names
SOMETIMES = 0.95  # share of the time below which a component is not always seen
ROW_TORQUE, ROW_TORQUES = "a torque that the motion does not explain", "torques that the motion does not explain"
HARMLESS_CHECKS = (  # a warning of theirs makes no force wrong: it says what is left out, not known, or kept twice
    "gap, time goes back, repeated stamps, duplicate file, stretch without contact, before the flight, control, "
    "calibration".split(", ")
)
COMPARED_WITH = {"truth": "true force", "sensor": "force sensor"}


@dataclass(frozen=True)
class Finding:
    """One line of the report.

    Attributes:
        check: name of the check, such as `gyro against attitude`.
        verdict: `good`, `note` (a figure without judgement), `warning`, or `refused` (certainly wrong).
        text: the measured figure in words.
        value: the figure.
        unit: its unit.
    """

    check: str
    verdict: FindingVerdict
    text: str
    value: float | None = None
    unit: str = ""

    @property
    def warns(self) -> bool:
        """Whether it spoils the estimate."""
        return self.verdict in ("warning", "refused")

    def __str__(self) -> str:
        return f"{self.check}: {self.text}"


def refuse_if_certain(log: str, findings: Iterable[Finding]) -> None:
    """Raise LogError with all findings that are certainly wrong."""
    certain = [str(finding) for finding in findings if finding.verdict == "refused"]
    if certain:
        raise LogError(f"log {log}: {'; '.join(certain)}; --trust estimates nevertheless")


def verdict_of(
    estimate: StoredEstimate,
    scores: ObserverScores,
    start: float,
    kind: str,
    findings: Iterable[Finding],
    model: ModelCheck | None,
    *,
    level: bool = True,
) -> str:
    """Return the sentence about what an observer estimated, by its scores; times count from a start [s].

    `kind` is what the scores compare it with, `truth`, `sensor` or nothing; `model` says whether the belief is still
    that of its calibration, if there is one; `level` says that z is up in the world's axes.
    """
    head, contacts = estimate.head, scores.events or ()
    sought = scores.events is not None and (head.are_world_forces or not head.frames)
    level = level and bool(head.frames)  # else rows of a base are in its own axes
    pushes, least = pushes_of(estimate, start, contacts if sought else (), level=level), dict[str, float]()
    for unit, size in [(push.unit, push.peak) for push in pushes] + [(event.unit, event.size) for event in contacts]:
        least[unit] = max(least.get(unit, 0.0), CROSSTALK * size)
    if head.expected_force is None:  # else the deviations contain the errors of the belief
        least["N"] = max(least.get("N", 0.0), estimate.redundancy.least)
    certain = sorted((push for push in pushes if push.stands_out(least[push.unit])), key=lambda push: -push.peak)
    singular, plural = ("a push", "pushes") if head.frames else (ROW_TORQUE, ROW_TORQUES)
    what = f"{singular} at"
    if sought:
        blows = [push for push in certain if push.short]  # too short for a contact
        named = sorted(contacts, key=lambda event: -event.size)[: SAID_AT_MOST - len(blows[:1])]
        named.sort(key=lambda event: event.onset)
        certain = [contact_push(estimate, event, start, level=level) for event in named] + blows
        count = len(contacts) + len(blows)
        places = {place_of(event, estimate) for event in contacts} | {push.place for push in blows}
        what = what if count == 1 else f"{count} {plural}, at"
    else:
        count, places = len(certain), {push.place for push in certain}
    quiet = [push.place for push in pushes if push.place not in places]
    what = f"{what} {_listed(certain, count)}" if certain else f"no {singular[2:]} that stands out from its errors"
    sentence = f"{head.observer} finds {what}{'' if certain or scores.events is not None else _nearest(pushes)}"
    if certain and quiet:
        sentence += f"; nothing at {_listed(dict.fromkeys(quiet))} stands out from its errors"
    findings = tuple(findings)
    doubts = [f"the record contradicts itself: {finding.check}" for finding in findings if finding.verdict == "refused"]
    warned = dict.fromkeys(finding.check for finding in findings if finding.verdict == "warning")
    doubted = [check for check in warned if check not in (*HARMLESS_CHECKS, LOST_SAMPLES)]
    doubts += [f"a check doubts the record: {', '.join(doubted)}"] if doubted else []
    doubts += [finding.text for finding in findings if finding.check == LOST_SAMPLES][:1]  # others lack the same ones
    words, wrong = scores.judgement
    if certain and not scores.points:  # which test it
        untested = [finding.text for finding in findings if finding.check == UNTESTED]
        doubts += [f"no row is to spare: {WOULD_LOOK}"] if estimate.redundancy.verdict == "blind" else untested
    doubts += [words.removeprefix("belief: ").partition(";")[0]] * wrong
    doubts += ["something has changed since the calibration"] * (model is not None and model.verdict == "changed")
    parts = [sentence, _sureness(scores, kind, certain, pushes), *doubts, _unseen(scores)]
    return "; ".join(part for part in parts if part) + "."


def _nearest(pushes: Sequence[Push]) -> str:
    """Return the push that nearly stands out, if there is one, with its size in deviations and that which would."""
    near = max(pushes, key=lambda push: push.sure, default=None)
    if near is None or not near.deviation or near.short or near.sure < JUST_BELOW:
        return ""
    size = near.peak / near.deviation
    return f"; {near} is {size:.3g} deviations, of which {size / near.sure:.3g} would"


def _listed(things: Iterable[object], count: int = 0) -> str:
    """Return the first few things, and how many more there are, of `count` if they are not all."""
    texts = [str(thing) for thing in things]
    more = max(len(texts), count) - SAID_AT_MOST
    texts = [*texts[:SAID_AT_MOST], f"{more} more"] if more > 0 else texts
    return " and ".join(filter(None, [", ".join(texts[:-1]), texts[-1]]))


def _sureness(scores: ObserverScores, kind: str, certain: list[Push], pushes: list[Push]) -> str:
    """Return how sure the forces are: errors against a reference, or as stated; nothing where none is ever seen."""
    if scores.points:
        forces = {label: score for label, score in scores.scored.items() if label.rpartition(".")[2][0] == "F"}
        error = float(np.linalg.norm([score.rmse for score in forces.values()]))
        sizes = [part.rms or 0.0 for part in scores.components if short_label(part.name) in forces]
        size = float(np.linalg.norm(sizes))
        share = f"{100.0 * error / size:.2g} % of it" if 0.99 * size > error else "as much as it finds"
        where = f" at {_listed(scores.points)}" if kind == "sensor" else ""
        per_point = quantity(error / len(scores.points) ** 0.5, "N")
        return f"it is off the {COMPARED_WITH[kind]}{where} by {per_point} rms, {share}"
    if any(push.deviation is not None for push in certain):
        return "+- is one standard deviation at that time, as stated"
    if any(size.deviation is not None for size in scores.components):
        return f"its standard deviation, as stated, is {_listed(quantity(push.error, push.unit) for push in pushes)}"
    if scores.components and all(size.seen == 0.0 for size in scores.components):
        return ""  # nothing is seen that could be sure
    return "how sure that is cannot be said: a calibration, kalman or smoother would state it"


def _unseen(scores: ObserverScores) -> str:
    """Return which parts of the forces the record does not show."""
    never = [short_label(size.name) for size in scores.components if size.seen == 0.0] + scores.unseen
    rarely = [
        f"{short_label(size.name)} ({100.0 * size.seen:.0f} % of the time)"
        for size in scores.components
        if size.seen and size.seen < SOMETIMES
    ]
    if not never and not rarely:
        return "every direction of these forces can be seen"
    parts = [f"it cannot see {_listed(never)}"] if never else []
    return "; ".join([*parts, *([f"it sees only at times {_listed(rarely)}"] if rarely else [])])
