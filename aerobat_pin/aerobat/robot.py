"""Aerobat as a robot of records: its crank moves its joints through the closed linkage, and air acts on its wings.

Aerodynamic forces are never measured; they are always reconstructed, even for simulated flights. A model error is
simulated by assuming a robot or an air that differs from those that flew.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from hashlib import sha256
from typing import ClassVar

import numpy as np

from aerobat_pin.aerobat.accelerometer_mount import Mount
from aerobat_pin.aerobat.aerobat import JOINTS, Aerobat
from aerobat_pin.aerobat.air.believed_air import reconstructed_air
from aerobat_pin.aerobat.channels import angle_fault
from aerobat_pin.aerobat.crank_condition import CrankCondition, crank_condition
from aerobat_pin.aerobat.motion import (
    RECORDED,
    ROWS_OF_TORQUE,
    Motion,
    Torque,
    completed,
    crank_halfway,
    modelled_torque,
    spread_crank_torque,
)
from aerobat_pin.aerobat.parameters import PARAMETERS, SUSPECTS, carrying, changed_belief, crank_turned, flexed
from aerobat_pin.aerobat.prescribed_joints import joint_table
from aerobat_pin.errors import CalibrationError, LogError
from aerobat_pin.estimation import TORQUE
from aerobat_pin.numerics import Array
from aerobat_pin.observers import Observer, Rows
from aerobat_pin.records import EXTRA, Agreement, Block, Channel, Extras, Parameter, PlainRobot, SmoothedMotion, Suspect
from aerobat_pin.scenario import AirSection, RawSection

WEATHER_KEYS = {"wind", "gust", "turbulence", "wave", "warm_up_cycles"}  # keys of the air of the day
FEWEST_RAW_SAMPLES = 8  # of each channel
LARGEST_OPENING = np.degrees(0.01)  # [deg]: rms difference of a joint from the linkage; encoders are 20 times better


@dataclass(frozen=True)
class AerobatRobot(PlainRobot):
    """Aerobat with what is believed of it.

    Attributes:
        aerobat: the believed robot.
        air: the believed air.
        kind: which joint torque is known.
        raw: what is assumed of raw samples.
        mount: place and turn of the accelerometer as a calibration found them; as stated when None.
        thruster_scale: change of the known force of thrusters, as a calibration found it [-].
    """

    aerobat: Aerobat
    air: AirSection
    kind: Torque
    raw: RawSection = field(default_factory=RawSection)
    mount: Mount | None = None
    thruster_scale: float = 0.0
    moves_joints: ClassVar[bool] = True  # by its crank
    remembers: ClassVar[bool] = True  # the wake is that of all flaps before
    limits_forces: ClassVar[bool] = False  # its pose never hides a force on a wing

    @classmethod
    def of(cls, robot: Aerobat, air: AirSection | None = None, kind: Torque = "measured") -> AerobatRobot:
        """Return a believed robot in believed air, else the default air. Raises LogError for an unknown torque."""
        if kind not in ROWS_OF_TORQUE:
            raise LogError(f"torque = {kind!r}: one of {', '.join(ROWS_OF_TORQUE)} was expected")
        return cls(robot.model, True, JOINTS, robot.model.name, robot, air or AirSection(), kind)

    def fingerprint(self) -> str:
        """Return a number made of all values of the robot's morphology."""
        return sha256(repr(self.aerobat.morphology).encode()).hexdigest()[:16]

    @property
    def measures_effort(self) -> bool:
        """Whether the joint torques are measured ones."""
        return self.kind == "measured"

    def rows(self) -> Rows | None:
        """Return the rows that the known torque makes usable."""
        return ROWS_OF_TORQUE[self.kind]

    def changed(self, values: Mapping[str, float]) -> AerobatRobot:
        """Return the robot with other parameters: parameter -> change."""
        robot, air = changed_belief(self.aerobat, self.air, values)
        scale = values.get("thruster_scale", self.thruster_scale)
        return replace(self, model=robot.model, aerobat=robot, air=air, thruster_scale=scale)

    @property
    def parameters(self) -> Mapping[str, Parameter]:
        """The parameters that flights can identify; a modelled torque changes with all of them."""
        if self.kind != "modelled":
            return PARAMETERS
        return {name: parameter._replace(inertial=False) for name, parameter in PARAMETERS.items()}

    @property
    def assumptions(self) -> Mapping[str, str]:
        """The believed air, but for what differs from flight to flight, and which torque is known."""
        air = self.air.model_dump(exclude=WEATHER_KEYS)
        return {TORQUE: self.kind, **{f"air.{key}": str(value) for key, value in air.items()}}

    def condition(self, block: Block) -> CrankCondition:
        """Return phase and state of a completed block. Raises CalibrationError if the crank hardly turns."""
        return crank_condition(Motion.of(block), self.aerobat, self.kind)

    def suspects(self) -> Mapping[str, tuple[Suspect, ...]]:
        """Return what may have changed since a calibration; elbows that give show in measured torques alone."""
        return {name: group for name, group in SUSPECTS.items() if name != "compliance" or self.measures_effort}

    def suspected(self, cause: str, values: Array, block: Block) -> tuple[AerobatRobot, Block]:
        """Return robot and completed block as they would be if a cause had these values."""
        if cause == "air_density":
            return self.changed({"density": float(values[0])}), block
        if cause == "payload":
            loaded = replace(self.aerobat, model=carrying(self.aerobat.model, values))
            return replace(self, model=loaded.model, aerobat=loaded), block
        if cause == "crank_zero":
            return self, crank_turned(block, self.aerobat, float(values[0]))
        return self, flexed(block, self.aerobat, values)

    def learn_extras(self, free: Sequence[tuple[Array, Mapping[str, Channel]]], points: Sequence[str]) -> Extras | None:
        """Return where the accelerometer sits, from raw samples; None where records have configurations and velocities.

        Raises:
            CalibrationError: only some of the records have raw samples, or one has no accelerometer.
        """
        raw = [f"{EXTRA}encoder" in channels for _, channels in free]
        if not any(raw):
            return None
        if not all(raw):
            raise CalibrationError("calibrate: raw samples and logs of q and v: calibrate from one kind at a time")
        from aerobat_pin.aerobat.raw.find_mount import learn_mount  # compiles kernels that other records do not need

        return learn_mount(free, points, self.aerobat, self.air, self.kind, self.raw)

    def with_extras(self, values: Mapping[str, Array]) -> AerobatRobot:
        """Return the robot with its accelerometer where it was found. Raises CalibrationError if that cannot be."""
        return replace(self, mount=Mount.of_parts(values))

    def fault(self, channels: Mapping[str, Channel]) -> str | None:
        """Return why the motion cannot follow from a log's channels, in words; None if it can.

        With an encoder the channels are raw samples.
        """
        if f"{EXTRA}encoder" in channels:
            few = [channel for channel in channels.values() if len(channel.time) < FEWEST_RAW_SAMPLES]
            counts = [f"{len(channel.time)} samples of {', '.join(channel.names)}" for channel in few]
            return f"{counts[0]}: {FEWEST_RAW_SAMPLES} or more were expected" if counts else None
        twist = [key for key in ("base.velocity", "base.rate") if key in channels]
        if len(twist) == 1:
            return f"{', '.join(channels[twist[0]].names)}: velocity and angular velocity were expected, both or none"
        crank, joints = channels.get(f"{EXTRA}crank_angle"), channels.get("joints.position")
        if crank is None and f"{EXTRA}crank_rate" in channels:
            return "crank_rate without crank_angle: the linkage needs the angle"
        if crank is None and joints is None:
            return f"neither crank_angle nor the joints {', '.join(JOINTS)} are there"
        if crank is not None and (fault := angle_fault(crank.time[:], crank.values[:][:, 0], None)) is not None:
            return fault
        return None if joints is None else angle_fault(joints.time[:], None, joints.values[:])

    def complete(self, block: Block) -> Block:
        """Return a block with the joints that the crank drives, the crank's motion and the wind."""
        block = completed(block, self.aerobat, self.air)
        return replace(block, source={**block.source, "motor_torque": self.kind})

    def smooths(self, channels: Collection[str]) -> bool:
        """Return whether the channels are raw samples."""
        return f"{EXTRA}encoder" in channels

    def motion_from(
        self,
        time: Array,
        channels: Mapping[str, Channel],
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
        if "thrusters" in known:
            known["thrusters"] = (1.0 + self.thruster_scale) * known["thrusters"]
        return known

    def agreements(self, time: Array, measured: Callable[[str], Array | None]) -> Iterable[Agreement]:
        """Return the joint angles beside those of the closed linkage at the crank angle, if both are measured."""
        angles, crank = measured("joints.position"), measured(f"{EXTRA}crank_angle")
        if angles is None or crank is None:
            return ()
        driven = joint_table(self.aerobat.linkage.solve(crank[:, 0]))[:, 0]
        opening = Agreement(
            "joints off the linkage",
            ("joint positions", "crank angle"),
            time,
            np.degrees(angles),
            np.degrees(np.tile(driven, 2)),
            "values",
            JOINTS,
            "deg",
            LARGEST_OPENING,
            "the angle of the linkage at crank_angle was expected: check zero and sign of joints and crank, and the "
            "believed linkage",
            share=0.0,
        )
        return (opening,)

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
