"""Suggest a map for a log: what its names and numbers look like, and questions where they do not say."""

from __future__ import annotations

import itertools
import json
import os
import re
import shlex
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio as pin

from aerobat_pin.errors import LogError
from aerobat_pin.numerics import Array, guarded
from aerobat_pin.observers import has_free_base
from aerobat_pin.records.columns import Columns
from aerobat_pin.records.csv_columns import SECONDS, header_of
from aerobat_pin.records.joint_columns import WANTED_WORDS, humps_apart, joint_columns, measured_first, named_unit
from aerobat_pin.records.map_tables import LogTable, TimeSection
from aerobat_pin.records.read import BAGS, NETCDF, read_columns
from aerobat_pin.records.robot_files import model_of_file, option_of_robot, robot_of_map, urdf_of
from aerobat_pin.records.robot_tables import RobotTable
from aerobat_pin.records.robots import PlainRobot
from aerobat_pin.records.spool import typical_spacing
from aerobat_pin.records.suggest_base import ROTOR_WORDS, attitudes, line_of_attitude, numbered_imu, suggest_rotors
from aerobat_pin.records.suggest_joints import followers, joint_topic, listed, suggest_joints, toml_text, topics_of

TIME = re.compile(
    r"^_*(((t|time|stamp|epoch|unix|elapsed|duration|seconds)[ _]*)+|(?=[mun]s$))"
    r"[(\[]?(s|sec|ms|us|ns)?[)\]]?$",
    re.IGNORECASE,
)
M_ROWS = ("base.Mx", "base.My", "base.Mz")
GAIN, SHARE_OF_RATE = 200.0, 0.2  # K [1/s] that is suggested, or so much of a slow log's rate
FIRST_ROWS = 1000  # of a table, that tell what looks like its time
STEMS = [  # as in vel_x_world, and velocity_x: what is read of a name counts where all its axes are there
    re.compile(rf"^(?P<stem>.*?)[._ ]?(?P<axis>[xyzw])(?P<tail>{tail})$", re.IGNORECASE) for tail in ("_[a-z0-9]*", "")
]
TOOL_WORDS = {"tool", "tcp", "ee", "eef", "hand", "gripper", "flange", *WANTED_WORDS}  # of poses that are no base's
WORLD_BEHIND = {"p", "pos", "position", "translation", "v", "vel", "velocity", "a", "acc", "f", "force", "wrench"}
UNIT_BEHIND = re.compile(r"\s*(\[.*\]|\(.*\))$")  # as in nav.x [m]
GROUP_WORDS = {  # what a group of columns may be -> words in its name
    "acceleration": ("a", "acc", "specific", "linear_acceleration"),
    "rate": ("gyro", "gyr", "omega", "angular", "ang_vel", "angvel", "rate", "w"),
    "quaternion": ("q", "quat", "orientation", "attitude"),
    "velocity": ("v", "vel", "velocity", "linear"),
    "position": ("p", "pos", "position", "translation", "mocap", "vicon", "optitrack", "base", "xyz", ""),
    "force": ("f", "force", "wrench", "thrust"),
}


@guarded()
def suggested_map(log: Path, robot: Path | str | None, points: Sequence[str] = ()) -> str:
    """Return a map for a log as text, with questions as comments.

    Args:
        log: the log.
        robot: its URDF file, or its name; None if it is unknown.
        points: frames where something may push; ends of limbs are suggested when empty.

    Raises:
        LogError: log or robot cannot be read.
    """
    known = None
    if robot is not None:
        known = RobotTable.model_validate({**option_of_robot(str(robot)), "points": tuple(points)})
    built = None if known is None else robot_of_map(known, Path())
    columns, timed = _all_columns(log)
    groups = dict(_column_groups(columns))
    lines = [
        f"# A map for {log.name}: what it looks like. Answer the questions, then",
        f"#   aerobat estimate {shlex.quote(str(log))} --map map.toml",
        *(f"# {note}" for note in columns.notes),
        "",
    ]
    free = "position" in groups or bool(_pose_topics(columns)) or (built is not None and not built.joints)
    lines += _robot(columns, known, free)
    if built is not None and (following := followers(columns, built)):
        lines.append(f"rows = {{ignore = {listed(following)}}}  # they follow other joints, whose motors move them")
    elif built is None or not built.joints:
        lines.append(f"rows = {{ignore = {listed(M_ROWS)}}}  # are all moments on the body known? Then leave this out")
    lines += ["", "[log]"]
    spacing = _spacing_of_lead(columns)
    if not columns.kinds and not str(log).lower().endswith(NETCDF):
        line, spacing = _suggested_time(log, columns, timed, _lead(columns, built, groups.get("position", ())))
        lines.append(line)
    lines += ['world = "z_up"  # or "ned": does z point down?', ""]
    lines += [*_suggest_base(columns, groups), *suggest_joints(columns, built, spacing)]
    if check := list(_suggest_check(columns, groups)):
        lines += ["[check]", *check, ""]
    if free and not columns.kinds:
        lines += suggest_rotors(columns, built and built.model, groups.get("rotors", ()), "\n".join(lines))
    gain = min(GAIN, SHARE_OF_RATE / spacing) if spacing else GAIN
    gain_line = f"gain = {float(f'{gain:.2g}'):g}  # K [1/s]: 1/K is the lag; smaller is smoother"
    lines += ["[observer]", 'names = ["force_level"]', gain_line, ""]
    text = "\n".join(lines)
    unused = [name for name in columns.names if not columns.kinds and toml_text(name) not in text]
    return text + (f"# Columns that are not used here: {', '.join(unused)}\n" if unused else "")


