"""MuJoCo: the closed linkage over ten turns from rest, with the file's own settings, and its speed."""

from __future__ import annotations

import json
import sys
import time
from pathlib import Path

import mujoco
import numpy as np

import aerobat_description as description
from aerobat_pin import load_aerobat

RATE = 2.0 * np.pi * 4.75  # [rad/s]


def main() -> None:
    """Print the largest errors over the three robots, and the slowest of them."""
    shoulder, elbow, speed = 0.0, 0.0, np.inf
    for name in json.loads(Path(sys.argv[1]).read_text()):
        model = mujoco.MjModel.from_xml_path(str(Path(description.PACKAGE_PATH, "mjcf", f"{name}.xml")))
        data, linkage, rows = mujoco.MjData(model), load_aerobat(name).linkage, []
        data.ctrl[0] = RATE
        start = time.process_time()  # of this process alone: other work on the machine does not count
        while data.joint("left_crank").qpos[0] < -0.5 * np.pi + 20.0 * np.pi:
            mujoco.mj_step(model, data)
            rows.append(data.qpos.copy())
        speed = min(speed, data.time / (time.process_time() - start))
        columns = np.array(rows).T
        for side in ("left", "right"):
            crank, up, out = (
                columns[model.joint(f"{side}_{joint}").qposadr[0]] for joint in ("crank", "shoulder", "elbow")
            )
            closure = linkage.solve(crank)
            shoulder = max(shoulder, np.abs(up - closure.theta_s).max())
            elbow = max(elbow, np.abs(np.remainder(out - closure.theta_e + np.pi, 2.0 * np.pi) - np.pi).max())
    assert max(shoulder, elbow) < 2.5e-3
    print(
        f"found: MJCF, ten turns at 4.75 Hz: shoulder within {shoulder:.1e} rad of the closed form, elbow within "
        f"{elbow:.1e}; {speed:.0f} times real time on one core"
    )


main()
