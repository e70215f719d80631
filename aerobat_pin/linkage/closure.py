"""The closed linkage: three dyads in a row, from the crank angle to every bar and pin and their derivatives by it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple, cast

import numpy as np
from numpy.typing import ArrayLike

from aerobat_description.morphology_tables import LinkageLengths
from aerobat_pin.linkage.arms import ANGLES, Complex, bent_arms, loops
from aerobat_pin.numerics import Array, guarded, together

DYADS = {"J4": ("J2", "J5"), "J7": ("J3", "J8"), "J10": ("J9", "J6")}  # pin: the pins at the other ends of its two bars


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

    def __sub__(self, carrier: Angle) -> Angle:
        """Return the angle relative to that of another bar, in [-pi, pi)."""
        return Angle((self.at - carrier.at + np.pi) % (2.0 * np.pi) - np.pi, self.d - carrier.d, self.d2 - carrier.d2)


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


def _dot(u: Complex, w: Complex) -> Array:
    return np.asarray((u.conj() * w).real)


def _cross(u: Complex, w: Complex) -> Array:
    return np.asarray((u.conj() * w).imag)


def _solve_dots(u: Complex, w: Complex, a: Array, b: Array) -> Complex:
    """Return z with u.z = a and w.z = b."""
    return np.asarray(1j * (b * u - a * w) / _cross(u, w))


def close_dyads(bars: LinkageLengths, crank_angle: Array) -> tuple[dict[str, Angle], dict[str, Pin]]:
    """Close the dyads at J4, J7 and J10 one after the other; return the angles of the bars, and the pins.

    If a dyad cannot close, its values and all that follow are NaN.
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


class _JointPart:
    """A property of `Closure`: the shoulder or elbow angle, or a derivative of it by crank angle or by time."""

    def __init__(self, joint: str, part: str, meaning: str) -> None:
        self.joint, self.part, self.__doc__ = joint, part, meaning

    def __get__(self, closure: Closure, _: type | None = None) -> Array:
        moving: Angle = getattr(closure, self.joint)
        value = getattr(moving, self.part) if self.part in Angle._fields else getattr(closure, self.part)(moving)
        return cast(Array, value)


