"""The array type of this package, and the check that a caller's array is what it should be."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from aerobat_pin.errors import ShapeError

Array = NDArray[np.floating[Any]]


def shaped(values: ArrayLike, shape: tuple[int, ...], name: str) -> Array:
    """Return values as a contiguous array of doubles, as kernels take it. Raises ShapeError where the shape differs."""
    array = np.ascontiguousarray(values, float)
    if array.shape != shape:
        raise ShapeError(f"{name} has shape {array.shape}: {shape} was expected")
    return array


def checked(values: ArrayLike, size: int, name: str) -> Array:
    """Return a private copy of a finite vector. Raises ShapeError naming it."""
    vector = np.array(values, float)
    if vector.shape != (size,):
        raise ShapeError(f"{name} has shape {vector.shape}: ({size},) was expected")
    if not np.all(np.isfinite(vector)):
        raise ShapeError(f"{name} holds NaN or infinity")
    return vector