def _all_columns(log: Path) -> tuple[Columns, bool]:
    """Read all columns that have numbers; where a table's time is not found, which is said, as if there were none."""
    timed = True
    try:
        columns = read_columns(log, LogTable())
    except LogError:
        if os.path.isdir(log) or log.suffix.lower() in (*BAGS, *NETCDF):
            raise
        columns, timed = read_columns(log, LogTable(time=TimeSection(rate=1.0))), False
    empty = {name for name in columns.values if not np.isfinite(columns.sample(name)).any()}
    values = {name: series for name, series in columns.values.items() if name not in empty}
    if not values and not columns.kinds:
        below = "; is there a line of units below the names? They stand behind these, as 'x [m]'"
        raise LogError(f"log {log}: no column holds numbers alone{below}")
    return replace(columns, names=tuple(name for name in columns.names if name not in empty), values=values), timed


def _column_groups(columns: Columns) -> Iterator[tuple[str, tuple[str, ...]]]:
    """Yield kind -> columns of each group of x, y, z (and w) that belongs together, for tables."""
    if columns.kinds:
        return
    axes_of: dict[tuple[str, str], dict[str, str]] = {}
    for name in columns.names:
        for match in filter(None, (stem.match(humps_apart(UNIT_BEHIND.sub("", name))) for stem in STEMS)):
            key = match["stem"].lower(), match["tail"].lower()
            axes_of.setdefault(key, {})[match["axis"].lower()] = name
    taken, turns, numbers = set[str](), "", itertools.count(2)  # of force sensors
    for (stem, tail), axes in sorted(axes_of.items(), key=lambda item: not re.search("imu|gyro", item[0][0])):
        of_tool = TOOL_WORDS & {*re.split(r"[ _.]", stem + tail)}
        for kind in GROUP_WORDS:
            needed = "xyzw" if kind == "quaternion" else "xyz"
            if (of_tool and kind != "force") or not {*needed} <= {*axes} or not _is_called(stem, kind):
                continue
            names = tuple(axes[axis] for axis in needed)
            if kind == "force" and {*re.split(r"[ _.]", stem)} & ROTOR_WORDS:
                yield "rotors", names
            elif kind not in taken and (kind == "quaternion" or "w" not in axes or tail):
                taken.add(kind)
                turns = stem if kind == "quaternion" else turns
                yield kind, names
            elif kind == "force":
                yield f"force {next(numbers)}", names
            else:
                continue
            break
    if "position" not in taken:  # odom_x beside odom_qx, unless it is a tool's
        for (stem, _), axes in axes_of.items():
            beside = stem and turns.startswith(stem) and not TOOL_WORDS & set(re.split(r"[_ .]", stem))
            if beside and set(axes) == set("xyz"):
                yield "position", tuple(axes[axis] for axis in "xyz")
                break
    yield from ((kind, names) for kind, names in numbered_imu(columns) if kind not in taken)
    if "quaternion" not in taken:
        yield from (("quaternion", names) for names in attitudes(columns))


def _is_called(stem: str, kind: str) -> bool:
    """Return whether a group's name says what it is, by its last word, or a longer one in it; a force by its first."""
    words, parts = GROUP_WORDS[kind], re.split(r"[ _.]", stem.rstrip("_ ."))
    last = parts[-2] if parts[-1] == "w" and {*parts[-2:-1]} & WORLD_BEHIND else parts[-1]
    first = re.split(r"[ _.]", stem)[0] if kind == "force" else last  # as in F_ext_x
    return bool({first, last} & {*words}) or (len(last) > 2 and any(len(word) > 2 and word in stem for word in words))


