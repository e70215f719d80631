"""Suggest which columns of a table are the attitude of the base: numbered quaternions, or roll, pitch and yaw."""

from __future__ import annotations

import re
from collections.abc import Iterator

import numpy as np

from aerobat_pin.records.columns import Columns
from aerobat_pin.records.joint_columns import MEASURED_WORDS, named_unit, words_of_name
from aerobat_pin.records.suggest_joints import listed

UNIT_ERROR = 1e-3  # of a quaternion's length, as it is written
FULL_TURN = 7.0  # beyond any angle of an attitude in rad
RPY = ("roll", "pitch", "yaw")
OF_BASE = {"attitude", "att", "orientation", "euler", "rpy", "angle", "angles", "base", "body", "pose", "imu", "odom"}
OF_BASE |= {"mocap", "vicon", "vision", "optitrack", *MEASURED_WORDS}  # else a joint of that name, or its command


def attitudes(columns: Columns) -> Iterator[tuple[str, ...]]:
    """Yield columns that may be the attitude, the likeliest last: roll, pitch and yaw, four that are numbered."""
    found: dict[tuple[str, ...], dict[str, str]] = {}
    for name in columns.names:
        words = [word for word in words_of_name(name) if word not in {"deg", "rad"}]
        if words and words[-1] in RPY and {*words[:-1]} <= OF_BASE:
            found.setdefault(tuple(words[:-1]), {})[words[-1]] = name
    yield from (tuple(axes[axis] for axis in RPY) for axes in found.values() if len(axes) == len(RPY))
    yield from (names for names in _numbered_by_four(columns) if _is_attitude(columns, names))


def line_of_attitude(columns: Columns, names: tuple[str, ...]) -> str:
    """Return the line of a map about a quaternion, or about roll, pitch and yaw."""
    if len(names) == 3:
        largest = max(float(np.nanmax(np.abs(columns.sample(name)))) for name in names)
        unit = named_unit("angle", names) or ("deg" if largest > FULL_TURN else "rad")
        asked = "about x, then y, then z? With z up pitch is nose down"
        return f'quaternion = {{columns = {listed(names)}, unit = "{unit}"}}  # {asked}; the largest is {largest:.3g}'
    means = [float(np.abs(columns.sample(name)).mean()) for name in names]
    numbered = names in [*_numbered_by_four(columns)]
    order = "wxyz" if numbered and means[0] > means[3] else "xyzw"
    asked = f"  # or {'xyzw' if order == 'wxyz' else 'wxyz'}?" if numbered else ""
    return f'quaternion = {{columns = {listed(names)}, order = "{order}", sense = "body_to_world"}}{asked}'


def _numbered_by_four(columns: Columns) -> Iterator[tuple[str, ...]]:
    """Yield four columns each that are numbered, as q[0] to q[3]."""
    groups: dict[str, list[str]] = {}
    for name in columns.names:
        groups.setdefault(re.sub(r"[\[_ .]?\d\]?$", "", name), []).append(name)
    yield from (tuple(names) for names in groups.values() if len(names) == 4)


def _is_attitude(columns: Columns, names: tuple[str, ...]) -> bool:
    """Return whether four columns are unit quaternions that turn."""
    values = np.column_stack([columns.sample(name) for name in names])
    return bool(np.allclose(np.linalg.norm(values, axis=1), 1.0, atol=UNIT_ERROR) and np.ptp(values, axis=0).any())
