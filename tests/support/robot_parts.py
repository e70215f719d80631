"""What robots of tests are made of: links and joints of a URDF, efforts of a motion under a force, columns of a map."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pinocchio as pin

ALIGNED = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED


def link(name: str, mass: float = 0.0, centre: str = "0 0 0", moments: Sequence[float] = (0.0, 0.0, 0.0)) -> str:
    """Return a link of a URDF: mass [kg], its centre [m] and moments of inertia about it [kg m2]; or a bare frame."""
    if not mass:
        return f'<link name="{name}"/>'
    x, y, z = moments
    inertia = f'<inertia ixx="{x}" ixy="0" ixz="0" iyy="{y}" iyz="0" izz="{z}"/>'
    return f'<link name="{name}"><inertial><origin xyz="{centre}"/><mass value="{mass}"/>{inertia}</inertial></link>'


def joint(
    name: str, kind: str, parent: str, child: str, at: str = "0 0 0", axis: str = "0 1 0", limit: float = 99.0
) -> str:
    """Return a joint of a URDF at a place in its parent [m]; its positions end at both sides of 0 alike [rad, m]."""
    ends = f'<parent link="{parent}"/><child link="{child}"/><origin xyz="{at}"/>'
    turn = f'<axis xyz="{axis}"/><limit lower="-{limit:g}" upper="{limit:g}" effort="999" velocity="99"/>'
    return f'<joint name="{name}" type="{kind}">{ends}{"" if kind == "fixed" else turn}</joint>'


def efforts(model: pin.Model, frame: str, q: np.ndarray, v: np.ndarray, a: np.ndarray, force: np.ndarray) -> np.ndarray:
    """Return generalised forces (n, nv) of a motion under world forces (n, 3) or wrenches (n, 6) at a frame."""
    data, at, found = model.createData(), model.getFrameId(frame), np.empty_like(v)
    for k, push in enumerate(force):
        J = pin.computeFrameJacobian(model, data, q[k], at, ALIGNED)[: len(push)]
        found[k] = pin.rnea(model, data, q[k], v[k], a[k]) - J.T @ push
    return found


def sines(time: np.ndarray, size: Any, pace: Any, phase: Any, middle: Any = 0.0) -> tuple[np.ndarray, ...]:
    """Return positions, rates and accelerations (m, n) at times (m,): about a middle, sums of k sines (k, n) or one."""
    size, pace, phase = (np.atleast_2d(one)[:, None] for one in (size, pace, phase))
    angle = pace * time[:, None] + phase
    q, a = np.sum(size * np.sin(angle), axis=0), np.sum(-size * pace**2 * np.sin(angle), axis=0)
    return middle + q, np.sum(size * pace * np.cos(angle), axis=0), a


def joint_table(time: np.ndarray, names: Sequence[str], **parts: np.ndarray) -> pd.DataFrame:
    """Return a table of joints, whose columns are called `{joint}_{part}`: q, v and tau are those of `joint_map`."""
    columns = {f"{name}_{part}": values[:, k] for part, values in parts.items() for k, name in enumerate(names)}
    return pd.DataFrame({"t": time, **columns})


def joint_map(robot: str | Path, points: list[str], names: Sequence[str], **tables: Any) -> dict[str, Any]:
    """Return the map of such a table, with further tables: of a robot on the ground by its name, or by its URDF."""
    joints = {"names": list(names), **channels(names, position="{}_q", velocity="{}_v", effort="{}_tau")}
    table = {"name" if isinstance(robot, str) else "urdf": str(robot), "root": "fixed", "points": points}
    return {"robot": table, "log": {"time": {"column": "t"}}, "joints": joints, **tables}


def free_map(robot: str | Path, points: list[str], names: Sequence[str], **tables: Any) -> dict[str, Any]:
    """Return the map of such a table of a robot whose base moves, with further tables: x, qx, vx in the world, wx."""
    values = joint_map(robot, points, names, **tables)
    values["robot"]["root"] = "free_flyer"
    return values | {"base": by_axis(position="{}", quaternion="q{}", velocity="v{}", rate="w{}")}


def channels(names: Sequence[Any], **columns: str) -> dict[str, Any]:
    """Return channels of a map: each part's columns, by a pattern such as `{}_q` in which the names stand."""
    return {part: {"columns": [pattern.format(name) for name in names]} for part, pattern in columns.items()}


def by_axis(**columns: str) -> dict[str, Any]:
    """Return channels of a base: each part's columns by a pattern such as `v{}` in which the axes stand."""
    axes = {part: "xyzw" if part == "quaternion" else "xyz" for part in columns}
    return {part: {"columns": [columns[part].format(axis) for axis in names]} for part, names in axes.items()}
