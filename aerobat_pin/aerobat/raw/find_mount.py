"""Where the accelerometer sits and how it is turned, found from flights without unknown forces.

An accelerometer at place r, turned by R_s, feels R_s^T (a + w' x r + w x (w x r)) + b, with a the specific force at the
body's centre of mass. Place and turn are six more constant states of the joint smoother: errors dr and e of what is
stated, r + dr and R_s exp(e). Their columns of a sample's row are R_s^T ([w']x + [w]x [w]x) and [y]x, y the sample.
The smoother runs again about what it has found, until that stays.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
import pinocchio as pin

from aerobat_pin.aerobat.accelerometer_mount import PLACE_AXES, Mount
from aerobat_pin.aerobat.aerobat import Aerobat
from aerobat_pin.aerobat.motion import Torque
from aerobat_pin.aerobat.raw.channels import RawRecord, raw_record
from aerobat_pin.aerobat.raw.layout import MOUNT_PRIOR
from aerobat_pin.aerobat.raw.smoother import JointSmoother
from aerobat_pin.errors import CalibrationError
from aerobat_pin.numerics import Array
from aerobat_pin.records import Channel, Extras
from aerobat_pin.scenario import AirSection, RawSection

ROUNDS = 3  # of the smoother, each about the last result
SETTLED_PLACE, SETTLED_TURN = 1.0e-4, 5.0e-4  # [m, rad]: smaller changes end the rounds
LEARNT = 0.5  # of what is known beforehand: a larger deviation says that the flights do not show it


def mounted(record: RawRecord, mount: Mount) -> RawRecord:
    """Return a record whose accelerometer is where it was found."""
    if "accelerometer" not in record.channels:
        return record
    accelerometer = replace(record.channels["accelerometer"], place=mount.place, turn=mount.turn)
    return replace(record, channels={**record.channels, "accelerometer": accelerometer})


def find_mount(
    records: Sequence[RawRecord], robot: Aerobat, air: AirSection, frames: tuple[str, ...], settings: RawSection
) -> Mount:
    """Find place and turn of the accelerometer from flights without unknown forces; it has no clock offset.

    Forces at the frames take up what the belief gets wrong; other arguments are as of `JointSmoother`. Raises
    CalibrationError if a flight has no accelerometer.
    """
    for record in records:
        if "accelerometer" not in record.channels:
            raise CalibrationError("raw samples: no accelerometer, whose place and turn are what is learnt from them")
    stated = records[0].channels["accelerometer"]
    mount = Mount(stated.place, stated.turn, np.zeros((6, 6)))
    known, settings = np.diag(np.square(MOUNT_PRIOR) ** -1.0), settings.model_copy(update={"offset_error": 0.0})
    for _ in range(ROUNDS):
        smoother = JointSmoother(robot, air, frames, settings, mount=True)
        estimates = [smoother.run(mounted(record, mount)) for record in records]
        information, pull = np.zeros((6, 6)), np.zeros(6)
        for estimate in estimates:
            assert estimate.mount is not None
            error, covariance = estimate.mount
            weight = np.linalg.inv(covariance)
            information, pull = information + weight, pull + weight @ error
        step = np.linalg.solve(information, pull)
        covariance = np.linalg.inv(information - (len(records) - 1.0) * known)  # that every flight's estimate has
        mount = Mount(mount.place + step[:3], mount.turn @ pin.exp3(step[3:]), covariance)
        if np.all(np.abs(step[:3]) < SETTLED_PLACE) and np.all(np.abs(step[3:]) < SETTLED_TURN):
            break
        settings = settings.model_copy(update=estimates[0].tuning.stated())  # chosen once
    return mount


def learn_mount(
    free: Sequence[tuple[Array, Mapping[str, Channel]]],
    points: Sequence[str],
    robot: Aerobat,
    air: AirSection,
    torque: Torque,
    settings: RawSection,
) -> Extras:
    """Learn place and turn of the accelerometer from raw samples without unknown forces; errors as of `find_mount`."""
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