@dataclass(frozen=True, repr=False)
class Closure:
    """The closed linkage at one or many crank angles.

    Every quantity has the shape of the crank angle; pins have one more axis (outboard, up). The suffixes `_dot` and
    `_ddot` are derivatives by time [per s, per s2], the prefixes `d` and `d2` by crank angle [per rad, per rad2].

    Attributes:
        lengths: bar lengths and pivots of the linkage.
        crank_angle, crank_velocity, crank_acceleration: t1 [rad] and its derivatives by time.
        bars: the absolute angles t1, t2, t3, t5, t6, t8, t9 with their derivatives by crank angle.
        points: the pins J1..J10 as complex numbers with their derivatives by crank angle.
        theta_s, theta_e: shoulder angle t5 and elbow angle t6 - t5 [rad], the elbow angle in [-pi, pi); both with
            derivatives as above.
    """

    lengths: LinkageLengths
    crank_angle: Array
    crank_velocity: Array
    crank_acceleration: Array
    bars: Mapping[str, Angle]
    points: Mapping[str, Pin]

    theta_s = _JointPart("shoulder", "at", "Shoulder angle t5 [rad].")
    dtheta_s = _JointPart("shoulder", "d", "Shoulder angle by crank angle.")
    d2theta_s = _JointPart("shoulder", "d2", "Shoulder angle twice by crank angle.")
    theta_s_dot = _JointPart("shoulder", "rate", "Shoulder rate [rad/s].")
    theta_s_ddot = _JointPart("shoulder", "acceleration", "Shoulder acceleration [rad/s2].")
    theta_e = _JointPart("elbow", "at", "Elbow angle t6 - t5 [rad], in [-pi, pi).")
    dtheta_e = _JointPart("elbow", "d", "Elbow angle by crank angle.")
    d2theta_e = _JointPart("elbow", "d2", "Elbow angle twice by crank angle.")
    theta_e_dot = _JointPart("elbow", "rate", "Elbow rate [rad/s].")
    theta_e_ddot = _JointPart("elbow", "acceleration", "Elbow acceleration [rad/s2].")

    def __repr__(self) -> str:
        if np.size(self.crank_angle) == 0:
            return "Closure(no crank angle)"
        ranges = {"t1": self.crank_angle, "theta_s": self.theta_s, "theta_e": self.theta_e}
        said = (f"{k} {np.degrees(np.min(x)):.1f} .. {np.degrees(np.max(x)):.1f} deg" for k, x in ranges.items())
        return f"Closure({np.size(self.crank_angle)} crank angles, {', '.join(said)}, residual {self.residual:.1e} m)"

    @property
    def angles(self) -> dict[str, Array]:
        """Absolute angles of the bars, by name [rad]."""
        return {name: bar.at for name, bar in self.bars.items()}

    @property
    def pins(self) -> dict[str, Array]:
        """Positions (..., 2) of the pins, by name: outboard, up [m]."""
        return {name: np.stack([pin.at.real, pin.at.imag], axis=-1) for name, pin in self.points.items()}

    @property
    def shoulder(self) -> Angle:
        """Shoulder angle with its derivatives by crank angle."""
        return self.bars["t5"]

    @cached_property
    def elbow(self) -> Angle:
        """Elbow angle with its derivatives by crank angle."""
        return self.bars["t6"] - self.bars["t5"]

    def rate(self, moving: Angle | Pin) -> Array:
        """Return the rate of a bar [rad/s], or the velocity of a pin as a complex number [m/s]."""
        return cast(Array, moving.d * self.crank_velocity)

    def acceleration(self, moving: Angle | Pin) -> Array:
        """Return the acceleration of a bar [rad/s2], or of a pin as a complex number [m/s2]."""
        return cast(Array, moving.d2 * self.crank_velocity**2 + moving.d * self.crank_acceleration)

    @cached_property
    def transmission(self) -> dict[str, Array]:
        """Angle between the two bars that meet at J4, J7 and J10 [rad], in [0, pi]; 0 and pi are singular."""
        at = {name: pin.at for name, pin in self.points.items()}
        return {
            name: np.abs(np.angle((at[start] - at[name]) / (at[end] - at[name])))
            for name, (start, end) in DYADS.items()
        }

    @property
    def residual(self) -> float:
        """Largest gap at J4, J7 and J10 over all crank angles [m]."""
        angles = np.stack([self.bars[name].at for name in ANGLES], axis=-1)
        return float(np.max(np.abs(loops(self.lengths).at(angles)), initial=0.0))

    @guarded()
    def crank_torque(self, shoulder_torque: ArrayLike, elbow_torque: ArrayLike) -> Array:
        """Map one wing's joint torques to the crank by virtual work: tau_s dtheta_s + tau_e dtheta_e [N m]."""
        shoulder, elbow = np.asarray(shoulder_torque), np.asarray(elbow_torque)
        together(shoulder_torque=shoulder, elbow_torque=elbow, crank_angle=self.crank_angle)
        return shoulder * self.dtheta_s + elbow * self.dtheta_e

    @guarded()
    def joint_torques(self, crank_torque: ArrayLike) -> tuple[Array, Array]:
        """Distribute a crank torque over one wing's joints: return shoulder and elbow torque [N m].

        tau = tau_crank d / (d.d) with d = [dtheta_s, dtheta_e]. Every pair with tau.d = tau_crank does the same work as
        the crank. The pair returned is the smallest: it has no part that only strains the linkage. `crank_torque` is
        the inverse.
        """
        torque, _ = together(crank_torque=np.asarray(crank_torque), crank_angle=self.crank_angle)
        share = torque / (self.dtheta_s**2 + self.dtheta_e**2)
        return share * self.dtheta_s, share * self.dtheta_e
