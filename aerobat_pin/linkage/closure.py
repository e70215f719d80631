"""The closed linkage: where every bar and pin is, and how it moves."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import cast

import numpy as np
from numpy.typing import ArrayLike

from aerobat_description.morphology_tables import LinkageLengths
from aerobat_pin.linkage.arms import ANGLES, loops
from aerobat_pin.linkage.moving import Angle, Complex, Pin, opening, wrapped
from aerobat_pin.numerics import Array

DYADS = {"J4": ("J2", "J5"), "J7": ("J3", "J8"), "J10": ("J9", "J6")}  # pin: where its two bars come from


@dataclass(frozen=True)
class Closure:
    """The closed linkage at one or many crank angles.

    Every quantity has the shape of the crank angle (pins one axis more: outboard, up). With suffix `_dot` and `_ddot`
    it is differentiated by time [per s, per s2], with prefix `d` and `d2` by crank angle [per rad, per rad2].

    Attributes:
        lengths: of the linkage.
        crank_angle, crank_velocity, crank_acceleration: t1 [rad] and its derivatives by time.
        bars: the absolute angles t1, t2, t3, t5, t6, t8, t9 with their derivatives by crank angle.
        points: the pins J1..J10 as complex numbers with their derivatives by crank angle.
    """

    lengths: LinkageLengths
    crank_angle: Array
    crank_velocity: Array
    crank_acceleration: Array
    bars: Mapping[str, Angle]
    points: Mapping[str, Pin]

    @property
    def angles(self) -> dict[str, Array]:
        """Absolute bar angles [rad]."""
        return {name: bar.at for name, bar in self.bars.items()}

    @property
    def dangles(self) -> dict[str, Array]:
        """Bar angles by crank angle."""
        return {name: bar.d for name, bar in self.bars.items()}

    @property
    def d2angles(self) -> dict[str, Array]:
        """Bar angles twice by crank angle."""
        return {name: bar.d2 for name, bar in self.bars.items()}

    @property
    def angles_dot(self) -> dict[str, Array]:
        """Rates of the bar angles [rad/s]."""
        return {name: self._rate(bar) for name, bar in self.bars.items()}

    @property
    def angles_ddot(self) -> dict[str, Array]:
        """Accelerations of the bar angles [rad/s2]."""
        return {name: self._acceleration(bar) for name, bar in self.bars.items()}

    @property
    def pins(self) -> dict[str, Array]:
        """Pin positions [m]."""
        return {name: _pair(point.at) for name, point in self.points.items()}

    @property
    def dpins(self) -> dict[str, Array]:
        """Pin positions by crank angle [m/rad]."""
        return {name: _pair(point.d) for name, point in self.points.items()}

    @property
    def d2pins(self) -> dict[str, Array]:
        """Pin positions twice by crank angle [m/rad2]."""
        return {name: _pair(point.d2) for name, point in self.points.items()}

    @property
    def pins_dot(self) -> dict[str, Array]:
        """Pin velocities [m/s]."""
        return {name: _pair(self._rate(point)) for name, point in self.points.items()}

    @property
    def pins_ddot(self) -> dict[str, Array]:
        """Pin accelerations [m/s2]."""
        return {name: _pair(self._acceleration(point)) for name, point in self.points.items()}

    @property
    def theta_s(self) -> Array:
        """Shoulder angle t5 [rad]."""
        return self.bars["t5"].at

    @property
    def dtheta_s(self) -> Array:
        """Shoulder angle by crank angle."""
        return self.bars["t5"].d

    @property
    def d2theta_s(self) -> Array:
        """Shoulder angle twice by crank angle."""
        return self.bars["t5"].d2

    @property
    def theta_s_dot(self) -> Array:
        """Shoulder rate [rad/s]."""
        return self._rate(self.bars["t5"])

    @property
    def theta_s_ddot(self) -> Array:
        """Shoulder acceleration [rad/s2]."""
        return self._acceleration(self.bars["t5"])

    @property
    def theta_e(self) -> Array:
        """Elbow angle t6 - t5 [rad], in [-pi, pi)."""
        return self._elbow.at

    @property
    def dtheta_e(self) -> Array:
        """Elbow angle by crank angle."""
        return self._elbow.d

    @property
    def d2theta_e(self) -> Array:
        """Elbow angle twice by crank angle."""
        return self._elbow.d2

    @property
    def theta_e_dot(self) -> Array:
        """Elbow rate [rad/s]."""
        return self._rate(self._elbow)

    @property
    def theta_e_ddot(self) -> Array:
        """Elbow acceleration [rad/s2]."""
        return self._acceleration(self._elbow)

    @cached_property
    def _elbow(self) -> Angle:
        shoulder, forearm = self.bars["t5"], self.bars["t6"]
        return Angle(wrapped(forearm.at - shoulder.at), forearm.d - shoulder.d, forearm.d2 - shoulder.d2)

    @cached_property
    def transmission(self) -> dict[str, Array]:
        """Angle between the two bars that meet at J4, J7 and J10 [rad], in [0, pi]; singular at both ends."""
        at = self.points
        return {name: opening(at[start], at[name], at[end]) for name, (start, end) in DYADS.items()}

    @cached_property
    def gap(self) -> Array:
        """What is left open at J4, J7 or J10, the largest [m]."""
        angles = np.stack([self.bars[name].at for name in ANGLES], axis=-1)
        largest: Array = np.max(np.abs(loops(self.lengths).at(angles)), axis=-1)
        return largest

    @property
    def residual(self) -> float:
        """Largest gap over all crank angles [m]."""
        return float(np.max(self.gap))

    def crank_torque(self, shoulder_torque: ArrayLike, elbow_torque: ArrayLike) -> Array:
        """Map one wing's joint torques to the crank by virtual work: tau_s dtheta_s + tau_e dtheta_e [N m]."""
        shoulder, elbow = np.asarray(shoulder_torque, float), np.asarray(elbow_torque, float)
        return shoulder * self.dtheta_s + elbow * self.dtheta_e

    def joint_torques(self, crank_torque: ArrayLike) -> tuple[Array, Array]:
        """Spread a crank torque over one wing's joints: shoulder and elbow torque [N m].

        tau = tau_crank d / (d.d) with d = [dtheta_s, dtheta_e]. Any pair with tau.d = tau_crank does the crank's work;
        this is the smallest of them, free of parts that only strain the linkage. `crank_torque` undoes it.
        """
        share = np.asarray(crank_torque, float) / (self.dtheta_s**2 + self.dtheta_e**2)
        return share * self.dtheta_s, share * self.dtheta_e

    def _rate(self, moving: Angle | Pin) -> Array:
        return cast(Array, moving.d * self.crank_velocity)

    def _acceleration(self, moving: Angle | Pin) -> Array:
        return cast(Array, moving.d2 * self.crank_velocity**2 + moving.d * self.crank_acceleration)


def _pair(point: Complex | Array) -> Array:
    return np.stack([point.real, point.imag], axis=-1)
