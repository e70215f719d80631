"""The closed linkage in Pinocchio: a tree of all bars with the points that close its loops, and bars for pictures.

    model, constraints = closed_model("aerobat")
    q, v, _ = closed_state(model, KineticSculpture(), crank_angle=-1.57, crank_velocity=29.8)
    data, datas = model.createData(), pin.StdVec_RigidConstraintData()
    datas.extend(one.createData() for one in constraints)
    pin.initConstraintDynamics(model, data, constraints, datas)
    a = pin.constraintDynamics(model, data, q, v, tau, constraints, datas, closed_settings())

Model and constraints come from the MJCF of the robot description. Each crank is free and takes its own torque, since
Pinocchio knows no joint that follows another one in these dynamics.

A planar loop has two closing equations, and a point three. The third, across the plane, cannot be satisfied while an
integrator is between two closed states: the force across the plane grows as 1/mu with the proximal parameter mu, and
turns the body. `closed_settings` has the mu that leaves both errors small. With mu = 1e-8, which is as exact in closed
states, 0.2 s of free flight differ by 2.6 mm from the right one at steps of 1 ms; with 1e-3, by 0.01 mm.

In the robot's own tree L3 and L7 are links. The other bars cannot be, so the crank angle gives their placements:

    picture = visual_model_with_bars(robot)
    place_bars(robot, picture, crank_angle)
    pin.updateGeometryPlacements(robot.model, data, picture, picture_data)
"""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import TypeAlias

import numpy as np
import pinocchio as pin

from aerobat_description.bars import BarMasses, closing_bars
from aerobat_description.morphology import Morphology
from aerobat_description.write_mjcf import mjcf_text
from aerobat_pin.aerobat.aerobat import (
    CRANK_START,
    JOINTS,
    STANDARD_GRAVITY,
    Aerobat,
    geometry_object,
    limit_free_flyer,
    load_morphology,
)
from aerobat_pin.errors import FrameNotFoundError
from aerobat_pin.linkage import KineticSculpture
from aerobat_pin.numerics import Array, guarded

PROXIMAL = (1e-14, 1e-14, 1e-3, 5)  # absolute and relative accuracy, mu, iterations
CLOSING_RATE = 100.0  # [1/s]: rate at which gaps that an integrator opens close again (Baumgarte)
# Joint of a side: the bar whose absolute angle it has, and the bar relative to which it has it.
BAR_JOINTS = {
    "crank": ("t1", None),
    "J2": ("t2", "t1"),
    "J3": ("t3", "t2"),
    "J8": ("t8", None),
    "J9": ("t9", "t8"),
    "shoulder": ("t5", None),
    "elbow": ("t6", "t5"),
}
Constraints: TypeAlias = "pin.StdVec_RigidConstraintModel"
BAR_ANGLES = {"L1": "t1", "L2": "t2", "L4": "t3", "L5": "t8", "L6": "t9"}  # bar, as numbered in the paper: its angle


@guarded(gravity="not negative")
def closed_model(
    morphology: str | Path | Morphology = "aerobat", bars: BarMasses = "light", *, gravity: float = STANDARD_GRAVITY
) -> tuple[pin.Model, Constraints]:
    """Return the robot with its closed linkage: model, and the constraints of its six closing points.

    Joints are the free base `root_joint` and, on each side, `left_crank` (absolute crank angle t1), `left_shoulder`,
    `left_elbow` (as in the URDF), `left_J2`, `left_J3`, `left_J8` and `left_J9` (bars). The reference configuration
    `closed` has the crank straight down. No joint has armature: the flywheel of the MJCF's servo is not the robot's.

    Args:
        morphology: shipped name, TOML file, or a morphology.
        bars: masses of the linkage's bars, taken from the body: `"cad"` those of the morphology, `"light"` a hundredth.
        gravity: gravitational acceleration along -z of the world [m/s2].

    Raises:
        MorphologyFileError: for the same reasons as `load_morphology`.
    """
    shape = morphology if isinstance(morphology, Morphology) else load_morphology(morphology)
    with tempfile.TemporaryDirectory() as folder:  # Pinocchio reads MJCF from files only
        file = Path(folder, f"{shape.name}.xml")
        file.write_text(mjcf_text(shape, bars, meshdir=None), encoding="utf-8")
        model, constraints = pin.buildModelAndLegacyConstraintsFromMJCF(str(file))[:2]
    model.gravity.linear = np.array([0.0, 0.0, -gravity])
    model.armature = np.zeros(model.nv)
    limit_free_flyer(model, shape.free_flyer)
    for joint in JOINTS:  # Pinocchio's reader shifts their limits by the angle of the file's pose
        index = model.joints[model.getJointId(joint)].idx_q
        limits = getattr(shape.joints, f"{joint.partition('_')[2]}_limits")
        model.lowerPositionLimit[index], model.upperPositionLimit[index] = limits
    corrector = pin.BaumgarteCorrectorParameters(CLOSING_RATE**2, 2.0 * CLOSING_RATE)  # gap'' = -2 s gap' - s^2 gap
    for constraint in constraints:
        constraint.setBaumgarteCorrectorParameters(corrector)
    model.referenceConfigurations["closed"] = closed_state(model, KineticSculpture(shape.linkage), -0.5 * np.pi)[0]
    return model, constraints


