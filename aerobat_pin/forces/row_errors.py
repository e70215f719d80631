"""What the errors of rows do to forces: of each by itself, and those that all instants share.

With L the weighted rows in use and A = (J L)^T the forces' part in them, the best forces are A^+ L^T phi and no force
explains N L^T phi, N = I - A A^+. An error of the generalised force with covariance S S^T therefore gives forces the
covariance A^+ L^T S S^T L A^+^T, and what no force explains the mean square tr(N L^T S S^T L N).
Other rows check a row's error as far as its leverage on the forces leaves.

All instants share errors of the masses of links, or of a factor of all efforts:

    y = J^T f + X b + W c + e,    f ~ N(0, S^2),    e ~ N(0, R),    c ~ N(0, s^2) of each link

y are rows, X b friction and rotors, W what each link weighs, and c by which share of it its mass errs. Most of W c
looks like a force at the points, so that R, which rows to spare show row by row, does not contain it. But all instants
share c, so that they show some of its directions to some thousandths. How large it is in these says how large it is:
the s that makes them most likely (empirical Bayes, Efron and Morris 1973). With it c in the others follows, and what it
does to forces.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from aerobat_pin.forces.explanations import QUARTERS, coefficient_covariance, without_quarters
from aerobat_pin.forces.inputs import KnownInputs
from aerobat_pin.forces.instants import Instants, column_rms
from aerobat_pin.numerics import Array
from aerobat_pin.observers import Expected, Observer, typical_step

GEOMETRY_SPACING = 0.004  # [s] between the instants at which the geometry is evaluated
LEAST_SEEN = 1.0e-5  # of the largest singular value: fainter patterns of forces leave no trace
LEAST_TRACE = 1e-9  # of that of rows over their errors: a fainter force leaves none
NO_CHANCE = 3.0  # standard deviations from which errors count: a gain of half their square in the log likelihood
ERROR_OF_MASS = 0.1  # of a link's, that nobody would notice
ERRORS_TRIED = np.geomspace(1e-3, 1.0, 31)  # s that are tried
AT_POINTS = 1e-3  # of what a link weighs, in squares, that forces at the points leave: what it errs by is one of these
HARDLY_FELT = 1e-9  # share of a coefficient's information that is added to it


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


@dataclass(frozen=True)
class SharedError:
    """What a record shows of the errors c of n links, beside forces of any instant."""

    shown: Array  # (n,) c, a share of each mass [1], in directions that are not shown 0
    covariance: Array  # (n, n) its covariance [1], in directions that are not shown of errors as large as the masses
    moved: Array  # (m, k, n) what c does to each component at some instants [N or N m]
    carried: Array | float = 0.0  # (k,) rms of the components there [N or N m]
    masses: Array | float = 1.0  # (n,) of the links [kg]

    @property
    def size(self) -> float:
        """The most likely s, a share of each mass [1]; 0 where chance explains what is shown."""
        values, vectors = np.linalg.eigh(self.covariance)
        values = np.maximum(values, np.finfo(float).tiny)
        square = ERRORS_TRIED[:, None] ** 2 + values
        along = (self.shown @ vectors) ** 2
        gain = 0.5 * np.sum(np.log(values / square) + along / values - along / square, axis=1)
        best = int(np.argmax(gain))
        return float(ERRORS_TRIED[best]) if gain[best] > 0.5 * NO_CHANCE**2 else 0.0

    @property
    def deviation(self) -> Array:
        """The rms (k,) over the instants of what c does to each component [N or N m], as far as the record tells it."""
        size = self.size
        covariance, taken = self._moments(size)
        return self._deviation(covariance + np.outer(taken, taken))

    @property
    def by_weight(self) -> Array:
        """As `deviation` (k,), where weight, wrong by a tenth of a link's at most, told the factors of efforts."""
        share = min(self.size, ERROR_OF_MASS) * np.linalg.norm(self.masses) / np.sum(self.masses)
        return np.hypot(self.deviation, share * self.carried)

    @property
    def untested(self) -> Array:
        """The rms (k,) of what three quarters would not show of c [N or N m], if each mass may err by a tenth."""
        return self._deviation(self._moments(ERROR_OF_MASS)[0])

    def _moments(self, size: float) -> tuple[Array, Array]:
        """Return covariance and mean of c that has deviations of a size before it is shown."""
        share = size**2 * np.linalg.inv(size**2 * np.eye(len(self.shown)) + self.covariance)
        return size**2 * (np.eye(len(share)) - share), share @ self.shown

    def _deviation(self, square: Array) -> Array:
        return np.asarray(
            np.sqrt(np.maximum(np.einsum("mkp,pq,mkq->k", self.moved, square, self.moved), 0.0) / len(self.moved))
        )


