"""adam-robotics: the mass matrix of all three robots."""

from __future__ import annotations

import contextlib
import io
import json
import sys
from pathlib import Path

import adam
import numpy as np
from adam.numpy import KinDynComputations

import aerobat_description as description


def main() -> None:
    """Print the largest error over the three robots."""
    reference, worst = json.loads(Path(sys.argv[1]).read_text()), 0.0
    for name, said in reference.items():
        with contextlib.redirect_stderr(io.StringIO()):  # it names each attribute that it does not know
            robot = KinDynComputations(
                str(Path(description.PACKAGE_PATH, "urdf", f"{name}.urdf")), list(said["joints"])
            )
        robot.set_frame_velocity_representation(adam.Representations.BODY_FIXED_REPRESENTATION)
        for state in said["states"]:
            x, y, z, w = state["quaternion"]
            H = np.eye(4)
            H[:3, :3] += 2.0 * np.array(
                [
                    [-y * y - z * z, x * y - w * z, x * z + w * y],
                    [x * y + w * z, -x * x - z * z, y * z - w * x],
                    [x * z - w * y, y * z + w * x, -x * x - y * y],
                ]
            )
            H[:3, 3] = state["position"]
            M = np.array(robot.mass_matrix(H, np.array(state["angles"])))
            worst = max(worst, float(np.abs(M - state["M"]).max() / np.abs(state["M"]).max()))
    assert worst < 1e-9
    print(f"found: mass matrix at 15 states to {worst:.0e}")


main()
