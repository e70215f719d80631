"""The robot of a record, from a URDF or MJCF file or one rigid body by numbers, and what it may know beyond its masses.

`PlainRobot` knows its masses alone. A robot that knows more, such as its air or how a crank moves its joints, is a
subclass that overrides what it knows: Aerobat is one, and so is any robot of a user's own.
"""

from __future__ import annotations

import os
import xml.etree.ElementTree as ElementTree
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from hashlib import sha256
from pathlib import Path
from typing import ClassVar, Self

import numpy as np
import pinocchio as pin

from aerobat_pin.errors import LogError, MapError
from aerobat_pin.numerics import Array, read_robot
from aerobat_pin.observers import Observer, Rows
from aerobat_pin.records.agreement import Agreement
from aerobat_pin.records.block import Block, SmoothedMotion
from aerobat_pin.records.channel import LogChannel
from aerobat_pin.records.learnable import Condition, Extras, Parameter
from aerobat_pin.records.map_tables import PayloadSection, RobotTable

LARGEST_ROBOT = 100_000_000  # bytes of a robot's file
FREE_NQ, FREE_NV = 7, 6


@dataclass(frozen=True)
class PlainRobot:
    """A robot of which the model is known, and which a subclass can know more about.

    Attributes:
        model: the model; its gravity is that of the map.
        free: whether its first joint is a free-flyer.
        joints: names of the other joints, in the order of v.
        title: what it is, for reports.
        payload: what it carries, contained in the model; None if nothing is known of it.
        unloaded, stated: the model without the payload, and also without corrected links; None if it is the model.
    """

    model: pin.Model
    free: bool
    joints: tuple[str, ...]
    title: str
    payload: PayloadSection | None = field(default=None, kw_only=True)
    unloaded: pin.Model | None = field(default=None, kw_only=True)
    stated: pin.Model | None = field(default=None, kw_only=True)
    moves_joints: ClassVar[bool] = False  # whether `complete` finds the joints that have no channel
    remembers: ClassVar[bool] = False  # whether `known` depends on the past, so that a part of a record is taken whole

    @property
    def parameters(self) -> Mapping[str, Parameter]:
        """The parameters that a calibration can identify."""
        return {}

    @property
    def assumptions(self) -> Mapping[str, str]:
        """What is believed beside the model, such as `air.density`, in words: a calibration belongs to all of it."""
        return {}

    def condition(self, block: Block) -> Condition | None:
        """Return phase and state of a completed block, on which errors may depend; None for a robot without a phase.

        Raises:
            CalibrationError: the robot has a phase, but this block does not show it.
        """
        return None

    def learn_extras(
        self, free: Sequence[tuple[Array, Mapping[str, LogChannel]]], points: Sequence[str]
    ) -> Extras | None:
        """Return what only this robot learns from free records; None, as here, where the rest is to be learnt.

        Args:
            free: common times [s] and channels of each record.
            points: frames at which forces would be sought.
        """
        return None

    def with_extras(self, values: Mapping[str, Array]) -> PlainRobot:
        """Return the robot with what `learn_extras` found. Raises CalibrationError if that cannot be."""
        return self

    def fault(self, channels: Mapping[str, LogChannel]) -> str | None:
        """Return what is wrong with the channels of a log as a whole, in words; None, as here, if nothing is.

        Args:
            channels: key -> channel.
        """
        return None

    def complete(self, block: Block) -> Block:
        """Return a block with what was not measured but follows from what was, such as joints that a crank drives."""
        return block

    def known(self, block: Block) -> Mapping[str, Array]:
        """Return the generalised forces (m, nv) that the robot itself knows, interval means: its air, its rotors' drag.

        Args:
            block: a stretch of the record, completed.
        """
        return {}

    def agreements(self, time: Array, measured: Callable[[str], Array | None]) -> Iterable[Agreement]:
        """Return series that must agree whatever forces act, beyond those of every record.

        Args:
            time: (m,) increasing common times of the record [s].
            measured: key of a channel -> (m, k) samples at these times; None if there is no such channel.
        """
        return ()

    def torque(self, block: Block, known: Mapping[str, Array]) -> Array:
        """Return the joint torques (m, nv) that are known in a block, given the other known forces; else its `tau`."""
        return block.tau

    @property
    def measures_effort(self) -> bool:
        """Whether the efforts of its records are torques at the joints, each measured."""
        return True

    @property
    def knows_forces(self) -> bool:
        """Whether the robot itself knows forces that act on it."""
        return type(self).known is not PlainRobot.known

    def rows(self) -> Rows | None:
        """Return the rows to believe; None where that follows from the map and the channels that are there."""
        return None

    def smooths(self, channels: Collection[str]) -> bool:
        """Return whether `motion_from` finds the motion, bridging holes itself, for a record with these keys."""
        return False

    def motion_from(
        self,
        time: Array,
        channels: Mapping[str, LogChannel],
        observers: Sequence[Observer],
        progress: Callable[[float], None] | None,
    ) -> SmoothedMotion | None:
        """Return motion and forces found together; None, as here, where the channels give the motion directly.

        Args:
            time: (m + 1,) common times of the record [s].
            channels: key -> channel, each on its own clock.
            observers: those that are asked for.
            progress: called with the share that is done.
        """
        return None

    def changed(self, values: Mapping[str, float]) -> PlainRobot:
        """Return the robot with parameters changed by values, as a calibration found them."""
        return self

    @property
    def mass(self) -> float:
        """Mass of everything that moves [kg]."""
        return float(sum(inertia.mass for inertia in self.model.inertias.tolist()[1:]))

    @property
    def weight(self) -> float:
        """Weight of everything that moves [N]."""
        return self.mass * float(np.linalg.norm(self.model.gravity.linear))

    def q_index(self, joint: str) -> int:
        """Return the index in q of a joint of one coordinate."""
        return int(self.model.joints[self.model.getJointId(joint)].idx_q)

    def v_index(self, joint: str) -> int:
        """Return the index in v of a joint of one coordinate."""
        return int(self.model.joints[self.model.getJointId(joint)].idx_v)

    def slides(self, joint: str) -> bool:
        """Return whether a joint slides, so that its row is in N."""
        return bool(self.model.joints[self.model.getJointId(joint)].shortname().startswith("JointModelP"))

    def heavier(self, factor: float) -> Self:
        """Return the robot with all its own masses and inertias times a factor."""
        model = self.own_model.copy()
        for k, inertia in enumerate(self.own_model.inertias.tolist()):
            model.inertias[k] = pin.Inertia(factor * inertia.mass, inertia.lever, factor * inertia.inertia)
        return replace(self, model=model, unloaded=None).carrying(self.payload)

    def with_links(self, changes: Array) -> Self:
        """Return the robot with other dynamic parameters of its stated links, by changes (links, 10)."""
        stated, model = self.stated_model, self.stated_model.copy()
        for k in np.flatnonzero(np.any(changes, axis=1)).tolist():
            own = stated.inertias[k + 1].toDynamicParameters()
            model.inertias[k + 1] = pin.Inertia.FromDynamicParameters(own + changes[k])
        return replace(self, model=model, unloaded=None, stated=stated).carrying(self.payload)

    @property
    def stated_model(self) -> pin.Model:
        """The model as its file states it: without a payload and corrections of its links."""
        return self.own_model if self.stated is None else self.stated

    @property
    def own_model(self) -> pin.Model:
        """The model without a payload."""
        return self.model if self.unloaded is None else self.unloaded

    def carrying(self, payload: PayloadSection | None) -> Self:
        """Return the robot with a payload; as it is if there is none, or one that is still sought.

        Raises:
            MapError: the payload's frame does not move, or there is none of its name.
        """
        frames = {frame.name: frame for frame in self.model.frames.tolist() if frame.parentJoint}
        if payload is not None and payload.frame not in frames:
            names = ", ".join(list(frames)[:40])
            raise MapError(
                f"map: payload.frame = {payload.frame}: a moving frame of {self.title} was expected: {names}"
            )
        if payload is None or payload.com is None or payload.mass is None:
            return self
        frame, model = frames[payload.frame], self.own_model.copy()
        inertia = pin.Inertia(payload.mass, np.array(payload.com), np.diag(payload.inertia))
        model.appendBodyToJoint(frame.parentJoint, inertia, frame.placement)
        return replace(self, model=model, payload=payload, unloaded=self.own_model)

    def fingerprint(self) -> str:
        """Return a number made of joints, their places, masses without a payload, and gravity."""
        model = self.own_model
        parts = [str(list(model.names)), *(f"{joint.shortname()}" for joint in model.joints.tolist()[1:])]
        numbers = [place.homogeneous for place in model.jointPlacements.tolist()]
        numbers += [inertia.toDynamicParameters() for inertia in model.inertias.tolist()[1:]]
        numbers.append(model.gravity.linear)
        parts += [f"{value:.9g}" for array in numbers for value in np.ravel(array)]
        return sha256(" ".join(parts).encode()).hexdigest()[:16]

    def neutral(self) -> Array:
        """Return the configuration (nq,) of zeros and of an upright base."""
        return np.array(pin.neutral(self.model))


