"""Replay any motion of any robot from a CSV file.

Its columns are `time` [s], the entries of the configuration q in the model's order under any names, and, for a force at
a frame, `<frame>.Fx`, `<frame>.Fy`, `<frame>.Fz` [N], world axes. If the table has seven columns more than the joints
need, the base is free. The first seven columns are then its placement: position, then quaternion with w last.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from aerobat_pin.errors import LogError
from aerobat_pin.numerics import Array
from aerobat_pin.scenario import TextTable
from aerobat_pin.visualization.replay.any_robot import FREE_BASE, load_any_robot
from aerobat_pin.visualization.replay.recording import Recording, record

FORCE_COLUMN = re.compile(r"(?P<frame>.+)\.F(?P<axis>[xyz])")
LARGEST_MOTION = 1e6  # of any number: no motion goes further, and a page holds single precision


def replay_table(table: Path, urdf: Path) -> Recording:
    """Prepare the replay of the motion in a CSV file.

    Args:
        table: the CSV file.
        urdf: the robot.

    Raises:
        LogError: the table or the URDF cannot be read, or they do not fit together.
        FrameNotFoundError: a force acts at a frame that the model does not have.
        ShapeError: the time decreases.
    """
    names, values = _read_table(table)
    if "time" not in names:
        raise LogError(f"motion {table}: no column named time; there are {', '.join(names)}")
    forces: dict[str, Array] = {}
    columns = []
    for k, name in enumerate(names):
        if found := FORCE_COLUMN.fullmatch(name):
            force = forces.setdefault(found["frame"], np.full((len(values), 3), np.nan))
            force[:, "xyz".index(found["axis"])] = values[:, k]
        elif name != "time":
            columns.append(k)
    for frame, force in forces.items():
        if np.isnan(force).any():
            raise LogError(f"motion {table}: three columns {frame}.Fx, {frame}.Fy and {frame}.Fz were expected")
    model, visual_model = load_any_robot(urdf, len(columns), table)
    q = values[:, columns]
    if model.joints[1].nq == FREE_BASE:
        length = np.linalg.norm(q[:, 3:7], axis=1)
        if np.any(np.abs(length - 1.0) > 0.01):
            raise LogError(f"motion {table}: columns 4 to 7 of the configuration are no unit quaternion, w last")
        q[:, 3:7] /= length[:, None]
    return record(model, visual_model, values[:, names.index("time")], q, forces, title=table.stem)


def _read_table(table: Path) -> tuple[list[str], Array]:
    """Return the names of the columns without units, and the values (n, columns)."""
    text = TextTable(table, "motion", LogError)
    if len(set(text.names)) < len(text.names):
        twice = next(name for name in text.names if text.names.count(name) > 1)
        raise LogError(f"motion {table}: two columns are named {twice}")
    numbers = text.numbers()
    if np.any(np.abs(numbers) > LARGEST_MOTION):
        row, column = np.argwhere(np.abs(numbers) > LARGEST_MOTION)[0]
        where = f"line {text.line(int(row))}: {text.names[column]} = {numbers[row, column]:g}"
        raise LogError(f"motion {table}, {where}: numbers up to {LARGEST_MOTION:g} were expected")
    if len(numbers) < 2:
        raise LogError(f"motion {table}: a header and two rows or more were expected")
    return text.names, numbers
