"""PyBullet: mass matrix with a floating base, bias forces with a fixed one, and what it takes without the flag."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np
import pybullet

import aerobat_description as description


def main() -> None:
    """Print the largest errors over the three robots."""
    reference, package = json.loads(Path(sys.argv[1]).read_text()), Path(description.PACKAGE_PATH)
    pybullet.connect(pybullet.DIRECT)
    pybullet.setGravity(0.0, 0.0, -9.81)
    worst, mass = 0.0, 0.0
    for name, said in reference.items():
        file, flag = str(package / "urdf" / f"{name}.urdf"), pybullet.URDF_USE_INERTIA_FROM_FILE
        robot, fixed = (pybullet.loadURDF(file, flags=flag, useFixedBase=held) for held in (False, True))
        names = [pybullet.getJointInfo(robot, i)[1].decode() for i in range(pybullet.getNumJoints(robot))]
        moving = [names.index(joint) for joint in said["joints"]]
        assert moving == sorted(moving)
        total = sum(pybullet.getDynamicsInfo(robot, i)[0] for i in range(-1, len(names)))
        mass = max(mass, abs(total / said["mass"] - 1.0))
        order = [3, 4, 5, 0, 1, 2, 6, 7, 8, 9]  # PyBullet has the base's angular velocity first
        for state in said["states"]:
            for body in (robot, fixed):
                for joint, angle in zip(moving, state["angles"], strict=True):
                    pybullet.resetJointState(body, joint, angle)
            pybullet.resetBasePositionAndOrientation(robot, state["position"], state["quaternion"])
            M = np.array(pybullet.calculateMassMatrix(robot, state["angles"]))
            bias = pybullet.calculateInverseDynamics(fixed, state["angles"], state["velocity"][6:], [0.0] * 4)
            found = [(M, np.array(state["M"])[np.ix_(order, order)]), (np.array(bias), state["bias_fixed_base"])]
            worst = max(worst, *(float(np.abs(a - b).max() / np.abs(b).max()) for a, b in found))
    careless = pybullet.loadURDF(str(package / "urdf" / "aerobat.urdf"))
    taken = pybullet.getDynamicsInfo(careless, -1)[2][0]
    assert worst < 1e-6
    assert mass < 1e-9
    print(
        f"found: mass matrix at 15 states, and bias forces with a fixed base, to {worst:.0e}; without the flag, "
        f"Ixx of the base is {taken:.1e} kg m2"
    )


main()