def robot_of_map(table: RobotTable, folder: Path) -> PlainRobot:
    """Build the model of a map's robot; relative paths begin at `folder`.

    Raises:
        LogError: not exactly one robot is given, its file cannot be read, or a joint has several coordinates.
    """
    given = [name for name in ("body", "urdf", "mjcf") if getattr(table, name) is not None]
    if len(given) != 1:
        named = " and ".join(given) or "none"
        raise LogError(f"map: robot has {named}: exactly one of body = {{...}}, urdf = FILE, mjcf = FILE was expected")
    free = table.root == "free_flyer"
    if table.body is not None:
        model, title = _one_body(table), f"one body of {1e3 * table.body.mass:g} g"
        if not free:
            raise LogError('map: robot.root = "fixed": one rigid body cannot move then; "free_flyer" was expected')
    else:
        path = Path(folder, table.urdf or table.mjcf or "")
        model, title = _from_file(path, mjcf=table.mjcf is not None, free=free), path.stem
        free = model.njoints > 1 and model.joints[1].shortname() == "JointModelFreeFlyer"
    model.gravity.linear = np.array([0.0, 0.0, -table.gravity])
    joints = tuple(model.names.tolist()[2 if free else 1 :])
    for name in joints:
        joint = model.joints[model.getJointId(name)]
        if (joint.nq, joint.nv) != (1, 1):
            raise LogError(
                f"robot {title}: joint '{name}' has {joint.nq} coordinates: joints of one angle or one length were "
                "expected"
            )
    for frame in (*table.points, *table.wrenches):
        if not model.existFrame(frame):
            names = [frame.name for frame in model.frames.tolist()[1:]]
            raise LogError(f"map: no frame '{frame}' (robot.points) in robot {title}; it has {', '.join(names[:40])}")
    if not (table.points or table.wrenches):
        names = [frame.name for frame in model.frames.tolist()[1:]]
        raise LogError(f"map: robot.points: where may something push? Name frames of {title}: {', '.join(names[:40])}")
    return PlainRobot(model, free, joints, title)


