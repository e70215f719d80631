"""Samples of each sensor on its own clock, and windows of a long record that are smoothed one after the other."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np

from aerobat_pin.aerobat.aerobat import Aerobat
from aerobat_pin.aerobat.motion import RECORDED, Torque
from aerobat_pin.errors import LogError
from aerobat_pin.numerics import Array
from aerobat_pin.records import EXTRA, Channel, sampled
from aerobat_pin.scenario import RawSection

NOISE = {  # deviations of good laboratory sensors, where neither log nor settings say others
    "position": 1.0e-3,
    "orientation": 3.0e-3,
    "gyro": 3.0e-3,
    "accelerometer": 0.05,
    "crank": 2.0 * np.pi / 4096 / np.sqrt(12.0),
    "torque": 5.0e-4,
}
CHANNEL = {  # name -> key of the record
    "position": "base.position",
    "orientation": "base.quaternion",
    "gyro": "base.rate",
    "accelerometer": "check.specific_force",
    "crank": f"{EXTRA}encoder",
}
LONGEST_STRETCH = 5.0  # [s]: records that are longer are smoothed in parts
LATE_PART, EARLY_PART = 0.6, 0.3  # [s] at the end of a part that are given up, and at its start for warming up


@dataclass(frozen=True)
class SensorSamples:
    """Samples of one sensor.

    Attributes:
        name: `position`, `orientation`, `gyro`, `accelerometer`, `crank` or `torque`.
        time: (k,) stamps [s].
        values: (k, c) samples.
        noise: standard deviation of a sample.
        place: (3,) of the sensor from the body's COM, body axes [m].
        turn: (3, 3) rotation matrix, sensor to body.
    """

    name: str
    time: Array
    values: Array
    noise: float
    place: Array
    turn: Array


@dataclass(frozen=True)
class RawRecord:
    """What the joint smoother reads of a log.

    Attributes:
        time: (m + 1,) knots [s], those of the log.
        channels: name -> samples.
        known: (m, nv) known generalised forces, interval means.
        torque: which torque is used: `measured`, `motor_only` or `none`.
    """

    time: Array
    channels: dict[str, SensorSamples]
    known: Array
    torque: Torque

    def shifted(self, offsets: Mapping[str, float]) -> RawRecord:
        """Return the record with clock offsets [s] of some sensors taken off."""
        late = {name: replace(each, time=each.time - offsets.get(name, 0.0)) for name, each in self.channels.items()}
        return replace(self, channels=late)


def raw_record(
    time: Array, measured: Mapping[str, Channel], robot: Aerobat, torque: Torque, settings: RawSection
) -> RawRecord:
    """Gather raw samples.

    The time (m + 1,) is that of the knots [s]; the settings are the table `observers.raw`.

    Raises:
        LogError: the record has no encoder, or not the torque that is asked for.
    """
    stated = settings.noise.model_dump()
    channels = {
        name: _samples_of(name, measured[key], stated[name]) for name, key in CHANNEL.items() if key in measured
    }
    if "crank" not in channels:
        raise LogError("flight log: no channel named encoder: without the crank's angle the wings' motion is unknown")
    if torque == "modelled":
        raise LogError("observers.torque = modelled: raw samples take measured, motor_only or none")
    if torque == "measured":
        if "joints.effort" not in measured:
            raise LogError(
                "flight log: no channel named joint_torque_sample: torque = measured needs it; 'motor_only' and 'none' "
                "do not"
            )
        channels["torque"] = _samples_of("torque", measured["joints.effort"], stated["torque"])
    elif torque == "motor_only":
        channels["torque"] = _motor_alone(measured, robot, channels["crank"], stated["torque"])
    known = np.zeros((len(time) - 1, robot.model.nv))
    for key, channel in measured.items():
        if key.startswith(f"{EXTRA}{RECORDED}"):
            values = channel.values[:]
            if not channel.means:
                at = sampled(channel.time[:], values, time)
                values = 0.5 * (at[1:] + at[:-1])
            known[:, : values.shape[1]] += values
    return RawRecord(time, channels, known, torque)


def _samples_of(name: str, channel: Channel, stated: float | None) -> SensorSamples:
    """Return a channel with its noise: the stated one, else the one noted in the log, else that of a good sensor."""
    noise = stated if stated is not None else channel.deviation
    if noise is None or not 0.0 < noise < np.inf:
        noise = NOISE[name]
    place = np.zeros(3) if channel.place is None else channel.place
    turn = np.eye(3) if channel.turn is None else channel.turn
    return SensorSamples(name, channel.time[:], channel.values[:], float(noise), place, turn)


def _motor_alone(
    measured: Mapping[str, Channel], robot: Aerobat, crank: SensorSamples, stated: float | None
) -> SensorSamples:
    """Return the motor's torque at the crank: measured there, or as four joint torques do work on the crank."""
    if f"{EXTRA}crank_torque" in measured:
        return _samples_of("torque", measured[f"{EXTRA}crank_torque"], stated)
    if "joints.effort" not in measured:
        raise LogError(
            "flight log: no channel named crank_torque_sample: torque = motor_only needs it; 'none' does not"
        )
    joints = _samples_of("torque", measured["joints.effort"], stated)
    angle = np.interp(joints.time, crank.time, np.unwrap(crank.values[:, 0]))
    closure = robot.linkage.solve(angle)
    torque = closure.crank_torque(joints.values[:, 0], joints.values[:, 1])
    both = torque + closure.crank_torque(joints.values[:, 2], joints.values[:, 3])
    slope = np.sqrt(2.0 * np.mean(closure.dtheta_s**2 + closure.dtheta_e**2))
    return SensorSamples("torque", joints.time, both[:, None], joints.noise * float(slope), joints.place, joints.turn)


@dataclass(frozen=True)
class RecordPart:
    """Knots `start` to `stop` of a part; those from `first` to `last` are kept; the next window starts at `next`."""

    start: int
    stop: int
    first: int
    last: int
    next: int | None


def stretches(time: Array) -> Iterator[RecordPart]:
    """Yield the windows of a record with knots at `time` (m + 1,)."""
    start = first = 0
    end = len(time) - 1
    while True:
        stop = int(np.searchsorted(time, time[start] + LONGEST_STRETCH))
        if stop >= end or time[end] - time[stop] < LATE_PART:
            yield RecordPart(start, end, first, end, None)
            return
        last = int(np.searchsorted(time, time[stop] - LATE_PART))
        following = int(np.searchsorted(time, time[last] - EARLY_PART))
        yield RecordPart(start, stop, first, last, following)
        start, first = following, last


def part_of(record: RawRecord, start: int, stop: int) -> RawRecord:
    """Return the knots `start` to `stop` of a record; samples up to the second stay out if that is not the record's."""
    if start == 0 and stop == len(record.time) - 1:
        return record
    low = -np.inf if start == 0 else record.time[start + 1] - 1e-9  # those before are in the prior of the first knot
    high = np.inf if stop == len(record.time) - 1 else record.time[stop] + 1e-9
    channels = {}
    for name, channel in record.channels.items():
        use = (channel.time >= low) & (channel.time <= high)
        channels[name] = replace(channel, time=channel.time[use], values=channel.values[use])
    return replace(record, time=record.time[start : stop + 1], channels=channels, known=record.known[start:stop])
