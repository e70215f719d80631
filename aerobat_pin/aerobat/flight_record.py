"""A flight of Aerobat, simulated or recorded, as a record: the log's measured channels at the log's own times.

| channel of the log | of the record |
|---|---|
| `q`, or `pose` and `joint_angle` | `base.position`, `base.quaternion`, `joints.position` |
| `v`, or `twist` and `joint_rate` | `base.velocity`, `base.rate` (body axes), `joints.velocity` |
| `motor_torque` or `joint_torque` | `joints.effort`, interval means |
| `crank_angle`, `crank_rate`, `airspeed`, `wind_W`, `crank_torque`, `known_*` | `extra.*`, which `AerobatRobot` reads |
| raw samples, each with times of its own | as `RAW_KEYS` says |
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np
import pinocchio as pin

from aerobat_pin.aerobat.aerobat import JOINTS, Aerobat
from aerobat_pin.aerobat.channels import KNOWN
from aerobat_pin.aerobat.flight_log import SUM, FlightLog, truth_of
from aerobat_pin.aerobat.motion import RECORDED, Motion, Torque
from aerobat_pin.aerobat.prescribed_joints import BASE_SIZE
from aerobat_pin.aerobat.robot import AerobatRobot
from aerobat_pin.errors import CalibrationError
from aerobat_pin.forces import KnownForces, KnownInputs, inputs_of
from aerobat_pin.numerics import Array, guarded
from aerobat_pin.records import Channel, Map, Record, Series, Spool, parse_map, series_of
from aerobat_pin.scenario import AirSection, ObserverSection

if TYPE_CHECKING:
    import xarray as xr


EXTRA_CHANNELS = ("crank_angle", "crank_rate", "airspeed", "wind_W", "crank_torque")
PLACE_SIZE = 7  # of the base in q
LARGEST_TRUTH = 1.0e-3  # [N]: rms of a true force that counts as none
RAW_KEYS = {  # channel of raw samples -> key
    "mocap_position": "base.position",
    "mocap_quaternion": "base.quaternion",
    "gyro": "base.rate",
    "accelerometer": "check.specific_force",
    "encoder": "extra.encoder",
    "joint_torque_sample": "joints.effort",
    "crank_torque_sample": "extra.crank_torque",
}


@guarded()
def free_record(
    log: FlightLog, robot: AerobatRobot, section: ObserverSection | None = None, label: str = "flight"
) -> Record:
    """Return the record of a flight without unknown forces, as `flight_record`, to be calibrated from.

    Raises:
        CalibrationError: the truth of a simulated log knows an unknown force.
    """
    if log.truth is not None and log.truth["force_W"].size:
        sizes = np.sqrt(np.mean(np.sum(log.truth["force_W"].values ** 2, axis=2), axis=0))
        at = int(np.argmax(sizes))
        if sizes[at] > LARGEST_TRUTH:
            raise CalibrationError(
                f"{label}: an unknown force of {1e3 * sizes[at]:.0f} mN rms acts at {log.truth['point'].values[at]}: a "
                "flight without unknown forces was expected"
            )
    return flight_record(log, robot, section, label)


def flight_record(
    log: FlightLog, robot: AerobatRobot, section: ObserverSection | None = None, label: str = "flight"
) -> Record:
    """Return the measured channels of a flight log as a record, whose references are its true values, if any.

    Args:
        log: the flight log.
        robot: the assumed robot.
        section: the observers, and the frames at whose origins unknown forces act; the usual ones when omitted.
        label: what messages and pages call the flight.
    """
    knots = series_of(Spool(), log.time)
    channels = flight_channels(log, robot.aerobat, knots)
    section = section or ObserverSection()
    last, references = len(log.time) - 1, truth_of(log, [*section.frames, *[SUM] * log.is_raw])  # as no torque shows it
    start, span = float(log.time[0]), float(log.time[-1] - log.time[0])
    rate = last / span if span > 0.0 else 1.0
    driven = JOINTS if "joints.effort" in channels else ()
    joints = JOINTS if {"joints.position", "joints.velocity"} & channels.keys() else ()
    return Record(
        map=flight_map(section),
        robot=robot,
        channels=channels,
        joints=joints,
        driven=driven,
        start=start,
        rate=rate,
        parts=((0, last),),
        knots=knots,
        label=label,
        references=references,
    )


def flight_map(section: ObserverSection) -> Map:
    """Return the map of a flight log: velocities in body axes, forces at the frames of the observers."""
    observer = section.model_dump(include={"names", "gain", "kalman", "smoother", "super_twisting"}, exclude_none=True)
    robot = {"points": section.frames}
    return parse_map({"robot": robot, "base": {"velocity": {"axes": "body"}}, "observer": observer}, "of a flight")


def _channels(log: FlightLog, robot: Aerobat) -> Iterator[tuple[str, str, Array, bool]]:
    """Yield key, name in the log, values (n, k), and whether they are interval means."""
    names = [str(name) for name in log.measured.data_vars if str(name) not in RAW_KEYS]
    measured = {name: np.asarray(log.measured[name].values, float) for name in names}
    for name in ("q", "pose"):
        if name in measured:
            yield "base.position", name, measured[name][:, :3], False
            yield "base.quaternion", name, measured[name][:, 3:PLACE_SIZE], False
            break
    for name in ("v", "twist"):
        if name in measured:
            yield "base.velocity", name, measured[name][:, :3], False
            yield "base.rate", name, measured[name][:, 3:BASE_SIZE], False
            break
    at_q, at_v = list(robot.idx_q), list(robot.idx_v)
    for key, whole, joints, rows, means in (
        ("position", "q", "joint_angle", at_q, False),
        ("velocity", "v", "joint_rate", at_v, False),
        ("effort", "motor_torque", "joint_torque", at_v, True),
    ):
        if whole in measured:
            yield f"joints.{key}", whole, measured[whole][:, rows], means
        elif joints in measured:
            yield f"joints.{key}", joints, log.measured[joints].sel(joint=list(JOINTS)).values, means
    for name, values in measured.items():
        if name in EXTRA_CHANNELS or name.startswith(KNOWN):
            key = RECORDED + name.removeprefix(KNOWN) if name.startswith(KNOWN) else name
            means = log.measured[name].dims[0] == "interval"
            table = values.reshape(len(values), -1)
            yield f"extra.{key}", name, np.unwrap(table, axis=0) if name == "crank_angle" else table, means


def flight_channels(log: FlightLog, robot: Aerobat, knots: Series | None = None) -> dict[str, Channel]:
    """Return key -> channel of a log, those at its own times on one clock, `knots`."""
    knots = series_of(Spool(), log.time) if knots is None else knots
    spool = knots.spool
    extra = {
        key: Channel(key, (name,), knots, series_of(spool, values), means)
        for key, name, values, means in _channels(log, robot)
    }
    raw = {key: _raw_channel(spool, key, log.measured[name]) for name, key in RAW_KEYS.items() if name in log.measured}
    return extra | raw


def _raw_channel(spool: Spool, key: str, data: xr.DataArray) -> Channel:
    """Return raw samples with their own stamps, and what the log notes about their sensor."""
    values, noted = np.asarray(data.values, float), data.attrs
    time = series_of(spool, np.asarray(data[data.dims[0]].values, float))
    place, angles = (np.array(noted.get(name, np.zeros(3)), float) for name in ("place", "turn_deg"))
    turn = np.asarray(pin.rpy.rpyToMatrix(*np.radians(angles)))
    deviation = float(noted["noise"]) if "noise" in noted else None
    samples = series_of(spool, values.reshape(len(values), -1))
    return Channel(key, (str(data.name),), time, samples, False, deviation, place, turn)


@guarded()
def known_inputs(
    log: FlightLog, robot: Aerobat, torque: Torque = "measured", air: AirSection | None = None
) -> KnownInputs:
    """Prepare an observer's inputs from the measured channels of a log; its true values are not used.

    Args:
        log: the flight log.
        robot: the assumed robot. Its linkage supplies joint angles that were not measured; its inertia supplies the
            `modelled` torque.
        torque: which joint torque to use; choose `none` if the log contains no torque.
        air: the assumed air; when omitted the air noted in the log, or the default air if the log notes none.

    Raises:
        LogError: there is no such kind of torque, the log lacks the channels for it, or a gap in time is too long.
    """
    record = flight_record(log, AerobatRobot.of(robot, noted_air(log) if air is None else air, torque))
    rows = record.robot.rows()
    assert rows is not None
    return inputs_of(record, *record.parts[0], KnownForces(record), rows)


@guarded()
def flight_motion(log: FlightLog, robot: Aerobat, air: AirSection) -> Motion:
    """Return the motion of a flight, as `AerobatRobot` completes it; errors as of `motion.completed`."""
    record = flight_record(log, AerobatRobot.of(robot, air))
    return Motion.of(record.block(*record.parts[0]))


def noted_air(log: FlightLog) -> AirSection:
    """Return the assumed air noted in the attributes of a log, or the default air."""
    return AirSection.model_validate_json(log.measured.attrs.get("air", "{}"))
