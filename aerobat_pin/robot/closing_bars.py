"""The bars that close the linkage's loops: they cannot be links of a tree, so the crank angle gives their placements.

    picture = visual_model_with_bars(robot)
    place_bars(robot, picture, crank_angle)
    pin.updateGeometryPlacements(robot.model, data, picture, picture_data)

The bars L3 and L7 are links of the tree, and Pinocchio places them.
"""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from aerobat_description.bars import closing_bars
from aerobat_pin.numerics import guarded
from aerobat_pin.robot.aerobat import CRANK_START, Aerobat, geometry_object

BAR_ANGLES = {"L1": "t1", "L2": "t2", "L4": "t3", "L5": "t8", "L6": "t9"}  # bar, as numbered in the paper: its angle


@guarded()
def bar_placements(robot: Aerobat, crank_angle: float) -> dict[str, pin.SE3]:
    """Return the frames, in `base_link`, of the bars L1, L2, L4, L5 and L6 of both wings, named `left_L1` and so on.

    A frame has its origin at the bar's first pin and its y axis along the bar; right frames mirror left frames.

    Args:
        robot: the robot with the linkage.
        crank_angle: absolute t1 [rad].

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
