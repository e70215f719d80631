"""Replay any motion of any robot: its URDF file, which may come from a stranger, and a CSV file of the motion.

The files that a URDF names end up in a page that is then passed on, so only files of the robot's own packages are
read: the folder of the URDF (the folder above it, if its own is called `urdf`), every folder above it that has a
`package.xml`, packages beside those, and the packages of ROS_PACKAGE_PATH. The Collada files among them name textures,
which must be pictures in the same folders.

The table's columns are `time` [s], the entries of the configuration q in the model's order under any names, and, for a
force at a frame, `<frame>.Fx`, `<frame>.Fy`, `<frame>.Fz` [N], world axes. If it has seven columns more than the joints
need, the base is free. The first seven columns are then its placement: position, then quaternion with w last.
"""

from __future__ import annotations

import re
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import coal
import numpy as np
import pinocchio as pin

from aerobat_pin.errors import LARGEST_TABLE, LogError, foreign_file, foreign_xml
from aerobat_pin.numerics import Array, Packages, checked_robot, read_robot
from aerobat_pin.records import FREE_NQ, LogTable, header_of, read_columns, with_angles
from aerobat_pin.visualization import style
from aerobat_pin.visualization.replay.moving_page import Replay, record

LARGEST_MESH = 100_000_000  # bytes
MESHES = (".dae", ".obj", ".stl")  # what the page can draw; none of them but Collada names other files
PICTURES = (b"\x89PNG", b"\xff\xd8\xff", b"GIF8", b"BM")  # how the content of a texture begins
FORCE_COLUMN = re.compile(r"(?P<frame>.+)\.F(?P<axis>[xyz])")
INDEXED = re.compile(r"\S\[\d+\]$")  # `q[0]` is a name without a unit
PLAYED_UNITS = ("", "m", "rad", "-", "1", "N")
STICK = 0.04  # radius of a stick, in lengths of the robot
LARGEST_MOTION = 1e6  # of any number: no motion goes further, and a page holds single precision


def load_any_robot(
    urdf: Path, columns: int, table: Path, *, angles: bool = False
) -> tuple[pin.Model, pin.GeometryModel]:
    """Load a robot, with a free base if a table that moves it has as many columns as joints and the base's placement.

    A robot that has no visual shapes gets sticks. With `angles` continuous joints have one, as in a record, in place of
    cosine and sine.

    Raises:
        LogError: the file or one that it names cannot be read or lies outside the robot's packages; a number is not
            finite or too large; the robot cannot move, or has another number of joints.
    """
    root = checked_robot(urdf, "urdf")
    packages = Packages(urdf)
    for element in root.iter():
        if element.tag in ("mesh", "texture") and "filename" in element.attrib:
            check = _check_mesh if element.tag == "mesh" else _check_picture
            element.set("filename", str(packages.file(element.attrib["filename"], urdf.parent, check)))
    text = with_angles(root) if angles else ElementTree.tostring(root, encoding="unicode")
    model = read_robot(urdf, lambda: pin.buildModelFromXML(text))
    fixed = model.nq
    if columns == fixed + FREE_NQ:
        model = pin.buildModelFromXML(text, pin.JointModelFreeFlyer())
    if model.nq == 0:
        raise LogError(
            f"robot {urdf}: no joint of it moves; a joint, or the {FREE_NQ} columns of a free base, were expected"
        )
    if columns != model.nq:
        joints = zip(list(model.names)[1:], model.joints.tolist()[1:], strict=True)
        order = [f"{name}{' (cosine and sine)' * ((joint.nq, joint.nv) == (2, 1))}" for name, joint in joints]
        raise LogError(
            f"motion {table}: {columns} columns of configuration; {urdf.name} takes {fixed}, or "
            f"{fixed + FREE_NQ} on a free base, in the order {', '.join(order)}"
        )
    kind = pin.GeometryType.VISUAL
    visual_model = read_robot(urdf, lambda: pin.buildGeomFromUrdfString(model, text, kind))
    for part in visual_model.geometryObjects:
        if hasattr(part.geometry, "vertices") and not np.all(np.isfinite(part.geometry.vertices())):
            raise LogError(f"robot {urdf}: mesh {part.meshPath} holds NaN or infinity")
    return model, visual_model if visual_model.ngeoms else sticks(model)


def _check_mesh(path: Path, packages: Packages) -> None:
    """Raise LogError unless a file is a mesh that a page can draw, and the textures that it names are pictures."""
    if path.suffix.lower() not in MESHES:
        raise LogError(f"{path.suffix or 'no ending'}: one of {', '.join(MESHES)} was expected")
    foreign_file(path, "mesh", LARGEST_MESH)
    if path.suffix.lower() == ".dae":
        for library in foreign_xml(path, "mesh", "COLLADA").iter():
            if library.tag.endswith("library_images"):
                for element in (inner for inner in library.iter() if "init_from" in inner.tag):
                    packages.file(element.text or "", path.parent, _check_picture)


def _check_picture(path: Path, packages: Packages) -> None:
    """Raise LogError unless a file begins as a picture does, whatever its name."""
    with path.open("rb") as file:
        start = file.read(8)
    if not start.startswith(PICTURES):
        raise LogError("a picture (PNG, JPEG, GIF or BMP) was expected")


