"""MJX: the closed linkage has the accelerations that MuJoCo has."""

from __future__ import annotations

import jax
import mujoco
import numpy as np
from mujoco import mjx

import aerobat_description as description


def main() -> None:
    """Print the difference at rest and at the actuator's push, in double precision."""
    jax.config.update("jax_enable_x64", True)
    model = mujoco.MjModel.from_xml_path(description.MJCF_PATH)
    data = mujoco.MjData(model)
    data.ctrl[0] = 30.0
    mujoco.mj_forward(model, data)
    theirs = jax.jit(mjx.forward)(mjx.put_model(model), mjx.put_data(model, data))
    worst = float(np.abs(np.array(theirs.qacc) - data.qacc).max() / np.abs(data.qacc).max())
    assert worst < 1e-6
    print(f"found: MJCF: accelerations with the motor on as MuJoCo's, to {worst:.0e}, in double precision on a CPU")


main()
