"""Score estimates against the true forces (R2, error and lag for each axis); `Scores` is all of `metrics.json`."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, field, fields
from typing import Any

import numpy as np

from aerobat_pin.estimation.contradictions import Contradiction
from aerobat_pin.estimation.flight_summary import FlightSummary
from aerobat_pin.estimation.trust import (
    BeliefScore,
    ComponentSize,
    InnovationScore,
    belief_score,
    component_sizes,
    innovation_score,
    warnings_about,
)
from aerobat_pin.estimation.truth import true_force
from aerobat_pin.flight import FlightLog
from aerobat_pin.numerics import Array, guarded
from aerobat_pin.observers import Estimate

FORCE_AXES = ("Fx", "Fy", "Fz")
NO_SIGNAL = 1.0e-3  # [N]: if the true force has a smaller standard deviation, R2 is meaningless
LONGEST_LAG = 0.05  # [s]: the longest lag that the search can find
TABLE_HEADER = ("observer", "point", "axis", "R2", "R2 noise-free", "error rms", "lag", "deviation")


def _quantity(unit: str, meaning: str) -> dict[str, str]:
    return {"unit": unit, "meaning": meaning}


@dataclass(frozen=True)
class AxisScore:
    """Scores of one axis of one force; the metadata of each field names its unit.

    R2 and lag are None if the true force hardly varies (see `NO_SIGNAL`); the lag also if none is found.
    """

    r2: float | None = field(metadata=_quantity("1", "R2 against the true force with its noise"))
    r2_noise_free: float | None = field(metadata=_quantity("1", "R2 against the noise-free part of the true force"))
    rmse: float = field(metadata=_quantity("N", "root mean square error against the true force with its noise"))
    lag_s: float | None = field(metadata=_quantity("s", "delay of the noise-free truth that fits the estimate best"))

    def texts(self) -> tuple[str, str, str, str]:
        """Return the scores as text, in the order of the table's columns."""
        r2, noise_free = ("no signal" if score is None else f"{score:.5f}" for score in (self.r2, self.r2_noise_free))
        return r2, noise_free, f"{1e3 * self.rmse:.2f} mN", "-" if self.lag_s is None else f"{1e3 * self.lag_s:.2f} ms"


@dataclass(frozen=True)
class ObserverScores:
    """Scores of one observer: an entry of `observers` in `metrics.json`.

    Attributes:
        points: point -> axis (`Fx`, `Fy`, `Fz`) -> scores; empty if the log does not contain the true forces.
        components: root mean square of each estimated component.
        gain: gain K [1/s]: a number, a list with one number for each filtered quantity, or a matrix as nested lists.
        rank: rank of the linear equations for the unknown components.
        condition: condition number of the same equations; None if it is infinite.
        null_direction: combination of components that cannot be estimated because it has no effect on the equations;
            of several, the one with the smallest singular value. Its shape is (n, 3) if the components are n forces in
            world axes, else (c,). None at full rank.
        unseen: a line of text about each combination of components that cannot be estimated.
        redundancy: what no force explains, and what this says about the belief.
        deviation: point -> root mean square of the standard deviation of its three forces, None where it is infinite;
            None if the observer states none.
        innovation: how well a filter predicts the samples; None for other observers.
        warnings: a line of text about each property of this observer that spoils the estimate.
    """

    points: Mapping[str, Mapping[str, AxisScore]]
    components: tuple[ComponentSize, ...]
    gain: float | list[Any]
    rank: int
    condition: float | None
    null_direction: list[Any] | None
    unseen: list[str]
    redundancy: BeliefScore
    deviation: Mapping[str, list[float | None]] | None
    innovation: InnovationScore | None
    warnings: list[str]

    def to_json(self) -> dict[str, Any]:
        """Return the entry of `metrics.json`, in which the points are keys beside the other attributes."""
        rest = asdict(self)
        return {**rest.pop("points"), **rest, "components": list(rest["components"])}

    @classmethod
    def from_json(cls, entry: Mapping[str, Any]) -> ObserverScores:
        """Read an entry of `metrics.json`."""
        rest = {item.name: entry[item.name] for item in fields(cls) if item.name != "points"}
        points = {
            name: {axis: AxisScore(**score) for axis, score in axes.items()}
            for name, axes in entry.items()
            if name not in rest
        }
        made = {
            "components": tuple(ComponentSize(**size) for size in rest["components"]),
            "redundancy": BeliefScore(**rest["redundancy"]),
            "innovation": None if rest["innovation"] is None else InnovationScore(**rest["innovation"]),
        }
        return cls(points, **{**rest, **made})