def _robot(columns: Columns, known: RobotTable | None, free: bool) -> list[str]:
    if known is None:
        return [
            "[robot]",
            "# MISSING: which robot? A file, or a name (--urdf FILE, or NAME, with --suggest):",
            '#   urdf = "robot.urdf"  (or mjcf = ..., or name = "ur5")',
            "# or one rigid body by its numbers, kg and kg m2:",
            "#   body = {mass = ..., inertia = [..., ..., ...]}",
            'points = ["body"]  # where may something push?',
        ]
    path = urdf_of(known, Path()) or Path(known.mjcf or "")
    model = model_of_file(path, mjcf=known.mjcf is not None, free=free)
    floats = has_free_base(model)
    moved = {model.getJointId(name) for name in joint_columns(columns, model.names.tolist()[1:])} or {model.njoints - 1}
    leaves = sorted(moved - {int(model.parents[joint]) for joint in moved})
    bodies = [frame for frame in model.frames.tolist()[1:] if frame.type == pin.FrameType.BODY]
    ends = known.points or [[frame.name for frame in bodies if frame.parentJoint == joint][-1] for joint in leaves]
    frames = ", ".join(frame.name for frame in model.frames.tolist()[1:][:60])
    return [
        "[robot]",
        # a file's whole path, as the map may be in another folder
        *(
            f"{key} = {json.dumps(value, ensure_ascii=False)}"
            for key, value in known.model_dump(include={"name", "urdf", "mjcf"}, exclude_none=True).items()
        ),
        f'root = "{"free_flyer" if floats else "fixed"}"  # does its base move?',
        *["# MISSING: [base]. By its file it floats: its pose, or held = true if it stands still"] * (floats > free),
        f"points = {listed(ends)}  # where may something push? Its frames: {frames}",
    ]


def _lead(columns: Columns, robot: PlainRobot | None, places: Sequence[str]) -> Array:
    """Return which of a table's first rows have samples at whose times it is estimated: of joints, else of `places`."""
    parts = joint_columns(columns, [] if robot is None else list(robot.joints)).values()
    names = [*(part["position"] for part in parts if "position" in part), *places, *columns.values]
    return np.isfinite(columns.values[names[0]][:FIRST_ROWS]) if names else np.ones(FIRST_ROWS, bool)


def _suggested_time(log: Path, columns: Columns, timed: bool, lead: Array) -> tuple[str, float | None]:
    """Return the line about a table's time, if a column looks like one, and the step [s] of rows `lead`."""
    named = measured_first(name for name in columns.values if "time" in name.lower())
    rising = (name for name in [*named, *columns.values] if _is_evenly_rising(columns.values[name][:FIRST_ROWS]))
    name = next((match[0] for match in map(TIME.match, header_of(log)[1]) if match), next(rising, None))
    asked = "no column looks like a time"
    if name is not None and name not in columns.values and not timed:
        asked = f"{name} holds no numbers, nor dates as ISO 8601 writes them (2026-11-03T12:00:00.002)"
    elif name is not None:
        series = columns.values.get(name, columns.clocks["table"].time)[:FIRST_ROWS]
        series = series[lead] if np.sum(lead) > 1 else series
        step = float(np.median(np.diff(series))) if len(series) > 1 else 0.0
        if step:
            guess = next((unit for unit, factor in SECONDS.items() if 1e-5 < step * factor < 0.5), "s")
            unit = named_unit("time", [name]) or guess
            line = f'time = {{column = {toml_text(name)}, unit = "{unit}"}}  # steps of {step:.4g}: is the unit right?'
            return line, step * SECONDS[unit]
        asked = f"{name} repeats from row to row (add the parts of a second to it, if another column has them)"
    asked += ': how many samples a second, time = {rate = 1000}? Or time = {column = ..., unit = "s"}'
    return f"# MISSING: {asked}", None


def _is_evenly_rising(series: Array) -> bool:
    """Return whether samples rise as a clock does, row by row about as far, and do not count the rows."""
    steps = np.diff(series)
    middle = float(np.median(steps)) if len(steps) else 0.0
    return middle not in (0.0, 1.0) and bool(np.all(steps > 0.0) and np.mean(np.abs(steps / middle - 1.0)) < 0.5)


def _spacing_of_lead(columns: Columns) -> float | None:
    """Return the step [s] of the topic at whose stamps a bag is estimated, of a file its own; None if it has none."""
    lead = joint_topic(columns) or next(iter(_pose_topics(columns)), None)
    clock = columns.clocks.get(lead or next(iter(columns.clocks), ""))
    return typical_spacing(clock.time) if clock is not None and len(clock.time) > 1 else None


