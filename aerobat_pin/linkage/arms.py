"""The linkage as arms: each pin, and the gap of each loop, is a constant plus arms that turn with the bars.

With e = exp(i t), t = [t1, t2, t3, t5, t6, t8, t9], the pins P and the gaps of the loops are linear in e:

    P = p + V e      gap = c + W e = 0       P' = i V e t'      P'' = V (i t'' - t'^2) e

Only V and W depend on the lengths of the bars. How the loops are closed is the subject of `closure`. The derivatives of
the closed linkage by its adjustable lengths follow from the implicit function theorem on its loops.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from aerobat_description.morphology_tables import LinkageLengths
from aerobat_description.position_closure import ADJUSTABLE, elbow
from aerobat_pin.numerics import Array

Complex = NDArray[np.complex128]
ANGLES = ("t1", "t2", "t3", "t5", "t6", "t8", "t9")  # each is numbered like the pin at which its bar begins
PINS = tuple(f"J{i}" for i in range(1, 11))
T1, T2, T3, T5, T6, T8, T9 = np.eye(7)


class Arms(NamedTuple):
    """Arms of the bent bars [m], named after the pins at their ends, each as x + i y in the frame of its bar."""

    J2_J3: complex
    J5_J4: complex
    J5_J6: complex
    J8_J7: complex
    J8_J9: complex
    J6_J10: complex


def bent_arms(bars: LinkageLengths) -> Arms:
    """Return the arms of the bent bars."""
    return Arms(
        J2_J3=complex(bars.L2b, bars.L2c),
        J5_J4=np.exp(-1j * bars.alpha3) * complex(-bars.L3b, bars.L3c),
        J5_J6=elbow(bars),
        J8_J7=complex(-bars.L5a, bars.L5b),
        J8_J9=complex(bars.L5c, bars.L5d),
        J6_J10=complex(bars.L7b, bars.L7c),
    )


class Linear(NamedTuple):
    """Points (n,) in the plane [m] as functions of the seven angles: `constant` (n,) + `arms` (n, 7) exp(i angles)."""

    constant: Complex
    arms: Complex

    def at(self, angles: Array) -> Complex:
        """Return the points (..., n) [m] at angles (..., 7) [rad]."""
        return np.asarray(self.constant + np.exp(1j * angles) @ self.arms.T)

    def by_angles(self, angles: Array) -> Complex:
        """Return the Jacobian (..., n, 7) of the points with respect to the angles [m/rad]."""
        return np.asarray(1j * np.exp(1j * angles)[..., None, :] * self.arms)

    def centripetal(self, angles: Array, rates: Array) -> Complex:
        """Return the points' acceleration (..., n) [m/s2] at rates (..., 7) [rad/s], without angular acceleration."""
        return np.asarray(-(rates**2 * np.exp(1j * angles)) @ self.arms.T)


def pins(bars: LinkageLengths) -> Linear:
    """Return the ten pins; J4, J7 and J10, where two bars meet, are reached along the first of these bars."""
    arm = bent_arms(bars)
    p1, p5, p8 = (complex(*pivot) for pivot in (bars.P1, bars.P5, bars.P8))
    zero = np.zeros(7)
    j2 = bars.L1 * T1
    j3 = j2 + arm.J2_J3 * T2
    j9 = arm.J8_J9 * T8
    rows = [zero, j2, j3, j2 + bars.L2a * T2, zero, arm.J5_J6 * T5, j3 + bars.L4 * T3, zero, j9, j9 + bars.L6 * T9]
    return Linear(np.array([p1, p1, p1, p1, p5, p5, p1, p8, p8, p8]), np.array(rows, complex))


def loops(bars: LinkageLengths) -> Linear:
    """Return the gaps at J4, J7 and J10: the pin reached along the first bar minus the pin along the second bar."""
    arm, way = bent_arms(bars), pins(bars)
    ends = np.array([arm.J5_J4 * T5, arm.J8_J7 * T8, arm.J5_J6 * T5 + arm.J6_J10 * T6])
    pivots = np.array([complex(*bars.P5), complex(*bars.P8), complex(*bars.P5)])
    first = [PINS.index(name) for name in ("J4", "J7", "J10")]
    return Linear(way.constant[first] - pivots, way.arms[first] - ends)


def loops_by_lengths(bars: LinkageLengths, angles: Array) -> Complex:
    """Return the derivatives (..., 3, 3) of the gaps at fixed angles; the columns are for L3b, L5a and L5b."""
    turn = np.exp(1j * angles)
    by = np.zeros((*angles.shape[:-1], 3, 3), complex)
    by[..., 0, 0] = np.exp(-1j * bars.alpha3) * turn[..., ANGLES.index("t5")]
    by[..., 1, 1] = turn[..., ANGLES.index("t8")]
    by[..., 1, 2] = -1j * turn[..., ANGLES.index("t8")]
    return by


def real_rows(equations: Complex) -> Array:
    """Return complex equations (..., 3, k) as real equations (..., 6, k): real parts, then imaginary parts."""
    return np.concatenate([equations.real, equations.imag], axis=-2)


@dataclass(frozen=True)
class Sensitivity:
    """Derivatives of the closed linkage by one length, at a fixed crank angle.

    `theta_s`, `theta_e` and `angles` t1, t2, t3, t5, t6, t8, t9 [rad/m] have the shape of the crank angle. `pins`
    J1..J10 (..., 2) [m/m] have one more axis (outboard, up).
    """

    theta_s: Array
    theta_e: Array
    angles: Mapping[str, Array]
    pins: Mapping[str, Array]


def sensitivities(bars: LinkageLengths, angles: Array) -> dict[str, Sensitivity]:
    """Differentiate the closed linkage at angles (..., 7) [rad], as `ANGLES`, by L3b, L5a and L5b, its keys.

    J dt/dL = -d(gap)/dL at constant t1.
    """
    jacobian = real_rows(loops(bars).by_angles(angles))
    dependent = -np.linalg.solve(jacobian[..., 1:], real_rows(loops_by_lengths(bars, angles)))
    by_length = np.concatenate([np.zeros_like(dependent[..., :1, :]), dependent], axis=-2)
    points = pins(bars).by_angles(angles) @ by_length  # `pins` reaches no pin along an adjustable length
    sensitivities = {}
    for i, length in enumerate(ADJUSTABLE):
        of_angle = {name: by_length[..., k, i] for k, name in enumerate(ANGLES)}
        of_pin = {
            name: np.stack([points[..., k, i].real, points[..., k, i].imag], axis=-1) for k, name in enumerate(PINS)
        }
        sensitivities[length] = Sensitivity(of_angle["t5"], of_angle["t6"] - of_angle["t5"], of_angle, of_pin)
    return sensitivities
