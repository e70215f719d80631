"""Learn from raw samples of free flights where the accelerometer sits and how it is turned."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from aerobat_pin.aerobat.accelerometer_mount import PLACE_AXES
from aerobat_pin.aerobat.calibration.calibration import Belief, Calibration
from aerobat_pin.aerobat.calibration.flight_state import flight_state
from aerobat_pin.aerobat.calibration.free_flight import FreeFlight
from aerobat_pin.aerobat.calibration.learnt_range import LearntRange
from aerobat_pin.aerobat.flight_record import flight_channels
from aerobat_pin.errors import CalibrationError
from aerobat_pin.scenario import RawSection

LEARNT = 0.5  # of what is known beforehand: a larger deviation says that the flights do not show it


def calibrate_mount(flights: Sequence[FreeFlight], parameters: Sequence[str] | None) -> Calibration:
    """Learn place and turn of the accelerometer.

    Args:
        flights: flights without unknown forces, all with one belief, all of raw samples.
        parameters: as for `calibrate`: nothing else can be learnt from raw samples.

    Raises:
        CalibrationError: a flight has no raw samples or no accelerometer, or a parameter is asked for.
    """
    from aerobat_pin.aerobat.raw.air import AirAboutNominal
    from aerobat_pin.aerobat.raw.channels import raw_record  # compiles kernels that other logs do not need
    from aerobat_pin.aerobat.raw.find_mount import find_mount
    from aerobat_pin.aerobat.raw.prior import MOUNT_PRIOR

    if not all(one.log.is_raw for one in flights):
        raise CalibrationError("calibrate: raw samples and logs of q and v: calibrate from one kind at a time")
    if parameters:
        raise CalibrationError(
            f"calibrate: '{parameters[0]}' cannot be learnt from raw samples: only the accelerometer's mount can"
        )
    first = flights[0]
    settings = first.raw or RawSection()
    records = [
        raw_record(one.log.time, flight_channels(one.log, one.robot), one.robot, one.torque, settings)
        for one in flights
    ]
    mount, found = find_mount(records, first.robot, first.air, tuple(first.frames), settings)
    stated = records[0].channels["accelerometer"]
    away = 1e3 * float(np.linalg.norm(mount.place - stated.place))
    notes = [f"{mount}", f"the accelerometer is {away:.1f} mm from its stated place"]
    deviation = np.sqrt(np.diag(mount.covariance))
    hidden = [
        name for name, spread, prior in zip(PLACE_AXES, deviation, MOUNT_PRIOR, strict=True) if spread > LEARNT * prior
    ]
    if hidden:
        notes.append(f"not seen in these flights: {', '.join(hidden)}")
    air = AirAboutNominal(first.robot, first.air)
    states = np.concatenate([flight_state(air.motion(one.nominal)).values for one in found])
    return Calibration(
        belief=Belief.of(first.robot, first.air, first.torque),
        learnt=LearntRange.of(states),
        harmonics=None,
        flights=tuple(one.name for one in flights),
        notes=tuple(notes),
        accelerometer=mount,
    )
