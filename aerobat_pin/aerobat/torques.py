"""Joint torques that are not measured: modelled from the motion, or spread from one torque at the crank."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from aerobat_pin.aerobat.motion import Motion
from aerobat_pin.errors import LogError
from aerobat_pin.numerics import Array
from aerobat_pin.robot import BASE_SIZE, Aerobat, prescribed_joint_dynamics


def crank_halfway(moved: Motion) -> Array:
    """Return angle, rate and acceleration (3, m) of the crank in the middle of each interval."""
    if moved.crank is None:
        raise LogError("flight log: no channel named crank_angle: a torque at the crank, or from its motion, needs it")
    return np.asarray(0.5 * (moved.crank[:, 1:] + moved.crank[:, :-1]))


def modelled_torque(robot: Aerobat, moved: Motion, force: Array) -> Array:
    """Return the motor torque (m, nv) that the prescribed joint motion needs if no unknown force acts.

    `force` (m, nv) is the sum of the known generalised forces. Raises LogError if the crank is not recorded.
    """
    model, data = robot.model, robot.model.createData()
    closure = robot.linkage.solve(*crank_halfway(moved))
    still = np.zeros((len(force), BASE_SIZE))
    joints = robot.velocity(still, closure.theta_s_ddot, closure.theta_e_ddot)[:, BASE_SIZE:]
    torque = np.zeros_like(force)
    q, v = moved.q, moved.v
    for k in range(len(force)):
        halfway = pin.interpolate(model, q[k], q[k + 1], 0.5)
        nle = pin.nonLinearEffects(model, data, halfway, 0.5 * (v[k] + v[k + 1]))
        torque[k] = prescribed_joint_dynamics(pin.crba(model, data, halfway), nle, force[k], joints[k])[1]
    return torque


def spread_crank_torque(robot: Aerobat, moved: Motion, torque: Array) -> Array:
    """Return the generalised force (m, nv) that has the power of a torque (m,) at the crank [N m], interval means.

    Each wing receives half of the torque. Raises LogError if the crank is not recorded.
    """
    shoulder, elbow = robot.linkage.solve(crank_halfway(moved)[0]).joint_torques(0.5 * torque)
    return robot.velocity(np.zeros((len(torque), BASE_SIZE)), shoulder, elbow)
