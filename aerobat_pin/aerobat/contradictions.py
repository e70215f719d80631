"""What a log of Aerobat shows of itself, by the checks of any record: its channels, its motion, its linkage."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pinocchio as pin

from aerobat_pin.aerobat.flight_log import FlightLog
from aerobat_pin.estimation.checks import MeasuredMotion, channel_findings, motion_findings
from aerobat_pin.estimation.findings import Finding
from aerobat_pin.numerics import Array
from aerobat_pin.records import Agreement, LogChannel, Spool, rotation_matrices, series_of
from aerobat_pin.robot import JOINTS, Aerobat

LARGEST_OPENING = 0.01  # [rad]: rms difference of a joint angle from the closed linkage; encoders are 20 times better
READINGS = {
    (order, sense): (columns, signs)
    for order, columns in (("xyzw", [0, 1, 2, 3]), ("wxyz", [1, 2, 3, 0]))
    for sense, signs in (("body_to_world", 1.0), ("world_to_body", np.array([-1.0, -1.0, -1.0, 1.0])))
}
RAW_TITLES = {
    "mocap_position": "position of motion capture",
    "mocap_quaternion": "quaternion of motion capture",
    "gyro": "gyro",
    "accelerometer": "accelerometer",
    "encoder": "joints.position",
    "joint_torque_sample": "joint torque",
    "crank_torque_sample": "crank torque",
}


def contradictions(log: FlightLog, robot: Aerobat) -> list[str]:
    """Return what the measured channels of a log contradict each other in; an empty list for a consistent log.

    Each is one sentence that begins with the name of the check and says what is wrong and what to check.

    Args:
        log: the flight log.
        robot: the assumed robot, whose linkage ties the joints to the crank.

    Raises:
        LinkageError: the assumed linkage cannot close at a recorded crank angle.
    """
    found = list(_raw_findings(log) if log.is_raw else _sampled_findings(log, robot))
    return [str(finding) for finding in found if finding.verdict in ("warning", "refused")]


def _channel(title: str, time: Array, values: Array) -> LogChannel:
    spool = Spool()
    return LogChannel(title, (title,), series_of(spool, time), series_of(spool, values.reshape(len(time), -1)))


def _sampled_findings(log: FlightLog, robot: Aerobat) -> Iterator[Finding]:
    rising = np.diff(log.time, prepend=-np.inf) > 0.0
    time = log.time[rising]
    channels = {name: values[rising] for name, values in _sampled_channels(log).items()}
    for title, values in channels.items():
        yield from channel_findings(_channel(title, time, values), [], alone=False)
    velocity, gyro = channels.get("velocity"), channels.get("gyro")
    motion = MeasuredMotion(
        time,
        position=channels["position"],
        attitudes=_readings(channels["attitude"]),
        velocity=None if velocity is None else lambda turns: _turned_by(rotation_matrices(turns), velocity),
        gyro=None if gyro is None else lambda _: gyro,
        joints=JOINTS,
        angles=channels.get("joint angles"),
        rates=channels.get("joint rates"),
        slides=(False,) * len(JOINTS),
    )
    yield from motion_findings(motion, _linkage(channels, robot, motion))


def _readings(quaternions: Array) -> dict[tuple[str, str], Array]:
    return {name: quaternions[:, columns] * signs for name, (columns, signs) in READINGS.items()}


def _turned_by(rotations: Array, vectors: Array) -> Array:
    return np.asarray(np.einsum("mij,mj->mi", rotations, vectors))


def _linkage(channels: dict[str, Array], robot: Aerobat, motion: MeasuredMotion) -> Iterator[Agreement]:
    """Yield the joint angles beside those of the closed linkage at the crank angle."""
    angles = channels.get("joint angles")
    if angles is None or "crank angle" not in channels:
        return
    closure = robot.linkage.solve(channels["crank angle"][:, 0])
    closed = np.stack([closure.theta_s, closure.theta_e] * 2, axis=1)
    yield Agreement(
        "joints off the linkage",
        ("joint positions", "crank angle"),
        motion.time,
        np.degrees(angles),
        np.degrees(closed),
        "values",
        JOINTS,
        "deg",
        float(np.degrees(LARGEST_OPENING)),
        motion.latest,
        "the angle of the linkage at crank_angle was expected: check zero and sign of joints and crank, and the "
        "believed linkage",
        share=0.0,
    )


def _sampled_channels(log: FlightLog) -> dict[str, Array]:
    """Return the sampled channels, each (m, c), by the names that warnings call them."""
    measured = {name: np.asarray(log.measured[name].values, float) for name in log.measured.data_vars}
    pose, twist = measured.get("q", measured.get("pose")), measured.get("v", measured.get("twist"))
    assert pose is not None
    found = {"position": pose[:, :3], "attitude": pose[:, 3:7]}
    if twist is not None:
        found |= {"velocity": twist[:, :3], "gyro": twist[:, 3:6]}
    if "q" in measured or "joint_angle" in measured:
        found["joint angles"] = measured["joint_angle"] if "joint_angle" in measured else pose[:, 7:]
    if "v" in measured or "joint_rate" in measured:
        found["joint rates"] = measured["joint_rate"] if "joint_rate" in measured else measured["v"][:, 6:]
    for name, title in (("crank_angle", "crank angle"), ("airspeed", "airspeed")):
        if name in measured:
            found[title] = measured[name][:, None]
    return found


def _raw_findings(log: FlightLog) -> Iterator[Finding]:
    """Yield what channels on clocks of their own show; gyro and accelerometer are turned to the markers' axes."""
    channels = {}
    for name, title in RAW_TITLES.items():
        if name in log.measured:
            data = log.measured[name]
            time, values = np.asarray(data[data.dims[0]].values, float), np.asarray(data.values, float)
            channels[name] = _channel(title, time, values)
            yield from channel_findings(channels[name], [], alone=True)
    pose, place = channels["mocap_quaternion"], channels["mocap_position"]
    time = pose.time[:]

    def seen(name: str) -> Array | None:
        if name not in channels:
            return None
        turn = _turn_of(log, "mocap_quaternion").T @ _turn_of(log, name)
        stamps, values = channels[name].time[:], channels[name].values[:] @ turn.T
        return np.column_stack([np.interp(time, stamps, column) for column in values.T])

    gyro = seen("gyro")
    motion = MeasuredMotion(
        time,
        position=np.column_stack([np.interp(time, place.time[:], column) for column in place.values[:].T]),
        attitudes=_readings(pose.values[:]),
        gyro=None if gyro is None else lambda _: gyro,
        specific_force=seen("accelerometer"),
    )
    yield from motion_findings(motion)


def _turn_of(log: FlightLog, name: str) -> Array:
    return np.asarray(pin.rpy.rpyToMatrix(*np.radians(np.array(log.measured[name].attrs.get("turn_deg", np.zeros(3))))))
