"""Any motion of any robot from a table of text, to be looked at.

| column | unit | |
|---|---|---|
| `time` | s | not falling |
| the configuration | m, rad | as many columns as the model's `q` has entries, in its order, under any names |
| `<frame>.Fx`, `<frame>.Fy`, `<frame>.Fz` | N | optional, per frame all three: a force at the frame, world axes |

Seven columns more than the joints need are the placement of a free base: position, then quaternion with w last.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pinocchio as pin

from aerobat_pin.errors import LogError
from aerobat_pin.numerics import Array
from aerobat_pin.scenario import TextTable
from aerobat_pin.visualization.replay.recording import Recording, record

FORCE = re.compile(r"(?P<frame>.+)\.F(?P<axis>[xyz])")
FREE = 7  # entries of a free base


def recording_of(table: Path, urdf: Path) -> Recording:
    """Record what a table says of a robot.

    Raises:
        LogError: the table or the URDF cannot be read, or they do not fit together.
        FrameNotFoundError: a force at a frame that the model does not have.
        ShapeError: a time that falls.
    """
    names, values = _read(table)
    if "time" not in names:
        raise LogError(f"motion {table}: no column named time; there are {', '.join(names)}")
    forces: dict[str, Array] = {}
    columns = []
    for k, name in enumerate(names):
        if found := FORCE.fullmatch(name):
            force = forces.setdefault(found["frame"], np.full((len(values), 3), np.nan))
            force[:, "xyz".index(found["axis"])] = values[:, k]
        elif name != "time":
            columns.append(k)
    for frame, force in forces.items():
        if np.isnan(force).any():
            raise LogError(f"motion {table}: three columns {frame}.Fx, {frame}.Fy and {frame}.Fz were expected")
    model, visual_model = _model(urdf, len(columns), table)
    q = values[:, columns]
    if model.joints[1].nq == FREE:
        length = np.linalg.norm(q[:, 3:7], axis=1)
        if np.any(np.abs(length - 1.0) > 0.01):
            raise LogError(f"motion {table}: columns 4 to 7 of the configuration are no unit quaternion, w last")
        q[:, 3:7] /= length[:, None]
    return record(model, visual_model, values[:, names.index("time")], q, forces, title=table.stem)


def _model(urdf: Path, columns: int, table: Path) -> tuple[pin.Model, pin.GeometryModel]:
    """Load a robot, on a free base where the table has that many columns."""
    if not urdf.is_file():
        raise LogError(f"robot {urdf}: there is no such file")
    try:
        model = pin.buildModelFromUrdf(str(urdf))
        fixed = model.nq
        if columns == fixed + FREE:
            model = pin.buildModelFromUrdf(str(urdf), pin.JointModelFreeFlyer())
        folders = [str(folder) for folder in urdf.resolve().parents]
        visual_model = pin.buildGeomFromUrdf(model, str(urdf), pin.GeometryType.VISUAL, package_dirs=folders)
    except (ValueError, RuntimeError) as error:
        said = str(error).strip()
        if "could not be found" in said:  # Pinocchio itself looks where the variable points
            said += " In the folders above the URDF, or those of ROS_PACKAGE_PATH, it was expected."
        raise LogError(f"robot {urdf}: Pinocchio cannot read it: {said}") from error
    if columns != model.nq:
        raise LogError(
            f"motion {table}: {columns} columns of configuration; {urdf.name} takes {fixed}, or {fixed + FREE} on a "
            f"free base, in the order {', '.join(list(model.names)[1:])}"
        )
    return model, visual_model


def _read(table: Path) -> tuple[list[str], Array]:
    """Return names without units, and numbers (n, columns)."""
    text = TextTable(table, "motion", LogError)
    numbers = text.numbers()
    if len(numbers) < 2:
        raise LogError(f"motion {table}: a header and two rows or more were expected")
    return text.names, numbers
