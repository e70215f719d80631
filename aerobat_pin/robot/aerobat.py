"""The robot in Pinocchio: models, reference configuration, index maps, linkage and wing."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from aerobat_description import MORPHOLOGIES
from aerobat_description.morphology import Morphology
from aerobat_description.morphology_tables import FreeFlyer
from aerobat_description.reading import MorphologyError
from aerobat_description.write_urdf import srdf_text, urdf_text
from aerobat_pin.errors import MorphologyFileError
from aerobat_pin.linkage import KineticSculpture
from aerobat_pin.numerics import Array
from aerobat_pin.robot.visual_model import visual_model
from aerobat_pin.robot.wing import Wing

JOINTS = ("left_shoulder", "left_elbow", "right_shoulder", "right_elbow")
FORCE_POINTS = ("left_force_point", "right_force_point")
CRANK_START = -np.pi / 2  # [rad], crank straight down
STANDARD_GRAVITY = 9.81  # [m/s2]


@dataclass(frozen=True, repr=False)
class Aerobat:
    """One robot. `q` is [position (3), quaternion xyzw (4), joints (4)], `v` the body twist in LOCAL axes, then rates.

    Joints are reached through `idx_q` and `idx_v`, in the order of `JOINTS`; never by counting.
    `text` is the URDF that the model was read from.
    """

    morphology: Morphology
    model: pin.Model
    text: str
    linkage: KineticSculpture
    wing: Wing
    idx_q: tuple[int, ...]
    idx_v: tuple[int, ...]

    def __repr__(self) -> str:
        """Say which robot it is, its size, and what it stands on in Pinocchio."""
        return (
            f"Aerobat({self.morphology.name!r}, {1e3 * self.mass:.1f} g, span {1e3 * self.wing.span:.0f} mm, "
            f"nq {self.model.nq}, nv {self.model.nv})"
        )

    @cached_property
    def visual_model(self) -> pin.GeometryModel:
        """Visible parts, built in memory when first asked for: a changed robot shows its change without any file."""
        return visual_model(self.model, self.morphology)

    @cached_property
    def collision_model(self) -> pin.GeometryModel:
        """Collision boxes."""
        return pin.buildGeomFromUrdfString(self.model, self.text, pin.GeometryType.COLLISION)

    @property
    def q0(self) -> Array:
        """Configuration (nq,) with the base at the origin and the crank straight down."""
        start = self.linkage.solve(CRANK_START)
        return self.configuration([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0], start.theta_s, start.theta_e)

    def with_changes(self, changes: Mapping[str, Any]) -> Aerobat:
        """Return a consistent new robot under the same gravity, without touching the disk.

        Where the linkage changes, joint limits and proximal stations that are not changed too follow it.

        Args:
            changes: nested values laid over the morphology, such as
                `{"linkage": {"L3b": 6.8e-3}, "wing": {"offset_x": 0.0}, "scale": {"span": 1.1}, "tail": None}`.

        Raises:
            MorphologyFileError: a change that no robot can have.
        """
        try:
            shape = self.morphology.with_changes(changes)
        except MorphologyError as error:
            raise MorphologyFileError(str(error)) from error
        return _build(shape, self.model.gravity.linear.copy())

    @property
    def mass(self) -> float:
        """Total mass [kg]."""
        return float(pin.computeTotalMass(self.model))

    def configuration(self, placement: ArrayLike, theta_s: ArrayLike, theta_e: ArrayLike) -> Array:
        """Return q (..., nq) of a base placement (..., 7) with both wings at the same shoulder and elbow angles."""
        placement = np.asarray(placement, float)
        q = np.empty((*placement.shape[:-1], self.model.nq))
        q[..., :7] = placement
        for index, angle in zip(self.idx_q, (theta_s, theta_e, theta_s, theta_e), strict=True):
            q[..., index] = angle
        return q

    def velocity(self, twist: ArrayLike, theta_s_dot: ArrayLike, theta_e_dot: ArrayLike) -> Array:
        """Return v (..., nv) of a base twist (..., 6) with both wings at the same joint rates (also accelerations)."""
        twist = np.asarray(twist, float)
        v = np.empty((*twist.shape[:-1], self.model.nv))
        v[..., :6] = twist
        for index, rate in zip(self.idx_v, (theta_s_dot, theta_e_dot, theta_s_dot, theta_e_dot), strict=True):
            v[..., index] = rate
        return v


def load_aerobat(
    morphology: str | Path = "aerobat", changes: Mapping[str, Any] | None = None, *, gravity: float = STANDARD_GRAVITY
) -> Aerobat:
    """Load a robot from a morphology.

    Args:
        morphology: `"aerobat"`, `"aerobat_guard"`, `"aerobat_light"`, or the path of a TOML file.
        changes: nested values laid over it, such as `{"wing": {"offset_x": -0.06}}`.
        gravity: downward, along -z of the world [m/s2].

    Raises:
        MorphologyFileError: as `load_morphology`.
    """
    return _build(load_morphology(morphology, changes), np.array([0.0, 0.0, -gravity]))


def load_morphology(morphology: str | Path, changes: Mapping[str, Any] | None = None) -> Morphology:
    """Read a morphology, as `Morphology.load` does, with an error of this package that names the file.

    Raises:
        MorphologyFileError: no such morphology, or one that no robot can have, or whose crank cannot turn.
    """
    try:
        return Morphology.load(morphology, changes)
    except (MorphologyError, OSError) as error:
        raise MorphologyFileError(_with_file(str(error), str(morphology))) from error


def _with_file(message: str, morphology: str) -> str:
    """Return what is wrong with a morphology, with the file it came from, if it came from one of the user's own."""
    if morphology in MORPHOLOGIES or message.startswith("morphology file"):
        return message
    if Path(morphology).is_file():
        return f"morphology file {morphology}: {message.removeprefix('morphology: ')}"
    is_path = morphology.endswith(".toml") or "/" in morphology
    return f"morphology file {morphology}: there is no such file" if is_path else message


def _build(shape: Morphology, gravity: Array) -> Aerobat:
    linkage = KineticSculpture(shape.linkage)
    linkage.check()
    text = urdf_text(shape)
    model = pin.buildModelFromXML(text, pin.JointModelFreeFlyer())
    model.gravity.linear = gravity
    pin.loadReferenceConfigurationsFromXML(model, srdf_text(shape))
    _limit_free_flyer(model, shape.free_flyer)
    indices = [model.getJointId(name) for name in JOINTS]
    return Aerobat(
        morphology=shape,
        model=model,
        text=text,
        linkage=linkage,
        wing=Wing(shape),
        idx_q=tuple(model.joints[i].idx_q for i in indices),
        idx_v=tuple(model.joints[i].idx_v for i in indices),
    )


def _limit_free_flyer(model: pin.Model, limits: FreeFlyer) -> None:
    """Replace the free-flyer's infinite limits; its effort is zero, for nothing drives a free base."""
    bound = np.concatenate([np.full(3, limits.position), np.ones(4)])
    lower, upper = model.lowerPositionLimit.copy(), model.upperPositionLimit.copy()
    lower[:7], upper[:7] = -bound, bound
    model.lowerPositionLimit, model.upperPositionLimit = lower, upper
    speed, effort = model.velocityLimit.copy(), model.effortLimit.copy()
    speed[:3], speed[3:6], effort[:6] = limits.velocity, limits.angular_velocity, 0.0
    model.velocityLimit, model.effortLimit = speed, effort
