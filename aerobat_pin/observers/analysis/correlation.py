"""How many samples of a filtered series are worth one independent sample."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from aerobat_pin.numerics import Array

WINDOW = 2.5  # correlation lengths over which the autocorrelation is summed; Sokal's 5, who counts half of ours


def correlation_length(series: ArrayLike) -> float:
    """Return tau = 1 + 2 sum rho_k, by which the variance of a mean exceeds that of independent samples.

    The sum ends where it covers `WINDOW` times its own value: further lags hold noise alone (A. Sokal,
    Monte Carlo Methods in Statistical Mechanics, 1989). White noise has 1, a
    first-order filter of white noise (1 + a)/(1 - a) with a = exp(-K dt).

    Args:
        series: (m,) or (m, c), of which the longest counts; its mean is taken off.
    """
    values: Array = np.asarray(series, float).reshape(len(np.asarray(series)), -1)
    return max(_column_length(column - column.mean()) for column in values.T)


def _column_length(centred: Array) -> float:
    count = len(centred)
    spectrum = np.fft.rfft(centred, 2 * count)  # padded: lags must not wrap around
    products = np.fft.irfft(spectrum * spectrum.conj())[:count]
    if not products[0] > 0.0:
        return 1.0
    sums = 2.0 * np.cumsum(products / products[0]) - 1.0
    covered = np.arange(count) >= WINDOW * sums
    return float(max(1.0, sums[int(np.argmax(covered)) if np.any(covered) else -1]))
