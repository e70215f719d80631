"""What the errors of the rows do to forces, and to what no force explains, along a motion.

With L the weighted rows in use and A = (J L)^T the forces' part in them, the best forces are A^+ L^T phi and no force
explains N L^T phi, N = I - A A^+. An error of the generalised force with covariance S S^T therefore gives forces the
covariance A^+ L^T S S^T L A^+^T, and what no force explains the mean square tr(N L^T S S^T L N).
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


@dataclass(frozen=True)
class RowGeometry:
    """The geometry at some intervals of a stretch.

    Attributes:
        at: (n,) indices of the intervals.
        rows: (n, nv, k) L.
        forces: (n, c, k) A^+; patterns of forces without a trace get nothing.
        projector: (n, k, k) N.
    """

    at: NDArray[np.intp]
    rows: Array
    forces: Array
    projector: Array

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
