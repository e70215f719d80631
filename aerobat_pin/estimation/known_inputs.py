"""From a flight log to the inputs of an observer: configuration, velocity, and known generalised forces.

Each input notes its source: `measured`, or `reconstructed` from a believed robot and its air. Aerodynamic forces are
never measured, so they are always reconstructed, for simulated flights too; a model error is a belief that differs
from the robot and air that flew.

The known joint torque decides which forces can be found. The linkage prescribes the joints' motion, so the *measured*
torque contains the reaction to the unknown force. A torque *modelled* from the motion alone does not, and hides exactly
that part. *motor_only* is the crank's torque: it gives the power of all joints together, not the torque of each. With
*none*, only the rows of the base can be used.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np
import pinocchio as pin

from aerobat_pin.errors import LogError
from aerobat_pin.estimation.believed_air import reconstructed_air
from aerobat_pin.estimation.motion import Motion, motion
from aerobat_pin.flight import KNOWN, FlightLog
from aerobat_pin.numerics import Array
from aerobat_pin.observers import Rows
from aerobat_pin.robot import BASE_SIZE, JOINTS, Aerobat, prescribed_joint_dynamics
from aerobat_pin.scenario import AirSection

Torque = Literal["measured", "modelled", "motor_only", "none"]
ROWS_OF_TORQUE: dict[str, Rows] = {"measured": "all", "modelled": "all", "motor_only": "base+power", "none": "base"}


@dataclass(frozen=True, repr=False)
class KnownInputs:
    """The inputs of an observer.

    Attributes:
        time: (m + 1,) [s].
        q, v: (m + 1, nq), (m + 1, nv).
        tau: (m, nv) motor torque at the joints, interval means.
        known: name -> (m, nv) other known generalised forces, interval means.
        rows: rows of the residual that can be used.
        source: input -> where it comes from. `q`, `v`, `wind` and the known forces are `measured` or `reconstructed`,
            the wind also `believed`; `motor_torque` has the kind of torque that was chosen.
    """

    time: Array
    q: Array
    v: Array
    tau: Array
    known: Mapping[str, Array]
    rows: Rows
    source: Mapping[str, str]

    def __repr__(self) -> str:
        sources = ", ".join(f"{name} {source}" for name, source in self.source.items())
        span = f"{self.time[0]:.4g} to {self.time[-1]:.4g} s"
        return f"KnownInputs of {len(self.tau)} intervals, {span}; rows {self.rows}\n  {sources}"


def known_inputs(
    log: FlightLog, robot: Aerobat, torque: Torque = "measured", air: AirSection | None = None
) -> KnownInputs:
    """Make an observer's inputs from the measured side of a log and a believed robot, without the log's truth.

    Args:
        log: the flight.
        robot: the believed robot; its linkage supplies joints, its inertia a torque, where they were not measured.
        torque: which joint torque to use; `none` where the log has no torque at all.
        air: the believed air along the recorded motion; by default the one that the log notes, else the default air.

    Raises:
        LogError: there is no such kind of torque, the log lacks its channels, or a gap in time is too long.
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
    """Return the believed air that a log notes, or the default air."""
    return AirSection.model_validate_json(log.measured.attrs.get("air", "{}"))


def _recorded_torque(log: FlightLog, robot: Aerobat, moved: Motion, torque: Torque) -> Array:
    """Return the recorded motor torque (m, nv): of the joints, or of the crank alone spread over them."""
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
    """Return the crank's angle, rate and acceleration (3, m) half way through the intervals."""
    if moved.crank is None:
        raise LogError("flight log: no channel named crank_angle: a torque at the crank, or from its motion, needs it")
    return np.asarray(0.5 * (moved.crank[:, 1:] + moved.crank[:, :-1]))


def modelled_torque(robot: Aerobat, moved: Motion, force: Array) -> Array:
    """Return the motor torque (m, nv) that the prescribed motion needs when no unknown force acts.

    Args:
        robot: the believed robot.
        moved: the recorded motion.
        force: (m, nv) sum of the known generalised forces, interval means.

    Raises:
        LogError: the crank is not recorded.
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
    """Spread a torque at the crank (m,) over both wings' joints with the same power: (m, nv).

    Args:
        robot: the believed robot.
        moved: the recorded motion.
        torque: (m,) interval means [N m].

    Raises:
        LogError: the crank is not recorded.
    """
    shoulder, elbow = robot.linkage.solve(_crank_halfway(moved)[0]).joint_torques(0.5 * torque)
    return robot.velocity(np.zeros((len(torque), BASE_SIZE)), shoulder, elbow)
