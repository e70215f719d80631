"""Prepare the inputs of an observer from a flight log: configuration, velocity, and known generalised forces.

The source of each input is noted: `measured`, or `reconstructed` from the assumed robot and air. Aerodynamic forces
are never measured; they are always reconstructed, even for simulated flights. A model error is simulated by assuming a
robot or an air that differs from those that flew.

The joint torque that is known decides which forces can be estimated. The linkage prescribes the joints' motion, so the
*measured* torque contains the reaction to the unknown force. A torque *modelled* from the motion alone does not, so the
part of the force that this reaction balances cannot be estimated. *motor_only* is the torque at the crank: it
determines the power of all joints together, but not the torque of each. With *none*, only the rows of the base can be
used.
"""

from __future__ import annotations

from typing import Literal

import numpy as np
import pinocchio as pin

from aerobat_pin.aerobat.believed_air import reconstructed_air
from aerobat_pin.aerobat.channels import KNOWN
from aerobat_pin.aerobat.flight_log import FlightLog
from aerobat_pin.aerobat.motion import Motion, motion
from aerobat_pin.errors import LogError
from aerobat_pin.estimation import KnownInputs
from aerobat_pin.numerics import Array, guarded
from aerobat_pin.observers import Rows
from aerobat_pin.robot import BASE_SIZE, JOINTS, Aerobat, prescribed_joint_dynamics
from aerobat_pin.scenario import AirSection

Torque = Literal["measured", "modelled", "motor_only", "none"]
ROWS_OF_TORQUE: dict[str, Rows] = {"measured": "all", "modelled": "all", "motor_only": "base+power", "none": "base"}


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
    if torque not in ROWS_OF_TORQUE:
        raise LogError(f"torque = {torque!r}: one of {', '.join(ROWS_OF_TORQUE)} was expected")
    believed = noted_air(log) if air is None else air
    moved = motion(log, robot, believed)
    known: dict[str, Array] = dict(reconstructed_air(robot, believed, moved))
    source = {**moved.source, **dict.fromkeys(known, "reconstructed"), "motor_torque": torque}
    for name in log.measured.data_vars:
        if str(name).startswith(KNOWN):
            values = np.asarray(log.measured[name].values, float)
            known[str(name).removeprefix(KNOWN)] = np.pad(values, ((0, 0), (0, robot.model.nv - values.shape[1])))
            source[str(name).removeprefix(KNOWN)] = "measured"
    shape = (len(moved.time) - 1, robot.model.nv)
    if torque == "modelled":
        tau = modelled_torque(robot, moved, sum(known.values(), np.zeros(shape)))
    elif torque == "none":
        tau = np.zeros(shape)
    else:
        tau = _recorded_torque(log, robot, moved, torque)
    return KnownInputs(moved.time, moved.q, moved.v, tau, known, ROWS_OF_TORQUE[torque], source)


def noted_air(log: FlightLog) -> AirSection:
    """Return the assumed air noted in the attributes of a log, or the default air."""
    return AirSection.model_validate_json(log.measured.attrs.get("air", "{}"))


def _recorded_torque(log: FlightLog, robot: Aerobat, moved: Motion, torque: Torque) -> Array:
    """Return the recorded motor torque (m, nv): at the joints, or at the crank and then spread over the joints."""
    measured, at = log.measured, list(robot.idx_v)
    tau = np.zeros((len(moved.time) - 1, robot.model.nv))
    if "motor_torque" in measured:
        tau = np.array(measured["motor_torque"].values, float)
    elif "joint_torque" in measured:
        tau[:, at] = measured["joint_torque"].sel(joint=list(JOINTS)).values
    elif torque == "motor_only" and "crank_torque" in measured:
        return spread_crank_torque(robot, moved, np.asarray(measured["crank_torque"].values, float))
    else:
        names = "motor_torque or joint_torque" + (" or crank_torque" if torque == "motor_only" else "")
        raise LogError(
            f"flight log: no channel named {names}: torque = {torque} needs it; 'modelled' and 'none' do not"
        )
    if torque == "motor_only":
        left_shoulder, left_elbow, right_shoulder, right_elbow = (tau[:, i] for i in at)
        closure = robot.linkage.solve(_crank_halfway(moved)[0])
        crank = closure.crank_torque(left_shoulder, left_elbow) + closure.crank_torque(right_shoulder, right_elbow)
        return spread_crank_torque(robot, moved, crank)
    return tau


def _crank_halfway(moved: Motion) -> Array:
    """Return angle, rate and acceleration (3, m) of the crank in the middle of each interval."""
    if moved.crank is None:
        raise LogError("flight log: no channel named crank_angle: a torque at the crank, or from its motion, needs it")
    return np.asarray(0.5 * (moved.crank[:, 1:] + moved.crank[:, :-1]))


def modelled_torque(robot: Aerobat, moved: Motion, force: Array) -> Array:
    """Return the motor torque (m, nv) that the prescribed joint motion needs if no unknown force acts.

    `force` (m, nv) is the sum of the known generalised forces. Raises LogError if the crank is not recorded.
    """
    model, data = robot.model, robot.model.createData()
    closure = robot.linkage.solve(*_crank_halfway(moved))
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
    shoulder, elbow = robot.linkage.solve(_crank_halfway(moved)[0]).joint_torques(0.5 * torque)
    return robot.velocity(np.zeros((len(torque), BASE_SIZE)), shoulder, elbow)
