"""The raw samples of a log, with what is believed about each sensor: noise, place and turn in the body."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import pinocchio as pin

from aerobat_pin.aerobat.channels import KNOWN
from aerobat_pin.aerobat.flight_log import FlightLog
from aerobat_pin.aerobat.robot import Torque
from aerobat_pin.errors import LogError
from aerobat_pin.numerics import Array
from aerobat_pin.robot import Aerobat
from aerobat_pin.scenario import RawSection

NOISE = {  # deviations of good laboratory sensors, where neither log nor settings say others
    "position": 1.0e-3,
    "orientation": 3.0e-3,
    "gyro": 3.0e-3,
    "accelerometer": 0.05,
    "crank": 2.0 * np.pi / 4096 / np.sqrt(12.0),
    "torque": 5.0e-4,
}
CHANNEL = {
    "position": "mocap_position",
    "orientation": "mocap_quaternion",
    "gyro": "gyro",
    "accelerometer": "accelerometer",
    "crank": "encoder",
}


@dataclass(frozen=True)
class RawChannel:
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
    channels: dict[str, RawChannel]
    known: Array
    torque: Torque


def raw_record(log: FlightLog, robot: Aerobat, torque: Torque, settings: RawSection) -> RawRecord:
    """Gather the raw samples of a log.

    Raises:
        LogError: the log has no encoder, no gyro and accelerometer, or not the torque that is asked for.
    """
    measured, stated = log.measured, settings.noise.model_dump()
    channels = {}
    for name, key in CHANNEL.items():
        if key in measured:
            channels[name] = _samples_of(name, measured[key], stated[name])
    if "crank" not in channels:
        raise LogError("flight log: no channel named encoder: without the crank's angle the wings' motion is unknown")
    if torque not in ("measured", "motor_only", "none"):
        raise LogError(f"observers.torque = {torque}: raw samples take measured, motor_only or none")
    if torque == "measured":
        if "joint_torque_sample" not in measured:
            raise LogError(
                "flight log: no channel named joint_torque_sample: torque = measured needs it; 'motor_only' and 'none' "
                "do not"
            )
        channels["torque"] = _samples_of("torque", measured["joint_torque_sample"], stated["torque"])
    elif torque == "motor_only":
        channels["torque"] = _motor_alone(measured, robot, channels["crank"], stated["torque"])
    known = np.zeros((len(log.time) - 1, robot.model.nv))
    for found in measured.data_vars:
        if str(found).startswith(KNOWN):
            values = np.asarray(measured[found].values, float)
            known[:, : values.shape[1]] += values
    return RawRecord(log.time, channels, known, torque)


def _samples_of(name: str, data: Any, stated: float | None) -> RawChannel:
    """Return a channel with its noise: the stated one, else the one noted in the log, else that of a good sensor."""
    values = np.asarray(data.values, float)
    values = values.reshape(len(values), -1)
    noise = float(stated if stated is not None else data.attrs.get("noise", NOISE[name]))
    if not 0.0 < noise < np.inf:
        noise = NOISE[name]
    place = np.array(data.attrs.get("place", np.zeros(3)), float)
    turn = pin.rpy.rpyToMatrix(*np.radians(np.array(data.attrs.get("turn_deg", np.zeros(3)), float)))
    return RawChannel(name, np.asarray(data[data.dims[0]].values, float), values, noise, place, np.asarray(turn))


def _motor_alone(measured: Any, robot: Aerobat, crank: RawChannel, stated: float | None) -> RawChannel:
    """Return the motor's torque at the crank: measured there, or as four joint torques do work on the crank."""
    if "crank_torque_sample" in measured:
        return _samples_of("torque", measured["crank_torque_sample"], stated)
    if "joint_torque_sample" not in measured:
        raise LogError(
            "flight log: no channel named crank_torque_sample: torque = motor_only needs it; 'none' does not"
        )
    joints = _samples_of("torque", measured["joint_torque_sample"], stated)
    angle = np.interp(joints.time, crank.time, np.unwrap(crank.values[:, 0]))
    closure = robot.linkage.solve(angle)
    left = closure.crank_torque(joints.values[:, 0], joints.values[:, 1])
    both = left + closure.crank_torque(joints.values[:, 2], joints.values[:, 3])
    slope = np.sqrt(2.0 * np.mean(closure.dtheta_s**2 + closure.dtheta_e**2))
    return RawChannel("torque", joints.time, both[:, None], joints.noise * float(slope), joints.place, joints.turn)
