"""What is known of the joint torques.

It decides which forces can be estimated. The linkage prescribes the joints' motion, so the *measured* torque contains
the reaction to the unknown force. A torque *modelled* from the motion alone does not, so the part of the force that
this reaction balances cannot be estimated. *motor_only* is the torque at the crank: it determines the power of all
joints together, but not the torque of each. With *none*, only the rows of the base can be used.
"""

from __future__ import annotations

from typing import Literal

import numpy as np
import pinocchio as pin

from aerobat_pin.aerobat.aerobat import Aerobat
from aerobat_pin.aerobat.motion import Motion
from aerobat_pin.aerobat.prescribed_joints import BASE_SIZE, prescribed_joint_dynamics
from aerobat_pin.errors import LogError
from aerobat_pin.numerics import Array
from aerobat_pin.observers import Rows

Torque = Literal["measured", "modelled", "motor_only", "none"]
ROWS_OF_TORQUE: dict[str, Rows] = {"measured": "all", "modelled": "all", "motor_only": "base+power", "none": "base"}
RECORDED = "known."  # prefix of known forces among a block's extra channels


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
