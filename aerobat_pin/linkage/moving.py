"""Points and bars that move with the crank, each with its first two derivatives by the crank angle."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from aerobat_pin.numerics import Array

Complex = NDArray[np.complex128]


class Pin(NamedTuple):
    """A point that moves with the crank: position [m] and its first and second derivative by t1 [m/rad, m/rad2]."""

    at: Complex
    d: Complex
    d2: Complex

    def __add__(self, other: Pin) -> Pin:  # type: ignore[override]
        """Add two moving points."""
        return Pin(self.at + other.at, self.d + other.d, self.d2 + other.d2)


class Angle(NamedTuple):
    """A bar's absolute angle [rad] and its first and second derivative by t1."""

    at: Array
    d: Array
    d2: Array

    def carry(self, arm: complex) -> Pin:
        """Return R(t) arm: the moving tip of an `arm` [m] that is fixed in the bar's frame and starts at the origin."""
        at = np.exp(1j * self.at) * arm
        return Pin(at, 1j * self.d * at, (1j * self.d2 - self.d**2) * at)


def still(point: complex, like: Array) -> Pin:
    """Return a point that does not move, repeated in the shape of `like`."""
    at = np.full(like.shape, point)
    return Pin(at, np.zeros_like(at), np.zeros_like(at))


def meet(a: Pin, reach_a: float, b: Pin, reach_b: float) -> Pin:
    """Close a dyad: return the pin C with |C - A| = reach_a, |C - B| = reach_b, left of the ray A -> B.

    C is NaN where no such point exists. Its derivatives come from differentiating both constraints by t1 once,
    (C - A).(C' - A') = 0, and twice.
    """
    ray = b.at - a.at
    d = np.abs(ray)
    x = (reach_a**2 - reach_b**2 + d**2) / (2.0 * d)
    h2 = reach_a**2 - x**2
    c = a.at + (x + 1j * np.sqrt(np.where(h2 > 0.0, h2, np.nan))) * ray / d
    u, w = c - a.at, c - b.at
    c_d = _solve_dots(u, w, _dot(u, a.d), _dot(w, b.d))
    c_d2 = _solve_dots(u, w, _dot(u, a.d2) - np.abs(c_d - a.d) ** 2, _dot(w, b.d2) - np.abs(c_d - b.d) ** 2)
    return Pin(c, c_d, c_d2)


def bar_angle(start: Pin, end: Pin, arm: complex) -> Angle:
    """Return the angle of the bar from start to end; `arm` is the vector between these pins in the bar's frame."""
    bar, bar_d, bar_d2 = (e - s for e, s in zip(end, start, strict=True))
    length2 = abs(arm) ** 2
    return Angle(np.angle(bar / arm), _cross(bar, bar_d) / length2, _cross(bar, bar_d2) / length2)


def opening(a: Pin, c: Pin, b: Pin) -> Array:
    """Return the angle at C between the bars to A and to B, in [0, pi]."""
    between: Array = np.abs(np.angle((a.at - c.at) / (b.at - c.at)))
    return between


def wrapped(angle: Array) -> Array:
    """Return an angle in [-pi, pi)."""
    return (angle + np.pi) % (2.0 * np.pi) - np.pi


def _dot(u: Complex, w: Complex) -> Array:
    return np.asarray((u.conj() * w).real)


def _cross(u: Complex, w: Complex) -> Array:
    return np.asarray((u.conj() * w).imag)


def _solve_dots(u: Complex, w: Complex, a: Array, b: Array) -> Complex:
    """Return z with u.z = a and w.z = b."""
    return np.asarray(1j * (b * u - a * w) / _cross(u, w))