@dataclass(frozen=True, repr=False)
class Scores:
    """The content of `metrics.json`; `print` shows it as the table that the commands print.

    Attributes:
        scenario: name of the scenario, or of the recorded flight.
        seed: seed of the random numbers; None for a recorded flight.
        versions: package -> version.
        torque: which joint torque the observers knew, as `observers.torque` of the scenario.
        inputs: input of the observers -> its source, such as `measured`.
        note: a line about the flight.
        observers: name -> scores of the observer.
        contradictions: those between the channels of the log.
        flight: summary of the flight; None for a recorded flight.
    """

    scenario: str
    seed: int | None
    versions: Mapping[str, str]
    torque: str
    inputs: Mapping[str, str]
    note: str
    observers: Mapping[str, ObserverScores]
    contradictions: tuple[Contradiction, ...] = ()
    flight: FlightSummary | None = None

    def to_json(self) -> dict[str, Any]:
        """Return the content of `metrics.json`."""
        values: dict[str, Any] = {item.name: getattr(self, item.name) for item in fields(self)}
        values |= {"versions": dict(self.versions), "inputs": dict(self.inputs)}
        values["observers"] = {name: found.to_json() for name, found in self.observers.items()}
        values["warnings"] = self.warnings
        del values["contradictions"]
        flight = values.pop("flight")
        return values if flight is None else {**values, "flight": flight.to_json()}

    @property
    def verdicts(self) -> dict[str, list[str]]:
        """What the redundancy says about the belief: line of text -> observers that say it."""
        lines: dict[str, list[str]] = {}
        for name, found in self.observers.items():
            lines.setdefault(found.redundancy.words, []).append(name)
        return lines

    @property
    def warnings(self) -> list[str]:
        """Lines of text about what spoils the estimates: a log that contradicts itself, a wrong belief, an observer."""
        lines = [contradiction.text for contradiction in self.contradictions]
        lines += [
            f"{', '.join(names)}: {words}"
            for words, names in self.verdicts.items()
            if self.observers[names[0]].redundancy.verdict == "inconsistent"
        ]
        return lines + [f"{name}: {line}" for name, found in self.observers.items() for line in found.warnings]

    def rows(self) -> Iterator[tuple[str, ...]]:
        """Yield the rows of the table, with the columns of `TABLE_HEADER`; none if the true forces are unknown."""
        for name, found in self.observers.items():
            yield from _table_rows(name, found)

    @property
    def title(self) -> str:
        """One line about the flight: scenario, seed, note and joint torque."""
        seed = "" if self.seed is None else f", seed {self.seed}"
        return f"{self.scenario}{seed}: {self.note}; motor torque {self.torque}"

    @property
    def worse_than_nothing(self) -> bool:
        """Whether any R2 is below 0, as with strong sensor noise: the true mean would then be a better estimate."""
        points = [axes for found in self.observers.values() for axes in found.points.values()]
        return any((score.r2_noise_free or 0.0) < 0.0 for axes in points for score in axes.values())

    def __repr__(self) -> str:
        """Return title, warnings and table as text; forces that cannot be estimated precede an observer's rows."""
        lines = [self.title, *(f"warning: {contradiction.text}" for contradiction in self.contradictions)]
        if any(found.points for found in self.observers.values()):
            lines.append(_line(TABLE_HEADER))
        for name, found in self.observers.items():
            lines += [f"{name}: rank {found.rank}; cannot be seen at all: {pattern}" for pattern in found.unseen]
            lines += [_line(row) for row in _table_rows(name, found)]
            if found.innovation is not None:
                lines.append(
                    f"{name}: innovations {found.innovation.nis:.2g} of their variance (1 if exact), correlation of "
                    f"neighbours {found.innovation.whiteness:.2f} (0 if exact)"
                )
            lines += [f"{name}: {line}" for line in found.warnings]
        for words, names in self.verdicts.items():
            lines.append(words if len(self.verdicts) == 1 else f"{', '.join(names)}: {words}")
        return "\n".join(lines)


