"""What friction leaves of an arm's torques, without a map: beside `aerobat estimate`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pinocchio as pin
from scipy.signal import savgol_filter

SMOOTHED, STEP = 11, 0.01  # samples of the parabolas that differentiate; [s] between samples


def arm_residuals(table: Path, urdf: Path, chosen: dict[str, Any], joints: list[str]) -> dict[str, list[list[float]]]:
    """Return rms of the torque [N m] that is left over on the second half: joint -> [without, with friction] twice.

    The table is brought to even times by straight lines between its rows. The first pair is of the means of two
    neighbouring samples, where Coulomb's tanh has a scale of 0.02 rad/s, the second of single samples and 0.01 rad/s.

    Args:
        table: the table that `examples/recordings/tiago.py` writes.
        urdf: the robot.
        chosen: the map as values.
        joints: those to return.
    """
    data = pd.read_csv(table)
    first, last = chosen["use"]["part"]
    time = np.arange(data.t.iloc[0] + first, data.t.iloc[0] + last, STEP)
    names, constants = chosen["joints"]["names"], chosen["joints"]["effort"]["torque_per_unit"]
    q, current = (
        np.column_stack([np.interp(time, data.t, data[f"{name}_{part}"]) for name in names])
        for part in ("position", "effort")
    )
    model = pin.buildModelFromUrdf(str(urdf))
    v, a = (savgol_filter(q, SMOOTHED, 2, deriv=order, delta=STEP, axis=0) for order in (1, 2))
    rows = [model.joints[model.getJointId(name)].idx_v for name in names]
    at = [model.joints[model.getJointId(name)].idx_q for name in names]
    needed, workspace = np.empty(q.shape), model.createData()
    for k in range(len(q)):
        whole, speed, push = pin.neutral(model), np.zeros(model.nv), np.zeros(model.nv)
        whole[at], speed[rows], push[rows] = q[k], v[k], a[k]
        needed[k] = pin.rnea(model, workspace, whole, speed, push)[rows]
    single = current * [constants[name] for name in names] - needed, v, a
    found: dict[str, list[list[float]]] = {joint: [] for joint in joints}
    for series, slow in ((tuple(0.5 * (one[1:] + one[:-1]) for one in single), 0.02), (single, 0.01)):
        for joint in joints:
            torque, rate, push = (one[:, names.index(joint)] for one in series)
            shape, half = np.column_stack([np.tanh(rate / slow), rate, push, np.ones(len(rate))]), len(rate) // 2
            fit = np.linalg.lstsq(shape[:half], torque[:half], rcond=None)[0]
            rest = (torque - shape @ fit)[half:]
            found[joint].append([float(np.sqrt(np.mean(one**2))) for one in (torque[half:], rest)])
    return found
