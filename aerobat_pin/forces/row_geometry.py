"""What the errors of the rows do to forces, and to what no force explains, along a motion.

With L the weighted rows in use and A = (J L)^T the forces' part in them, the best forces are A^+ L^T phi and no force
explains N L^T phi, N = I - A A^+. An error of the generalised force with covariance S S^T therefore gives forces the
covariance A^+ L^T S S^T L A^+^T, and what no force explains the mean square tr(N L^T S S^T L N).
Other rows check a row's error as far as its leverage on the forces leaves.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from aerobat_pin.forces.inputs import KnownInputs
from aerobat_pin.numerics import Array
from aerobat_pin.observers import Observer, typical_step

GEOMETRY_SPACING = 0.004  # [s] between the instants at which the geometry is evaluated
LEAST_SEEN = 1.0e-5  # of the largest singular value: fainter patterns of forces leave no trace
LEAST_TRACE = 1e-9  # of that of rows over their errors: a fainter force leaves none


@dataclass(frozen=True)
class RowGeometry:
    """The geometry at some intervals of a stretch."""

    at: NDArray[np.intp]  # (n,) indices of the intervals
    rows: Array  # (n, nv, k) L
    forces: Array  # (n, c, k) A^+; patterns of forces without a trace get nothing
    projector: Array  # (n, k, k) N

    @classmethod
    def of(cls, observer: Observer, inputs: KnownInputs) -> RowGeometry:
        """Return the geometry of an observer's rows and forces along a motion."""
        at = np.arange(0, len(inputs.tau), max(1, round(GEOMETRY_SPACING / typical_step(inputs.time))))
        middle = 0.5 * (inputs.v[at] + inputs.v[at + 1])
        rows = observer.believed.map(middle)
        seen = observer.applications.jacobian(inputs.q[at]) @ rows
        scale = observer.applications.scale[:, None]
        A = np.swapaxes(scale * seen, 1, 2)
        inverse = np.linalg.pinv(A, rcond=LEAST_SEEN)
        return cls(at, rows, scale * inverse, np.eye(A.shape[1]) - A @ inverse)

    def weighted(self, factors: Array) -> Array:
        """Return L^T S (n, k, r) of factors S (m, nv, r) in all intervals."""
        return np.asarray(np.swapaxes(self.rows, 1, 2) @ factors[self.at])

    def deviations(self, factors: Array) -> Array:
        """Return the standard deviations (m, c) of the components if the rows' errors have factors S (m, nv, r)."""
        deviations = np.sqrt(np.sum((self.forces @ self.weighted(factors)) ** 2, axis=2))
        every = np.arange(len(factors))
        return np.column_stack([np.interp(every, self.at, values) for values in deviations.T])

    def unexplained_square(self, factors: Array) -> Array:
        """Return the expected square (n,) [N^2], summed over rows, of what no force explains of such errors."""
        return np.asarray(np.sum((self.projector @ self.weighted(factors)) ** 2, axis=(1, 2)))

    def unexplained(self, force: Array) -> Array:
        """Return what no force explains (m, k) [N] of a generalised force (m, nv), between the instants linearly."""
        every = np.arange(len(force))
        place = np.searchsorted(self.at, every, "right") - 1
        after = np.minimum(place + 1, len(self.at) - 1)
        gap = np.maximum(self.at[after] - self.at[place], 1)
        share = np.minimum((every - self.at[place]) / gap, 1.0)[:, None]
        rows = [np.einsum("nvk,nv->nk", self.rows[index], force) for index in (place, after)]
        both = [np.einsum("nkl,nl->nk", self.projector[k], row) for k, row in zip((place, after), rows, strict=True)]
        return np.asarray((1.0 - share) * both[0] + share * both[1])


def spare_share(J: Array, force: Array, error: Array) -> Array:
    """Return which share (k,) of each row's error the other rows show whatever the forces are: 1 - its leverage."""
    return np.asarray(np.mean(_pseudo_inverse(J, force, error)[1], axis=0))


def checked_share(J: Array, force: Array, error: Array) -> tuple[Array, Array]:
    """Return how much of the rows that show each component others check (c,), and each row's share in it (c, k).

    The first is the mean of `spare_share`, by the shares of the rows, which are those of what errors make of it.

    Args:
        J: (m, c, k) Jacobian of the components.
        force: (c,) or (m, c) what is expected of these [N or N m].
        error: (k,), or (m, 1, k), of each row [N or N m].
    """
    inverse, spare = _pseudo_inverse(J, force, error)
    shares = inverse**2 / np.maximum(np.sum(inverse**2, axis=1, keepdims=True), np.finfo(float).tiny)
    return np.einsum("mic,mi->c", shares, spare) / len(J), shares.mean(axis=0).T


def _pseudo_inverse(J: Array, force: Array, error: Array) -> tuple[Array, Array]:
    """Return what whitened rows make of components over their sizes (m, k, c), and 1 - leverage of each row (m, k)."""
    B = force[..., None] * J / error
    inverse = np.linalg.pinv(B, rcond=LEAST_TRACE)
    return inverse, 1.0 - np.einsum("mic,mci->mi", inverse, B)
