"""Gains of an observer: one number, one for each filtered quantity, or a matrix."""

from __future__ import annotations

import numpy as np

from aerobat_pin.errors import ObserverError
from aerobat_pin.numerics import Array


def modes(gain: Array, size: int) -> tuple[Array, Array]:
    """Split a gain into gains (size,) and the orthonormal basis (size, size) in which they act.

    The basis is empty unless the gain is a matrix. Raises ObserverError if the gain does not fit or is not positive.
    """
    if gain.shape not in ((), (size,), (size, size)):
        raise ObserverError(
            f"gain of shape {gain.shape}: one number, {size} numbers or a matrix of {size} x {size} were expected"
        )
    gains, basis = gain, np.zeros((0, 0))
    if gain.ndim == 2 and np.all(np.isfinite(gain)):
        if not np.allclose(gain, gain.T, rtol=1e-9, atol=0.0):
            raise ObserverError("gain matrix: a symmetric one was expected")
        gains, basis = np.linalg.eigh(gain)
    if not (np.all(np.isfinite(gains)) and np.all(gains > 0.0)):
        raise ObserverError(f"gain = {gain}: a finite positive gain in 1/s was expected")
    return np.array(np.broadcast_to(gains, (size,))), basis
