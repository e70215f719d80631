"""Sigma_K: the closure of the Kinetic Sculpture, the planar linkage that drives shoulder and elbow.

Seven bars L1..L7 and ten pins J1..J10 have one degree of freedom, the crank angle t1. Three dyads close one after the
other (paper, section II-A; loops at J4, J7 and J10):

    J4:   P2 + L2a e(t2) = P5 + R(t5 - alpha3) [-L3b, L3c]     P2 = P1 + L1 e(t1)
    J7:   P3 + L4 e(t3)  = P8 + R(t8) [-L5a, L5b]              P3 = P2 + R(t2) [L2b, L2c]
    J10:  P9 + L6 e(t9)  = P6 + R(t6) [L7b, L7c]               P9 = P8 + R(t8) [L5c, L5d]

A point of the plane is a complex number, outboard + i up, so a rotation is a product. The plane is that of the left
wing; the right one mirrors it. Angles are absolute and counter-clockwise; theta_s = t5 and theta_e = t6 - t5.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from aerobat_description.morphology import LinkageLengths, Morphology
from aerobat_pin.arrays import Array
from aerobat_pin.errors import LinkageError, ShapeError

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
        """Return the path of `arm` [m], fixed in the bar's frame: R(t) arm."""
        at = np.exp(1j * self.at) * arm
        return Pin(at, 1j * self.d * at, (1j * self.d2 - self.d**2) * at)


@dataclass(frozen=True)
class Closure:
    """The closed linkage at one or many crank angles; every field has the shape of the crank angle.

    `theta_s_dot` and the like are by time, `dtheta_s` and `d2theta_s` by crank angle. `angles` holds the absolute bar
    angles t1, t2, t3, t5, t6, t8, t9 [rad], `pins` the positions J1..J10 (..., 2) [m] (outboard, up), `gap` what is
    left open at J4, J7 or J10 when its second bar is followed [m], `transmission` the angle between the two bars at
    J4, J7 and J10 [rad].
    """

    crank_angle: Array
    theta_s: Array
    theta_e: Array
    theta_s_dot: Array
    theta_e_dot: Array
    theta_s_ddot: Array
    theta_e_ddot: Array
    dtheta_s: Array
    dtheta_e: Array
    d2theta_s: Array
    d2theta_e: Array
    angles: Mapping[str, Array]
    pins: Mapping[str, Array]
    gap: Array
    transmission: Mapping[str, Array]

    def crank_torque(self, shoulder_torque: ArrayLike, elbow_torque: ArrayLike) -> Array:
        """Map one wing's joint torques to the crank by virtual work: tau_s dtheta_s + tau_e dtheta_e [N m]."""
        shoulder, elbow = np.asarray(shoulder_torque, float), np.asarray(elbow_torque, float)
        return np.asarray(shoulder * self.dtheta_s + elbow * self.dtheta_e)

    @property
    def residual(self) -> float:
        """Largest gap over all crank angles [m]."""
        return float(np.max(self.gap))