def _table_rows(observer: str, found: ObserverScores) -> Iterator[tuple[str, ...]]:
    certainties = iter(size.certainty for size in found.components)
    for point, axes in found.points.items():
        for axis, score in axes.items():
            yield (observer, point, axis, *score.texts(), next(certainties))


def _line(cells: tuple[str, ...]) -> str:
    name, point, axis, r2, noise_free, error, lag, sure = cells
    return f"{name:<12} {point:<12} {axis:<4} {r2:>9} {noise_free:>14} {error:>10} {lag:>9} {sure:>10}"


@guarded()
def observer_scores(estimate: Estimate, log: FlightLog) -> ObserverScores:
    """Score an estimate; R2, error and lag are included only if the log contains the true forces."""
    found = estimate.identifiability
    points = {}
    if log.truth is not None:
        dt = float(np.median(np.diff(estimate.time)))
        for i, frame in enumerate(estimate.frames):
            truth, noise_free = true_force(log, frame)
            points[point_label(frame)] = {
                axis: axis_score(estimate.force[:, i, k], truth[:, k], noise_free[:, k], dt)
                for k, axis in enumerate(FORCE_AXES)
            }
    components = component_sizes(estimate)
    by_point = None
    if estimate.standard_deviation is not None and estimate.are_world_forces:
        sure = [size.deviation for size in components]
        by_point = {point_label(frame): sure[3 * i : 3 * i + 3] for i, frame in enumerate(estimate.frames)}
    return ObserverScores(
        points=points,
        components=components,
        gain=estimate.gain.tolist(),
        rank=found.rank,
        condition=found.condition if np.isfinite(found.condition) else None,
        null_direction=None if found.null_direction is None else found.null_direction.tolist(),
        unseen=found.describe(),
        redundancy=belief_score(estimate.redundancy),
        deviation=by_point,
        innovation=innovation_score(estimate),
        warnings=warnings_about(estimate),
    )


@guarded()
def point_label(frame: str) -> str:
    """Return the short name of a force point: `left` for `left_force_point`."""
    return frame.removesuffix("_force_point")


def axis_score(estimate: Array, truth: Array, noise_free: Array, dt: float) -> AxisScore:
    """Score one axis of a force.

    Args:
        estimate: (m,) estimated force, interval means [N].
        truth: (m,) true force with its noise, interval means [N].
        noise_free: (m,) noise-free part of the true force, interval means [N].
        dt: length of the intervals [s].
    """
    return AxisScore(
        r2=r_squared(estimate, truth),
        r2_noise_free=r_squared(estimate, noise_free),
        rmse=float(np.sqrt(np.mean((estimate - truth) ** 2))),
        lag_s=lag(estimate, noise_free, dt),
    )


@guarded(estimate=("m",), truth=("m",))
def r_squared(estimate: Array, truth: Array) -> float | None:
    """Return R2 = 1 - SSE/SST of two series (m,) [N], or None if the standard deviation of `truth` is below 1 mN."""
    if np.std(truth) < NO_SIGNAL:
        return None
    return float(1.0 - np.sum((estimate - truth) ** 2) / np.sum((truth - np.mean(truth)) ** 2))


def lag(estimate: Array, truth: Array, dt: float) -> float | None:
    """Return the lag of an estimate: the delay [s] of `truth` (m,) with the smallest squared error to `estimate` (m,).

    A parabola interpolates between samples. The result is None if `truth` hardly varies, or if the best delay lies at
    an end of the searched range, 0 to 50 ms (less for a short flight).
    """
    if np.std(truth) < NO_SIGNAL:
        return None
    longest = min(max(2, round(LONGEST_LAG / dt)), len(truth) // 4)
    # Row i of `windows` is the truth at delay longest - i samples, cut to the samples in which every delay has data.
    windows = np.lib.stride_tricks.sliding_window_view(truth, len(truth) - 1 - longest)
    errors = np.mean((estimate[longest:-1] - windows[longest + 1 :: -1]) ** 2, axis=1)
    best = int(np.argmin(errors))
    if best in (0, len(errors) - 1):
        return None
    before, here, after = errors[best - 1 : best + 2]
    bend = before - 2.0 * here + after
    offset = 0.5 * (before - after) / bend if bend > 0.0 else 0.0
    return float((best - 1 + offset) * dt)
