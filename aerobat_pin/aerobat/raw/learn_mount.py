"""Learn from raw samples of free flights where the accelerometer sits and how it is turned."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from aerobat_pin.aerobat.accelerometer_mount import PLACE_AXES
from aerobat_pin.aerobat.raw.channels import raw_record
from aerobat_pin.aerobat.raw.find_mount import find_mount
from aerobat_pin.aerobat.raw.prior import MOUNT_PRIOR
from aerobat_pin.aerobat.torque import Torque
from aerobat_pin.numerics import Array
from aerobat_pin.records import Extras, LogChannel
from aerobat_pin.robot import Aerobat
from aerobat_pin.scenario import AirSection, RawSection

LEARNT = 0.5  # of what is known beforehand: a larger deviation says that the flights do not show it


def learn_mount(
    free: Sequence[tuple[Array, Mapping[str, LogChannel]]],
    points: Sequence[str],
    robot: Aerobat,
    air: AirSection,
    torque: Torque,
    settings: RawSection,
) -> Extras:
    """Learn place and turn of the accelerometer from raw samples without unknown forces.

    Raises:
        CalibrationError: a record has no accelerometer.
        LogError: a record lacks another channel.
    """
    raw = [raw_record(time, channels, robot, torque, settings) for time, channels in free]
    mount = find_mount(raw, robot, air, tuple(points), settings)
    away = 1e3 * float(np.linalg.norm(mount.place - raw[0].channels["accelerometer"].place))
    notes = [f"{mount}", f"the accelerometer is {away:.1f} mm from its stated place"]
    deviation = np.sqrt(np.diag(mount.covariance))
    hidden = [
        name for name, spread, prior in zip(PLACE_AXES, deviation, MOUNT_PRIOR, strict=True) if spread > LEARNT * prior
    ]
    if hidden:
        notes.append(f"not seen in these flights: {', '.join(hidden)}")
    return Extras(mount.parts(), tuple(notes))
