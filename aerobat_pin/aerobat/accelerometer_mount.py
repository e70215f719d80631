"""Place and turn of an accelerometer in the body, as they were found from flights without unknown forces."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from aerobat_pin.errors import CalibrationError
from aerobat_pin.numerics import Array

PLACE_AXES = ("x", "y", "z", "roll", "pitch", "yaw")  # of place and turn
MOUNT_PARTS = ("accelerometer_place", "accelerometer_turn", "accelerometer_covariance")  # of a calibration
FARTHEST_PLACE = 1.0  # [m] from the body's centre of mass, of an accelerometer


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

    @classmethod
    def of_parts(cls, values: Mapping[str, Array]) -> Mount:
        """Return the mount of what `parts` gave. Raises CalibrationError if something is missing, or cannot be."""
        if not set(MOUNT_PARTS) <= values.keys():
            raise CalibrationError("raw samples: a calibration learnt from raw samples was expected, or none")
        place, turn, covariance = (values[part] for part in MOUNT_PARTS)
        if (place.shape, turn.shape, covariance.shape) != ((3,), (3, 3), (6, 6)):
            raise CalibrationError("calibration: accelerometer: a place, a turn and their covariance were expected")
        if not (np.allclose(turn @ turn.T, np.eye(3), atol=1e-6) and np.linalg.det(turn) > 0.0):
            raise CalibrationError("calibration: accelerometer_turn: a rotation matrix was expected")
        if np.any(np.abs(place) > FARTHEST_PLACE) or np.any(np.diag(covariance) < 0.0):
            raise CalibrationError(
                f"calibration: accelerometer_place: within {FARTHEST_PLACE:g} m of the body's COM was expected"
            )
        return cls(place, turn, covariance)

    def parts(self) -> dict[str, Array]:
        """Return the mount as arrays, for a calibration."""
        return dict(zip(MOUNT_PARTS, (self.place, self.turn, self.covariance), strict=True))

    def __str__(self) -> str:
        values = [*1e3 * self.place, *np.degrees(pin.rpy.matrixToRpy(self.turn))]
        spreads = np.sqrt(np.diag(self.covariance)) * np.repeat([1e3, 180.0 / np.pi], 3)
        said = [f"{a} {x:.2f} +- {s:.2f}" for a, x, s in zip(PLACE_AXES, values, spreads, strict=True)]
        return f"accelerometer at {', '.join(said[:3])} mm, turned by {', '.join(said[3:])} deg"
