"""MuJoCo: the closed linkage over ten turns from rest, with the file's own settings, and its speed."""

import time

import mujoco
import numpy as np
from support.closed import MJCF, RATE, fly_in_mujoco, miss

from aerobat_pin import load_aerobat

TURNS = 10


def main() -> None:
    """Print the largest errors over the three robots, and the slowest of them."""
    misses, speed = [], np.inf
    for name, path in MJCF.items():
        model = mujoco.MjModel.from_xml_path(path)
        data, start = mujoco.MjData(model), time.process_time()  # of this process alone: other work does not count
        columns = fly_in_mujoco(model, data, round(2.0 * np.pi * TURNS / RATE / model.opt.timestep)).T
        speed = min(speed, data.time / (time.process_time() - start))
        for side in ("left", "right"):
            angles = (columns[model.joint(f"{side}_{one}").qposadr[0]] for one in ("crank", "shoulder", "elbow"))
            misses.append(miss(load_aerobat(name).linkage, *angles))
    shoulder, elbow = np.max(misses, axis=0)
    assert max(shoulder, elbow) < 2.5e-3
    print(
        f"found: MJCF, ten turns at 4.75 Hz: shoulder within {shoulder:.1e} rad of the closed form, elbow within "
        f"{elbow:.1e}; {speed:.0f} times real time on one core"
    )


main()
