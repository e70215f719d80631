"""Aerobat as a robot of records: its crank moves its joints through the closed linkage, and air acts on its wings.

The joint torque that is known decides which forces can be estimated. The linkage prescribes the joints' motion, so the
*measured* torque contains the reaction to the unknown force. A torque *modelled* from the motion alone does not, so the
part of the force that this reaction balances cannot be estimated. *motor_only* is the torque at the crank: it
determines the power of all joints together, but not the torque of each. With *none*, only the rows of the base can be
used.

Aerodynamic forces are never measured; they are always reconstructed, even for simulated flights. A model error is
simulated by assuming a robot or an air that differs from those that flew.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from hashlib import sha256
from typing import ClassVar, Literal

import numpy as np
import pinocchio as pin

from aerobat_pin.aerobat.believed_air import reconstructed_air
from aerobat_pin.aerobat.calibration.parameters import PARAMETERS, changed_belief
from aerobat_pin.aerobat.motion import Motion, completed
from aerobat_pin.errors import LogError
from aerobat_pin.numerics import Array
from aerobat_pin.observers import Rows
from aerobat_pin.records import Block, Parameter, PlainRobot
from aerobat_pin.robot import BASE_SIZE, JOINTS, Aerobat, prescribed_joint_dynamics
from aerobat_pin.scenario import AirSection

Torque = Literal["measured", "modelled", "motor_only", "none"]
ROWS_OF_TORQUE: dict[str, Rows] = {"measured": "all", "modelled": "all", "motor_only": "base+power", "none": "base"}
RECORDED = "known."  # prefix of known forces among a block's extra channels


@dataclass(frozen=True)
class AerobatRobot(PlainRobot):
    """Aerobat with what is believed of it.

    Attributes:
        aerobat: the believed robot.
        air: the believed air.
        kind: which joint torque is known.
    """

    aerobat: Aerobat
    air: AirSection
    kind: Torque
    remembers: ClassVar[bool] = True  # the wake is that of all flaps before
    parameters: ClassVar[Mapping[str, Parameter]] = PARAMETERS

    @classmethod
    def of(cls, robot: Aerobat, air: AirSection, kind: Torque = "measured") -> AerobatRobot:
        """Return a believed robot in believed air as a robot of records. Raises LogError for an unknown kind."""
        if kind not in ROWS_OF_TORQUE:
            raise LogError(f"torque = {kind!r}: one of {', '.join(ROWS_OF_TORQUE)} was expected")
        return cls(robot.model, True, JOINTS, robot.model.name, robot, air, kind)

    def fingerprint(self) -> str:
        """Return a number made of all values of the robot's morphology."""
        return sha256(repr(self.aerobat.morphology).encode()).hexdigest()[:16]

    def rows(self) -> Rows | None:
        """Return the rows that the known torque makes usable."""
        return ROWS_OF_TORQUE[self.kind]

    def changed(self, values: Mapping[str, float]) -> AerobatRobot:
        """Return the robot with other parameters: parameter -> change."""
        return AerobatRobot.of(*changed_belief(self.aerobat, self.air, values), self.kind)

    def complete(self, block: Block) -> Block:
        """Return a block with the joints that the crank drives, the crank's motion and the wind; see `motion`."""
        block = completed(block, self.aerobat, self.air)
        return replace(block, source={**block.source, "motor_torque": self.kind})

    def known(self, block: Block) -> Mapping[str, Array]:
        """Return the air's forces along a completed block, and those that were recorded, such as the thrusters'."""
        known = dict(reconstructed_air(self.aerobat, self.air, Motion.of(block)))
        for name, values in block.extra.items():
            if name.startswith(RECORDED):
                known[name.removeprefix(RECORDED)] = np.pad(values, ((0, 0), (0, self.model.nv - values.shape[1])))
        return known

    def torque(self, block: Block, known: Mapping[str, Array]) -> Array:
        """Return the motor's torque at the joints (m, nv): measured, modelled, or spread from the crank.

        Raises:
            LogError: the record lacks a channel for the kind of torque.
        """
        moved = Motion.of(block)
        if self.kind == "none":
            return np.zeros_like(block.tau)
        if self.kind == "modelled":
            return modelled_torque(self.aerobat, moved, sum(known.values(), np.zeros_like(block.tau)))
        if "joints.effort" not in block.measured:
            if self.kind == "motor_only" and "crank_torque" in block.extra:
                return spread_crank_torque(self.aerobat, moved, block.extra["crank_torque"][:, 0])
            names = "motor_torque or joint_torque" + (" or crank_torque" if self.kind == "motor_only" else "")
            raise LogError(
                f"flight log: no channel named {names}: torque = {self.kind} needs it; 'modelled' and 'none' do not"
            )
        if self.kind == "measured":
            return block.tau
        left_shoulder, left_elbow, right_shoulder, right_elbow = (block.tau[:, i] for i in self.aerobat.idx_v)
        closure = self.aerobat.linkage.solve(_crank_halfway(moved)[0])
        crank = closure.crank_torque(left_shoulder, left_elbow) + closure.crank_torque(right_shoulder, right_elbow)
        return spread_crank_torque(self.aerobat, moved, crank)


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
