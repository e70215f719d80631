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

from aerobat_pin.aerobat.believed_air import reconstructed_air
from aerobat_pin.aerobat.crank_condition import CrankCondition, crank_condition
from aerobat_pin.aerobat.motion import Motion, completed
from aerobat_pin.aerobat.parameters import PARAMETERS, changed_belief, scaled_thrusters
from aerobat_pin.aerobat.torques import crank_halfway, modelled_torque, spread_crank_torque
from aerobat_pin.errors import LogError
from aerobat_pin.estimation import TORQUE
from aerobat_pin.numerics import Array
from aerobat_pin.observers import Rows
from aerobat_pin.records import Block, Parameter, PlainRobot
from aerobat_pin.robot import JOINTS, Aerobat
from aerobat_pin.scenario import AirSection

Torque = Literal["measured", "modelled", "motor_only", "none"]
ROWS_OF_TORQUE: dict[str, Rows] = {"measured": "all", "modelled": "all", "motor_only": "base+power", "none": "base"}
OF_THE_DAY = {"wind", "gust", "warm_up_cycles"}  # keys of the air that may differ from flight to flight
RECORDED = "known."  # prefix of known forces among a block's extra channels


@dataclass(frozen=True)
class AerobatRobot(PlainRobot):
    """Aerobat with what is believed of it.

    Attributes:
        aerobat: the believed robot.
        air: the believed air.
        kind: which joint torque is known.
        thruster_scale: change of the known force of thrusters, as a calibration found it [-].
    """

    aerobat: Aerobat
    air: AirSection
    kind: Torque
    thruster_scale: float = 0.0
    remembers: ClassVar[bool] = True  # the wake is that of all flaps before

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

    @property
    def parameters(self) -> Mapping[str, Parameter]:
        """The parameters that flights can identify; a modelled torque changes with all of them."""
        if self.kind != "modelled":
            return PARAMETERS
        return {name: parameter._replace(inertial=False) for name, parameter in PARAMETERS.items()}

    @property
    def assumptions(self) -> Mapping[str, str]:
        """The believed air, but for what differs from flight to flight, and which torque is known."""
        air = self.air.model_dump(exclude=OF_THE_DAY)
        return {TORQUE: self.kind, **{f"air.{key}": str(value) for key, value in air.items()}}

    def changed(self, values: Mapping[str, float]) -> AerobatRobot:
        """Return the robot with other parameters: parameter -> change."""
        changed = AerobatRobot.of(*changed_belief(self.aerobat, self.air, values), self.kind)
        return replace(changed, thruster_scale=values.get("thruster_scale", 0.0))

    def condition(self, block: Block) -> CrankCondition:
        """Return phase and state of a completed block. Raises CalibrationError if the crank hardly turns."""
        return crank_condition(Motion.of(block), self.aerobat, self.kind)

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
        return scaled_thrusters(known, self.thruster_scale)

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
        closure = self.aerobat.linkage.solve(crank_halfway(moved)[0])
        crank = closure.crank_torque(left_shoulder, left_elbow) + closure.crank_torque(right_shoulder, right_elbow)
        return spread_crank_torque(self.aerobat, moved, crank)
