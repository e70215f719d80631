"""A planform: lengths along its span, and by how much its open tips reduce the added mass pi rho b^2 per span.

A length is one number, a function, a polyline, or a number for each station.

A plate that accelerates along its normal in still air carries a potential jump mu(x, y), which makes the normal
velocity of the air equal to that of the plate. The added mass per span is rho times the integral of mu over the chord,
at unit velocity. Here mu is constant on each panel of a grid, a ring vortex along the panel's edge; no-flow is required
at the panels' centres. Grid lines and centres lie at equal angles of a cosine along span and chord, since mu falls to
zero as the square root of the distance from the edge.

The factor is local: 1 in the middle of a long wing, falling to 0 at its tips. It is exact for a wing that plunges, and
used for every motion. On an elliptic wing it is the same at every section, 1 / E (Lamb, Hydrodynamics, art. 373; the
disc: 2 / pi); on rectangular wings its mean is the coefficient of Blevins (Formulas for natural frequency and mode
shape, 1979, table 14-1). By reciprocity, local factors of a plunging wing also give the total force of any other motion
along the normal exactly. Moments of inertia are not exact: against flapping 6 % too large at aspect ratio 4 and 3 % at
6, against pitching about 8 and 6 % too small.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike

from aerobat_pin.errors import ArgumentError, ShapeError
from aerobat_pin.numerics import LARGEST_REAL, Array, real_numbers, shown

AlongSpan = float | ArrayLike | Callable[[Array], ArrayLike]
FINE = 4096  # number of midpoints in theta at which a planform is sampled for its area, accurate to 1e-7
PANELS = (6, 48)  # along chord and span: 0.2 % of the tabulated coefficients


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
        lengths = real_numbers(given(y), f"{name} as a function")
        if lengths.shape not in ((), y.shape):
            raise ShapeError(
                f"{name} as a function has shape {lengths.shape} at {len(y)} stations: {y.shape} was expected"
            )
        wrong = ~(np.abs(lengths) <= LARGEST_REAL)
        if np.any(wrong):
            raise ShapeError(f"{name} = {lengths[wrong][0]}: finite lengths in metres were expected")
        return np.array(np.broadcast_to(lengths, y.shape))

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


def added_mass_factor(chord: Callable[[Array], Array], span: float, y: Array) -> Array:
    """Return the added mass per span, divided by pi rho b^2, at stations y (n,) [m] of a planform."""
    edge_y, centre = _edges_and_centres(PANELS[1])
    factor = _factor_of_chords(span, *(tuple(chord(0.5 * span * at).tolist()) for at in (centre, edge_y)))
    # mu vanishes at the tips as a square root: interpolating over the angle of the cosine follows it.
    angles, factors = np.arccos([1.0, *centre[::-1], -1.0]), [0.0, *factor[::-1], 0.0]
    return np.asarray(np.interp(np.arccos(2.0 * y / span), angles, factors))


@lru_cache(maxsize=16)  # a plant, a belief and each run of a sweep have the same wing
def _factor_of_chords(span: float, chords: tuple[float, ...], at_edges: tuple[float, ...]) -> Array:
    """Return the factor between the edges of panels, given the chords there and at the edges."""
    edge_x, x = _edges_and_centres(PANELS[0])
    edge_y, centre = _edges_and_centres(PANELS[1])
    length, corner_x, half = np.array(chords), 0.5 * np.outer(edge_x, at_edges), len(x) // 2
    at_x, at_y = 0.5 * np.outer(x[:half], length), np.broadcast_to(0.5 * span * centre, (half, len(centre)))
    rings = _rings(corner_x, np.broadcast_to(0.5 * span * edge_y, corner_x.shape), at_x.ravel(), at_y.ravel())
    influence = (rings[:, :half] + rings[:, : half - 1 : -1]).reshape(at_x.size, -1)  # mu is even about mid-chord
    jump = _solved(influence, np.ones(at_x.size)).reshape(at_x.shape)
    return np.asarray(np.abs(np.diff(edge_x)[:half] @ jump) / (0.25 * np.pi * length))


def _solved(matrix: Array, values: Array) -> Array:
    """Solve linear equations by elimination; matrix and values are overwritten.

    A library's solver adds in an order that depends on its number of threads, so flights would differ in their last
    digits from process to process. The matrix is dominated by its diagonal and needs no pivoting.
    """
    for k in range(len(values)):
        share = matrix[k + 1 :, k] / matrix[k, k]
        matrix[k + 1 :, k:] -= share[:, None] * matrix[k, k:]
        values[k + 1 :] -= share * values[k]
    for k in reversed(range(len(values))):
        values[k] = (values[k] - np.sum(matrix[k, k + 1 :] * values[k + 1 :])) / matrix[k, k]
    return values


def _edges_and_centres(panels: int) -> tuple[Array, Array]:
    """Return the edges (n + 1,) and centres (n,) of panels between -1 and 1, equally spaced in the cosine's angle."""
    angles = np.linspace(np.pi, 0.0, 2 * panels + 1)
    return np.cos(angles[::2]), np.cos(angles[1::2])


def _rings(corner_x: Array, corner_y: Array, x: Array, y: Array) -> Array:
    """Return the normal velocities at points (k,) due to unit ring vortices around the panels of a plane grid (m, n).

    The grid's corners are (m + 1, n + 1), the velocities (k, m, n).
    """
    off_x, off_y = x[:, None, None] - corner_x, y[:, None, None] - corner_y
    along_x, along_y = (off / np.hypot(off_x, off_y) for off in (off_x, off_y))

    def edges(first: tuple[slice, slice], last: tuple[slice, slice]) -> Array:
        """Return the velocities due to the straight vortices from the first corners to the last ones."""
        start, end = (slice(None), *first), (slice(None), *last)
        across = off_x[start] * off_y[end] - off_y[start] * off_x[end]
        turn = (corner_x[last] - corner_x[first]) * (along_x[start] - along_x[end])
        turn += (corner_y[last] - corner_y[first]) * (along_y[start] - along_y[end])
        return np.asarray(turn / np.where(across == 0.0, np.inf, across))

    every, front, back = slice(None), slice(None, -1), slice(1, None)
    out, aft = edges((every, front), (every, back)), edges((front, every), (back, every))
    return np.asarray((aft[..., :-1] + out[:, 1:] - aft[..., 1:] - out[:, :-1]) / (4.0 * np.pi))
