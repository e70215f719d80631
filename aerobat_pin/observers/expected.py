"""What is expected of forces and of rows before a sample is seen."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pinocchio as pin

from aerobat_pin.errors import ObserverError
from aerobat_pin.numerics import Array, guarded
from aerobat_pin.observers.kernels.memory import ObserverMemory
from aerobat_pin.observers.rows import BelievedRows, Rows

SHOWN = 0.9  # of what was expected of a component: what is seen better counts as seen
DOUBTFUL = 3.0  # how many times as large as stated the errors of the rows may be (in squares) before it is said
LEAST_SPARE = 0.5  # rows beyond what the components take up, below which nothing shows the size of the errors
ROUNDS = 3  # each finds the size of the forces given that of the errors, and then the errors
SIZES_TRIED = 2.0 ** np.arange(0.0, 10.5, 0.5)
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
    """

    force: Array
    row_error: Array
    stiction: Array
    stiction_rate: Array
    doubt: float = 1.0

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

    def row_deviation(self, v: Array) -> Array:
        """Return the standard deviation (..., nv) of each row at velocities (..., nv), at k = 1."""
        at_rest = 1.0 - np.tanh(v / self.stiction_rate) ** 2
        return np.asarray(np.sqrt(self.row_error**2 + self.stiction**2 / 3.0 * at_rest))

    def write(self, memory: ObserverMemory) -> None:
        """Write it into an observer's memory."""
        memory.information[:] = self.force**-2.0
        memory.row_variance[:] = self.row_error**2
        memory.stiction_variance[:] = self.stiction**2 / 3.0
        memory.stiction_rate[:] = self.stiction_rate
        memory.least[:] = self.doubt


def seen_share(deviation: Array, expected: Array) -> Array:
    """Return 1 - P/S^2: the share of the expected square of each component that the rows settle, between 0 and 1.

    Args:
        deviation: (..., c) standard deviation of each component with the rows known; infinite where they say nothing.
        expected: (c,) its standard deviation before.
    """
    return np.asarray(1.0 - np.minimum(np.square(deviation / expected), 1.0))


def robot_length(model: pin.Model) -> float:
    """Return the radius of gyration [m] of a robot in its neutral configuration: the lever arm of expected moments."""
    data = model.createData()
    pin.ccrba(model, data, pin.neutral(model), np.zeros(model.nv))
    return float(np.sqrt(np.trace(data.Ig.inertia) / (2.0 * max(data.Ig.mass, 1e-12))))


def with_record(
    expected: Expected, rows: Rows, model: pin.Model, v: Array, residual: Array, jacobians: Array
) -> Expected:
    """Return what is expected once a record is known: with its k, and forces of the size that make it most likely.

    k is the median, over instants with rows to spare, of what no force explains. The rows y of each instant are taken
    as N(0, k R + J^T (factor S)^2 J); factors below 1 are not tried: at rest they would call every force certain, and
    zero.

    Args:
        expected: what is expected without the record.
        rows: the rows in use.
        model: the robot.
        v: (m, nv) velocities.
        residual: (m, nv) generalised forces behind the observer's low-pass.
        jacobians: (m, c, nv) of the components.
    """
    believed = BelievedRows(model, rows)
    instants = []
    for velocity, y, J in zip(v, residual, jacobians, strict=True):
        L, deviation = believed.map(velocity), expected.row_deviation(velocity)
        L = L / np.maximum(np.linalg.norm(L * deviation[:, None], axis=0), 1e-150)
        U, sizes, _ = np.linalg.svd((J @ L).T * expected.force)
        signal = np.zeros(L.shape[1])
        signal[: len(sizes)] = sizes**2
        instants.append((np.square(U.T @ (L.T @ y)), signal))
    squares, signal = (np.stack(part) for part in zip(*instants, strict=True))  # along the rows' principal directions
    factor, k = 1.0, 1.0
    for _ in range(ROUNDS):
        variances = [k + tried**2 * signal for tried in SIZES_TRIED]
        likely = [float(np.sum(np.log(variance) + squares / variance)) for variance in variances]
        factor = float(SIZES_TRIED[int(np.argmin(likely))])
        left = (1.0 + factor**2 * signal) ** -2.0  # share of a row's error that no force takes up, see the kernel
        spare = np.sum(left, axis=1)
        sizes = (np.sum(squares * left**2, axis=1) / np.maximum(spare, LEAST_SPARE))[spare >= LEAST_SPARE]
        k = max(1.0, float(np.median(sizes))) if len(sizes) else 1.0
    return replace(expected, force=factor * expected.force, doubt=k)
