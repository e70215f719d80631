"""viser: the wings move where Pinocchio has them."""

from __future__ import annotations

import json
import sys
import time
from pathlib import Path

import numpy as np
import viser
import yourdfpy
from viser.extras import ViserUrdf

import aerobat_description as description


def matrix(frame) -> np.ndarray:
    """Return the placement of a frame in its parent."""
    w, x, y, z = frame.wxyz
    made = np.eye(4)
    made[:3, :3] = np.eye(3) + 2.0 * np.array(
        [
            [-y * y - z * z, x * y - w * z, x * z + w * y],
            [x * y + w * z, -x * x - z * z, y * z - w * x],
            [x * z - w * y, y * z + w * x, -x * x - y * y],
        ]
    )
    made[:3, 3] = frame.position
    return made


def main() -> None:
    """Print the largest error over the three robots."""
    reference, worst, took = json.loads(Path(sys.argv[1]).read_text()), 0.0, 0.0
    server = viser.ViserServer(port=0, verbose=False)
    for name, said in reference.items():
        tree = yourdfpy.URDF.load(str(Path(description.PACKAGE_PATH, "urdf", f"{name}.urdf")))
        shown = ViserUrdf(server, tree, root_node_name=f"/{name}")
        for state in said["states"]:
            angles, start = dict(zip(said["joints"], state["angles"], strict=True)), time.perf_counter()
            shown.update_cfg(np.array([angles[joint] for joint in shown.get_actuated_joint_names()]))
            took = max(took, time.perf_counter() - start)
            local = {frame.name: matrix(frame) for frame in shown._joint_frames}
            for link, place in state["places"].items():
                path = next(path for path in local if path.endswith(f"/{link}"))
                found, parts = np.eye(4), path.split("/")
                for k in range(2, len(parts) + 1):
                    found = found @ local.get("/".join(parts[:k]), np.eye(4))
                worst = max(worst, float(np.abs(found - place).max()))
    assert worst < 1e-9
    print(f"found: wings and force point where Pinocchio has them, to {worst:.0e}; an update takes {1e3 * took:.0f} ms")


main()
