"""What Pinocchio finds in the robot's files at some states, as JSON for the checks of other tools; see other_tools.py.

Order of all vectors: base (linear, angular, base axes), left shoulder, left elbow, right shoulder, right elbow.
"""

import json
import sys
from pathlib import Path

import numpy as np
import pinocchio as pin
from support.closed import symmetric
from support.readers import in_pinocchio

from aerobat_description import MORPHOLOGIES
from aerobat_pin import load_aerobat
from aerobat_pin.aerobat import JOINTS, closed_model, closed_state

FRAMES = ("left_proximal", "left_distal", "right_proximal", "right_distal", "left_force_point")


def reference(name: str) -> dict:
    """Return mass, five states, and the joint angles over a turn of the crank."""
    model, robot = in_pinocchio(name), load_aerobat(name)
    joints = [model.joints[model.getJointId(joint)] for joint in JOINTS]
    order, rng, states = [*range(6), *(one.idx_v for one in joints)], np.random.default_rng(5), []
    data = model.createData()
    for _ in range(5):
        q, v, angles = pin.neutral(model), rng.standard_normal(model.nv), rng.uniform(-1.5, 0.65, 4)
        q[:3], turn = rng.uniform(-1.0, 1.0, 3), rng.standard_normal(4)
        q[3:7] = turn / np.linalg.norm(turn)
        q[[one.idx_q for one in joints]] = angles
        M, bias = symmetric(pin.crba(model, data, q)), pin.nonLinearEffects(model, data, q, v)[order]
        fixed = q.copy()
        fixed[:7] = pin.neutral(model)[:7]
        pin.framesForwardKinematics(model, data, fixed)
        states.append(
            {
                "angles": angles.tolist(),
                "position": q[:3].tolist(),
                "quaternion": q[3:7].tolist(),
                "velocity": v[order].tolist(),
                "M": M[np.ix_(order, order)].tolist(),
                "bias": bias.tolist(),
                "places": {frame: data.oMf[model.getFrameId(frame)].homogeneous.tolist() for frame in FRAMES},
            }
        )
    turn = robot.linkage.solve(np.radians(np.arange(0.0, 360.0, 0.5)))
    return {
        "mass": robot.mass,
        "joints": JOINTS,
        "states": states,
        "turn": np.column_stack([turn.theta_s, turn.theta_e]).tolist(),
        "closed": closed(name, robot.linkage),
    }


def closed(name: str, linkage: object) -> dict:
    """Return joint angles, masses and places of the bodies of the closed robot, and the points that close it."""
    model, constraints = closed_model(name)
    q = closed_state(model, linkage, 0.7)[0]
    data = model.createData()
    pin.framesForwardKinematics(model, data, q)
    bodies = [frame for frame in model.frames if frame.type == pin.FrameType.BODY and frame.name != "universe"]
    names = list(model.names)

    def of_joint(joint: int) -> str:
        return next(frame.name for frame in bodies if frame.parentJoint == joint)

    return {
        "angles": {joint: q[model.joints[model.getJointId(joint)].idx_q] for joint in names[2:]},
        "masses": {frame.name: model.inertias[frame.parentJoint].mass for frame in bodies},
        "places": {frame.name: data.oMf[model.getFrameId(frame.name)].homogeneous.tolist() for frame in bodies},
        "closing": [
            [
                of_joint(one.joint1_id),
                one.joint1_placement.translation.tolist(),
                of_joint(one.joint2_id),
                one.joint2_placement.translation.tolist(),
            ]
            for one in constraints
        ],
    }


if __name__ == "__main__":
    Path(sys.argv[1]).write_text(json.dumps({name: reference(name) for name in MORPHOLOGIES}))
