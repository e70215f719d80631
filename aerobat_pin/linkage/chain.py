"""Three dyads in a row: from the crank angle to every bar and pin, each with two derivatives by the crank angle."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from aerobat_description.morphology_tables import LinkageLengths
from aerobat_pin.linkage.arms import Complex, bent_arms
from aerobat_pin.numerics import Array


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


def close_dyads(bars: LinkageLengths, crank_angle: Array) -> tuple[dict[str, Angle], dict[str, Pin]]:
    """Close the dyads at J4, J7 and J10 one after the other.

    Args:
        bars: bar lengths and pivots.
        crank_angle: absolute t1, any shape [rad].

    Returns:
        The angles of the bars, and the pins. If a dyad cannot close, its values and all that follow are NaN.
    """
    arm = bent_arms(bars)
    t1 = Angle(crank_angle[()], np.ones_like(crank_angle)[()], np.zeros_like(crank_angle)[()])
    j1, j5, j8 = (still(complex(*pivot), crank_angle) for pivot in (bars.P1, bars.P5, bars.P8))
    with np.errstate(invalid="ignore"):
        j2 = j1 + t1.carry(bars.L1)
        j4 = meet(j2, bars.L2a, j5, abs(arm.J5_J4))
        t2, t5 = bar_angle(j2, j4, bars.L2a), bar_angle(j5, j4, arm.J5_J4)
        j3 = j2 + t2.carry(arm.J2_J3)
        j7 = meet(j3, bars.L4, j8, abs(arm.J8_J7))
        t3, t8 = bar_angle(j3, j7, bars.L4), bar_angle(j8, j7, arm.J8_J7)
        j9 = j8 + t8.carry(arm.J8_J9)
        j6 = j5 + t5.carry(arm.J5_J6)
        j10 = meet(j9, bars.L6, j6, abs(arm.J6_J10))
        t9, t6 = bar_angle(j9, j10, bars.L6), bar_angle(j6, j10, arm.J6_J10)
    angles = {"t1": t1, "t2": t2, "t3": t3, "t5": t5, "t6": t6, "t8": t8, "t9": t9}
    pins = {"J1": j1, "J2": j2, "J3": j3, "J4": j4, "J5": j5, "J6": j6, "J7": j7, "J8": j8, "J9": j9, "J10": j10}
    return angles, pins
