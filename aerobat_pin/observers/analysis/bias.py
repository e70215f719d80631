"""The bias of an estimate, from a free run in which nothing unknown pushed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from aerobat_pin.errors import ShapeError
from aerobat_pin.numerics import Array
from aerobat_pin.observers.analysis.correlation import correlation_length


@dataclass(frozen=True)
class Bias:
    """What an estimate reads when nothing pushes.

    Attributes:
        mean: (c,) or a number [unit of the estimate].
        standard_error: of the mean, with the effective number of samples.
        effective_samples: (c,) or a number; samples that hang together through the filter count once.
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
