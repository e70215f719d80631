"""How exact coefficients are that were found by least squares beside unknown forces, and what that does to the rows.

Where b was found and c is true, rows y = J^T f + X c + e are wrong by X (c - b), and the most likely forces, which are
f = G (y - X b) with G = P J R^-1 (`momentum_equations.posterior`), by G X (c - b). With C the covariance of b, the
diagonal of X C X^T belongs to the variance R of the rows, and P then contains the projected error, in records and
streams alike.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from aerobat_pin.numerics import Array

FEWEST_INDEPENDENT = 3.0  # instants that count at least: Student's distribution of fewer has no variance


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
