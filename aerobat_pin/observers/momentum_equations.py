"""The momentum observers over a whole record in numpy: every equation once, in the symbols of the paper.

A robot with momentum p = M(q) v, under known generalised forces u and unknown components f with Jacobian J, obeys

    p' = u + J^T f + C^T v - g

The paper's observer r = K (p - int(u + C^T v - g + r) - p0) is a low-pass of J^T f, r' = K (J^T f - r). From sample to
sample this needs no integral: the mean of J^T f over an interval follows from the momenta at its ends, and the low-pass
of a constant is known exactly.

    phi = (p_1 - p_0) / dt - (b_0 + b_1) / 2 - u,   b = C^T v - g       `mean_residuals`
    r   = phi + exp(-K dt) (r - phi)                                    `filter_means`
    f   = argmin |L^T (r - J^T f)|^2,   L: the weighted rows in use     `Projection`, or `posterior` with expected sizes

`momentum` filters phi, then projects; all others project, then filter f. This is the path of every record. A stream
takes the compiled kernels of `kernels/`, which compute the same a sample at a time; the tests hold the two together.
In all shapes m is the number of intervals, nv of velocities, c of components, and k of rows in use.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin

from aerobat_pin.errors import ShapeError
from aerobat_pin.numerics import Array, placements
from aerobat_pin.observers.applications import Applications
from aerobat_pin.observers.expected import Expected
from aerobat_pin.observers.kernels.filters import FIRST_ORDER, RISE, SECOND_ORDER
from aerobat_pin.observers.kernels.posterior import LEAST_SPARE, MEMORY_OF_K
from aerobat_pin.observers.kernels.projection import DAMPING, SUSPECT, UNSEEN_EIGENVALUE
from aerobat_pin.observers.kernels.residual import TOO_LARGE
from aerobat_pin.observers.redundancy import low_passed
from aerobat_pin.observers.rows import BelievedRows


class Samples(NamedTuple):
    """What the equations need of m + 1 samples."""

    p: Array  # (m + 1, nv) momentum M v
    b: Array  # (m + 1, nv) drift C^T v - g
    v: Array  # (m + 1, nv) velocity
    J: Array  # (m + 1, c, nv) Jacobian of the components


class Equations(NamedTuple):
    """Which observer it is."""

    project_first: bool  # whether the components are filtered, or the residual
    filter: int  # which filter, see `kernels.filters`
    gains: Array  # K [1/s] of the filtered quantities, or of their coordinates in `basis`
    basis: Array  # orthonormal basis of a matrix gain, one vector per column, or (0, 0)
    slope: float  # [N/s], used by the super-twisting filter only
    rows: BelievedRows  # the rows in use
    expected: Expected | None  # sizes of forces and of errors of the rows; None for any size


class Observed(NamedTuple):
    """The estimate of m intervals."""

    residual: Array  # (m, nv) generalised force r
    components: Array  # (m, c) f
    unexplained: Array  # (m, nv) rows L^T (phi - J^T f) that no force explains, before the filter, padded with zeros
    pivot: Array  # (m,) smallest pivot of the equations for f over their trace
    deviation: Array | None = None  # (m, c) standard deviation of f, with expected sizes
    k: Array | None = None  # (m,) how many times as large as expected the squared errors of the rows are
    innovation: Array | None = None  # (m, nv) whitened innovations of a filter


def sample_robot(
    model: pin.Model,
    data: pin.Data,
    compute: Callable[[pin.Model, pin.Data, Array, Array], None],
    applications: Applications,
    q: Array,
    v: Array,
) -> Samples:
    """Return momentum, drift and Jacobians of the components at samples q (m + 1, nq) and v (m + 1, nv).

    `compute` lets Pinocchio compute M, C, g, the world Jacobians and the placements at one sample.
    """
    M, Ct, g, oMi, J = data.M, data.C.T, data.g, placements(data.oMi), data.J.reshape(6, -1)  # (6,) of one joint
    p, b, wanted = np.empty_like(v), np.empty_like(v), len(applications.components) > 0
    world, places = np.empty((len(v), 6, model.nv)), np.empty((len(v), *oMi.shape))
    for q_i, v_i, p_i, b_i, J_i, place in zip(q, v, p, b, world, places, strict=True):
        compute(model, data, q_i, v_i)
        M.dot(v_i, p_i)  # p = M v
        Ct.dot(v_i, b_i)  # b = C^T v - g
        b_i -= g
        if wanted:
            J_i[:], place[:] = J, oMi
    return Samples(p, b, v, applications.jacobians(world, places))


def observe_record(equations: Equations, samples: Samples, time: Array, u: Array) -> Observed:
    """Return the estimate over a record; an interval of no length repeats the result of the one before.

    Times (m + 1,) [s] do not decrease; the known generalised force u (m, nv) is the mean of each interval. Raises
    ShapeError if a residual is not finite.
    """
    new = np.diff(time) > 0.0
    if new.all():
        return _observe(equations, samples, time, u)
    kept, last = np.concatenate([[True], new]), np.cumsum(new) - 1
    observed = _observe(equations, Samples(*(values[kept] for values in samples)), time[kept], u[new])

    def repeated(values: Array | None) -> Any:
        if values is None:
            return None
        first = np.zeros((1, *values.shape[1:]))  # the result of what repeats the first sample
        return np.concatenate([first, values])[last + 1]

    return Observed(*map(repeated, observed))


def _observe(equations: Equations, samples: Samples, time: Array, u: Array) -> Observed:
    """Return the estimate over a record whose stamps increase."""
    dt, rows = np.diff(time), equations.rows
    phi = mean_residuals(samples, time, u)
    v, J = (0.5 * (values[1:] + values[:-1]) for values in (samples.v, samples.J))  # in mid-interval, to second order
    projection = Projection.of(rows, J, v, samples.J[1:], samples.v[1:])
    best = projection.components(rows.of(phi, v))
    remainder = rows.of(phi - _generalized(J, best), v)
    unexplained = np.zeros_like(phi)
    unexplained[:, : remainder.shape[1]] = remainder[:, : phi.shape[1]]
    deviation = k = None
    r, f = phi, best
    if not equations.project_first:
        r = f = filter_means(equations, dt, phi)
    if equations.expected is not None:
        f, deviation, k = posterior(equations, dt, J, v, r)
    elif not equations.project_first:
        f = projection.components(rows.of(r, v))
    if equations.project_first:
        f = filter_means(equations, dt, f)
        r = _generalized(J, f)
    return Observed(r, f, unexplained, projection.pivot, deviation, k)


def mean_residuals(samples: Samples, time: Array, u: Array) -> Array:
    """Return phi (m, nv), the mean of the unknown generalised force J^T f over each interval. Raises ShapeError."""
    p, b, dt = samples.p, samples.b, np.diff(time)[:, None]
    phi = (p[1:] - p[:-1]) / dt - 0.5 * (b[1:] + b[:-1]) - u
    usable = np.all(np.abs(phi) < TOO_LARGE, axis=1) & (dt[:, 0] < TOO_LARGE)  # NaN is not
    if not usable.all():
        at = time[:-1][np.argmin(usable)]
        raise ShapeError(f"the residual after {at} s is not finite: q, v or a force is too large")
    return np.asarray(phi)


def _generalized(J: Array, f: Array) -> Array:
    """Return J^T f (m, nv)."""
    return np.asarray(np.einsum("mcn,mc->mn", J, f))


class Projection(NamedTuple):
    """The equations A f = B y for the components that best explain rows y, A = B B^T, B = J L."""

    B: Array  # (m, c, k) rows of the components
    A: Array  # (m, c, c), with a little on its diagonal, and `unseen` times its trace
    unseen: Array  # (m, c, c) projector onto patterns of components that leave no trace
    pivot: Array  # (m,) smallest pivot of A over its trace

    @classmethod
    def of(cls, rows: BelievedRows, J: Array, v: Array, J_end: Array, v_end: Array) -> Projection:
        """Return the equations of each interval.

        The mean of two rank-deficient Jacobians has nearly, but not exactly, deficient rank, and least squares with it
        would magnify the patterns that leave no trace. They are therefore found with the exact Jacobian at the end of
        the interval, and the result contains nothing of them. J (m, c, nv) and v (m, nv), the direction of the row of
        power, are those in mid-interval, J_end and v_end those at its end.
        """
        B = rows.of(J, v)
        A, c = B @ np.swapaxes(B, 1, 2), J.shape[1]
        trace, unseen = np.trace(A, axis1=1, axis2=2), np.zeros_like(A)
        least = _smallest_pivot(A + _damping(trace, c))
        suspect = np.flatnonzero(least < SUSPECT * trace)
        if len(suspect):
            end = rows.of(J_end[suspect], v_end[suspect])
            size, V = np.linalg.eigh(end @ np.swapaxes(end, 1, 2))
            V = V * (size <= UNSEEN_EIGENVALUE * np.sum(size, axis=1, keepdims=True))[:, None]
            unseen[suspect] = V @ np.swapaxes(V, 1, 2)
        A = A + trace[:, None, None] * unseen + _damping(trace, c)
        return cls(B, A, unseen, np.divide(least, trace, out=np.zeros_like(trace), where=trace > 0.0))

    def components(self, y: Array) -> Array:
        """Return the components f (m, c) that best explain rows y (m, k)."""
        b = np.einsum("mck,mk->mc", self.B, y)
        b -= np.einsum("mcd,md->mc", self.unseen, b)
        return np.asarray(np.linalg.solve(self.A, b[..., None])[..., 0])


def _damping(trace: Array, c: int) -> Array:
    """Return what is added to A; where no row depends on the forces (trace 0), they become 0."""
    return np.where(trace > 0.0, DAMPING * trace, 1.0)[:, None, None] * np.eye(c)


def _smallest_pivot(A: Array) -> Array:
    """Return the smallest pivot (m,) of A = L L^T; -inf where A is not positive definite."""
    if A.shape[1] == 0:
        return np.ones(len(A))
    try:
        factors = np.linalg.cholesky(A)
    except np.linalg.LinAlgError:
        half = len(A) // 2
        if half == 0:
            return np.full(1, -np.inf)
        return np.concatenate([_smallest_pivot(A[:half]), _smallest_pivot(A[half:])])
    return np.asarray(np.min(np.diagonal(factors, axis1=1, axis2=2), axis=1) ** 2)


def posterior(equations: Equations, dt: Array, J: Array, v: Array, y: Array) -> tuple[Array, Array, Array]:
    """Return f (m, c), its standard deviation (m, c), and k (m,), given y = J^T f + e and what is expected of both.

        e ~ N(0, k R),   f ~ N(0, S^2)           see `Expected`
        P = (J R^-1 J^T / k + S^-2)^-1           covariance of f, given y
        f = (1 + N - N^3) P J R^-1 y / k,   N = P S^-2

    P J R^-1 y / k is the mean of f given y. It is too small by the share P S^-2 of the force, a tenth where nine tenths
    are seen, though R and S are guesses at times; the first factor leaves the square of this share, and adds
    nothing where nothing is seen.

    k is the square of the whitened rows that no force explains, for each row to spare, behind the low-pass of the
    observer, as noise that this takes out does no harm. A few rows at one instant say little about their errors, which
    last: k is no less than its mean over some seconds before, and than what is expected. Rows to spare are those in use
    less the sum of the shares 1 - (P/S^2)^2 that the components take up; NaN is returned where there is none.
    """
    expected, rows = equations.expected, equations.rows
    assert expected is not None
    size = rows.of(expected.row_deviation(v) ** 2, v, power=2)
    white = np.divide(1.0, np.sqrt(size), out=np.zeros_like(size), where=size > 0.0)  # R^-1/2 of the rows in use
    B, y = rows.of(J, v) * white[:, None], rows.of(y, v) * white
    information = expected.force**-2.0  # S^-2

    def given(k: Array, B: Array, y: Array) -> tuple[Array, Array]:
        P = np.linalg.inv(B @ np.swapaxes(B, 1, 2) / k[:, None, None] + np.diag(information))
        mean = np.einsum("mcd,mdk,mk->mc", P, B, y / k[:, None], optimize=True)
        N = P * information
        missing = np.einsum("mcd,md->mc", N, mean)
        return mean + missing - np.einsum("mcd,mde,me->mc", N, N, missing), np.diagonal(P, axis1=1, axis2=2)

    f, variance = given(np.ones(len(y)), B, y)
    spare = rows.count - np.sum(1.0 - (variance * information) ** 2, axis=1)
    remainder = _first_order(equations.gains[:1], dt, y - np.einsum("mck,mc->mk", B, f))
    squares = np.sum(remainder**2, axis=1)
    k = np.divide(squares, spare, out=np.full_like(spare, np.nan), where=spare >= LEAST_SPARE)
    level, mean, seconds = np.empty_like(k), 0.0, 0.0
    for i, now in enumerate(k.tolist()):
        if now > 0.0:
            seconds += dt[i]
            mean += min(dt[i] / seconds + dt[i] / MEMORY_OF_K, 1.0) * (now - mean)
        level[i] = max(mean, expected.doubt)
    level = np.fmax(k, level)
    more = level > 1.0
    deviation = np.sqrt(variance)
    if more.any():
        f[more], variance = given(level[more], B[more], y[more])
        deviation[more] = np.sqrt(variance)
    return f, deviation, k


def filter_means(equations: Equations, dt: Array, values: Array) -> Array:
    """Return values (m, n), constant over each interval dt (m,) [s], behind the filter, which begins at 0."""
    gains, basis = equations.gains, equations.basis
    if len(basis):
        return filter_means(equations._replace(basis=basis[:0]), dt, values @ basis) @ basis.T
    if equations.filter == FIRST_ORDER:
        return _first_order(gains, dt, values)
    if equations.filter == SECOND_ORDER:
        return _second_order(RISE * gains, dt, values)
    return _super_twisting(RISE * gains, equations.slope, dt, values)


def _first_order(K: Array, dt: Array, phi: Array) -> Array:
    """Solve r' = K (phi - r), exactly: r <- r + (1 - exp(-K dt)) (phi - r)."""
    return low_passed(phi, -np.expm1(-K * dt[:, None]))


