"""How much of the unknown forces can be known at all: rank, singular values, patterns that leave no trace."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from aerobat_pin.numerics import Array
from aerobat_pin.observers.applications import Applications
from aerobat_pin.observers.rows import BelievedRows

RANK_TOLERANCE = 1.0e-6  # of the largest singular value


@dataclass(frozen=True, repr=False)
class Identifiability:
    """What the geometry lets an observer know, at the worst configuration of a run.

    It follows from the map of components to believed rows, in which a moment counts as a force at a lever of 50 mm.

    Attributes:
        components: (c,) their labels, such as `tool.Fx`.
        rank: number of independent components that the rows determine.
        singular_values: (c,) of the weighted map, largest first.
        null_space: (c - rank, c) unit patterns of components that leave no trace; the last is the faintest.
        deviation: (c,) standard deviation [N or N m] of each component per newton of white noise on every weighted
            row; infinite where a component belongs to a pattern that leaves no trace.
    """

    components: tuple[str, ...]
    rank: int
    singular_values: Array
    null_space: Array
    deviation: Array

    @property
    def null_direction(self) -> Array | None:
        """The faintest pattern, (n, 3) where the components are n forces in world axes; None at full rank."""
        if not len(self.null_space):
            return None
        last: Array = self.null_space[-1]
        return last.reshape(-1, 3) if all(".F" in name for name in self.components) and len(last) % 3 == 0 else last

    @property
    def condition(self) -> float:
        """Largest over smallest singular value; infinite where the rank is not full, 1 without components."""
        if not self.singular_values.size:
            return 1.0
        return float("inf") if len(self.null_space) else float(self.singular_values[0] / self.singular_values[-1])

    def describe(self) -> list[str]:
        """Say in words which patterns leave no trace, one line each; empty at full rank."""
        return [_pattern(self.components, row) for row in self.null_space]

    def __repr__(self) -> str:
        """Give rank, condition and what leaves no trace."""
        title = f"Identifiability: rank {self.rank} of {len(self.components)}, condition {self.condition:.3g}"
        return "\n".join([title, *(f"  no trace: {pattern}" for pattern in self.describe())])


def judge(
    applications: Applications, jacobians: Array, velocities: Array, believed: BelievedRows, samples: int = 64
) -> Identifiability:
    """Find the worst of up to `samples` instants, spread evenly over those of a run.

    Args:
        applications: where the unknown forces act.
        jacobians: (m, c, nv).
        velocities: (m, nv), whose joint part is the direction of the power row.
        believed: rows of the generalised residual.
        samples: how many instants to look at.
    """
    count = len(applications.components)
    if not count:
        return Identifiability((), 0, np.zeros(0), np.zeros((0, 0)), np.zeros(0))
    at = np.unique(np.linspace(0, len(jacobians) - 1, samples).astype(int))
    scale = applications.scale
    maps = [believed.map(velocities[i]) for i in (at if believed.name == "base+power" else at[:1])]
    chosen = scale[:, None] * (jacobians[at] @ np.stack(maps))
    squares = np.linalg.eigvalsh(chosen @ np.swapaxes(chosen, 1, 2))  # quick, and exact enough to find the worst
    worst = int(np.argmin(squares[:, 0] / np.maximum(squares[:, -1], 1e-300)))
    _, values, vectors = np.linalg.svd(chosen[worst].T, full_matrices=True)
    values = np.concatenate([values, np.zeros(count - len(values))])
    rank = int(np.sum(values > RANK_TOLERANCE * values[0]))
    with np.errstate(divide="ignore", invalid="ignore"):
        seen = np.sqrt(np.sum((vectors[:rank] / values[:rank, None]) ** 2, axis=0))
    hidden = np.any(np.abs(vectors[rank:]) > 1e-3, axis=0)
    return Identifiability(
        components=applications.components,
        rank=rank,
        singular_values=values,
        null_space=vectors[rank:],
        deviation=np.where(hidden, np.inf, scale * seen),
    )


def _pattern(components: Sequence[str], row: Array) -> str:
    """Name a pattern of components that leaves no trace."""
    points: dict[str, Array] = {}
    for name, value in zip(components, row, strict=True):
        frame, axis = name.rsplit(".", 1)
        if axis in ("Fx", "Fy", "Fz"):
            points.setdefault(frame, np.zeros(3))["xyz".index(axis[1])] = value
        elif abs(value) > 1e-6:
            points = {}
            break
    loud = [frame for frame, force in points.items() if np.linalg.norm(force) > 1e-6]
    if len(loud) == 2 and np.allclose(points[loud[0]], -points[loud[1]], atol=1e-6):
        return f"equal and opposite along the line from {loud[0]} to {loud[1]}"
    parts = [f"{value:+.2f} {name}" for name, value in zip(components, row, strict=True) if abs(value) > 5e-3]
    return "together: " + ", ".join(parts)
