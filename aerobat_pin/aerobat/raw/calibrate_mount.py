"""Learn from raw samples of free flights where the accelerometer sits and how it is turned."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from aerobat_pin.aerobat.accelerometer_mount import PLACE_AXES, Mount
from aerobat_pin.aerobat.flight_log import FlightLog
from aerobat_pin.aerobat.flight_record import flight_map, refuse_forced
from aerobat_pin.aerobat.robot import AerobatRobot
from aerobat_pin.errors import CalibrationError
from aerobat_pin.estimation import Belief, Calibration, belief_of
from aerobat_pin.numerics import Array, guarded
from aerobat_pin.scenario import RawSection

LEARNT = 0.5  # of what is known beforehand: a larger deviation says that the flights do not show it
FARTHEST_PLACE = 1.0  # [m] from the body's centre of mass, of an accelerometer
PARTS = ("accelerometer_place", "accelerometer_turn", "accelerometer_covariance")  # of a calibration's extras


@guarded()
def calibrate_mount(
    flights: Sequence[tuple[str, FlightLog, AerobatRobot]], frames: Sequence[str], settings: RawSection | None = None
) -> Calibration:
    """Learn place and turn of the accelerometer.

    Args:
        flights: name, log of raw samples without unknown forces, and believed robot of each flight.
        frames: frames at which forces take up what the belief gets wrong.
        settings: the table `observers.raw`.

    Raises:
        CalibrationError: a flight has no raw samples or no accelerometer, an unknown force acts, or beliefs differ.
    """
    from aerobat_pin.aerobat.raw.channels import raw_record  # compiles kernels that other logs do not need
    from aerobat_pin.aerobat.raw.find_mount import find_mount
    from aerobat_pin.aerobat.raw.prior import MOUNT_PRIOR

    if not all(log.is_raw for _, log, _ in flights):
        raise CalibrationError("calibrate: raw samples and logs of q and v: calibrate from one kind at a time")
    robot, settings = flights[0][2], settings or RawSection()
    belief = raw_belief(robot, frames)
    for name, log, own in flights:
        refuse_forced(log, name)
        belief.refuse_other(raw_belief(own, frames))
    records = [raw_record(log, robot.aerobat, robot.kind, settings) for _, log, _ in flights]
    mount = find_mount(records, robot.aerobat, robot.air, tuple(frames), settings)
    away = 1e3 * float(np.linalg.norm(mount.place - records[0].channels["accelerometer"].place))
    notes = [f"{mount}", f"the accelerometer is {away:.1f} mm from its stated place"]
    deviation = np.sqrt(np.diag(mount.covariance))
    hidden = [
        name for name, spread, prior in zip(PLACE_AXES, deviation, MOUNT_PRIOR, strict=True) if spread > LEARNT * prior
    ]
    if hidden:
        notes.append(f"not seen in these flights: {', '.join(hidden)}")
    extras: dict[str, Array] = dict(zip(PARTS, (mount.place, mount.turn, mount.covariance), strict=True))
    return Calibration(belief, tuple(name for name, _, _ in flights), extras=extras, notes=tuple(notes))


def raw_belief(robot: AerobatRobot, frames: Sequence[str]) -> Belief:
    """Return what is believed of a flight whose samples are raw."""
    return belief_of(flight_map(frames, 1.0), robot, ())


def mount_of(calibration: Calibration) -> Mount:
    """Return the accelerometer's place and turn.

    Raises:
        CalibrationError: the calibration has none, or impossible ones.
    """
    if not set(PARTS) <= calibration.extras.keys():
        raise CalibrationError("raw samples: a calibration learnt from raw samples was expected, or none")
    place, turn, covariance = (calibration.extras[part] for part in PARTS)
    if (place.shape, turn.shape, covariance.shape) != ((3,), (3, 3), (6, 6)):
        raise CalibrationError("calibration: accelerometer: a place, a turn and their covariance were expected")
    if not (np.allclose(turn @ turn.T, np.eye(3), atol=1e-6) and np.linalg.det(turn) > 0.0):
        raise CalibrationError("calibration: accelerometer_turn: a rotation matrix was expected")
    if np.any(np.abs(place) > FARTHEST_PLACE) or np.any(np.diag(covariance) < 0.0):
        raise CalibrationError(
            f"calibration: accelerometer_place: within {FARTHEST_PLACE:g} m of the body's centre of mass was expected"
        )
    return Mount(place, turn, covariance)
