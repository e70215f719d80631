"""The closed linkage: position, velocity and acceleration of every bar and pin."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import cast

import numpy as np
from numpy.typing import ArrayLike

from aerobat_description.morphology_tables import LinkageLengths
from aerobat_pin.linkage.arms import ANGLES, loops
from aerobat_pin.linkage.chain import Angle, Pin, opening, wrapped
from aerobat_pin.numerics import Array, guarded, together

DYADS = {"J4": ("J2", "J5"), "J7": ("J3", "J8"), "J10": ("J9", "J6")}  # pin: the pins at the other ends of its two bars


class _JointPart:
    """A property of `Closure`: the shoulder or elbow angle, or a derivative of it by crank angle or by time."""

    def __init__(self, joint: str, part: str, meaning: str) -> None:
        self.joint, self.part, self.__doc__ = joint, part, meaning

    def __get__(self, closure: Closure, _: type | None = None) -> Array:
        moving: Angle = getattr(closure, self.joint)
        found = getattr(moving, self.part) if self.part in Angle._fields else getattr(closure, self.part)(moving)
        return cast(Array, found)


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
        upper, fore = self.bars["t5"], self.bars["t6"]
        return Angle(wrapped(fore.at - upper.at), fore.d - upper.d, fore.d2 - upper.d2)

    def rate(self, moving: Angle | Pin) -> Array:
        """Return the rate of a bar [rad/s], or the velocity of a pin as a complex number [m/s]."""
        return cast(Array, moving.d * self.crank_velocity)

    def acceleration(self, moving: Angle | Pin) -> Array:
        """Return the acceleration of a bar [rad/s2], or of a pin as a complex number [m/s2]."""
        return cast(Array, moving.d2 * self.crank_velocity**2 + moving.d * self.crank_acceleration)

    @cached_property
    def transmission(self) -> dict[str, Array]:
        """Angle between the two bars that meet at J4, J7 and J10 [rad], in [0, pi]; 0 and pi are singular."""
        at = self.points
        return {name: opening(at[start], at[name], at[end]) for name, (start, end) in DYADS.items()}

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