def shared_error(model: pin.Model, instants: Instants, expected: Expected) -> SharedError:
    """Return what instants of a record show of the errors of links, beside forces and friction."""
    some, kept, still, data = instants.weighed, instants.kept, np.zeros(model.nv), model.createData()
    links = np.array([inertia.toDynamicParameters() for inertia in model.inertias[1:]]).ravel()
    weighs = [pin.computeJointTorqueRegressor(model, data, q, still, still) * links for q in instants.q[some]]
    weights = np.reshape(weighs, (len(weighs), model.nv, -1, 10))[:, kept].sum(axis=3)  # of one joint they are (10,)
    J = instants.jacobians[some][..., kept]
    R = expected.doubt * expected.row_deviation(instants.v[some])[:, kept] ** 2
    identity = np.eye(len(kept))[instants.at].T
    friction = np.concatenate([x[:, None] * identity for x in instants.columns[:3, some][..., instants.at]], axis=2)
    white, y = J / R[:, None], instants.rows[some][:, kept]
    both = white @ np.concatenate([weights, y[:, :, None]], axis=2)
    both = np.linalg.solve(white @ np.swapaxes(J, 1, 2) + np.diag(expected.force**-2.0), both)
    moved, force = both[:, :, :-1], expected.force[:, None] * J
    columns = np.concatenate([weights, friction], axis=2)
    shared = shown_without_any_quarter(columns, y, force, R, moved)
    if np.any(many := np.abs(shared.shown) > 1.0):
        columns[..., : len(many)][..., many & _loads(weights, J)] = 0.0
        shared = shown_without_any_quarter(columns, y, force, R, moved)
    return replace(shared, carried=column_rms(both[:, :, -1]), masses=links.reshape(-1, 10)[:, 0])


def _loads(weights: Array, J: Array) -> NDArray[np.bool_]:
    """Return which links' weights (m, k, n) forces at the points would make, too.

    What a wheel or a foot bears all the time looks like many times its mass, and is no error of it.
    """
    beside = weights - np.swapaxes(J, 1, 2) @ (np.linalg.pinv(np.swapaxes(J, 1, 2)) @ weights)
    squares = (np.sum(each**2, axis=(0, 1)) for each in (beside, AT_POINTS**0.5 * weights))
    return np.asarray(np.less(*squares))


def shown_without_any_quarter(columns: Array, y: Array, force: Array, variance: Array, moved: Array) -> SharedError:
    """Return what is shown of errors that move components so (m, k, n), by the three quarters that show least.

    A push elsewhere, which lasts for a while, is no error of masses. The rest as in `beside_forces`. Fewer instants
    than quarters show nothing.
    """
    n, errors = moved.shape[2], list[SharedError]()
    if len(y) < QUARTERS:
        return SharedError(np.zeros(n), np.eye(n), moved)
    for k in range(QUARTERS):
        quarter = range(k, k + 1)
        x, rows, SJ, R = (without_quarters(each, quarter) for each in (columns, y, force, variance))
        b, covariance = beside_forces(x, rows, SJ, R, n)
        errors.append(SharedError(b[:n], covariance[:n, :n], moved))
    return min(errors, key=lambda each: each.size)


def beside_forces(columns: Array, y: Array, force: Array, variance: Array, shares: int) -> tuple[Array, Array]:
    """Return the most likely coefficients (p,) of columns (m, k, p) in rows (m, k) beside forces; their covariance.

    The forces are S J (m, c, k), and R is the variance (m, k). The first `shares` of the coefficients are expected to
    be of size 1; nothing is of the others.
    """
    p, at = columns.shape[2], range(y.shape[1])
    cov = np.swapaxes(force, 1, 2) @ force
    cov[:, at, at] += variance
    white = np.linalg.solve(cov, np.concatenate([columns, y[:, :, None]], axis=2))
    flat = columns.reshape(-1, p)
    both = flat.T @ white.reshape(len(flat), -1)
    normal, target, prior = both[:, :p], both[:, p], (np.arange(p) < shares).astype(float)
    felt = np.diag(normal) + prior > 0.0
    normal[range(p), range(p)] += prior + HARDLY_FELT * np.diag(normal)
    b = np.zeros(p)
    b[felt] = np.linalg.solve(normal[np.ix_(felt, felt)], target[felt])
    scores = np.einsum("mkp,mk->mp", columns, white[:, :, p] - white[:, :, :p] @ b)
    return b, coefficient_covariance(normal, scores, prior, felt)
