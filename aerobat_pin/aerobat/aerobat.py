"""The robot in Pinocchio: models, reference configuration, index maps, linkage and wing."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import coal
import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from aerobat_description import MORPHOLOGIES
from aerobat_description.meshes import parts
from aerobat_description.morphology import Morphology
from aerobat_description.morphology_tables import FreeFlyer
from aerobat_description.reading import MorphologyError
from aerobat_description.solids import Mesh
from aerobat_description.write_urdf import MATERIALS, srdf_text, urdf_text
from aerobat_pin.aerobat.wing import Wing
from aerobat_pin.errors import MorphologyFileError
from aerobat_pin.linkage import KineticSculpture
from aerobat_pin.numerics import Array, ShownInNotebooks, frame_id, guarded
from aerobat_pin.scenario import Scenario

JOINTS = ("left_shoulder", "left_elbow", "right_shoulder", "right_elbow")
FORCE_POINTS = ("left_force_point", "right_force_point")
CRANK_START = -np.pi / 2  # [rad], crank straight down
STANDARD_GRAVITY = 9.81  # [m/s2]


@dataclass(frozen=True, repr=False)
class Aerobat(ShownInNotebooks):
    """A robot: its morphology, Pinocchio model, linkage and wing.

    A configuration `q` is [position (3), quaternion xyzw (4), joint angles (4)]; a velocity `v` is the body twist (6)
    in LOCAL axes, then the joint rates (4). The entries of the joints are at `idx_q` and `idx_v`, in the order of
    `JOINTS`; their order in q and v can differ from that. `text` is the URDF from which the model was read.
    """

    morphology: Morphology
    model: pin.Model
    text: str
    linkage: KineticSculpture
    wing: Wing
    idx_q: tuple[int, ...]
    idx_v: tuple[int, ...]

    def __repr__(self) -> str:
        return (
            f"Aerobat({self.morphology.name!r}, {1e3 * self.mass:.1f} g, span {1e3 * self.wing.span:.0f} mm, "
            f"nq {self.model.nq}, nv {self.model.nv})"
        )

    @cached_property
    def visual_model(self) -> pin.GeometryModel:
        """Visible parts, each on its link's joint; built in memory, so that a changed robot needs no mesh files."""
        visual = pin.GeometryModel()
        for name, part in parts(self.morphology).items():
            visual.addGeometryObject(geometry_object(self.model, name, part.link, part.mesh(), part.material))
        return visual

    @cached_property
    def collision_model(self) -> pin.GeometryModel:
        """Collision boxes of the links."""
        return pin.buildGeomFromUrdfString(self.model, self.text, pin.GeometryType.COLLISION)

    @property
    def q0(self) -> Array:
        """Configuration (nq,) with the base at the origin and the crank straight down."""
        start = self.linkage.solve(CRANK_START)
        return self.configuration([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0], start.theta_s, start.theta_e)

    @guarded()
    def with_changes(self, changes: Mapping[str, Any]) -> Aerobat:
        """Return a new, consistent robot under the same gravity, without writing files.

        If the linkage is changed, joint limits and proximal stations are adapted to it, unless `changes` sets them too.

        Args:
            changes: nested values that replace those of the morphology, such as
                `{"linkage": {"L3b": 6.8e-3}, "wing": {"offset_x": 0.0}, "scale": {"span": 1.1}, "tail": None}`.

        Raises:
            MorphologyFileError: the changed values are not a valid morphology.
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

    @guarded(placement=(..., 7), theta_s=[(), (...,)], theta_e=[(), (...,)])
    def configuration(self, placement: ArrayLike, theta_s: ArrayLike, theta_e: ArrayLike) -> Array:
        """Return q (..., nq) for a base placement (..., 7) and equal shoulder and elbow angles in both wings."""
        placement = np.asarray(placement, float)
        q = np.empty((*placement.shape[:-1], self.model.nq))
        q[..., :7] = placement
        for index, angle in zip(self.idx_q, (theta_s, theta_e, theta_s, theta_e), strict=True):
            q[..., index] = angle
        return q

    @guarded(twist=(..., 6), theta_s_dot=[(), (...,)], theta_e_dot=[(), (...,)])
    def velocity(self, twist: ArrayLike, theta_s_dot: ArrayLike, theta_e_dot: ArrayLike) -> Array:
        """Return v (..., nv) for a base twist (..., 6) and equal joint rates in both wings; likewise accelerations."""
        twist = np.asarray(twist, float)
        v = np.empty((*twist.shape[:-1], self.model.nv))
        v[..., :6] = twist
        for index, rate in zip(self.idx_v, (theta_s_dot, theta_e_dot, theta_s_dot, theta_e_dot), strict=True):
            v[..., index] = rate
        return v


@guarded(gravity="not negative")
def load_aerobat(
    morphology: str | Path = "aerobat", changes: Mapping[str, Any] | None = None, *, gravity: float = STANDARD_GRAVITY
) -> Aerobat:
    """Load a robot from a morphology.

    Args:
        morphology: `"aerobat"`, `"aerobat_guard"`, `"aerobat_light"`, or the path of a TOML file.
        changes: nested values that replace those of the morphology, such as `{"wing": {"offset_x": -0.06}}`.
        gravity: gravitational acceleration along -z of the world [m/s2].

    Raises:
        MorphologyFileError: for the same reasons as `load_morphology`.
    """
    return _build(load_morphology(morphology, changes), np.array([0.0, 0.0, -gravity]))


@guarded()
def load_morphology(morphology: str | Path, changes: Mapping[str, Any] | None = None) -> Morphology:
    """Read a morphology as `Morphology.load` does; errors are of this package and name the file.

    Raises:
        MorphologyFileError: the morphology does not exist or is not valid, or its crank cannot turn.
    """
    try:
        return Morphology.load(morphology, changes)
    except (MorphologyError, OSError) as error:
        raise MorphologyFileError(_with_file(str(error), str(morphology))) from error


def _with_file(message: str, morphology: str) -> str:
    """Return an error message, with the file name added if the morphology comes from a file of the user."""
    if morphology in MORPHOLOGIES or message.startswith("morphology file"):
        return message
    if os.path.isfile(morphology):
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
    limit_free_flyer(model, shape.free_flyer)
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


def limit_free_flyer(model: pin.Model, limits: FreeFlyer) -> None:
    """Replace the infinite limits of the free-flyer joint; its effort limit is zero, since no motor drives the base."""
    bound = np.concatenate([np.full(3, limits.position), np.ones(4)])
    model.lowerPositionLimit[:7], model.upperPositionLimit[:7] = -bound, bound
    model.velocityLimit[:3], model.velocityLimit[3:6] = limits.velocity, limits.angular_velocity
    model.effortLimit[:6] = 0.0


@guarded()
def flown_robot(scenario: Scenario) -> Aerobat:
    """Load the robot that flies in a scenario, with the scenario's changes and gravity.

    Raises the same errors as `load_aerobat`.
    """
    chosen = scenario.robot
    return load_aerobat(chosen.morphology, chosen.changes, gravity=scenario.flight.gravity)


@guarded()
def believed_robot(scenario: Scenario) -> Aerobat:
    """Load the robot that a scenario's observers assume. Raises the same errors as `load_aerobat`."""
    chosen = scenario.believed_robot
    return load_aerobat(chosen.morphology, chosen.changes, gravity=scenario.flight.gravity)


def geometry_object(model: pin.Model, name: str, link: str, mesh: Mesh, material: str) -> pin.GeometryObject:
    """Return a geometry object for a mesh whose points are in the frame of a link."""
    frame = frame_id(model, link)
    placement = model.frames[frame].placement
    item = pin.GeometryObject(name, model.frames[frame].parentJoint, frame, placement, _bvh(mesh))
    item.meshColor = np.array(MATERIALS[material])
    return item


def _bvh(mesh: Mesh) -> coal.BVHModelOBBRSS:
    corners = [point for triangle in mesh for point in triangle]
    unique = {point: i for i, point in enumerate(dict.fromkeys(corners))}
    shape = coal.BVHModelOBBRSS()
    shape.beginModel(len(mesh), len(unique))
    shape.addVertices(np.array(list(unique)))
    shape.addTriangles(np.array([[unique[point] for point in triangle] for triangle in mesh]))
    shape.endModel()
    return shape
