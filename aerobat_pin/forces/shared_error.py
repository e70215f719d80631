"""Errors that all rows of a fixed robot share: of the masses, or of a factor of the efforts, which may drift.

    y = J^T f + X b + c n + e,    f ~ N(0, S^2),    e ~ N(0, R),    c a number for each stretch of the record

y are rows, X b friction, n what motion and weight need. Most of c n looks like a force at the points, so that R, which
rows to spare show row by row, does not contain it: of what a tool's arm weighs they show some hundredths, in squares.
But all instants of a stretch share a factor, so that it becomes known to some thousandths.
"""

from __future__ import annotations

import numpy as np

from aerobat_pin.forces.coefficient_errors import coefficient_covariance
from aerobat_pin.forces.expected_of_record import STRETCHES
from aerobat_pin.forces.instants import column_rms
from aerobat_pin.numerics import Array

NO_CHANCE = 3.0  # standard deviations from which a factor counts
HARDLY_FELT = 1e-9  # share of a coefficient's information that is added to it


def shared_error(y: Array, friction: Array, needed: Array, force: Array, variance: Array) -> Array:
    """Return the rms (k,) of c n in each row [N, N m]: the median of c^2 over stretches, 0 where chance explains it.

    Args:
        y: (m, k) rows, generalised forces of the joints [N, N m].
        friction: (m, k, p) columns of X [N, N m for each unit of their coefficients].
        needed: (m, k) n [N, N m].
        force: (m, c, k) S J, of the expected size of each component [N, N m].
        variance: (m, k) R, the squares of the rows' unit.
    """
    each = np.repeat(np.eye(STRETCHES), -(-len(y) // STRETCHES), axis=0)[: len(y)]
    columns = np.concatenate([needed[:, :, None] * each[:, None], friction], axis=2)
    b, covariance = beside_forces(columns, y, force, variance, np.zeros(columns.shape[2]))
    square, chance = b[:STRETCHES] ** 2, np.diag(covariance)[:STRETCHES]
    size = np.sqrt(np.median(np.where(square > NO_CHANCE**2 * chance, square, 0.0)))
    return np.asarray(size * column_rms(needed))


def beside_forces(columns: Array, y: Array, force: Array, variance: Array, prior: Array) -> tuple[Array, Array]:
    """Return the most likely coefficients (p,) of columns (m, k, p) in rows beside forces, and their covariance.

    `prior` (p,) is the inverse of the variance that is expected of each, 0 for none; the rest as in `shared_error`.
    """
    p, at = columns.shape[2], range(y.shape[1])
    cov = np.swapaxes(force, 1, 2) @ force
    cov[:, at, at] += variance
    white = np.linalg.solve(cov, np.concatenate([columns, y[:, :, None]], axis=2))
    flat = columns.reshape(-1, p)
    both = flat.T @ white.reshape(len(flat), -1)
    normal, target = both[:, :p], both[:, p]
    felt = np.diag(normal) > 0.0
    normal[range(p), range(p)] += prior + HARDLY_FELT * np.diag(normal)
    b = np.zeros(p)
    b[felt] = np.linalg.solve(normal[np.ix_(felt, felt)], target[felt])
    scores = np.einsum("mkp,mk->mp", columns, white[:, :, p] - white[:, :, :p] @ b)
    covariance = coefficient_covariance(normal, scores, prior, felt)
    unfelt = ~felt & (prior > 0.0)
    covariance[unfelt, unfelt] = 1.0 / prior[unfelt]
    return b, covariance


def in_own_rows(x: Array, at: list[int], rows: int) -> Array:
    """Return columns (m, rows, kinds n) of what kinds of friction (kinds, m, n) do in the rows `at` of their joints."""
    spread = x[:, :, None] * np.eye(rows)[at].T  # (kinds, m, rows, n)
    return np.asarray(np.concatenate(list(spread), axis=2))