def replay_table(table: Path, urdf: Path) -> Replay:
    """Prepare the replay of the motion in a CSV file, of the robot in a URDF file.

    Raises:
        LogError: the table or the URDF cannot be read, or they do not fit together.
        FrameNotFoundError: a force acts at a frame that the model does not have.
    """
    names, values = _read_table(table)
    forces: dict[str, Array] = {}
    columns = []
    for k, name in enumerate(names, start=1):
        if match := FORCE_COLUMN.fullmatch(name):
            force = forces.setdefault(match["frame"], np.full((len(values), 3), np.nan))
            force[:, "xyz".index(match["axis"])] = values[:, k]
        else:
            columns.append(k)
    for frame, force in forces.items():
        if np.isnan(force).any():
            raise LogError(f"motion {table}: three columns {frame}.Fx, {frame}.Fy and {frame}.Fz were expected")
    model, visual_model = load_any_robot(urdf, len(columns), table)
    q = values[:, columns]
    if model.joints[1].nq == FREE_NQ:
        length = np.linalg.norm(q[:, 3:7], axis=1)
        if np.any(np.abs(length - 1.0) > 0.01):
            raise LogError(f"motion {table}: columns 4 to 7 of the configuration are no unit quaternion, w last")
        q[:, 3:7] /= length[:, None]
    return record(model, visual_model, values[:, 0], q, forces, title=table.stem)


def _read_table(table: Path) -> tuple[list[str], Array]:
    """Return the names of the columns but for the time, and the values (n, 1 + columns), the time first."""
    foreign_file(table, f"log {table}", LARGEST_TABLE)
    names = []
    for cell in header_of(table)[1]:
        name, _, unit = (cell, "", "") if INDEXED.search(cell) else (part.strip("] ") for part in cell.partition("["))
        if unit not in PLAYED_UNITS and name != "time":
            raise LogError(f"log {table}: column '{name} [{unit}]': {', '.join(PLAYED_UNITS[1:])} was expected")
        names.append(name)
    if "time" not in names:
        raise LogError(f"log {table}: no column named time; there are {', '.join(names)}")
    columns = read_columns(table, LogTable.model_validate({"times": "own", "time": {"column": "time"}}), names)
    names.remove("time")
    numbers = np.column_stack([columns.clocks["table"].time, *(columns.values[name] for name in names)])
    if abs(numbers[0, 0]) > LARGEST_MOTION:  # Unix time
        numbers[:, 0] -= numbers[0, 0]
    wrong = ~(np.abs(numbers) <= LARGEST_MOTION)
    if np.any(wrong):
        row, column = np.argwhere(wrong)[0]
        what = "is empty" if np.isnan(numbers[row, column]) else f"= {numbers[row, column]:g}"
        where = f"log {table}, row {row + 1}: {['time', *names][column]} {what}"
        raise LogError(f"{where}: numbers up to {LARGEST_MOTION:g} were expected")
    return names, numbers


def visible_parts(path: Path | None, model: pin.Model, name: str) -> tuple[pin.Model, pin.GeometryModel]:
    """Return the model with the shapes of its URDF file, if they can be read, else with sticks."""
    if path is not None:
        try:
            return load_any_robot(path, int(model.nq), Path(name), angles=True)
        except LogError:
            pass
    return model, sticks(model)


def sticks(model: pin.Model) -> pin.GeometryModel:
    """Return shapes for a robot without any: a stick from each joint to the next ones and to its frames, and a box.

    The longest arrow that begins in the box must come out of it, so that a body alone gets arms as a drone has them.
    """
    visual, data = pin.GeometryModel(), model.createData()
    pin.framesForwardKinematics(model, data, pin.neutral(model))
    places = [place.translation for place in (*data.oMi, *data.oMf)]
    length = max(float(np.max(np.ptp(places, axis=0))), 0.05)
    for joint in range(1, model.njoints):
        ends = [model.jointPlacements[k].translation for k in range(2, model.njoints) if model.parents[k] == joint]
        for frame in model.frames.tolist():
            end = frame.placement.translation
            if frame.parentJoint == joint and not any(np.allclose(other, end) for other in ends):
                ends.append(end)
        shapes, box = {}, length
        if model.joints[1].nq == model.nq == 7 and not any(np.linalg.norm(end) > 1e-3 * length for end in ends):
            ends, box = [0.35 * length * np.array([x, y, 0.0]) for x in (-1, 1) for y in (-1, 1)], 0.3 * length
        if joint == 1:
            shapes["box"] = coal.Box(0.3 * box, 0.2 * box, 0.08 * box), pin.SE3.Identity()
        for k, end in enumerate(ends):
            size = float(np.linalg.norm(end))
            if size > 1e-3 * length:
                turn = pin.Quaternion.FromTwoVectors(np.array([0.0, 0.0, 1.0]), end / size).matrix()
                shapes[f"stick_{joint}_{k}"] = coal.Cylinder(0.5 * STICK * length, size), pin.SE3(turn, 0.5 * end)
        for name, (shape, place) in shapes.items():
            part = pin.GeometryObject(name, joint, place, shape)
            part.meshColor = np.array([*style.rgb(style.BLUE if joint > 1 else style.GREEN), 1.0])
            visual.addGeometryObject(part)
    return visual