def _second_order(w: Array, dt: Array, f: Array) -> Array:
    """Solve x'' + 2 w x' + w^2 x = w^2 f, exactly."""
    out, x, rate, decay = np.empty_like(f), np.zeros(f.shape[1]), np.zeros(f.shape[1]), np.exp(-w * dt[:, None])
    for i in range(len(f)):
        gap = x - f[i]
        drive = rate + w * gap
        x = f[i] + (gap + drive * dt[i]) * decay[i]
        rate = (rate - w * drive * dt[i]) * decay[i]
        out[i] = x
    return out


def _super_twisting(w: Array, slope: float, dt: Array, f: Array) -> Array:
    """Advance a super-twisting differentiator with linear terms by implicit Euler steps.

    With z the estimate of the force f, and e the integral of f minus the integral of z,

        e' = f - z - k1 sqrt|e| sign e - 2 w e          k1 = 1.5 sqrt(slope)
        z' = 1.1 slope sign e + w^2 e
    """
    out, z, e = np.empty_like(f), np.zeros(f.shape[1]), np.zeros(f.shape[1])
    for i, h in enumerate(dt.tolist()):
        pushed = e + h * (f[i] - z)
        beyond = np.maximum(np.abs(pushed) - 1.1 * slope * h * h, 0.0)  # 0: `sign e` keeps e at 0
        a, k1 = 1.0 + 2.0 * w * h + (w * h) ** 2, 1.5 * np.sqrt(slope) * h
        e = np.sign(pushed) * ((np.sqrt(k1 * k1 + 4.0 * a * beyond) - k1) / (2.0 * a)) ** 2
        z = z + np.where(beyond > 0.0, h * (1.1 * slope * np.sign(pushed) + w * w * e), pushed / h)
        out[i] = z
    return out
