"""Axes of a log and of this package: world z up, body x ahead and z up, an IMU as it is mounted."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pinocchio as pin

from aerobat_pin.numerics import Array
from aerobat_pin.records.map_tables import Map
from aerobat_pin.records.resample import CONJUGATE, quaternion_product

HALF_TURN = np.diag([1.0, -1.0, -1.0])  # about x: z down to z up, for world and body axes alike
HALF_TURN_QUATERNION = np.array([1.0, 0.0, 0.0, 0.0])  # the same turn


def world_turn(chosen: Map) -> Array:
    """Return the matrix (3, 3) from the log's world axes to a world with z up."""
    return HALF_TURN if chosen.log.world == "ned" else np.eye(3)


def body_turn(chosen: Map) -> Array:
    """Return the matrix (3, 3) from the log's body axes to body axes x ahead, y left, z up."""
    return HALF_TURN if chosen.base.axes == "frd" else np.eye(3)


def imu_turn(chosen: Map) -> Array:
    """Return the matrix (3, 3) from the IMU's axes to those of the base."""
    return np.asarray(pin.rpy.rpyToMatrix(*np.radians(chosen.base.imu.turn)))


def sensor_turn(chosen: Map) -> Array:
    """Return the matrix (3, 3) from the log's body axes, which can be an IMU's, to those of the base."""
    turn = body_turn(chosen)
    return imu_turn(chosen) @ turn if any(chosen.base.imu.turn) else turn


def has_world_axes(chosen: Map, key: str, names: Sequence[str]) -> bool:
    """Return whether a channel of the base, of columns of these names, is in world axes; else it is in the body's.

    The twist of an Odometry topic is in body axes by its definition, unless the map says otherwise.
    """
    speed, rate = chosen.base.velocity, chosen.base.rate
    if key == "base.velocity":
        stated = None if speed is None else speed.axes
        return stated == "world" if stated else speed is not None and not names[0].startswith(f"{chosen.base.topic}.")
    if key == "base.rate":
        return rate is not None and rate.axes == "world"
    return key == "base.position"


def axes_of(chosen: Map, key: str, names: Sequence[str]) -> Array | None:
    """Return the matrix (k, k) from a channel of the base, as logged, to this package's axes; None if it is as logged.

    A velocity or rate in world axes stays in world axes. `names` are those of the channel's columns.
    """
    if key == "base.quaternion":
        return as_attitude(chosen, np.eye(4)).T
    if not key.startswith("base."):
        return None
    if has_world_axes(chosen, key, names):
        turn = world_turn(chosen)
    else:
        turn = body_turn(chosen) if key == "base.velocity" else sensor_turn(chosen)
    return None if np.array_equal(turn, np.eye(3)) else turn


def as_attitude(chosen: Map, turns: Array) -> Array:
    """Return unit quaternions (n, 4), in order, sense and axes of the log, as body to world with z up, x, y, z, w."""
    section = chosen.base.quaternion
    if section is not None and section.order == "wxyz" and len(section.columns) != 3:
        turns = np.roll(turns, -1, axis=1)
    if section is not None and section.sense == "world_to_body":
        turns = turns * CONJUGATE
    if chosen.log.world == "ned":
        turns = quaternion_product(HALF_TURN_QUATERNION, turns)
    if chosen.base.axes == "frd":
        turns = quaternion_product(turns, HALF_TURN_QUATERNION)
    if any(chosen.base.imu.turn):  # the attitude of the IMU after the base's in it
        turns = quaternion_product(turns, pin.Quaternion(imu_turn(chosen).T).coeffs())
    return turns
