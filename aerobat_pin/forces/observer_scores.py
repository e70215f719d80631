"""What is known of each observer's estimate: an entry of `observers` in `metrics.json`."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, fields
from typing import Any

import numpy as np

from aerobat_pin.forces.against_reference import PairedEstimate
from aerobat_pin.forces.calibration_use import CalibrationUse, Contact
from aerobat_pin.forces.contacts import found_contacts
from aerobat_pin.forces.deviations import (
    DOUBT_STRETCH,
    MISFIT,
    ComponentSize,
    InnovationScore,
    belief_words,
    warnings_about,
)
from aerobat_pin.forces.scores import Score, one_unit, point_label, short_label
from aerobat_pin.forces.stored_estimate import StoredEstimate
from aerobat_pin.observers import DOUBTFUL, Redundancy

ScoreTable = tuple[tuple[str, ...], list[tuple[str, ...]]]  # header and rows
TEXT_COLUMNS = ("observer", "point", "axis", "component")  # which begin at the left
DOUBTFUL_STRETCH = 10.0  # times as large as stated over one second: what lasts for a part of a record is said, too
MEDIAN_DEVIATION = "median deviation"  # in tables, of where the component is seen
SIZE_HEADER = ("observer", "component", "mean", "rms", "least", "largest", MEDIAN_DEVIATION, "seen")


@dataclass(frozen=True)
class ObserverScores:
    """Scores of one observer.

    Attributes:
        points: point -> axis (`Fx`, ..., `Mz`) -> scores, where there is a reference.
        components: root mean square of each estimated component.
        mean: component -> mean, where it is seen; None where it never is.
        gain: gain K [1/s]: a number, a list with one number for each filtered quantity, or a matrix as nested lists.
        rows: which rows of the residual are used.
        rank: rank of the linear equations for the unknown components.
        condition: condition number of the same equations; None if it is infinite.
        null_direction: combination of components that cannot be estimated because it has no effect on the equations;
            of several, the one with the smallest singular value. Its shape is (n, 3) if the components are n forces in
            world axes, else (c,). None at full rank.
        unseen: a line of text about each combination of components that cannot be estimated.
        redundancy: what no force explains, and what this says about the belief.
        deviation: point -> median of the standard deviation of its three forces, None where it is infinite;
            None if the observer states none.
        innovation: how well a filter predicts the samples; None for other observers.
        warnings: a line of text about each property of this observer that spoils the estimate.
        notes: a line of text about each thing that the observer chose or found beside the forces.
        seen: point -> share of the time in which its three forces are seen; None if no force was expected.
        k: how many times as large as stated the squared errors of the rows are; None if that cannot be seen.
        worst_k: the largest k over a second, and when after the start that begins [s]; None as for `k`, 0 of a shorter
            record.
        events: contacts that were found; None where they were not sought, as without a calibration.
    """

    points: Mapping[str, Mapping[str, Score]]
    components: tuple[ComponentSize, ...]
    mean: Mapping[str, float | None]
    gain: float | list[Any]
    rows: str
    rank: int
    condition: float | None
    null_direction: list[Any] | None
    unseen: list[str]
    redundancy: Redundancy
    deviation: Mapping[str, list[float | None]] | None
    innovation: InnovationScore | None
    warnings: list[str]
    notes: list[str]
    seen: Mapping[str, list[float | None]] | None = None
    k: float | None = None
    worst_k: tuple[float, float] | None = None
    events: list[Contact] | None = None

    @classmethod
    def of(
        cls,
        estimate: StoredEstimate,
        start: float,
        compared: Iterable[PairedEstimate] = (),
        use: CalibrationUse | None = None,
    ) -> ObserverScores:
        """Score an estimate, beside its references, with the contacts that were found by use of a calibration.

        Times count from a start [s].
        """
        head, identifiability, components = estimate.head, estimate.head.identifiability, estimate.component_sizes()
        worst = estimate.worst_doubt

        def by_point(values: list[float | None], stated: object) -> dict[str, list[float | None]] | None:
            if stated is None or not head.are_world_forces:
                return None
            return {point_label(frame): values[3 * i : 3 * i + 3] for i, frame in enumerate(head.frames)}

        return cls(
            points={point_label(side.reference.frame): side.scores() for side in compared},
            components=components,
            mean={
                name: float(mean) if np.isfinite(mean) else None
                for name, mean in zip(identifiability.components, estimate.mean, strict=True)
            },
            gain=head.gain.tolist(),
            rows=head.rows,
            rank=identifiability.rank,
            condition=identifiability.condition if np.isfinite(identifiability.condition) else None,
            null_direction=None if identifiability.null_direction is None else identifiability.null_direction.tolist(),
            unseen=identifiability.describe() if head.expected_force is None else [],
            redundancy=estimate.redundancy,
            deviation=by_point([size.deviation for size in components], head.standard_deviation),
            seen=by_point([size.seen for size in components], head.seen),
            k=estimate.doubt,
            worst_k=None if worst is None else (worst[0], worst[1] - start),
            innovation=estimate.innovation,
            warnings=warnings_about(next(estimate.blocks())),
            events=found_contacts(estimate, use),
            notes=list(head.notes),
        )

    @property
    def scored(self) -> dict[str, Score]:
        """Component, such as `left.Fx` -> its score."""
        return {f"{point}.{axis}": score for point, axes in self.points.items() for axis, score in axes.items()}

    @property
    def states_seen(self) -> bool:
        """Whether sizes were expected, so that it is stated how much of each component is seen."""
        return any(size.seen is not None for size in self.components)

    @property
    def judgement(self) -> tuple[str, bool]:
        """What no force explains says about the belief, in words, and whether the belief is wrong."""
        if self.k is None and self.states_seen:
            return "belief: cannot be judged, as no row is to spare", False
        if self.k is None:
            return self.redundancy.describe(), self.redundancy.verdict == "inconsistent"
        words = belief_words(self.k)
        k, begin = self.worst_k or (self.k, 0.0)
        if k > DOUBTFUL_STRETCH and f"{k:.2g}" != f"{self.k:.2g}":  # a filter knows but the mean
            words += f", {k:.2g} times from {begin:.1f} to {begin + DOUBT_STRETCH:.1f} s"
        doubtful = self.k > DOUBTFUL or k > DOUBTFUL_STRETCH
        return f"{words}: {MISFIT}" if doubtful else words, doubtful

    def to_json(self) -> dict[str, Any]:
        """Return the entry of `metrics.json`, in which the points are keys beside the other attributes.

        Where the errors of the rows are stated, the verdict of the redundancy is by these, as everywhere.
        """
        entry, redundancy = asdict(self), self.redundancy.to_json()
        if self.states_seen and redundancy["verdict"] != "blind":
            words, wrong = self.judgement
            redundancy |= {"words": words, "verdict": "inconsistent" if wrong else "consistent"}
        entry |= {"components": list(entry["components"]), "redundancy": redundancy}
        points = {name: {axis: score.to_json() for axis, score in axes.items()} for name, axes in self.points.items()}
        return {**points, **{key: value for key, value in entry.items() if key != "points"}}

    @classmethod
    def from_json(cls, entry: Mapping[str, Any]) -> ObserverScores:
        """Read an entry of `metrics.json`."""
        values: dict[str, Any] = {item.name: entry.get(item.name) for item in fields(cls) if item.name != "points"}
        points = {
            name: {axis: Score(**score) for axis, score in axes.items()}
            for name, axes in entry.items()
            if name not in values
        }
        typed = {
            "components": tuple(ComponentSize(**size) for size in values["components"]),
            "redundancy": Redundancy.from_json(values["redundancy"]),
            "events": None if values["events"] is None else [Contact(**event) for event in values["events"]],
            "worst_k": None if values["worst_k"] is None else tuple(values["worst_k"]),
            "innovation": None if values["innovation"] is None else InnovationScore(**values["innovation"]),
        }
        return cls(points, **{**values, **typed})


def score_table(observers: Mapping[str, ObserverScores]) -> ScoreTable:
    """Return the table of scores, without columns that say nothing, and rows of a truth that is no force."""
    tells = any(score.tells for scores in observers.values() for score in scores.scored.values())
    say, rows = one_unit(_sizes_of(observers.values())), []
    for name, scores in observers.items():
        sizes = {short_label(size.name): size for size in scores.components}
        for point, axes in scores.points.items():
            for axis, score in axes.items():
                if tells and not score.tells:
                    continue
                component = sizes[f"{point}.{axis}"]
                cells = {"observer": name, "point": point, "axis": axis, **_score_cells(score, component.unit, say)}
                rows.append({**cells, MEDIAN_DEVIATION: component.certainty(say)})
    always = all(row.get("rms where seen") == row["error rms"] for row in rows)
    hidden = {"R2 where seen", "rms where seen"} if always else set()
    keys = dict.fromkeys(key for row in rows for key, cell in row.items() if cell != "-" and key not in hidden)
    header = tuple(sorted(keys, key=MEDIAN_DEVIATION.__eq__))  # the median comes last
    return header, [tuple(row.get(key, "-") for key in header) for row in rows]


def _sizes_of(observers: Iterable[ObserverScores]) -> Iterator[float | None]:
    """Yield the sizes [N, N m] in a table of scores."""
    for scores in observers:
        yield from (size.deviation for size in scores.components if short_label(size.name) in scores.scored)
        for score in scores.scored.values():
            yield from (score.rmse, score.rmse_seen, score.rmse_outside_fit, score.offset)


def _score_cells(score: Score, unit: str, say: Callable[[float, str], str]) -> dict[str, str]:
    """Return the cells of a score, without those that have no meaning."""

    def r2(value: float | None) -> str:
        return "no signal" if value is None else f"{value:.5f}"

    def size(value: float) -> str:
        return say(value, unit)

    cells = {"R2": r2(score.r2)}
    if score.factor is None and score.offset is None:
        cells["R2 noise-free"] = r2(score.r2_noise_free)
    cells["error rms"] = size(score.rmse)
    if score.rmse_seen is not None:
        cells |= {"R2 where seen": r2(score.r2_seen), "rms where seen": size(score.rmse_seen)}
    if score.rmse_outside_fit is not None:
        cells |= {"R2 unfitted": r2(score.r2_outside_fit), "unfitted rms": size(score.rmse_outside_fit)}
    if score.offset is not None:
        cells["factor"] = "-" if score.factor is None else f"{score.factor:.4f}"
        cells["offset"] = size(score.offset)
    return {**cells, "lag": "-" if score.lag_s is None else f"{1e3 * score.lag_s:.2f} ms"}


def size_table(stored: Mapping[str, StoredEstimate]) -> list[tuple[str, ...]]:
    """Return the header, and a row for each component."""
    rows: list[tuple[str, ...]] = [SIZE_HEADER]
    for name, estimate in stored.items():
        least, most = estimate.extremes
        sizes = zip(estimate.component_sizes(), estimate.mean, least, most, strict=True)
        for size, mean, low, high in sizes:
            numbers = ("" if size.rms is None else f"{value:.4g} {size.unit}" for value in (mean, size.rms, low, high))
            seen = "-" if size.seen is None else f"{size.seen:.0%}"
            rows.append((name, size.name, *numbers, size.certainty("{:.4g} {}".format), seen))
    return rows


def text_table(cells: Sequence[tuple[str, ...]]) -> list[str]:
    """Return a table, its header first, as lines of text with columns as wide as they need to be."""
    widths = [max(map(len, column)) for column in zip(*cells, strict=True)]
    return [
        " ".join(
            cell.ljust(width) if name in TEXT_COLUMNS else cell.rjust(width + 1)
            for name, cell, width in zip(cells[0], row, widths, strict=True)
        )
        for row in cells
    ]