class KineticSculpture:
    """The linkage of one wing in its (+,+,+) assembly.

    Args:
        lengths: bar lengths and pivots; those of the default morphology when omitted.
    """

    def __init__(self, lengths: LinkageLengths | None = None) -> None:
        """Keep the lengths; `check` tells whether the crank can turn."""
        self.lengths = lengths if lengths is not None else Morphology.load("aerobat").linkage

    def solve(
        self, crank_angle: ArrayLike, crank_velocity: ArrayLike = 0.0, crank_acceleration: ArrayLike = 0.0
    ) -> Closure:
        """Close the linkage.

        Args:
            crank_angle: absolute t1 [rad], scalar or any shape.
            crank_velocity: [rad/s], broadcast against the angle.
            crank_acceleration: [rad/s2], broadcast against the angle.

        Raises:
            LinkageError: a dyad cannot close; the message names its pin and the crank angle.
            ShapeError: an angle, velocity or acceleration is not finite.
        """
        t1, rate, acceleration = np.broadcast_arrays(
            *(np.asarray(x, float) for x in (crank_angle, crank_velocity, crank_acceleration))
        )
        if not (np.all(np.isfinite(t1)) and np.all(np.isfinite(rate)) and np.all(np.isfinite(acceleration))):
            raise ShapeError("crank angle, velocity and acceleration must be finite")
        bars = self.lengths
        crank = Angle(t1, np.ones_like(t1), np.zeros_like(t1))
        p1, p5, p8 = (_still(complex(*pivot), t1) for pivot in (bars.P1, bars.P5, bars.P8))
        p2 = p1 + crank.carry(bars.L1)

        rocker = np.exp(-1j * bars.alpha3) * complex(-bars.L3b, bars.L3c)
        j4 = self._dyad("J4", t1, p2, bars.L2a, p5, abs(rocker))
        t2, t5 = _bar_angle(p2, j4, bars.L2a), _bar_angle(p5, j4, rocker)

        p3 = p2 + t2.carry(complex(bars.L2b, bars.L2c))
        lever = complex(-bars.L5a, bars.L5b)
        j7 = self._dyad("J7", t1, p3, bars.L4, p8, abs(lever))
        t3, t8 = _bar_angle(p3, j7, bars.L4), _bar_angle(p8, j7, lever)

        p9 = p8 + t8.carry(complex(bars.L5c, bars.L5d))
        elbow = complex(bars.L3a + bars.L3c * np.sin(bars.alpha3), bars.L3c * np.cos(bars.alpha3))
        p6 = p5 + t5.carry(elbow)
        forearm = complex(bars.L7b, bars.L7c)
        j10 = self._dyad("J10", t1, p9, bars.L6, p6, abs(forearm))
        t9, t6 = _bar_angle(p9, j10, bars.L6), _bar_angle(p6, j10, forearm)

        elbow_angle = Angle(_wrapped(t6.at - t5.at), t6.d - t5.d, t6.d2 - t5.d2)
        paths = {"J1": p1, "J2": p2, "J3": p3, "J4": j4, "J5": p5, "J6": p6, "J7": j7, "J8": p8, "J9": p9, "J10": j10}
        pins = {name: np.stack([path.at.real, path.at.imag], axis=-1) for name, path in paths.items()}
        ends = (p5 + t5.carry(rocker), p8 + t8.carry(lever), p6 + t6.carry(forearm))
        gap = np.max([np.abs(end.at - pin.at) for end, pin in zip(ends, (j4, j7, j10), strict=True)], axis=0)
        return Closure(
            crank_angle=t1,
            theta_s=t5.at,
            theta_e=elbow_angle.at,
            theta_s_dot=t5.d * rate,
            theta_e_dot=elbow_angle.d * rate,
            theta_s_ddot=t5.d2 * rate**2 + t5.d * acceleration,
            theta_e_ddot=elbow_angle.d2 * rate**2 + elbow_angle.d * acceleration,
            dtheta_s=t5.d,
            dtheta_e=elbow_angle.d,
            d2theta_s=t5.d2,
            d2theta_e=elbow_angle.d2,
            angles={"t1": t1, "t2": t2.at, "t3": t3.at, "t5": t5.at, "t6": t6.at, "t8": t8.at, "t9": t9.at},
            pins=pins,
            gap=gap,
            transmission={
                "J4": _opening(p2, j4, p5),
                "J7": _opening(p3, j7, p8),
                "J10": _opening(p9, j10, p6),
            },
        )

    def check(self) -> None:
        """Raise LinkageError unless the crank can turn through a full circle."""
        self.solve(np.radians(np.arange(0.0, 360.0, 0.5)))

    @staticmethod
    def _dyad(name: str, t1: Array, a: Pin, reach_a: float, b: Pin, reach_b: float) -> Pin:
        """Intersect two circles: the pin C with |C - A| = reach_a, |C - B| = reach_b, left of the ray A -> B.

        Its derivatives follow from the two constraints, (C - A).(C' - A') = 0 and once more by t1.
        """
        ray = b.at - a.at
        d = np.abs(ray)
        x = (reach_a**2 - reach_b**2 + d**2) / (2.0 * d)
        h2 = reach_a**2 - x**2
        if np.any(h2 < 0.0):
            first = float(np.atleast_1d(t1)[np.argmax(np.atleast_1d(h2) < 0.0)])
            gap = float(np.atleast_1d(d)[np.argmax(np.atleast_1d(h2) < 0.0)])
            message = (
                f"the linkage cannot close at {name} for a crank angle of {np.degrees(first):.1f} deg: its bars of "
                f"{1e3 * reach_a:.3f} and {1e3 * reach_b:.3f} mm cannot span {1e3 * gap:.3f} mm"
            )
            raise LinkageError(message, name, first)
        c = a.at + (x + 1j * np.sqrt(h2)) * ray / d
        u, w = c - a.at, c - b.at
        first_a, first_b = _dot(u, a.d), _dot(w, b.d)
        c_d = _solve_dots(u, w, first_a, first_b)
        c_d2 = _solve_dots(u, w, _dot(u, a.d2) - np.abs(c_d - a.d) ** 2, _dot(w, b.d2) - np.abs(c_d - b.d) ** 2)
        return Pin(c, c_d, c_d2)


def _still(point: complex, like: Array) -> Pin:
    at = np.full(like.shape, point)
    return Pin(at, np.zeros_like(at), np.zeros_like(at))


def _dot(u: Complex, w: Complex) -> Array:
    return np.asarray((u.conj() * w).real)


def _cross(u: Complex, w: Complex) -> Array:
    return np.asarray((u.conj() * w).imag)


def _solve_dots(u: Complex, w: Complex, a: Array, b: Array) -> Complex:
    """Return z with u.z = a and w.z = b."""
    return np.asarray(1j * (b * u - a * w) / _cross(u, w))


def _bar_angle(start: Pin, end: Pin, arm: complex) -> Angle:
    """Return the angle of the bar whose `arm`, in its own frame, points from start to end."""
    bar, bar_d, bar_d2 = (e - s for e, s in zip(end, start, strict=True))
    length2 = abs(arm) ** 2
    return Angle(np.angle(bar / arm), _cross(bar, bar_d) / length2, _cross(bar, bar_d2) / length2)


def _wrapped(angle: Array) -> Array:
    return np.asarray((angle + np.pi) % (2.0 * np.pi) - np.pi)


def _opening(a: Pin, c: Pin, b: Pin) -> Array:
    """Return the angle at C between the bars to A and to B, in [0, pi]."""
    return np.asarray(np.abs(np.angle((a.at - c.at) / (b.at - c.at))))