def _one_body(table: RobotTable) -> pin.Model:
    body = table.body
    assert body is not None
    model = pin.Model()
    model.name = "body"
    root = model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "root_joint")
    model.addJointFrame(root)
    inertia = pin.Inertia(body.mass, np.array(body.centre), np.diag(body.inertia))
    model.appendBodyToJoint(root, inertia, pin.SE3.Identity())
    model.addFrame(pin.Frame("body", root, 0, pin.SE3.Identity(), pin.FrameType.BODY))
    centre = pin.SE3(np.eye(3), np.array(body.centre))
    model.addFrame(pin.Frame("centre", root, 0, centre, pin.FrameType.OP_FRAME))
    return model


def _from_file(path: Path, *, mjcf: bool, free: bool) -> pin.Model:
    """Read a URDF or MJCF file; what Pinocchio prints about it becomes the error's message."""
    if not os.path.isfile(path):
        raise LogError(f"robot {path}: there is no such file")
    if path.stat().st_size > LARGEST_ROBOT:
        raise LogError(f"robot {path}: {path.stat().st_size} bytes: at most {LARGEST_ROBOT} were expected")

    root = [pin.JointModelFreeFlyer()] if free else []
    text = "" if mjcf else _with_angles(path)

    def read() -> pin.Model:
        return pin.buildModelFromMJCF(str(path), *root) if mjcf else pin.buildModelFromXML(text, *root)

    model = read_robot(path, read)
    if model.njoints > 2 and all(joint.shortname() == "JointModelFreeFlyer" for joint in model.joints.tolist()[1:3]):
        model = read_robot(path, lambda: pin.buildModelFromMJCF(str(path)))  # the file has a free joint of its own
    if model.nv == 0:
        raise LogError(f"robot {path}: no joint of it moves")
    return model


def _with_angles(path: Path) -> str:
    """Return a URDF whose continuous joints are revolute: one angle, as logs have it, in place of cosine and sine."""
    try:
        root = ElementTree.parse(path).getroot()
    except (ElementTree.ParseError, ValueError) as error:
        raise LogError(f"robot {path}: cannot be read as XML: {error}") from error
    for joint in root.iter("joint"):
        if joint.get("type") == "continuous":
            joint.set("type", "revolute")
            limit = joint.find("limit")
            limit = ElementTree.SubElement(joint, "limit") if limit is None else limit
            for key, value in (("lower", "-1e9"), ("upper", "1e9"), ("effort", "1e9"), ("velocity", "1e9")):
                if limit.get(key) is None or key in ("lower", "upper"):
                    limit.set(key, value)
    return ElementTree.tostring(root, encoding="unicode")
