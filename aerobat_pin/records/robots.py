"""The robot of a record, and what it may know beyond its masses.

`PlainRobot` knows its masses alone. A robot that knows more, such as its air or how a crank moves its joints, is a
subclass that overrides what it knows: Aerobat is one, and so is any robot of a user's own.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from hashlib import sha256
from typing import ClassVar, Self

import numpy as np
import pinocchio as pin

from aerobat_pin.errors import MapError
from aerobat_pin.numerics import Array, ShownInNotebooks
from aerobat_pin.observers import Observer, Rows, is_weightless
from aerobat_pin.records.block import Block, Channel, SmoothedMotion
from aerobat_pin.records.learnable import Condition, Extras, Parameter, Suspect
from aerobat_pin.records.reference import Agreement
from aerobat_pin.records.robot_tables import PayloadSection

FREE_NQ, FREE_NV = 7, 6
SMALLEST_BODY = 1e-4  # [m] root of moment over mass
FLATTEST = 1.02  # times the other two, the largest moment, as files round


@dataclass(frozen=True)
class Mimic:
    """How a joint follows another one: its position is a factor times that one's, plus an offset [rad, m]."""

    leader: str
    factor: float
    offset: float


@dataclass(frozen=True)
class PlainRobot(ShownInNotebooks):
    """A robot of which the model is known, and which a subclass can know more about.

    Attributes:
        model: the model; its gravity is that of the map.
        free: whether its first joint is a free-flyer.
        joints: names of the other joints, in the order of v.
        title: what it is, for reports.
        payload: what it carries, contained in the model; None if nothing is known of it.
        mimics: joint that a file says to follow another one -> how; the model lets both move by themselves.
        unread: what its file says and the model does not have, such as `gravcomp`.
        unloaded, stated: the model without the payload, and also without corrected links; None if it is the model.
    """

    model: pin.Model
    free: bool
    joints: tuple[str, ...]
    title: str
    payload: PayloadSection | None = field(default=None, kw_only=True)
    mimics: Mapping[str, Mimic] = field(default_factory=dict, hash=False, kw_only=True)
    unread: tuple[str, ...] = field(default=(), kw_only=True)
    unloaded: pin.Model | None = field(default=None, kw_only=True)
    stated: pin.Model | None = field(default=None, kw_only=True)
    moves_joints: ClassVar[bool] = False  # whether `complete` finds the joints that have no channel
    remembers: ClassVar[bool] = False  # whether `known` depends on the past, so that a part of a record is taken whole
    limits_forces: ClassVar[bool] = True  # whether forces are expected to be of the order of the weight

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

    def suspects(self) -> Mapping[str, tuple[Suspect, ...]]:
        """Return what may change from day to day: cause -> its parameters; nothing for a robot that knows of none."""
        return {}

    def suspected(self, cause: str, values: Array, block: Block) -> tuple[PlainRobot, Block]:
        """Return robot and completed block as they would be if a cause of `suspects` had these values."""
        raise NotImplementedError

    def learn_extras(self, free: Sequence[tuple[Array, Mapping[str, Channel]]], points: Sequence[str]) -> Extras | None:
        """Return what only this robot learns from free records; None, as here, where the rest is to be learnt.

        Args:
            free: common times [s] and channels of each record.
            points: frames at which forces would be sought.
        """
        return None

    def with_extras(self, values: Mapping[str, Array]) -> PlainRobot:
        """Return the robot with what `learn_extras` found. Raises CalibrationError if that cannot be."""
        return self

    def fault(self, channels: Mapping[str, Channel]) -> str | None:
        """Return what is wrong with all channels of a log together, in words; None, as here, if nothing is."""
        return None

    def complete(self, block: Block) -> Block:
        """Return a block with what was not measured but follows from what was, such as joints that a crank drives."""
        return block

    def known(self, block: Block) -> Mapping[str, Array]:
        """Return the generalised forces (m, nv), interval means, that the robot knows of a completed block: its air."""
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
        channels: Mapping[str, Channel],
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
    def impossible(self) -> list[str]:
        """Joints of links whose moments of inertia no body has."""
        names = []
        for joint, inertia in list(zip(self.own_model.names, self.own_model.inertias, strict=True))[1:]:
            small, middle, large = np.linalg.eigvalsh(inertia.inertia)
            if large > FLATTEST * (small + middle) or large < inertia.mass * SMALLEST_BODY**2:
                names.append(joint)
        return names

    @property
    def weight(self) -> float:
        """Weight of everything that moves [N]."""
        return self.mass * float(np.linalg.norm(self.model.gravity.linear))

    @property
    def weightless(self) -> bool:
        """Whether gravity is too weak to compare anything with, as in an orbit."""
        return is_weightless(self.model)

    def q_index(self, joint: str) -> int:
        """Return the index in q of a joint of one coordinate."""
        return int(self.model.joints[self.model.getJointId(joint)].idx_q)

    def v_index(self, joint: str) -> int:
        """Return the index in v of a joint of one coordinate."""
        return int(self.model.joints[self.model.getJointId(joint)].idx_v)

    def slides(self, joint: str) -> bool:
        """Return whether a joint slides, so that its row is in N."""
        return bool(self.model.joints[self.model.getJointId(joint)].shortname().startswith("JointModelP"))

    def limbs(self, joints: Sequence[str]) -> list[tuple[int, ...]]:
        """Return the places among some joints, by name, of those on each limb, a chain of joints without a branch."""
        limbs, parents = dict[int, list[int]](), self.model.parents.tolist()
        first = list(range(self.model.njoints))
        for k in range(2, self.model.njoints):
            if parents.count(parents[k]) == 1:
                first[k] = first[parents[k]]
        for column, joint in enumerate(joints):
            limbs.setdefault(first[self.model.getJointId(joint)], []).append(column)
        return [tuple(limb) for limb in limbs.values()]

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
            parameters = stated.inertias[k + 1].toDynamicParameters()
            model.inertias[k + 1] = pin.Inertia.FromDynamicParameters(parameters + changes[k])
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
