"""How far an estimate can be trusted: size and deviation of its components, what no force explains, warnings."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from aerobat_pin.observers import Estimate, MomentumObserver, Redundancy


@dataclass(frozen=True)
class ComponentSize:
    """Size of an estimated force component over the flight.

    Attributes:
        name: label of the component.
        rms: root mean square of the estimate.
        unit: N or N m.
        deviation: root mean square of the standard deviation that the observer states; None if it states none, or if
            it is infinite.
        unseen: whether the component belongs to a pattern that leaves no trace at some instant of the flight.
    """

    name: str
    rms: float
    unit: str
    deviation: float | None = None
    unseen: bool = False

    @property
    def certainty(self) -> str:
        """The deviation as text: `infinite` if the component is unseen, `-` if the observer states none."""
        if self.unseen:
            return "infinite"
        return "-" if self.deviation is None else f"{1e3 * self.deviation:.2f} m{self.unit}"


@dataclass(frozen=True)
class BeliefScore:
    """What no force explains, in N per redundant row; see `aerobat_pin.observers.Redundancy`.

    Attributes:
        rms: root mean square of the residual that no force explains.
        rows: number of rows in use.
        redundant: number of rows beyond the rank.
        sensors: part of the slow residual that sensor noise explains.
        belief: the rest of it.
        allowed: largest `belief` that counts as consistent.
        verdict: `consistent`, `inconsistent` or `blind`.
        words: the verdict in words.
    """

    rms: float
    rows: int
    redundant: int
    sensors: float
    belief: float
    allowed: float
    verdict: str
    words: str


@dataclass(frozen=True)
class InnovationScore:
    """Mean normalised innovation squared `nis` of a filter (1 if it errs as it says), and their `whiteness` (0)."""

    nis: float
    whiteness: float


def component_sizes(estimate: Estimate) -> tuple[ComponentSize, ...]:
    """Return size and deviation of each estimated component."""
    found, count = estimate.identifiability, len(estimate.units)
    sizes = np.sqrt(np.mean(estimate.components**2, axis=0)).tolist()
    sure: list[float | None] = [None] * count
    if estimate.standard_deviation is not None:
        own = np.sqrt(np.mean(estimate.standard_deviation**2, axis=0))
        sure = [float(size) if np.isfinite(size) else None for size in own]
    return tuple(map(ComponentSize, found.components, sizes, estimate.units, sure, np.isinf(found.deviation).tolist()))


def belief_score(redundancy: Redundancy) -> BeliefScore:
    """Return the numbers and words of what no force explains."""
    numbers = {item.name: getattr(redundancy, item.name) for item in fields(BeliefScore) if item.name != "words"}
    return BeliefScore(**numbers, words=redundancy.describe())


def innovation_score(estimate: Estimate) -> InnovationScore | None:
    """Return the summary of a filter's innovations; None for other observers."""
    found = estimate.innovation
    return None if found is None else InnovationScore(found.mean, found.whiteness)


def warnings_about(estimate: Estimate) -> list[str]:
    """Return what spoils this estimate although the rows determine it."""
    if estimate.observer == MomentumObserver.name and estimate.rows == "base+power":
        return [
            "filters the rows before it combines them with the motor's power, which holds at each instant only: the "
            "force between the points is wrong; force_level, kalman and smoother project first"
        ]
    return []
