"""The array type of this package, and functions that check the arrays of a caller."""

from __future__ import annotations

import itertools
from contextlib import suppress
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from aerobat_pin.errors import ArgumentError, ShapeError

Array = NDArray[np.floating[Any]]
LARGEST_REAL = 1.0e15  # no quantity in SI units is larger; squares and products of such numbers are finite


def real_numbers(values: ArrayLike, name: str) -> Array:
    """Return values as an array of doubles. Raises ArgumentError with `name` if they are not real numbers."""
    try:
        array = np.asarray(values)
    except (TypeError, ValueError) as error:  # lists of different lengths
        raise ArgumentError(f"{name} = {shown(values)}: an array of numbers was expected") from error
    if array.dtype.kind not in "iuf":
        raise ArgumentError(f"{name} = {shown(values)}: real numbers were expected")
    return np.asarray(array, float)


def shown(value: Any) -> str:
    """Return a value as short text for an error message."""
    if value is None or isinstance(value, str | bytes | float | complex | type | int | list | tuple):
        with suppress(ValueError):  # whole numbers of thousands of digits have no text
            text = repr(value)
            return text if len(text) <= 60 else f"{text[:50]}..."
    return f"an object of {type(value).__name__}"


def runs_of_true(mask: ArrayLike) -> list[tuple[int, int]]:
    """Return first index and last index + 1 of each run of True in a mask (n,)."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], np.asarray(mask, bool), [False]])))
    return list(zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True))


def checked_shape(array: Array, shape: Any, name: str, sizes: dict[Any, Any] | None = None) -> None:
    """Raise ShapeError unless an array has a shape.

    Args:
        array: the array.
        shape: tuple of sizes, or a list of such tuples of which one must fit. A name stands for any size, `...` at the
            start for any number of sizes, and `2+` for two or more.
        name: name of the array in the error.
        sizes: what names and `...` stand for, from other arrays; new ones are added.
    """
    known = {} if sizes is None else sizes
    shapes = shape if isinstance(shape, list) else [shape]
    if not any(_fits(array.shape, option, known) for option in shapes):
        texts = " or ".join(_shape_text(option, known) for option in shapes)
        raise ShapeError(f"{name} has shape {array.shape}: {texts} was expected")


def _fits(actual: tuple[int, ...], shape: tuple[Any, ...], known: dict[Any, Any]) -> bool:
    if shape[:1] == (...,):
        split = max(len(actual) - len(shape) + 1, 0)
        if known.setdefault(..., actual[:split]) != actual[:split]:
            return False
        shape, actual = shape[1:], actual[split:]
    return len(shape) == len(actual) and all(map(_fits_size, actual, shape, itertools.repeat(known)))


def _fits_size(actual: int, size: Any, known: dict[Any, Any]) -> bool:
    if not isinstance(size, str):
        return bool(actual == size)
    return actual >= int(size[:-1]) if size.endswith("+") else bool(actual == known.setdefault(size, actual))


def _shape_text(shape: tuple[Any, ...], known: dict[Any, Any]) -> str:
    sizes = [*known.get(..., ["..."]), *shape[1:]] if shape[:1] == (...,) else shape
    parts = [str(known.get(size, size)) for size in sizes]
    return f"({', '.join(parts)}{',' * (len(parts) == 1)})"


def together(**arrays: Array) -> list[Array]:
    """Broadcast arrays against each other. Raises ShapeError with their names if their shapes do not fit."""
    try:
        return list(np.broadcast_arrays(*arrays.values()))
    except ValueError:
        shapes = ", ".join(f"{name} {array.shape}" for name, array in arrays.items())
        raise ShapeError(f"shapes that fit each other were expected: {shapes}") from None


def shaped(values: ArrayLike, shape: tuple[int, ...], name: str) -> Array:
    """Return values as a contiguous array of doubles, as kernels need.

    Raises:
        ArgumentError: the values are not real numbers.
        ShapeError: the shape is wrong.
    """
    array = real_numbers(values, name)
    checked_shape(array, shape, name)
    return np.ascontiguousarray(array)


def checked(values: ArrayLike, size: int, name: str) -> Array:
    """Return a copy of a vector.

    Raises:
        ArgumentError: the values are not real numbers.
        ShapeError: the size is wrong or a number is not finite.
    """
    vector = np.array(real_numbers(values, name))
    checked_shape(vector, (size,), name)
    if not np.all(np.isfinite(vector)):
        raise ShapeError(f"{name} holds NaN or infinity")
    return vector
