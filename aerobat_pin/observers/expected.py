"""What is expected of forces and of rows before a sample is seen."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pinocchio as pin

from aerobat_pin.errors import ObserverError
from aerobat_pin.numerics import Array, guarded
from aerobat_pin.observers.kernels import posterior
from aerobat_pin.observers.rows import BelievedRows, Rows

SHOWN = 0.9  # of what was expected of a component: what is seen better counts as seen
DOUBTFUL = 3.0  # how many times as large as stated the errors of the rows may be (in squares) before it is said
SIZE_ROUNDS = 3  # each finds the size of the forces given that of the errors, and then the errors
SIZES_TRIED = 2.0 ** np.arange(11)
CHANGES_TRIED = 2.0 ** np.arange(-2.0, 2.5, 0.5)
SHARE_OF_WEIGHT = 1.0 / 3.0  # of the robot's weight: the size of a force that nothing else is known of


@guarded(force=("c",), row_error=("nv",), stiction=("nv",), stiction_rate=("nv",))
@dataclass(frozen=True)
class Expected:
    """What is expected of forces f and rows y = J^T f + e before a sample is seen; all are standard deviations.

        f ~ N(0, S^2),   e ~ N(0, k R),   R = row_error^2 + stiction^2 / 3 (1 - tanh^2(v / stiction_rate))

    k is how much larger the squared errors are than stated, which rows show that no force explains.

    Attributes:
        force: (c,) S: size of each component [N or N m].
        row_error: (nv,) error of each row where nothing touches, behind the observer's filter [N or N m].
        stiction: (nv,) Coulomb friction [N or N m]: at rest a joint may hold any torque up to it.
        stiction_rate: (nv,) speed at which Coulomb friction has set in [m/s or rad/s].
        doubt: least k, at least 1: that of a whole record, if it is known.
        shared: (c,) of what errors that all rows share do to each component [N or N m]; not among the rows' errors.
    """

    force: Array
    row_error: Array
    stiction: Array
    stiction_rate: Array
    doubt: float = 1.0
    shared: Array | float = 0.0

    def refuse_unusable(self, components: int, nv: int) -> None:
        """Raise ObserverError unless it fits the robot, everything is finite, and what divides is positive."""
        sizes = len(self.force), len(self.row_error)
        if sizes != (components, nv):
            raise ObserverError(f"expected: {sizes} components and rows: {(components, nv)} were expected")
        for name in ("force", "row_error", "stiction_rate"):
            values = getattr(self, name)
            if not (np.all(np.isfinite(values)) and np.all(values > 0.0)):
                raise ObserverError(f"expected.{name} = {values}: finite positive numbers were expected")
        if not (np.all(np.isfinite(self.stiction)) and np.all(self.stiction >= 0.0)):
            raise ObserverError(f"expected.stiction = {self.stiction}: finite numbers of at least 0 were expected")
        if not 1.0 <= self.doubt < np.inf:
            raise ObserverError(f"expected.doubt = {self.doubt}: a finite number of at least 1 was expected")

    def seen(self, deviation: Array) -> Array:
        """Return 1 - P/S^2: the share of the expected square of each component that the rows settle, from 0 to 1.

        Args:
            deviation: (..., c) standard deviation with the rows known; infinite where they say nothing.
        """
        return np.asarray(1.0 - np.minimum(np.square(deviation / self.force), 1.0))

    def row_deviation(self, v: Array) -> Array:
        """Return the standard deviation (..., nv) of each row at velocities (..., nv), at k = 1."""
        at_rest = 1.0 - np.tanh(v / self.stiction_rate) ** 2
        return np.asarray(np.sqrt(self.row_error**2 + self.stiction**2 / 3.0 * at_rest))

    def write(self, table: Array) -> None:
        """Write it into `ObserverState.posterior` (8, nv + c + 1)."""
        c, nv = len(self.force), len(self.row_error)
        table[posterior.INFORMATION, :c] = self.force**-2.0
        table[posterior.ROW_VARIANCE, :nv] = self.row_error**2
        table[posterior.STICTION, :nv] = self.stiction**2 / 3.0
        table[posterior.STICTION_RATE, :nv] = self.stiction_rate
        table[posterior.LEVELS, 0] = self.doubt


def robot_length(model: pin.Model) -> float:
    """Return the radius of gyration [m] of a robot in its neutral configuration: the lever arm of expected moments."""
    data = model.createData()
    pin.ccrba(model, data, pin.neutral(model), np.zeros(model.nv))
    return float(np.sqrt(np.trace(data.Ig.inertia) / (2.0 * max(data.Ig.mass, 1e-12))))


def with_record(
    expected: Expected, rows: Rows, model: pin.Model, v: Array, residual: Array, jacobians: Array
) -> Expected:
    """Return what is expected once a record is known: with its k, and forces of the sizes that make it most likely.

    The rows y of each instant are taken as N(0, k R + J^T (factor S)^2 J), with a factor for all components and then
    one for each. Factors below 1 are not tried: at rest they would call every force certain, and zero. k is the mean,
    over instants with rows to spare, of what no force explains. Velocities are (m, nv), residuals (m, nv) generalised
    forces behind the observer's low-pass, and Jacobians (m, c, nv) those of the components.
    """
    believed = BelievedRows(model, rows)
    size = np.maximum(np.sqrt(believed.of(expected.row_deviation(v) ** 2, v, power=2)), 1e-150)
    y = believed.of(residual, v) / size  # whitened rows (m, r), and what forces do to them
    B = np.swapaxes(believed.of(jacobians, v) / size[:, None], 1, 2) * expected.force
    r, c = B.shape[1:]
    eigenvalues, Q = np.linalg.eigh(np.swapaxes(B, 1, 2) @ B)
    eigenvalues, shown = np.maximum(eigenvalues, 0.0), np.einsum("mcd,mrc,mr->md", Q, B, y, optimize=True)
    k, squares_tried = 1.0, SIZES_TRIED[:, None, None] ** 2
    for _ in range(SIZE_ROUNDS):
        # V = k 1 + B S^2 B^T of one size s has log det V = sum(log(k + s^2 g)) + const., g the eigenvalues of B^T B.
        scaled = k + squares_tried * eigenvalues
        unlikely = np.sum(np.log(scaled) - squares_tried * shown**2 / scaled / k, axis=(1, 2))
        size_of_all = SIZES_TRIED[np.argmin(unlikely)]
        factors, inverse = np.full(c, size_of_all), 1.0 / (k + size_of_all**2 * eigenvalues)
        M = (Q * (eigenvalues * inverse)[:, None]) @ np.swapaxes(Q, 1, 2)  # B^T V^-1 B, and B^T V^-1 y
        n = np.einsum("mcd,md->mc", Q, inverse * shown)
        for j in range(c):  # another size of one component changes V by a matrix of rank one (Sherman and Morrison)
            tried = np.maximum(factors[j] * CHANGES_TRIED, 1.0)
            added = tried**2 - factors[j] ** 2
            scaled = 1.0 + added[:, None] * M[:, j, j]
            best = np.argmin(np.sum(np.log(scaled) - added[:, None] * n[:, j] ** 2 / scaled, axis=1))
            along = M[:, j] * (added[best] / scaled[best])[:, None]
            n, M = n - along * n[:, j, None], M - along[:, :, None] * M[:, None, j]
            factors[j] = tried[best]
        # The share of a row's error that no force takes up is the square of this, see `estimate_posterior`.
        unsettled = np.linalg.inv(np.eye(r) + (B * factors**2) @ np.swapaxes(B, 1, 2))
        unsettled = unsettled @ unsettled
        spare = np.trace(unsettled, axis1=1, axis2=2)
        squares = np.sum((unsettled @ y[..., None])[..., 0] ** 2, axis=1)[spare >= posterior.LEAST_SPARE]
        k = max(1.0, float(np.mean(squares / spare[spare >= posterior.LEAST_SPARE]))) if len(squares) else 1.0
    return replace(expected, force=factors * expected.force, doubt=k)
