"""Which components can be determined: rank, singular values, and combinations that leave no trace in the rows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from aerobat_pin.numerics import Array
from aerobat_pin.observers.applications import Applications
from aerobat_pin.observers.rows import UNSEEN_SHARE, BelievedRows

EXAMINED = 64  # worst instants of a run that are examined closely
RANK_TOLERANCE = 1.0e-6  # share of the largest singular value, below which a singular value counts as zero


@dataclass(frozen=True, repr=False)
class Identifiability:
    """Which components the geometry lets an observer determine, at the worst configuration of a run.

    A pattern is a combination of components. It leaves no trace if it does not change the rows that the observer uses.
    Everything here is computed from the map of components to these rows. In this map, moments are divided by a lever
    arm of 50 mm to compare them with forces; `null_space` alone has them as they are.

    Attributes:
        components: (c,) labels of the components, such as `tool.Fx`.
        rank: number of independent components that the rows determine.
        singular_values: (c,) singular values of the weighted map, largest first.
        null_space: (c - rank, c) unit patterns of components [N, N m] that leave no trace; the last is the faintest.
        deviation: (c,) standard deviation [N or N m] of each component if every weighted row has white noise of 1 N;
            infinite if the component belongs to a pattern that leaves no trace. Each at its own worst instant.
    """

    components: tuple[str, ...]
    rank: int
    singular_values: Array
    null_space: Array
    deviation: Array

    @property
    def null_direction(self) -> Array | None:
        """The faintest pattern, (n, 3) if the components are n forces, else (c,); None at full rank."""
        if not len(self.null_space):
            return None
        last: Array = self.null_space[-1]
        return last.reshape(-1, 3) if all(".F" in name for name in self.components) and len(last) % 3 == 0 else last

    @property
    def condition(self) -> float:
        """Ratio of largest to smallest singular value; infinite if the rank is not full, 1 without components."""
        if not self.singular_values.size:
            return 1.0
        return float("inf") if len(self.null_space) else float(self.singular_values[0] / self.singular_values[-1])

    def describe(self) -> list[str]:
        """Describe the patterns that leave no trace, one line for each; empty at full rank."""
        return [_pattern(self.components, row) for row in self.null_space]

    def __repr__(self) -> str:
        title = f"Identifiability: rank {self.rank} of {len(self.components)}, condition {self.condition:.3g}"
        return "\n".join([title, *(f"  no trace: {pattern}" for pattern in self.describe())])


def judge(
    applications: Applications, jacobians: Array, velocities: Array, believed: BelievedRows, pivots: Array | None = None
) -> Identifiability:
    """Return the identifiability at the worst instant of a run with Jacobians (m, c, nv) of the components.

    The joints' part of the velocities (m, nv) is the direction of the power row. `pivots` (m - 1,) are the smallest of
    the equations of each interval, over their trace: the smallest of all say which instants are worst, of which
    `EXAMINED` are looked at. When omitted, every instant is.
    """
    count = len(applications.components)
    if not count:
        return Identifiability((), 0, np.zeros(0), np.zeros((0, 0)), np.zeros(0))
    at = np.arange(len(jacobians))
    if pivots is not None and len(pivots) > EXAMINED:
        last = np.sort(np.argpartition(pivots, EXAMINED)[:EXAMINED])
        at = np.unique([last, last + 1])  # both ends of these intervals
    scale = applications.scale
    moving = velocities[at if believed.name == "base+power" else at[:1]]  # no other rows depend on the velocity
    chosen = scale[:, None] * (jacobians[at] @ believed.map(moving))
    squares = np.linalg.eigvalsh(chosen @ np.swapaxes(chosen, 1, 2))  # fast and accurate enough to find the worst
    worst = int(np.argmin(squares[:, 0] / np.maximum(squares[:, -1], 1e-300)))
    _, values, vectors = np.linalg.svd(chosen[worst].T, full_matrices=True)
    values = np.concatenate([values, np.zeros(count - len(values))])
    rank = int(np.sum(values > RANK_TOLERANCE * values[0]))
    if rank == count:
        seen = np.sqrt(np.max(np.diagonal(np.linalg.inv(chosen @ np.swapaxes(chosen, 1, 2)), axis1=1, axis2=2), axis=0))
    else:
        with np.errstate(divide="ignore", invalid="ignore"):
            seen = np.sqrt(np.sum((vectors[:rank] / values[:rank, None]) ** 2, axis=0))
    hidden = np.any(np.abs(vectors[rank:]) > UNSEEN_SHARE, axis=0)
    unseen = vectors[rank:] * scale  # as forces and moments, in N and N m
    return Identifiability(
        components=applications.components,
        rank=rank,
        singular_values=values,
        null_space=unseen / np.linalg.norm(unseen, axis=1, keepdims=True),
        deviation=np.where(hidden, np.inf, scale * seen),
    )


def _pattern(components: Sequence[str], row: Array) -> str:
    """Describe in words a pattern of components that leaves no trace."""
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
    parts = [f"{value:+.2g} {name}" for name, value in zip(components, row, strict=True) if abs(value) > 1e-3]
    return "together: " + ", ".join(parts)
