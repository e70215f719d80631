"""A flight's raw samples as a record: each channel on the clock of its own sensor.

| raw channel of the log | of the record |
|---|---|
| `mocap_position`, `mocap_quaternion` | `base.position`, `base.quaternion`, of the markers |
| `gyro`, `accelerometer` | `base.rate`, `check.specific_force`, turned to the markers' axes |
| `joint_torque_sample` | `joints.effort` |
| `encoder`, `crank_torque_sample` | `extra.crank_angle`, `extra.crank_torque` |
"""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from aerobat_pin.aerobat.flight_log import FlightLog
from aerobat_pin.aerobat.flight_record import flight_map
from aerobat_pin.aerobat.robot import AerobatRobot
from aerobat_pin.numerics import Array
from aerobat_pin.records import LogChannel, Record, Spool, series_of, typical_spacing
from aerobat_pin.robot import FORCE_POINTS, JOINTS

KEYS = {
    "mocap_position": "base.position",
    "mocap_quaternion": "base.quaternion",
    "gyro": "base.rate",
    "accelerometer": "check.specific_force",
    "joint_torque_sample": "joints.effort",
    "encoder": "extra.crank_angle",
    "crank_torque_sample": "extra.crank_torque",
}
TURNED = ("gyro", "accelerometer")


def raw_flight_record(log: FlightLog, robot: AerobatRobot) -> Record:
    """Return the raw channels of a flight log as a record, at the common times of its motion capture."""
    spool, channels = Spool(), {}
    for name, key in KEYS.items():
        if name in log.measured:
            data = log.measured[name]
            time, values = np.asarray(data[data.dims[0]].values, float), np.asarray(data.values, float)
            values = values.reshape(len(time), -1)
            if name in TURNED:
                values = values @ (_turn_of(log, "mocap_quaternion").T @ _turn_of(log, name)).T
            channels[key] = LogChannel(key, (name,), series_of(spool, time), series_of(spool, values))
    rate = 1.0 / typical_spacing(channels["base.position"].time)
    start = max(float(channel.time[0]) for channel in channels.values())
    end = min(float(channel.time[-1]) for channel in channels.values())
    driven = JOINTS if "joints.effort" in channels else ()
    parts = ((0, max(int((end - start) * rate), 1)),)
    return Record(flight_map(FORCE_POINTS, 1000.0), robot, channels, (), driven, start, rate, parts)


def _turn_of(log: FlightLog, name: str) -> Array:
    """Return the rotation (3, 3) from a sensor's axes to the body's."""
    return np.asarray(pin.rpy.rpyToMatrix(*np.radians(np.array(log.measured[name].attrs.get("turn_deg", np.zeros(3))))))
