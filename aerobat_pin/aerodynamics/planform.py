"""A length along the span of a wing: one number, a function, a polyline, or a number for each station."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike

from aerobat_pin.errors import ArgumentError, ShapeError
from aerobat_pin.numerics import LARGEST_REAL, Array, real_numbers, shown

AlongSpan = float | ArrayLike | Callable[[Array], ArrayLike]
FINE = 4096  # number of midpoints in theta at which a planform is sampled for its area, accurate to 1e-7


def along_span(values: AlongSpan, y: Array, span: float, name: str) -> tuple[Callable[[Array], Array], Array]:
    """Read a length along the span.

    Args:
        values: one number [m]; a function of the spanwise coordinate y [m]; a polyline as a pair (stations, values) of
            equally long lists [m], the stations rising from tip to tip; or one number for each station (N,) [m], with
            straight lines in between.
        y: stations (N,) [m], falling.
        span: length of the wing from tip to tip [m].
        name: name of the length in error messages.

    Returns:
        The function of y, and its values (N,) at the stations.

    Raises:
        ShapeError: the values have none of these forms, a polyline's stations do not rise from tip to tip, or a value
            is not finite.
    """
    given = values if callable(values) else _function(values, y, span, name)

    def function(y: Array) -> Array:
        found = real_numbers(given(y), f"{name} as a function")
        if found.shape not in ((), y.shape):
            raise ShapeError(
                f"{name} as a function has shape {found.shape} at {len(y)} stations: {y.shape} was expected"
            )
        wrong = ~(np.abs(found) <= LARGEST_REAL)
        if np.any(wrong):
            raise ShapeError(f"{name} = {found[wrong][0]}: finite lengths in metres were expected")
        return np.array(np.broadcast_to(found, y.shape))

    return function, function(y)


def _function(values: float | ArrayLike, y: Array, span: float, name: str) -> Callable[[Array], ArrayLike]:
    """Turn one number, a polyline, or one number for each station into a function of y."""
    allowed = (
        f"one number, {len(y)} numbers for {len(y)} strips, a pair of equally long lists (stations, values), or a "
        "function of y was expected"
    )
    try:
        array = real_numbers(values, name)
    except ArgumentError as error:
        raise ShapeError(f"{name} = {shown(values)}: {allowed}") from error
    if array.shape == ():
        return lambda _: array
    if array.shape == y.shape:
        return lambda where: np.interp(where, y[::-1], array[::-1])
    if array.ndim == 2 and len(array) == 2 and array.shape[1] >= 2:
        stations, lengths = array
        tip = 0.5 * span * (1.0 - 1e-9)
        if not (np.all(np.diff(stations) > 0.0) and stations[0] <= -tip and stations[-1] >= tip):
            raise ShapeError(
                f"{name}: the polyline's stations {stations.tolist()} were expected to rise from tip to tip, "
                f"{-0.5 * span:g} m to {0.5 * span:g} m"
            )
        return lambda where: np.interp(where, stations, lengths)
    raise ShapeError(f"{name} has shape {array.shape}: {allowed}")
