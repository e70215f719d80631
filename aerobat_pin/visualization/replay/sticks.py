"""Shapes for a robot that has none: sticks and a box."""

from __future__ import annotations

import coal
import numpy as np
import pinocchio as pin

from aerobat_pin.visualization import style

STICK = 0.04  # radius of a stick, in lengths of the robot


def sticks(model: pin.Model) -> pin.GeometryModel:
    """Return shapes for a robot without any: a stick from each joint to the next ones and to its frames, and a box."""
    visual, data = pin.GeometryModel(), model.createData()
    pin.framesForwardKinematics(model, data, pin.neutral(model))
    places = [data.oMi[k].translation.copy() for k in range(1, model.njoints)]
    places += [data.oMf[k].translation.copy() for k in range(len(model.frames))]
    length = max(float(np.max(np.ptp(np.array(places), axis=0))), 0.05)
    ends: dict[int, list[np.ndarray]] = {k: [] for k in range(1, model.njoints)}
    for k in range(2, model.njoints):
        if model.parents[k] > 0:
            ends[model.parents[k]].append(model.jointPlacements[k].translation)
    for frame in model.frames.tolist():
        if frame.parentJoint > 0 and not any(
            True for _ in ends[frame.parentJoint] if np.allclose(_, frame.placement.translation)
        ):
            ends[frame.parentJoint].append(frame.placement.translation)
    for joint, others in ends.items():
        colour = np.array([*style.rgb(style.BLUE if joint > 1 else style.GREEN), 1.0])
        if joint == 1:
            box = coal.Box(0.3 * length, 0.2 * length, 0.08 * length)
            _add(visual, "box", joint, box, pin.SE3.Identity(), colour)
        for k, end in enumerate(others):
            size = float(np.linalg.norm(end))
            if size > 1e-3 * length:
                turn = pin.Quaternion.FromTwoVectors(np.array([0.0, 0.0, 1.0]), end / size).matrix()
                stick = coal.Cylinder(0.5 * STICK * length, size)
                _add(visual, f"stick_{joint}_{k}", joint, stick, pin.SE3(turn, 0.5 * end), colour)
    return visual


def _add(visual: pin.GeometryModel, name: str, joint: int, shape: object, place: pin.SE3, colour: np.ndarray) -> None:
    part = pin.GeometryObject(name, joint, place, shape)
    part.meshColor = colour
    visual.addGeometryObject(part)
