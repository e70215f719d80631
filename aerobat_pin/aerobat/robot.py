"""Aerobat as a robot of records: its crank moves its joints through the closed linkage, and air acts on its wings.

Aerodynamic forces are never measured; they are always reconstructed, even for simulated flights. A model error is
simulated by assuming a robot or an air that differs from those that flew.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from hashlib import sha256
from typing import ClassVar

import numpy as np

from aerobat_pin.aerobat.accelerometer_mount import Mount
from aerobat_pin.aerobat.believed_air import reconstructed_air
from aerobat_pin.aerobat.calibration.parameters import PARAMETERS, changed_belief
from aerobat_pin.aerobat.motion import Motion, completed, fault_of
from aerobat_pin.aerobat.torque import (
    RECORDED,
    ROWS_OF_TORQUE,
    Torque,
    crank_halfway,
    modelled_torque,
    spread_crank_torque,
)
from aerobat_pin.errors import LogError
from aerobat_pin.numerics import Array
from aerobat_pin.observers import Observer, Rows
from aerobat_pin.records import EXTRA, Block, LogChannel, Parameter, PlainRobot, SmoothedMotion
from aerobat_pin.robot import JOINTS, Aerobat
from aerobat_pin.scenario import AirSection, RawSection


@dataclass(frozen=True)
class AerobatRobot(PlainRobot):
    """Aerobat with what is believed of it.

    Attributes:
        aerobat: the believed robot.
        air: the believed air.
        kind: which joint torque is known.
        raw: what is assumed of raw samples.
        mount: place and turn of the accelerometer as a calibration found them; as stated when None.
    """

    aerobat: Aerobat
    air: AirSection
    kind: Torque
    raw: RawSection = field(default_factory=RawSection)
    mount: Mount | None = None
    moves_joints: ClassVar[bool] = True  # by its crank
    remembers: ClassVar[bool] = True  # the wake is that of all flaps before
    parameters: ClassVar[Mapping[str, Parameter]] = PARAMETERS

    @classmethod
    def of(cls, robot: Aerobat, air: AirSection | None = None, kind: Torque = "measured") -> AerobatRobot:
        """Return a believed robot in believed air, else the default air. Raises LogError for an unknown torque."""
        if kind not in ROWS_OF_TORQUE:
            raise LogError(f"torque = {kind!r}: one of {', '.join(ROWS_OF_TORQUE)} was expected")
        return cls(robot.model, True, JOINTS, robot.model.name, robot, air or AirSection(), kind)

    def fingerprint(self) -> str:
        """Return a number made of all values of the robot's morphology."""
        return sha256(repr(self.aerobat.morphology).encode()).hexdigest()[:16]

    def rows(self) -> Rows | None:
        """Return the rows that the known torque makes usable."""
        return ROWS_OF_TORQUE[self.kind]

    def changed(self, values: Mapping[str, float]) -> AerobatRobot:
        """Return the robot with other parameters: parameter -> change."""
        robot, air = changed_belief(self.aerobat, self.air, values)
        return replace(AerobatRobot.of(robot, air, self.kind), raw=self.raw, mount=self.mount)

    def fault(self, channels: Mapping[str, LogChannel]) -> str | None:
        """Return what is wrong with the channels of a log as a whole: see `motion.fault_of`."""
        return fault_of(channels)

    def complete(self, block: Block) -> Block:
        """Return a block with the joints that the crank drives, the crank's motion and the wind; see `motion`."""
        block = completed(block, self.aerobat, self.air)
        return replace(block, source={**block.source, "motor_torque": self.kind})

    def smooths(self, channels: Collection[str]) -> bool:
        """Return whether the channels are raw samples."""
        return f"{EXTRA}encoder" in channels

    def motion_from(
        self,
        time: Array,
        channels: Mapping[str, LogChannel],
        observers: Sequence[Observer],
        progress: Callable[[float], None] | None,
    ) -> SmoothedMotion | None:
        """Smooth raw samples; None where the record has configurations and velocities.

        Raises:
            ScenarioError: an observer cannot use raw samples.
            LogError: a channel is missing.
        """
        if not self.smooths(channels):
            return None
        from aerobat_pin.aerobat.raw.results import smoothed_raw  # compiles kernels that other records do not need

        belief = self.aerobat, self.air, self.kind, self.raw, self.mount
        return smoothed_raw(time, channels, observers, progress, *belief)

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
        closure = self.aerobat.linkage.solve(crank_halfway(moved)[0])
        crank = closure.crank_torque(left_shoulder, left_elbow) + closure.crank_torque(right_shoulder, right_elbow)
        return spread_crank_torque(self.aerobat, moved, crank)
