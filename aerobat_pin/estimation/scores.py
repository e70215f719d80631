"""Score estimates against the true forces: R2, error and lag for each axis, and what each observer says of itself."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field, fields
from typing import Any

import numpy as np

from aerobat_pin.estimation.trust import (
    POINT_SUFFIX,
    ComponentSize,
    FoundEvent,
    InnovationScore,
    component_sizes,
    found_events,
    innovation_score,
    warnings_about,
)
from aerobat_pin.estimation.use import CalibrationUse
from aerobat_pin.numerics import Array, guarded
from aerobat_pin.observers import Estimate, Redundancy

FORCE_AXES = ("Fx", "Fy", "Fz")
NO_SIGNAL = 1.0e-3  # [N]: if the true force has a smaller standard deviation, R2 is meaningless
TrueForce = Callable[[str], tuple[Array, Array]]
LONGEST_LAG = 0.05  # [s]: the longest lag that the search can find


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
        notes: a line of text about each thing that the observer chose or found beside the forces.
        events: contacts that were found; None where they were not sought, as without a calibration.
    """

    points: Mapping[str, Mapping[str, AxisScore]]
    components: tuple[ComponentSize, ...]
    gain: float | list[Any]
    rank: int
    condition: float | None
    null_direction: list[Any] | None
    unseen: list[str]
    redundancy: Redundancy
    deviation: Mapping[str, list[float | None]] | None
    innovation: InnovationScore | None
    warnings: list[str]
    notes: list[str]
    events: list[FoundEvent] | None = None

    def to_json(self) -> dict[str, Any]:
        """Return the entry of `metrics.json`, in which the points are keys beside the other attributes."""
        rest = asdict(self)
        rest |= {"components": list(rest["components"]), "redundancy": self.redundancy.to_json()}
        return {**rest.pop("points"), **rest}

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
            "redundancy": Redundancy.from_json(rest["redundancy"]),
            "events": None if rest["events"] is None else [FoundEvent(**event) for event in rest["events"]],
            "innovation": None if rest["innovation"] is None else InnovationScore(**rest["innovation"]),
        }
        return cls(points, **{**rest, **made})


@guarded()
def observer_scores(
    estimate: Estimate, truth: TrueForce | None = None, use: CalibrationUse | None = None
) -> ObserverScores:
    """Score an estimate; R2, error and lag are included only if the true forces are known.

    Args:
        estimate: the estimate.
        truth: frame -> true force and its noise-free part, (m, 3) each, world axes [N]; None if nobody knows them.
        use: how a calibration was used, with the contacts that were found.
    """
    found = estimate.identifiability
    points = {}
    if truth is not None:
        dt = float(np.median(np.diff(estimate.time)))
        for i, frame in enumerate(estimate.frames):
            actual, noise_free = truth(frame)
            points[point_label(frame)] = {
                axis: axis_score(estimate.force[:, i, k], actual[:, k], noise_free[:, k], dt)
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
        redundancy=estimate.redundancy,
        deviation=by_point,
        innovation=innovation_score(estimate),
        warnings=warnings_about(estimate),
        events=None if use is None or use.contacts is None else found_events(estimate, use.contacts),
        notes=list(estimate.notes),
    )


@guarded()
def point_label(frame: str) -> str:
    """Return the short name of a force point: `left` for `left_force_point`."""
    return frame.removesuffix(POINT_SUFFIX)


def axis_score(estimate: Array, truth: Array, noise_free: Array, dt: float) -> AxisScore:
    """Score one axis of a force, from interval means (m,) [N] over intervals of length dt [s]."""
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
