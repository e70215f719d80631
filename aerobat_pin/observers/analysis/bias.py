"""The bias of an estimate and its standard error, measured in a free run: a record without unknown forces."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from aerobat_pin.errors import ShapeError
from aerobat_pin.numerics import Array, guarded

WINDOW = 2.5  # correlation lengths up to which the autocorrelation is summed; Sokal's 5, with a length twice his


@dataclass(frozen=True)
class Bias:
    """Mean of an estimate in a free run, in which no unknown force acts.

    Attributes:
        mean: (c,) or one number, the bias [unit of the estimate].
        standard_error: (c,) or one number, standard error of the mean, from the effective number of samples.
        effective_samples: (c,) or one number: number of independent samples with the same standard error.
    """

    mean: Array
    standard_error: Array
    effective_samples: Array

    @guarded()
    def remove(self, values: ArrayLike) -> Array:
        """Return the values (m,) or (m, c) minus the bias."""
        return np.asarray(np.asarray(values, float) - self.mean)


@guarded()
def bias_of(free: ArrayLike) -> Bias:
    """Measure the bias in a free run.

    Args:
        free: (m,) or (m, c) evenly sampled estimates of the free run, such as `estimate.components`.

    Raises:
        ShapeError: there are fewer than two samples, or a number is not finite.
    """
    values: Array = np.asarray(free, float)
    if values.ndim not in (1, 2) or len(values) < 2 or not np.all(np.isfinite(values)):
        raise ShapeError(f"free run of shape {values.shape}: two finite samples (m,) or (m, c) or more were expected")
    columns = values.reshape(len(values), -1).T
    count = np.array([len(values) / correlation_length(column) for column in columns]).reshape(values.shape[1:])
    spread = np.std(values, axis=0, ddof=1)
    return Bias(np.mean(values, axis=0), spread / np.sqrt(count), count)


def correlation_length(series: ArrayLike) -> float:
    """Return tau = 1 + 2 sum rho_k, with rho_k the autocorrelation at lag k.

    The variance of the mean of a correlated series is tau times the variance of the mean of independent samples. The
    sum ends at the first lag that is at least `WINDOW` times the sum so far, because later lags contain only noise
    (A. Sokal, Monte Carlo Methods in Statistical Mechanics, 1989). White noise has tau = 1. White noise after a
    first-order filter has tau = (1 + a)/(1 - a) with a = exp(-K dt).

    Args:
        series: (m,) or (m, c) series; its mean is subtracted. For several columns the largest tau is returned.
    """
    values: Array = np.asarray(series, float).reshape(len(np.asarray(series)), -1)
    return max(_column_length(column - column.mean()) for column in values.T)


def _column_length(centred: Array) -> float:
    count = len(centred)
    spectrum = np.fft.rfft(centred, 2 * count)  # padded with zeros, so that lags do not wrap around
    products = np.fft.irfft(spectrum * spectrum.conj())[:count]
    if not products[0] > 0.0:
        return 1.0
    sums = 2.0 * np.cumsum(products / products[0]) - 1.0
    covered = np.arange(count) >= WINDOW * sums
    return float(max(1.0, sums[int(np.argmax(covered)) if np.any(covered) else -1]))
