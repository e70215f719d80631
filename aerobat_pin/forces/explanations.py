"""How likely a change of the map, or of the robot, makes a record's efforts.

    y = J^T f + X b + H h + e,    f ~ N(0, S^2),    b ~ N(0, B^2),    e ~ N(0, R)

y are the rows at some instants behind the observer's low-pass, X b friction of each driven joint, perhaps the inertia
of its rotor, and a constant that stiction or a sensor may hold, H h what a change does. Its columns follow from motion
and model, not from the efforts: noise of a regressor would make its factor too small. R is scaled row by row as makes y
most likely (MacKay 1992: squared errors over the share of them that no force takes up), with the change and without it;
what that gains counts for as many instants as are independent.

Where b was found and c is true, the rows are wrong by X (c - b), and the most likely forces, f = G (y - X b) with
G = P J R^-1 (`momentum_equations.posterior`), by G X (c - b). With C the covariance of b, the diagonal of X C X^T
belongs to the variance R of the rows, and P then contains the projected error, in records and streams alike.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from aerobat_pin.forces.expected_of_record import SLIDES_AT
from aerobat_pin.forces.instants import Instants, column_rms
from aerobat_pin.numerics import Array
from aerobat_pin.observers import Expected

ROUNDS_AT_FIRST, ROUNDS_AFTER = 12, 4  # in which R is found, and from what is likely with another change
SPARE_AT_LEAST = 1e-3  # share of a row's error that no force takes up
NO_BETTER = 0.01  # of the middle one of the driven rows' squared errors: forces, which fit some rows, make none exact
OFFSET = 0.1  # of a row's effort, rms: what a sensor's offset may be
SMALLEST_SIZE = 1e-4  # of what is expected of a row's squared errors: none has smaller ones
LEAST_FELT = 1e-12  # of what rows expect, squared: what h = 1 does less to them is rounding, and h stays 0
QUARTERS = 4  # of a record
RANK_OF_ROWS = 1e-12  # of the largest eigenvalue: what no row shows is 0
FEWEST_INDEPENDENT = 3.0  # instants that count at least: Student's distribution of fewer has no variance


@dataclass(frozen=True)
class EffortRows:
    """Rows of a record at some instants."""

    y: Array  # (m, k) rows [N, N m]
    effort: Array  # (m, k) efforts
    # (m, k) what motion and weight need, but for what the forces give; just before and after, as noise that a regressor
    # shares with y would pass for a factor
    needed: Array
    rates: Array  # (m, k) how fast the efforts change [N/s, N m/s]
    forces: Array  # (m, c, k) S J, of forces of the size expected, or so many times that
    joint_terms: Array  # (m, k, p) friction and constants of the driven joints' rows, and rotors if they are sought
    prior: Array  # (p,) B^-2
    variance: Array  # (m, k) what is expected of R
    driven: Sequence[int]  # the rows of driven joints

    def but(self, quarters: range) -> EffortRows:
        """Return the rows without some quarters of the record."""
        series = ("y", "effort", "needed", "rates", "forces", "joint_terms", "variance")
        kept: dict[str, Any] = {name: without_quarters(getattr(self, name), quarters) for name in series}
        return replace(self, **kept)

    @property
    def mean_variance(self) -> Array:
        """(k,) of R."""
        return np.asarray(np.mean(self.variance, axis=0))


@dataclass(frozen=True)
class Explanation:
    """What is most likely with a change."""

    loss: float  # minus the logarithm of the likelihood, but for a constant
    size: Array  # (p,) h
    deviation: Array  # (p,) its standard deviation, if all instants were independent
    errors: Array  # (m, k) e
    around: Array  # (m, k) what the mean force of the instants beside it does, whose noise is not that of this one
    precision: Array  # (m, k, k) inverse of the covariance of the rows
    row_size: Array  # (k,) of R over what is expected

    @property
    def independent(self) -> float:
        """Share of the instants that are independent, of the middle one of the rows."""
        return float(np.median(independent(self.errors))) / len(self.errors)


def without_quarters(values: Array, quarters: range) -> Array:
    """Return values (m, ...) at instants without those of some quarters of the record."""
    pieces = np.array_split(values, QUARTERS)
    return np.concatenate([piece for k, piece in enumerate(pieces) if k not in quarters])


def effort_rows(
    instants: Instants,
    expected: Expected,
    driven: Sequence[int],
    jacobians: Array,
    *,
    forces: float,
    rotors: bool = False,
) -> EffortRows:
    """Return the rows at `WEIGHED` of some instants, of which some, `driven`, are those of driven joints.

    The Jacobians (m, c, nv) of the forces are those where the robot was as what the rows show happened. These may be
    `forces` times as large as expected, at no cost; 0 times where nothing touches the robot. `rotors` says whether each
    joint has one that the model may lack.
    """
    kept, some = instants.kept, instants.weighed
    y, (coulomb, viscous, _, effort) = instants.rows[some][:, kept], instants.columns[:, some]
    J = forces * expected.force[:, None] * jacobians[:, :, kept]
    identity = np.eye(len(kept))[:, driven]
    likely = (coulomb, viscous, *[instants.around[1, some]] * rotors)
    joint_terms = np.concatenate([x[:, :, None] * identity for x in (*likely, np.ones_like(y))], axis=2)
    rests = np.abs(instants.sliding[:, driven]).max(axis=0) < SLIDES_AT
    stiction = np.where(rests, expected.stiction[np.array(kept)[driven]], 0.0)
    constants = np.maximum(np.maximum(OFFSET * column_rms(effort)[driven], stiction), 1e-9)
    prior = np.concatenate([np.zeros(len(likely) * len(driven)), constants**-2.0])
    variance = expected.row_deviation(instants.v[some])[:, kept] ** 2
    J = J if forces else J[:, :0]
    return EffortRows(
        y, effort, instants.around[0, some], instants.rates[some], J, joint_terms, prior, variance, driven
    )


def most_likely_with(rows: EffortRows, columns: Array | None = None, start: Explanation | None = None) -> Explanation:
    """Return what is most likely if a change does h times columns (m, k, p), or without one.

    It begins with the errors that were most likely at the `start`, with another change.
    """
    y, x = rows.y, rows.joint_terms if columns is None else np.concatenate([rows.joint_terms, columns], axis=2)
    prior = np.concatenate([rows.prior, np.zeros(x.shape[2] - len(rows.prior))])
    at, reached = range(y.shape[1]), np.swapaxes(rows.forces, 1, 2) @ rows.forces
    size, flat = np.ones(y.shape[1]) if start is None else start.row_size, x.reshape(y.size, -1)
    for _ in range(ROUNDS_AT_FIRST if start is None else ROUNDS_AFTER):
        row_size, R = size, size * rows.variance
        cov = reached.copy()
        cov[:, at, at] += R
        W = np.linalg.inv(cov)
        normal = flat.T @ (W @ x).reshape(y.size, -1) + np.diag(prior)
        felt = np.diag(normal)
        unit = np.divide(1.0, np.sqrt(felt), out=np.zeros(len(felt)), where=felt > LEAST_FELT)
        unit = unit * unit[:, None]
        inverse = _inverse_of_shown(normal * unit) * unit
        b = inverse @ (flat.T @ (W @ y[..., None]).ravel())
        remainder = y - x @ b
        white = (W @ remainder[..., None])[..., 0]
        errors = R * white
        spare = np.maximum(np.mean(R * np.diagonal(W, axis1=1, axis2=2), axis=0), SPARE_AT_LEAST)
        size = np.maximum(np.mean(errors**2 / rows.variance, axis=0) / spare, SMALLEST_SIZE)
        means = size * rows.mean_variance
        size = np.maximum(means, NO_BETTER * np.median(means[rows.driven])) / rows.mean_variance
    loss = 0.5 * (np.sum(np.linalg.slogdet(cov)[1]) + np.sum(remainder * white) + prior @ b**2)
    deviation = np.sqrt(np.maximum(np.diag(inverse), 0.0))
    n = len(rows.prior)
    force = np.pad((rows.forces @ white[..., None])[..., 0], ((1, 1), (0, 0)), mode="reflect")
    around = np.einsum("mck,mc->mk", rows.forces, 0.5 * (force[:-2] + force[2:]))
    return Explanation(float(loss), b[n:], deviation[n:], errors, around, W, row_size)


def screened(rows: EffortRows, without: Explanation, columns: Sequence[Array], shifts: Sequence[Array]) -> Array:
    """Return about how much each of some columns (m, k, p), and of some shifts (m, k), gains: with R as without it."""
    parts = [rows.joint_terms, *columns, *(shift[..., None] for shift in shifts)]
    x = np.concatenate([*parts, rows.y[..., None]], axis=2)
    gram = x.reshape(rows.y.size, -1).T @ (without.precision @ x).reshape(rows.y.size, -1)
    n = len(rows.prior)
    gram[range(n), range(n)] += rows.prior
    inverse = _inverse_of_shown(gram[:n, :n])
    gram = gram[n:, n:] - gram[n:, :n] @ inverse @ gram[:n, n:]  # what these leave
    gains, at = [], 0
    for part in columns:
        chosen = slice(at, at + part.shape[2])
        at += part.shape[2]
        t = gram[chosen, -1]
        gains.append(0.5 * float(t @ _inverse_of_shown(gram[chosen, chosen]) @ t))
    alone = gram[range(at, len(gram) - 1), range(at, len(gram) - 1)]
    return np.array([*gains, *(gram[at:-1, -1] - 0.5 * alone)])


def _inverse_of_shown(normal: Array) -> Array:
    """Return the pseudo-inverse of a positive semidefinite (p, p) matrix; `numpy.linalg.pinv` takes twice as long."""
    values, vectors = np.linalg.eigh(normal)
    shown = values > RANK_OF_ROWS * values[-1]
    return np.asarray((vectors[:, shown] / values[shown]) @ vectors[:, shown].T)


def coefficient_covariance(normal: Array, scores: Array, prior: Array, free: NDArray[np.bool_]) -> Array:
    """Return the covariance C (p, p) of coefficients by bounded least squares; 0 for those that are at their bounds.

    With the others F the equations are N_FF b = t, so their errors are N_FF^-1 times the sum of the scores less what is
    expected of b,

        C_FF = N_FF^-1 (D sum(s s^T) D + B^-2) N_FF^-1,    s = X^T W (y - X b),    D^2 = m / independent(s)

    whatever the errors' distribution is (Huber 1967), and if they last, too (Newey and West 1987). N (p, p) is
    `normal`, sum(X^T W X) + B^-2 of weights W, s `scores` (m, p) of each instant, and B^-2 has the diagonal `prior`
    (p,): what was known before, 0 for nothing.
    """
    slow = np.sqrt(len(scores) / np.maximum(independent(scores), FEWEST_INDEPENDENT))
    inverse = np.zeros_like(normal)
    inverse[np.ix_(free, free)] = np.linalg.inv(normal[np.ix_(free, free)])
    spread = scores * slow
    return np.asarray(inverse @ (spread.T @ spread + np.diag(prior)) @ inverse)


def row_variance(x: Array, covariance: Array) -> Array:
    """Return the mean square (n,) of X (c - b) in each row, for x (kinds, m, n) and C (kinds n, kinds n)."""
    kinds, m, n = x.shape
    return np.asarray(np.einsum("ami,aibi,bmi->i", x, covariance.reshape(kinds, n, kinds, n), x, optimize=True) / m)


def independent(values: Array) -> Array:
    """Return how many of the samples (m, k) are independent (k,), about 0: m for white noise, 1 for a constant.

    They are m over 1 plus twice the sum of the autocorrelation, up to where this is first negative.
    """
    m = len(values)
    spectrum = np.abs(np.fft.rfft(values, 2 * m, axis=0)) ** 2
    along = np.fft.irfft(spectrum, axis=0)[:m]
    along /= np.maximum(along[0], np.finfo(float).tiny)
    positive = np.cumprod(along > 0.0, axis=0)
    return np.asarray(m / np.maximum(2.0 * np.sum(along * positive, axis=0) - 1.0, 1.0))
