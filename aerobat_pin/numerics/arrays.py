"""The array type of this package, and functions that check the arrays of a caller."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from aerobat_pin.errors import ShapeError

Array = NDArray[np.floating[Any]]


def shaped(values: ArrayLike, shape: tuple[int, ...], name: str) -> Array:
    """Return values as a contiguous array of doubles, as kernels need. Raises ShapeError if the shape is wrong."""
    array = np.ascontiguousarray(values, float)
    if array.shape != shape:
        raise ShapeError(f"{name} has shape {array.shape}: {shape} was expected")
    return array


def checked(values: ArrayLike, size: int, name: str) -> Array:
    """Return a copy of a vector. Raises ShapeError with its name if its size is wrong or a number is not finite."""
    vector = np.array(values, float)
    if vector.shape != (size,):
        raise ShapeError(f"{name} has shape {vector.shape}: ({size},) was expected")
    if not np.all(np.isfinite(vector)):
        raise ShapeError(f"{name} holds NaN or infinity")
    return vector
