"""Derivatives of the closed linkage by its adjustable lengths, from the implicit function theorem on its loops."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from aerobat_description.morphology_tables import LinkageLengths
from aerobat_description.position_closure import ADJUSTABLE
from aerobat_pin.linkage.arms import ANGLES, PINS, loops, loops_by_lengths, pins, real_rows
from aerobat_pin.numerics import Array


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
    """Differentiate the closed linkage by L3b, L5a and L5b: J dt/dL = -d(gap)/dL at constant t1.

    Args:
        bars: bar lengths and pivots.
        angles: (..., 7) angles of the closed linkage, in the order of `ANGLES` [rad].

    Returns:
        The derivatives, by the name of the length.
    """
    jacobian = real_rows(loops(bars).by_angles(angles))
    dependent = -np.linalg.solve(jacobian[..., 1:], real_rows(loops_by_lengths(bars, angles)))
    by_length = np.concatenate([np.zeros_like(dependent[..., :1, :]), dependent], axis=-2)
    points = pins(bars).by_angles(angles) @ by_length  # `pins` reaches no pin along an adjustable length
    found = {}
    for i, length in enumerate(ADJUSTABLE):
        of_angle = {name: by_length[..., k, i] for k, name in enumerate(ANGLES)}
        of_pin = {
            name: np.stack([points[..., k, i].real, points[..., k, i].imag], axis=-1) for k, name in enumerate(PINS)
        }
        found[length] = Sensitivity(of_angle["t5"], of_angle["t6"] - of_angle["t5"], of_angle, of_pin)
    return found