def closed_settings() -> pin.ProximalSettings:
    """Return the settings with which `pin.constraintDynamics` solves a closed model."""
    return pin.ProximalSettings(*PROXIMAL)


@guarded()
def closed_state(
    model: pin.Model, linkage: KineticSculpture, crank_angle: float, crank_velocity: float = 0.0
) -> tuple[Array, Array, Array]:
    """Return q, v and a of a closed model with the base at rest at the origin and both cranks alike, at constant rates.

    Args:
        model: model that `closed_model` returns.
        linkage: linkage of the same morphology.
        crank_angle: absolute crank angle t1 [rad].
        crank_velocity: its rate [rad/s].

    Raises:
        FrameNotFoundError: the model is not one of a closed linkage.
        LinkageError: the linkage cannot close.
    """
    closure = linkage.solve(crank_angle, crank_velocity)
    q, v, a = pin.neutral(model), np.zeros(model.nv), np.zeros(model.nv)
    for side in ("left", "right"):
        for name, (bar, carrier) in BAR_JOINTS.items():
            joint = f"{side}_{name}"
            if not model.existJointName(joint):
                raise FrameNotFoundError(joint, list(model.names))
            index = model.joints[model.getJointId(joint)]
            moving = closure.bars[bar] if carrier is None else closure.bars[bar] - closure.bars[carrier]
            q[index.idx_q], v[index.idx_v] = moving.at, closure.rate(moving)
            a[index.idx_v] = closure.acceleration(moving)
    return q, v, a


@guarded()
def bar_placements(robot: Aerobat, crank_angle: float) -> dict[str, pin.SE3]:
    """Return the frames, in `base_link`, of the bars L1, L2, L4, L5 and L6 of both wings at an absolute t1 [rad].

    A frame, such as `left_L1`, has its origin at the bar's first pin and its y axis along the bar; right frames mirror
    left frames.

    Raises:
        LinkageError: the linkage cannot close.
        ShapeError: the crank angle is not finite.
    """
    closure = robot.linkage.solve(crank_angle)
    placed = {}
    for name, (bar, side) in closing_bars(robot.morphology.linkage).items():
        sign = 1.0 if side == "left" else -1.0
        outboard, up = closure.pins[bar.origin]
        turn = pin.utils.rotate("x", sign * float(closure.angles[BAR_ANGLES[bar.name]]))
        placed[name] = pin.SE3(turn, np.array([robot.morphology.wing.offset_x, sign * outboard, up]))
    return placed


@guarded()
def visual_model_with_bars(robot: Aerobat) -> pin.GeometryModel:
    """Return the robot's visible parts plus the closing bars, attached to the base, with the crank straight down."""
    picture = robot.visual_model.copy()
    for name, (bar, side) in closing_bars(robot.morphology.linkage).items():
        material = "crank" if bar.name == "L1" else "bar"
        picture.addGeometryObject(geometry_object(robot.model, name, "base_link", bar.mesh(side), material))
    place_bars(robot, picture, CRANK_START)
    return picture


@guarded()
def place_bars(robot: Aerobat, picture: pin.GeometryModel, crank_angle: float) -> None:
    """Move the bars of `picture`, in place, to a crank angle [rad].

    `pin.updateGeometryPlacements` then moves them with the base.

    Raises:
        LinkageError: the linkage cannot close.
        ShapeError: the crank angle is not finite.
    """
    for name, placement in bar_placements(robot, crank_angle).items():
        picture.geometryObjects[picture.getGeometryId(name)].placement = placement
