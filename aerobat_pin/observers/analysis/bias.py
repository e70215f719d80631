"""The bias of an estimate, from a free run in which nothing unknown pushed, and how well it is known."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from aerobat_pin.errors import ShapeError
from aerobat_pin.numerics import Array

WINDOW = 2.5  # correlation lengths over which the autocorrelation is summed; Sokal's 5, who counts half of ours


@dataclass(frozen=True)
class Bias:
    """What an estimate reads when nothing pushes.

    Attributes:
        mean: (c,) or a number [unit of the estimate].
        standard_error: of the mean, with the effective number of samples.
        effective_samples: (c,) or a number: how many independent samples the filtered ones are worth.
    """

    mean: Array
    standard_error: Array
    effective_samples: Array

    def remove(self, values: ArrayLike) -> Array:
        """Return values (m,) or (m, c) without the bias."""
        return np.asarray(np.asarray(values, float) - self.mean)


def bias_of(free: ArrayLike) -> Bias:
    """Measure the bias of a free run.

    Args:
        free: (m,) or (m, c), evenly sampled, such as `estimate.components`.

    Raises:
        ShapeError: fewer than two samples, or a number that is not finite.
    """
    values: Array = np.asarray(free, float)
    if values.ndim not in (1, 2) or len(values) < 2 or not np.all(np.isfinite(values)):
        raise ShapeError(f"free run of shape {values.shape}: two finite samples (m,) or (m, c) or more were expected")
    columns = values.reshape(len(values), -1).T
    count = np.array([len(values) / correlation_length(column) for column in columns]).reshape(values.shape[1:])
    spread = np.std(values, axis=0, ddof=1)
    return Bias(np.mean(values, axis=0), spread / np.sqrt(count), count)


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
