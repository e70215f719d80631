"""Mistakes to plant in the channels of a good record, each with what a finding must say of it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from aerobat_pin.records import Record, Spool, series_of

Columns = dict[str, np.ndarray]  # key of a channel -> its samples (n, k), and `time of` key -> its stamps
Change = Callable[[Columns], None]
Mistakes = dict[str, tuple[Change, str]]
DEGREES = 180.0 / np.pi
PLACE, TURN, SPEED, GYRO = "base.position", "base.quaternion", "base.velocity", "base.rate"
ANGLES, RATES, EFFORTS, CRANK = "joints.position", "joints.velocity", "joints.effort", "extra.crank_angle"


def planted(record: Record, change: Change) -> Record:
    """Return a copy of a record with a mistake."""
    columns = {key: np.array(channel.values) for key, channel in record.channels.items()}
    change(columns | {f"time of {key}": np.array(channel.time) for key, channel in record.channels.items()})
    spool = Spool()
    channels = {
        key: replace(channel, values=series_of(spool, columns[key])) for key, channel in record.channels.items()
    }
    return replace(record, channels=channels)


def times(key: str, factor: float, *columns: int) -> Change:
    """Multiply some columns, or all."""

    def change(data: Columns) -> None:
        data[key][:, list(columns) or slice(None)] *= factor

    return change


def in_degrees(data: Columns) -> None:
    """Write angles and rates in degrees, which agree with each other."""
    for key in (ANGLES, RATES):
        data[key] *= DEGREES


def swapped(key: str, first: int, second: int, count: int = 1) -> Change:
    """Let two columns change places, or two groups of some columns side by side."""

    def change(data: Columns) -> None:
        one, other = (np.arange(begin, begin + count) for begin in (first, second))
        data[key][:, [*one, *other]] = data[key][:, [*other, *one]]

    return change


def late(by: float, *keys: str) -> Change:
    """Let channels be late [s], by whole samples."""

    def change(data: Columns) -> None:
        for key in keys:
            rows = round(by / float(np.median(np.diff(data[f"time of {key}"]))))
            data[key][:] = data[key][np.maximum(np.arange(len(data[key])) - rows, 0)]

    return change


def held(key: str) -> Change:
    """Let a channel keep each value for three samples."""

    def change(data: Columns) -> None:
        data[key][:] = data[key][np.arange(len(data[key])) // 3 * 3]

    return change


def off(key: str, by: float, column: int) -> Change:
    """Add a constant to a column."""

    def change(data: Columns) -> None:
        data[key][:, column] += by

    return change


def noisy(share: float) -> Change:
    """Add white noise to the efforts, a share of their rms."""

    def change(data: Columns) -> None:
        size = share * np.sqrt(np.mean(data[EFFORTS] ** 2))
        data[EFFORTS][:] += size * np.random.default_rng(1).standard_normal(data[EFFORTS].shape)

    return change


def rubbing(share: float) -> Change:
    """Add Coulomb friction to the efforts, a share of each joint's rms."""

    def change(data: Columns) -> None:
        data[EFFORTS][:] += share * np.sqrt(np.mean(data[EFFORTS] ** 2, axis=0)) * np.tanh(data[RATES] / 0.02)

    return change


def together(*changes: Change) -> Change:
    """Make several changes, one after the other."""

    def change(data: Columns) -> None:
        for one in changes:
            one(data)

    return change


def wxyz(data: Columns) -> None:
    """Write quaternions with w first."""
    data[TURN][:] = np.roll(data[TURN], 1, axis=1)


def inverse(data: Columns) -> None:
    """Write quaternions that turn the world to the body."""
    data[TURN][:, :3] *= -1.0


