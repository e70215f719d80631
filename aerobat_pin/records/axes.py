"""Axes of a log and of this package: world z up, body x ahead and z up, an IMU as it is mounted."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from aerobat_pin.numerics import Array
from aerobat_pin.records.channels import Request
from aerobat_pin.records.map_tables import Map

HALF_TURN = np.diag([1.0, -1.0, -1.0])  # about x: z down to z up, for world and body axes alike


def world_turn(chosen: Map) -> Array:
    """Return the matrix (3, 3) from the log's world axes to a world with z up."""
    return HALF_TURN if chosen.log.world == "ned" else np.eye(3)


def body_turn(chosen: Map) -> Array:
    """Return the matrix (3, 3) from the log's body axes to body axes x ahead, y left, z up."""
    return HALF_TURN if chosen.base.axes == "frd" else np.eye(3)


def imu_arm(chosen: Map) -> Array:
    """Return where the accelerometer is (3,) [m] from the base's origin, base axes."""
    return np.array(chosen.base.imu.place)


def imu_turn(chosen: Map) -> Array:
    """Return the matrix (3, 3) from the IMU's axes to those of the base."""
    return np.asarray(pin.rpy.rpyToMatrix(*np.radians(chosen.base.imu.turn)))


def sensor_turn(chosen: Map) -> Array:
    """Return the matrix (3, 3) from the log's body axes, which can be an IMU's, to those of the base."""
    turn = body_turn(chosen)
    return imu_turn(chosen) @ turn if any(chosen.base.imu.turn) else turn


def axes_of(chosen: Map, request: Request) -> Array | None:
    """Return the matrix (k, k) from a channel of the base, as logged, to this package's axes; None if it is as logged.

    A velocity or rate in world axes stays in world axes.
    """
    key, base = request.key, chosen.base
    if key == "base.quaternion":
        return as_attitude(chosen, np.eye(4)).T
    if key == "base.position":
        turn = world_turn(chosen)
    elif key == "base.velocity":
        of_topic = request.names[0].startswith(f"{base.topic}.linear")
        in_world = base.velocity is not None and base.velocity.axes == "world" and not of_topic
        turn = world_turn(chosen) if in_world else body_turn(chosen)
    elif key == "base.rate":
        in_world = base.rate is not None and bool(base.rate.columns) and base.rate.axes == "world"
        turn = world_turn(chosen) if in_world else sensor_turn(chosen)
    elif key == "base.acceleration":
        turn = sensor_turn(chosen)
    else:
        return None
    return None if np.array_equal(turn, np.eye(3)) else turn


def as_attitude(chosen: Map, turns: Array) -> Array:
    """Return quaternions (n, 4) of the log as body to world with z up, x, y, z, w.

    Args:
        chosen: the map, which gives order, sense and axes.
        turns: (n, 4) unit quaternions in the order of the columns.
    """
    section = chosen.base.quaternion
    if section is not None and section.order == "wxyz":
        turns = np.roll(turns, -1, axis=1)
    if section is not None and section.sense == "world_to_body":
        turns = turns * np.array([-1.0, -1.0, -1.0, 1.0])
    if chosen.log.world == "ned":
        x, y, z, w = turns.T
        turns = np.stack([w, -z, y, -x], axis=1)  # half a turn about x, then the attitude
    if chosen.base.axes == "frd":
        x, y, z, w = turns.T
        turns = np.stack([w, z, -y, -x], axis=1)  # the attitude after half a turn about the body's x
    if any(chosen.base.imu.turn):
        x, y, z, w = turns.T
        a, b, c, d = pin.Quaternion(imu_turn(chosen).T).coeffs()  # the attitude of the IMU after the base's in it
        turns = np.stack(
            [
                w * a + x * d + y * c - z * b,
                w * b - x * c + y * d + z * a,
                w * c + x * b - y * a + z * d,
                w * d - x * a - y * b - z * c,
            ],
            axis=1,
        )
    return turns
