"""What robots of tests are made of: links and joints of a URDF, efforts of a motion under a force, columns of a map."""

from collections.abc import Sequence
from typing import Any

import numpy as np
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


def channels(names: Sequence[Any], **columns: str) -> dict[str, Any]:
    """Return channels of a map: each part's columns, by a pattern such as `{}_q` in which the names stand."""
    return {part: {"columns": [pattern.format(name) for name in names]} for part, pattern in columns.items()}


def by_axis(**columns: str) -> dict[str, Any]:
    """Return channels of a base: each part's columns by a pattern such as `v{}` in which the axes stand."""
    axes = {part: "xyzw" if part == "quaternion" else "xyz" for part in columns}
    return {part: {"columns": [columns[part].format(axis) for axis in names]} for part, names in axes.items()}