FREE_BASE: Mistakes = {
    "position x in mm": (times(PLACE, 1e3, 0), r"position against velocity: .*along x.*\(mm\)"),
    "position y in mm": (times(PLACE, 1e3, 1), r"position against velocity: .*along y"),
    "position z in mm": (times(PLACE, 1e3, 2), r"position against velocity: .*along z.*\(mm\)"),
    "position in cm": (times(PLACE, 100.0), r"position against velocity: .*\(cm\)"),
    "sign of the velocity x": (times(SPEED, -1.0, 0), r"position against velocity: .*along x"),
    "sign of the velocity z": (times(SPEED, -1.0, 2), r"position against velocity: .*along z"),
    "velocity in mm/s": (times(SPEED, 1e3), r"position against velocity: .*thousandths"),
    "velocity z in mm/s": (times(SPEED, 1e3, 2), r"position against velocity: .*along z"),
    "velocity x and z swapped": (swapped(SPEED, 0, 2), r"position against velocity: .*along [xz]"),
    "gyro in deg/s": (times(GYRO, DEGREES), r"gyro against attitude: .*degrees are read as radians"),
    "gyro y in deg/s": (times(GYRO, DEGREES, 1), r"gyro against attitude: .*about y.*degrees are read as radians"),
    "sign of the gyro y": (times(GYRO, -1.0, 1), r"gyro against attitude: .*about y.*its sign is wrong"),
    "gyro x and y swapped": (swapped(GYRO, 0, 1), r"gyro against attitude: .*about [xy]"),
    "gyro y and z swapped": (swapped(GYRO, 1, 2), r"gyro against attitude: .*about [yz]"),
    "quaternion with w first": (wxyz, r"quaternion order: .*seem to be w, x, y, z, body to world"),
    "quaternion inverse": (inverse, r"quaternion order: .*seem to be x, y, z, w, world to body"),
    "pose late": (late(6e-3, PLACE, TURN), r"late channel: attitude comes \d\.\d ms after gyro"),
    "position late": (late(6e-3, PLACE), r"late channel: position comes \d\.\d ms after velocity"),
    "gyro late": (late(6e-3, GYRO), r"late channel: gyro comes \d\.\d ms after attitude"),
    "gyro held": (held(GYRO), r"held channel: gyro changes only"),
    "position held": (held(PLACE), r"held channel: position changes only"),
    "velocity held": (held(SPEED), r"held channel: velocity changes only"),
}
LINKAGE: Mistakes = {
    "zero of a joint off": (off(ANGLES, 0.03, 1), r"joints off the linkage: left_elbow is 1\.7\d deg"),
    "crank angle late": (late(6e-3, CRANK), r"late channel: crank angle comes \d\.\d ms after joint positions"),
    "crank angle off, as if it were late": (off(CRANK, 0.1, 0), r"late channel: joint positions|joints off"),
}

EFFORTS_APART: Mistakes = {
    "efforts late": (late(20e-3, EFFORTS), r"late efforts: joints\.effort comes (19|20|21) ms after the motion"),
    "angles and rates late": (late(20e-3, ANGLES, RATES), r"late efforts: the motion comes (19|20|21) ms after"),
}


def of_joints(names: tuple[str, ...], one: int, other: int) -> Mistakes:
    """Return mistakes in the channels of joints; those of single joints in two of them."""
    first, pair = names[one], rf"swapped joints: .*{names[one]} and {names[other]}"
    rates = rf"joint velocities against positions: .*at {first}"
    return {
        "joint rates in deg/s": (times(RATES, DEGREES), r"joint velocities against positions: .*degrees are read"),
        "one joint rate in deg/s": (times(RATES, DEGREES, one), rf"{rates}.*degrees are read as radians"),
        "sign of a joint rate": (times(RATES, -1.0, one), rf"{rates}.*its sign is wrong"),
        "joint angles in deg": (times(ANGLES, DEGREES), r"joint velocities against positions: .*degrees of the pos"),
        "one joint angle in deg": (times(ANGLES, DEGREES, one), rf"{rates}.*degrees of the position"),
        "two joint angles swapped": (swapped(ANGLES, one, other), rf"{pair}|{rates}"),
        "two joint rates swapped": (swapped(RATES, one, other), rf"{pair}|{rates}"),
        "joint angles and rates in deg": (
            in_degrees,
            r'joint limits: .* rad, its limits are .*unit = "deg" for joints',
        ),
        "joint rates late": (late(6e-3, RATES), r"late channel: joint velocities come \d\.\d ms after joint positions"),
        "joint angles late": (late(6e-3, ANGLES), r"late channel: joint positions come \d\.\d ms after joint vel"),
        "joint rates held": (held(RATES), r"held channel: joint velocities change only"),
        "joint angles held": (held(ANGLES), r"held channel: joint positions change only"),
        "efforts held": (held(EFFORTS), r"held channel: joint efforts change only"),
        "sign of an effort": (times(EFFORTS, -1.0, one), rf"effort sign: the effort of {first}"),
        "efforts in mN m": (times(EFFORTS, 1e3), r"effort unit or mass: all efforts .* 0\.00(1|09)"),
        "one effort in mN m": (times(EFFORTS, 1e3, one), rf"effort unit: the effort of {first}"),
        "two efforts swapped": (swapped(EFFORTS, one, other), rf"swapped joints: efforts of .*{names[one]}"),
    }
