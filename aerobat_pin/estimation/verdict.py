"""What a record says, in one sentence: what pushed, how much, how sure that is, and what could not be seen.

It is about the first observer, which the sentence names, whether or not another one is nearer to the truth: on a real
robot nobody knows which one is.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from aerobat_pin.estimation.calibration_use import SURE_OF_CONTACT, ModelCheck
from aerobat_pin.estimation.findings import Finding
from aerobat_pin.estimation.observer_scores import ObserverScores
from aerobat_pin.estimation.scores import point_label, quantity, short_label
from aerobat_pin.estimation.stored_estimate import StoredEstimate
from aerobat_pin.estimation.trust import burst_noise

LASTING = 1.5  # or its rms: noise alone has one error
CROSSTALK = 0.02  # share of the largest force that its estimate leaves elsewhere
SAID_AT_MOST = 2  # pushes, or components, that a sentence names
MOSTLY = 0.8  # share of a force that is along an axis before the axis is named
SOMETIMES = 0.95  # share of the time below which a component is not always seen
WAYS = {"Fx": ("along x", "against x"), "Fy": ("along y", "against y"), "Fz": ("upward", "downward")}
COMPARED_WITH = {"truth": "true force", "sensor": "force sensor"}


@dataclass(frozen=True)
class _Push:
    """Force or moment at one place: largest size, its time after the start [s] and direction; rms and error."""

    place: str
    unit: str
    peak: float
    at: float
    way: str
    rms: float
    error: float

    def stands_out(self, least: float) -> bool:
        """Whether errors, or an error of the belief that looks like `least`, cannot make it up."""
        return self.peak > max(SURE_OF_CONTACT * self.error, least) or self.rms > max(LASTING * self.error, least)

    def __str__(self) -> str:
        return f"{self.place} (up to {quantity(self.peak, self.unit)}{self.way}, at {self.at:.2f} s)"


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
    pushes = _pushes(estimate, start)
    largest = {unit: max(push.peak for push in pushes if push.unit == unit) for unit in {push.unit for push in pushes}}
    least = {unit: CROSSTALK * size for unit, size in largest.items()}
    if estimate.head.expected_force is None:  # else the deviations contain the errors of the belief
        least["N"] = max(least.get("N", 0.0), estimate.redundancy.least)
    certain = sorted((push for push in pushes if push.stands_out(least[push.unit])), key=lambda push: -push.peak)
    unsure = [push.place for push in pushes if push not in certain]
    what = "a push" if estimate.head.frames else "a torque that the motion does not explain"
    sentence = f"{estimate.head.observer} finds " + (
        f"{what} at {_listed(certain)}" if certain else f"no {what[2:]} that stands out from its errors"
    )
    if events := scores.events:
        many = f"{len(events)} contacts, the first" if len(events) > 1 else "one contact,"
        sentence += f", in {many} at {events[0].onset - start:.2f} s"
    if certain and unsure:
        sentence += f"; nothing at {_listed(dict.fromkeys(unsure))} stands out from its errors"
    doubts = [f"the record contradicts itself: {finding.check}" for finding in findings if finding.verdict == "refused"]
    words, wrong = scores.judgement
    doubts += [words.removeprefix("belief: ").partition(";")[0]] * wrong
    doubts += ["something has changed since the calibration"] * (model is not None and model.verdict == "changed")
    return "; ".join([sentence, _sureness(scores, kind, certain or pushes), *doubts, _unseen(scores)]) + "."


def _listed(things: Iterable[object]) -> str:
    """Return the first few things, and how many more there are."""
    texts = [str(one) for one in things]
    more = len(texts) - SAID_AT_MOST
    texts = [*texts[:SAID_AT_MOST], f"{more} more"] if more > 0 else texts
    return " and ".join(filter(None, [", ".join(texts[:-1]), texts[-1]]))


def _pushes(estimate: StoredEstimate, start: float) -> list[_Push]:
    """Return the force, and the moment, at each place once the estimate has risen."""
    labels = [label.rpartition(".") for label in estimate.head.identifiability.components]
    groups = dict[tuple[str, str], list[int]]()
    for k, ((place, _, axis), unit) in enumerate(zip(labels, estimate.head.units, strict=True)):
        groups.setdefault((place or axis, unit), []).append(k)
    largest = {key: (0.0, start, np.zeros(len(columns))) for key, columns in groups.items()}
    squares, count = dict.fromkeys(groups, 0.0), 0
    for block in estimate.blocks():
        after = block.time[:-1, None] > estimate.risen - 1e-9
        values = np.where(block.shown & after, block.components, 0.0)
        count += int(after.sum())
        for key, columns in groups.items():
            sizes = np.linalg.norm(values[:, columns], axis=1)
            at = int(np.argmax(sizes))
            squares[key] += float(np.sum(sizes**2))
            if sizes[at] > largest[key][0]:
                largest[key] = float(sizes[at]), float(block.time[at]), values[at, columns]
    noise = burst_noise(next(estimate.blocks()).components)
    errors = [noise[k] if one.deviation is None else one.deviation for k, one in enumerate(estimate.component_sizes())]
    pushes = []
    for (place, unit), columns in groups.items():
        peak, time, vector = largest[place, unit]
        at = int(np.argmax(np.abs(vector)))
        ways = WAYS.get(labels[columns[at]][2]) if abs(vector[at]) > MOSTLY * peak else None
        way = f" {ways[int(vector[at] < 0.0)]}" if ways else ""
        rms, error = (squares[place, unit] / max(count, 1)) ** 0.5, float(np.linalg.norm([errors[k] for k in columns]))
        pushes.append(_Push(point_label(place), unit, peak, time - start, way, rms, error))
    return pushes


def _sureness(scores: ObserverScores, kind: str, pushes: list[_Push]) -> str:
    """Return how sure the forces are: errors against a reference, or as stated."""
    if scores.points:
        forces = {label: score for label, score in scores.scored.items() if label.rpartition(".")[2][0] == "F"}
        error = float(np.linalg.norm([score.rmse for score in forces.values()]))
        size = float(
            np.linalg.norm([part.rms or 0.0 for part in scores.components if short_label(part.name) in forces])
        )
        share = f"{100.0 * error / size:.2g} % of it" if 0.99 * size > error else "as much as it finds"
        where = f" at {_listed(scores.points)}" if kind == "sensor" else ""
        per_point = quantity(error / len(scores.points) ** 0.5, "N")
        return f"it is off the {COMPARED_WITH[kind]}{where} by {per_point} rms, {share}"
    if any(size.deviation is not None for size in scores.components):
        return f"its standard deviation, as stated, is {_listed(quantity(push.error, push.unit) for push in pushes)}"
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
