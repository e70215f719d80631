"""What a record says, in one sentence: what pushed, how much, how sure that is, and what could not be seen.

It is about the first observer, which the sentence names, whether or not another one is nearer to the truth: on a real
robot nobody knows which one is.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from aerobat_pin.estimation.findings import LOST_SAMPLES, UNTESTED, WOULD_LOOK, Finding
from aerobat_pin.forces import (
    SURE_OF_CONTACT,
    TINY,
    ComponentSize,
    Contact,
    ModelCheck,
    ObserverScores,
    StoredEstimate,
    along_itself,
    burst_noise,
    during_contact,
    largest_of,
    point_label,
    quantity,
    short_label,
    without_lag,
)
from aerobat_pin.numerics import Array

LASTING = 1.5  # or its rms: noise alone has one error
SHORT_BLOW = 3.5  # times what size over errors without lag usually is: a blow, however sure its size is
USUALLY = 0.99  # share of the time
JUST_BELOW = 0.8  # of what would stand out: a push that is said to be below that
CROSSTALK = 0.02  # share of the largest force that its estimate leaves elsewhere
SAID_AT_MOST = 2  # pushes, or components, that a sentence names
MOSTLY = 0.8  # share of a force that is along an axis before the axis is named
SOMETIMES = 0.95  # share of the time below which a component is not always seen
ROW_TORQUE, ROW_TORQUES = "a torque that the motion does not explain", "torques that the motion does not explain"
WAYS = {"Fx": ("along x", "against x"), "Fy": ("along y", "against y"), "Fz": ("upward", "downward")}
HARMLESS_CHECKS = (  # a warning of theirs makes no force wrong: it says what is left out, not known, or kept twice
    "gap",
    "time goes back",
    "repeated stamps",
    "duplicate file",
    "stretch without contact",
    "before the flight",
    "control",
    "calibration",
)
COMPARED_WITH = {"truth": "true force", "sensor": "force sensor"}


@dataclass(frozen=True)
class _Push:
    """Force or moment at one place.

    Attributes:
        place: where.
        unit: N or N m.
        peak: its largest size that errors at its time cannot make up; without one, where it is largest beside them.
        at: when that was, after the start [s].
        way: its direction then, in words.
        deviation: its standard deviation then, along it; None if none is stated.
        sure: the peak over what errors make up at its time.
        rms: of the size.
        lasting: root mean square of the size over its error at each time.
        error: typical error.
        short: whether it is a blow, of which the filter shows that it was, not how large.
        ends: from and to of a contact, after the start [s]; None where contacts are not sought, or if it lasts.
    """

    place: str
    unit: str
    peak: float
    at: float
    way: str
    deviation: float | None
    sure: float
    rms: float = 0.0
    lasting: float = 0.0
    error: float = 0.0
    short: bool = False
    ends: tuple[float, float | None] | None = None

    def stands_out(self, least: float) -> bool:
        """Whether errors, or an error of the belief that looks like `least`, cannot make it up."""
        return (self.sure > 1.0 and self.peak > least) or (self.lasting > LASTING and self.rms > least)

    def __str__(self) -> str:
        size = quantity(self.peak, self.unit)
        if self.deviation is not None:  # in the unit of the size
            number, _, unit = size.partition(" ")
            factor = {"m": 1e3, "k": 1e-3}.get(unit.removesuffix(self.unit), 1.0)
            size = f"{number} +-{float(f'{factor * self.deviation:.2g}'):g} {unit}"
        when = f"at {self.at:.2f} s"
        if self.ends is not None:
            begin, end = self.ends
            when = f"from {begin:.2f} s to {'the end' if end is None else f'{end:.2f} s'}"
        return f"{self.place} ({'short, ' * self.short}up to {size}{self.way}, {when})"


def verdict_of(
    estimate: StoredEstimate,
    scores: ObserverScores,
    start: float,
    kind: str,
    findings: Iterable[Finding],
    model: ModelCheck | None,
) -> str:
    """Return the sentence about an observer.

    Args:
        estimate: what it estimated.
        scores: its scores.
        start: time from which the sentence counts [s].
        kind: what the scores compare it with: `truth` or `sensor`.
        findings: what the checks found.
        model: whether the belief is still that of its calibration; None without one.
    """
    pushes, events = _pushes(estimate, start), scores.events
    largest = {unit: max(push.peak for push in pushes if push.unit == unit) for unit in {push.unit for push in pushes}}
    least = {unit: CROSSTALK * size for unit, size in largest.items()}
    if estimate.head.expected_force is None:  # else the deviations contain the errors of the belief
        least["N"] = max(least.get("N", 0.0), estimate.redundancy.least)
    certain = sorted((push for push in pushes if push.stands_out(least[push.unit])), key=lambda push: -push.peak)
    singular, plural = ("a push", "pushes") if estimate.head.frames else (ROW_TORQUE, ROW_TORQUES)
    what = f"{singular} at"
    if events is not None and (estimate.head.are_world_forces or not estimate.head.frames):  # they were sought
        places = {_place_of(event, estimate) for event in events}
        blows = [push for push in certain if push.short and push.place not in places]  # too short for a contact
        named = sorted(events, key=lambda event: -event.size)[: SAID_AT_MOST - len(blows[:1])]
        certain = [_contact(estimate, event, start) for event in sorted(named, key=lambda event: event.onset)] + blows
        count, places = len(events) + len(blows), places | {push.place for push in blows}
        what = what if count == 1 else f"{count} {plural}, at"
    else:
        count, places = len(certain), {push.place for push in certain}
    quiet = [push.place for push in pushes if push.place not in places]
    what = f"{what} {_listed(certain, count)}" if certain else f"no {singular[2:]} that stands out from its errors"
    sentence = f"{estimate.head.observer} finds {what}{'' if certain or events is not None else _nearest(pushes)}"
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


def _nearest(pushes: Sequence[_Push]) -> str:
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


@dataclass
class _Largest:
    """Where a force is largest of those that errors cannot make up, or else over its error."""

    time: float
    force: Array
    deviation: Array
    rank: tuple[bool, float] = (False, -1.0)
    sure: float = 0.0

    def take(self, time: Array, force: Array, errors: Array, deviations: Array) -> Array:
        """Take forces (m, n) with their errors and stated deviations; return their sizes over the errors (m,)."""
        size = np.linalg.norm(force, axis=1)
        error = np.maximum(along_itself(force, errors) * force.shape[1] ** 0.5, TINY)
        beyond = size > SURE_OF_CONTACT * error
        weight = np.where(beyond, size, 0.0) if beyond.any() else size / error
        at = int(np.argmax(weight))
        if (rank := (bool(beyond[at]), float(weight[at]))) > self.rank:
            self.rank, self.time, self.sure = rank, float(time[at]), float(size[at] / error[at])
            self.force, self.deviation = force[at], deviations[at]
        return np.asarray(size / error)


class _Group:
    """The components at one place that have one unit: where they are largest, and sums over all intervals."""

    def __init__(self, place: str, unit: str, columns: list[int], axes: list[str], start: float) -> None:
        self.place, self.unit, self.columns, self.axes = place, unit, columns, axes
        none = np.zeros(len(columns))
        self.largest, self.blow = (_Largest(start, none, none + 1.0) for _ in range(2))
        self.squares = self.shares = self.usual = 0.0

    def take(self, time: Array, components: Array, deviations: Array, errors: Array) -> None:
        """Take the components (m, c) of a block, 0 where they are not seen, their deviations, and these without lag."""
        force, deviation, without = (table[:, self.columns] for table in (components, deviations, errors))
        square = np.sum(force**2, axis=1)
        self.squares += float(np.sum(square))
        self.shares += float(np.sum(square / np.maximum(np.sum(deviation**2, axis=1), TINY**2)))
        self.largest.take(time, force, deviation, deviation)
        over = self.blow.take(time, force, without, deviation)
        if len(seen := over[square > 0.0]):
            self.usual = max(self.usual, float(np.quantile(seen, USUALLY)))

    def push(self, start: float, count: int, sizes: Sequence[ComponentSize], noise: Array) -> _Push:
        """Return what pushed here, of `count` intervals."""
        short = not self.largest.rank[0] and self.blow.rank[0] and self.blow.sure > SHORT_BLOW * self.usual
        found = self.blow if short else self.largest
        stated = [sizes[k].deviation for k in self.columns]
        along, peak = float(along_itself(found.force, found.deviation)), float(np.linalg.norm(found.force))
        typical = [noise[k] if size is None else size for k, size in zip(self.columns, stated, strict=True)]
        return _Push(
            place=point_label(self.place),
            unit=self.unit,
            peak=peak,
            at=found.time - start,
            way=_way(found.force, self.axes),
            deviation=None if stated == [None] * len(stated) or (short and along > peak) else along,
            sure=found.sure / SURE_OF_CONTACT,
            rms=(self.squares / count) ** 0.5,
            lasting=(self.shares / count) ** 0.5,
            error=float(np.linalg.norm(typical)),
            short=short,
        )


def _pushes(estimate: StoredEstimate, start: float) -> list[_Push]:
    """Return the force, and the moment, at each place once the estimate has risen."""
    places = dict[tuple[str, str], dict[int, str]]()
    for k, label in enumerate(estimate.head.identifiability.components):
        place, _, axis = label.rpartition(".")
        places.setdefault((place or axis, estimate.head.units[k]), {})[k] = axis
    groups = [_Group(*place, list(axes), list(axes.values()), start) for place, axes in places.items()]
    noise, count = burst_noise(next(estimate.blocks()).components), 0
    for block in estimate.blocks():
        shown = block.shown & (block.time[:-1, None] > estimate.risen - 1e-9)
        components, deviations = np.where(shown, block.components, 0.0), np.broadcast_to(noise, shown.shape)
        if block.standard_deviation is not None:
            deviations = np.where(np.isfinite(block.standard_deviation), block.standard_deviation, noise)
        count += int(np.sum(shown.any(axis=1)))
        for group in groups:
            group.take(block.time, components, deviations, without_lag(block, deviations))
    sizes = estimate.component_sizes()
    return [group.push(start, max(count, 1), sizes, noise) for group in groups]


def _way(force: Array, axes: Sequence[str]) -> str:
    """Return the direction of a force (n,) along axes such as `Fx`, in words; nothing of a moment, or of one axis."""
    size, at = float(np.linalg.norm(force)), int(np.argmax(np.abs(force)))
    if len(force) == 1 or size == 0.0 or axes[at] not in WAYS:
        return ""
    if abs(force[at]) > MOSTLY * size:
        return f" {WAYS[axes[at]][int(force[at] < 0.0)]}"
    return f" along ({', '.join(f'{part:.2f}' for part in (force / size).round(2) + 0.0)})"


def _place_of(event: Contact, estimate: StoredEstimate) -> str:
    return event.point if estimate.head.frames else point_label(event.point.rpartition(".")[0])


def _contact(estimate: StoredEstimate, event: Contact, start: float) -> _Push:
    """Return a contact that a calibration found, at its largest."""
    head, components = estimate.head, estimate.head.identifiability.components
    frames = [point_label(frame) for frame in head.frames]
    columns = [3 * frames.index(event.point) + k for k in range(3)] if frames else [components.index(event.point)]
    place = _place_of(event, estimate)
    ends = event.onset - start, None if event.end is None else event.end - start
    during = during_contact(estimate, event)
    force = np.where(during.shown, during.components, 0.0)[:, columns]
    if not len(force):
        return _Push(place, event.unit, event.size, ends[0], "", None, np.inf, ends=ends)
    sure = during.standard_deviation
    at = largest_of(force, None if sure is None else sure[:, columns])
    way = _way(force[at], [components[k].rpartition(".")[2] for k in columns])
    along = None if sure is None else float(along_itself(force[at], sure[at, columns]))
    along = along if along is not None and np.isfinite(along) else None
    return _Push(place, event.unit, event.size, float(during.time[at]) - start, way, along, np.inf, ends=ends)


def _sureness(scores: ObserverScores, kind: str, certain: list[_Push], pushes: list[_Push]) -> str:
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
