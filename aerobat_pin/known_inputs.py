"""From a flight log to what an observer is fed: configuration, velocity, and known generalised forces.

Each input says where it comes from: `measured`, or `modelled` where a believed robot and its air supply it.

What is known of the joint torques decides what can be found. The linkage holds the joints to its motion whatever pushes
on them, so the *measured* torque contains the reaction to the unknown force; a torque *modelled* from the motion alone
does not, and hides exactly that part. With the *motor_only*, the crank's torque is known and with it the power of all
joints together, not its share per joint; with *none*, the base rows alone hold.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from aerobat_pin.arrays import Array
from aerobat_pin.dynamics import BASE, prescribed_joint_dynamics
from aerobat_pin.errors import LogError
from aerobat_pin.flight_log import KNOWN, FlightLog
from aerobat_pin.observers.force_points import Rows
from aerobat_pin.robot import Aerobat

ROWS_OF_TORQUE: dict[str, Rows] = {"measured": "all", "modelled": "all", "motor_only": "base+power", "none": "base"}


@dataclass(frozen=True)
class KnownInputs:
    """What an observer is fed.

    Attributes:
        time: (m + 1,) [s].
        q, v: (m + 1, nq), (m + 1, nv).
        tau: (m, nv) motor torque at the joints, interval means.
        known: name -> (m, nv) other known generalised forces, interval means.
        rows: which rows of the residual to believe.
        source: channel -> where it comes from.
    """

    time: Array
    q: Array
    v: Array
    tau: Array
    known: Mapping[str, Array]
    rows: Rows
    source: Mapping[str, str]


def known_inputs(log: FlightLog, robot: Aerobat, torque: str = "measured") -> KnownInputs:
    """Read an observer's inputs from the measured side of a log; the truth is not looked at.

    Args:
        log: the flight.
        robot: the believed robot; its linkage and inertia serve where the torque is not simply measured.
        torque: `measured`, `modelled`, `motor_only` or `none`.

    Raises:
        LogError: no such knowledge of the torque.
    """
    if torque not in ROWS_OF_TORQUE:
        raise LogError(f"torque = {torque!r}: one of {', '.join(ROWS_OF_TORQUE)} was expected")
    measured = log.measured
    q, v = (np.asarray(measured[name].values, float) for name in ("q", "v"))
    known = {
        str(name).removeprefix(KNOWN): np.asarray(measured[name].values, float)
        for name in measured.data_vars
        if str(name).startswith(KNOWN)
    }
    tau = np.asarray(measured["motor_torque"].values, float)
    crank = np.asarray(measured["crank_angle"].values, float)
    if torque == "modelled":
        tau = modelled_torque(robot, log.time, q, v, crank, sum(known.values(), np.zeros_like(tau)))
    elif torque == "motor_only":
        tau = through_the_crank(robot, crank, tau)
    elif torque == "none":
        tau = np.zeros_like(tau)
    source = {"q": "measured", "v": "measured", "motor_torque": torque, **dict.fromkeys(known, "modelled")}
    return KnownInputs(log.time, q, v, tau, known, ROWS_OF_TORQUE[torque], source)


def modelled_torque(robot: Aerobat, time: Array, q: Array, v: Array, crank: Array, force: Array) -> Array:
    """Return the motor torque (m, nv) that the prescribed motion takes when nothing unknown pushes.

    Args:
        robot: the believed robot.
        time: (m + 1,) [s].
        q: (m + 1, nq).
        v: (m + 1, nv).
        crank: (m + 1,) crank angle [rad].
        force: (m, nv) sum of the known generalised forces, interval means.
    """
    model, data = robot.model, robot.model.createData()
    dt = np.diff(time)
    rate = np.divide(np.diff(crank), dt, out=np.zeros_like(dt), where=dt > 0.0)
    closure = robot.linkage.solve(0.5 * (crank[1:] + crank[:-1]), rate)
    joints = robot.velocity(np.zeros((len(dt), BASE)), closure.theta_s_ddot, closure.theta_e_ddot)[:, BASE:]
    torque = np.zeros_like(force)
    for k in range(len(dt)):
        middle = pin.interpolate(model, q[k], q[k + 1], 0.5)
        nle = pin.nonLinearEffects(model, data, middle, 0.5 * (v[k] + v[k + 1]))
        torque[k] = prescribed_joint_dynamics(pin.crba(model, data, middle), nle, force[k], joints[k])[1]
    return torque


def through_the_crank(robot: Aerobat, crank: Array, tau: Array) -> Array:
    """Keep of joint torques (m, nv) what a sensor on the crank sees: spread along the linkage, with the same power."""
    closure = robot.linkage.solve(0.5 * (crank[1:] + crank[:-1]))
    along = robot.velocity(np.zeros((len(tau), BASE)), closure.dtheta_s, closure.dtheta_e)
    return np.asarray(along * (np.sum(along * tau, axis=1) / np.sum(along * along, axis=1))[:, None])