def _pose_topics(columns: Columns) -> list[str]:
    """Return the topics that may tell where the base is."""
    return topics_of(columns, "Pose", "Odometry", "Transform", without=TOOL_WORDS)


def _or(topics: Sequence[str]) -> str:
    """Return the question whether another topic than the first is meant."""
    return f" Or {', '.join(topics[1:])}?" if topics[1:] else ""


def _suggest_base(columns: Columns, groups: dict[str, tuple[str, ...]]) -> Iterator[str]:
    poses, imus = _pose_topics(columns), topics_of(columns, "Imu")
    imu = imus[0] if imus else None
    if poses:
        yield "[base]"
        yield f'topic = "{poses[0]}"  # the pose of the base link, or of markers on it?{_or(poses)}'
        if imu:
            yield f'rate = {{topic = "{imu}"}}  # are its axes those of the base link?{_or(imus)}'
        yield ""
    elif "position" in groups:
        yield "[base]"
        unit = named_unit("length", groups["position"]) or "m"
        yield f'position = {{columns = {listed(groups["position"])}, unit = "{unit}"}}'
        if "quaternion" in groups:
            yield line_of_attitude(columns, groups["quaternion"])
        else:
            yield "# quaternion = {columns = [...]}  # which columns are the attitude?"
        if "velocity" in groups:
            names = listed(groups["velocity"])
            axes, other = ("body", "world") if "body" in names.lower() else ("world", "body")
            unit = named_unit("speed", groups["velocity"]) or "m/s"
            yield f'velocity = {{columns = {names}, unit = "{unit}", axes = "{axes}"}}  # or axes = "{other}"?'
        else:
            yield 'velocity = {from = "pose", window = 0.05}'
        if "rate" in groups:
            yield _rate(columns, groups["rate"])
        else:
            yield 'rate = {from = "pose", window = 0.05}'
        yield ""
    elif imu or {"quaternion", "rate"} <= {*groups}:
        felt = groups.get("acceleration")
        yield '# Does the base move, with this IMU on it? Then root = "free_flyer" above, and'
        yield "# [base]"
        yield f'# from = "{"imu" if imu or felt else "joints"}"'
        if imu:
            yield f'# topic = "{imu}"'
        else:
            yield f"# {line_of_attitude(columns, groups['quaternion'])}"
            yield f"# {_rate(columns, groups['rate'])}"
        if felt:
            yield f"# acceleration = {_felt(columns, felt)}"
        yield ""


def _rate(columns: Columns, names: tuple[str, ...]) -> str:
    size = float(np.nanstd(np.stack([columns.sample(name) for name in names])))
    unit = named_unit("rate", names) or ("deg/s" if size > 8.0 else "rad/s")
    return f'rate = {{columns = {listed(names)}, unit = "{unit}", axes = "body"}}  # its scatter is {size:.3g}'


def _felt(columns: Columns, names: tuple[str, ...]) -> str:
    felt = np.stack([columns.sample(name) for name in names])
    size = float(np.nanmedian(np.linalg.norm(felt, axis=0)))
    unit = named_unit("acceleration", names) or ("g" if 0.5 < size < 2.0 else "m/s2")
    return f'{{columns = {listed(names)}, unit = "{unit}"}}  # its median is {size:.3g}'


def _suggest_check(columns: Columns, groups: dict[str, tuple[str, ...]]) -> Iterator[str]:
    wrenches, imus = topics_of(columns, "Wrench"), topics_of(columns, "Imu")
    if imus:
        yield f'specific_force = {{topic = "{imus[0]}"}}'
    elif "acceleration" in groups:
        yield f"specific_force = {_felt(columns, groups['acceleration'])}"
    asked = 'force on the robot (1) or on the sensor (-1)? In its own axes: axes = "frame".'
    if wrenches:
        yield f'wrench = {{topic = "{wrenches[0]}", sign = 1}}  # {asked} At which point?{_or(wrenches)}'
    elif "force" in groups:
        unit = named_unit("load", groups["force"]) or "N"
        yield f'wrench = {{columns = {listed(groups["force"])}, unit = "{unit}", sign = 1}}  # {asked} At which point?'
        others = [name for kind, names in groups.items() if kind.startswith("force ") for name in names]
        if others:
            yield f"# And {', '.join(others)}? A sensor can also be a known input, 3 or 6 columns at its frame:"
            yield '# [known.NAME] with columns = [...], frame = "...", axes = "frame"; then its force is not sought'
