"""Place and turn of an accelerometer in the body, as they were found from flights without unknown forces."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from aerobat_pin.numerics import Array

PLACE_AXES = ("x", "y", "z", "roll", "pitch", "yaw")  # of place and turn


@dataclass(frozen=True)
class Mount:
    """Place and turn of an accelerometer.

    Attributes:
        place: (3,) from the body's COM, body axes [m].
        turn: (3, 3) rotation matrix, sensor to body.
        covariance: (6, 6) of the place [m] and of a small further turn, a rotation vector in the sensor's axes [rad].
    """

    place: Array
    turn: Array
    covariance: Array

    def __str__(self) -> str:
        """Return place and turn in words."""
        deviation = np.sqrt(np.diag(self.covariance))
        place = ", ".join(
            f"{axis} {1e3 * value:.2f} +- {1e3 * spread:.2f}"
            for axis, value, spread in zip("xyz", self.place, deviation[:3], strict=True)
        )
        angles = np.degrees(pin.rpy.matrixToRpy(self.turn))
        turn = ", ".join(
            f"{axis} {value:.2f} +- {np.degrees(spread):.2f}"
            for axis, value, spread in zip(("roll", "pitch", "yaw"), angles, deviation[3:], strict=True)
        )
        return f"accelerometer at {place} mm, turned by {turn} deg"
