"""A recorded flight from a table of text: one row a sample, one named column a channel, units in the header.

| column | unit | |
|---|---|---|
| `time` | s | rising |
| `x`, `y`, `z` | m | body COM in world axes, z up |
| `qx`, `qy`, `qz`, `qw` | - | body to world |
| `vx`, `vy`, `vz` | m/s | optional, all or none: velocity of the body COM in body axes |
| `wx`, `wy`, `wz` | rad/s | optional, all or none: gyro, body axes |
| `crank_angle` | rad | absolute t1, unwrapped or not; or instead of it the four joints |
| `crank_rate` | rad/s | optional, beside the angle: of a tachometer, or of the angle once smoothed |
| `left_shoulder`, ... | rad | joint angles; any of them may have `<joint>_rate` [rad/s] beside it |
| `airspeed` | m/s | optional: of the air past the body, along its x axis from ahead |
| `wind_x`, `wind_y`, `wind_z` | m/s | optional: of the air over ground, world axes |
| `crank_torque` | N m | optional: of the motor on the crank |
| `torque_<joint>` | N m | optional, all four or none: of the motor at the joints |
| `thrust_fx` ... `thrust_mz` | N, N m | optional, all six or none: known wrench at the body COM, body axes |

A header cell is a name, or a name with its unit as in `x [m]`. Forces and torques are samples; their interval means are
taken as the mean of both ends. Writing a log, where they are means, a sample is the mean of both its neighbours.
"""

from __future__ import annotations

import difflib
import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import xarray as xr

from aerobat_pin.errors import LogError, OutputError
from aerobat_pin.flight.flight_log import KNOWN, POSE_AXIS, TWIST_AXIS, FlightLog, channel
from aerobat_pin.numerics import Array
from aerobat_pin.robot import JOINTS
from aerobat_pin.scenario import TextTable

POSE = ("x", "y", "z", "qx", "qy", "qz", "qw")
VELOCITY, GYRO = ("vx", "vy", "vz"), ("wx", "wy", "wz")
WIND = ("wind_x", "wind_y", "wind_z")
THRUST = tuple(f"thrust_{name}" for name in ("fx", "fy", "fz", "mx", "my", "mz"))
RATES = tuple(f"{name}_rate" for name in JOINTS)
TORQUE_COLUMNS = tuple(f"torque_{name}" for name in JOINTS)
UNITS = {
    "time": "s",
    **dict.fromkeys(POSE[:3], "m"),
    **dict.fromkeys(POSE[3:], "-"),
    **dict.fromkeys((*VELOCITY, *WIND, "airspeed"), "m/s"),
    **dict.fromkeys((*GYRO, "crank_rate", *RATES), "rad/s"),
    **dict.fromkeys(("crank_angle", *JOINTS), "rad"),
    **dict.fromkeys(("crank_torque", *TORQUE_COLUMNS, *THRUST[3:]), "N m"),
    **dict.fromkeys(THRUST[:3], "N"),
}
THRUSTERS = f"{KNOWN}thrusters"
# Columns, the channels of which one may hold them, and their labels there.
WRITTEN: tuple[tuple[Sequence[str], Sequence[str], Sequence[str] | None], ...] = (
    (POSE, ("q", "pose"), POSE_AXIS),
    ((*VELOCITY, *GYRO), ("v", "twist"), TWIST_AXIS),
    (("crank_angle",), ("crank_angle",), None),
    (("crank_rate",), ("crank_rate",), None),
    (JOINTS, ("q", "joint_angle"), JOINTS),
    (RATES, ("v", "joint_rate"), JOINTS),
    (("airspeed",), ("airspeed",), None),
    (WIND, ("wind_W",), ("x", "y", "z")),
    (("crank_torque",), ("crank_torque",), None),
    (TORQUE_COLUMNS, ("motor_torque", "joint_torque"), JOINTS),
    (THRUST, (THRUSTERS,), TWIST_AXIS),
)
FASTEST_CRANK = 60.0  # [Hz]: a faster one is in degrees
LONGEST_SAMPLE_TIME = 0.5  # [s] between samples: a flap is over in less, so a slower log is in milliseconds
FEWEST_SAMPLES = 3  # rates of a shorter record cannot be told
HEADER_CELL = re.compile(r"\s*(?P<name>[A-Za-z_]\w*)\s*(?:\[(?P<unit>[^\]]*)\])?\s*")


def read_csv(path: str | Path) -> FlightLog:
    """Read a recorded flight.

    Raises:
        LogError: the file cannot be read, or is not a flight; the message names file, column and line.
    """
    text = TextTable(Path(path), "log", LogError)
    columns = _columns(text)
    _check(columns, text)
    time = columns["time"]
    per_sample, per_interval = ("time",), ("interval",)
    coords = {
        "time": channel(time, per_sample, "s", "sample time"),
        "interval": channel(time[:-1], per_interval, "s", "start of the interval"),
        "pose_axis": list(POSE_AXIS),
    }
    pose = _stacked(columns, POSE)
    pose[:, 3:] /= np.linalg.norm(pose[:, 3:], axis=1, keepdims=True)
    made = {"pose": channel(pose, ("time", "pose_axis"), "m, -", "body placement in world: position, quaternion")}
    for names, title, meaning in (
        ((*VELOCITY, *GYRO), "twist", "body twist in body axes"),
        (JOINTS, "joint_angle", "joint angles"),
        (RATES, "joint_rate", "joint rates"),
        (WIND, "wind_W", "velocity of the air over ground, world axes"),
    ):
        if all(name in columns for name in names):
            axis = {"twist": "twist_axis", "wind_W": "axis"}.get(title, "joint")
            labels = {"twist_axis": list(TWIST_AXIS), "axis": ["x", "y", "z"], "joint": list(JOINTS)}
            coords[axis] = labels[axis]
            unit = ", ".join(dict.fromkeys(UNITS[name] for name in names))
            made[title] = channel(_stacked(columns, names), ("time", axis), unit, meaning)
    for name, meaning in (
        ("crank_angle", "absolute crank angle t1"),
        ("crank_rate", "rate of the crank angle"),
        ("airspeed", "airspeed along the body's x axis"),
    ):
        if name in columns:
            values = np.unwrap(columns[name]) if name == "crank_angle" else columns[name]
            made[name] = channel(values, per_sample, UNITS[name], meaning)
    if "crank_torque" in columns:
        made["crank_torque"] = channel(
            _interval_means(columns["crank_torque"]), per_interval, "N m", "motor torque at the crank"
        )
    if all(name in columns for name in TORQUE_COLUMNS):
        coords["joint"] = list(JOINTS)
        made["joint_torque"] = channel(
            _interval_means(_stacked(columns, TORQUE_COLUMNS)),
            ("interval", "joint"),
            "N m",
            "motor torque at the joints",
        )
    if all(name in columns for name in THRUST):
        coords["twist_axis"] = list(TWIST_AXIS)
        made[THRUSTERS] = channel(
            _interval_means(_stacked(columns, THRUST)),
            ("interval", "twist_axis"),
            "N, N m",
            "known wrench at the body COM",
        )
    return FlightLog(xr.Dataset(made, coords=coords, attrs={"scenario": Path(path).stem}))


def write_csv(log: FlightLog, path: str | Path) -> None:
    """Write the measured side of a flight as a table that `read_csv` reads, units in the header.

    Samples come back as they were, to ten digits; forces and torques smoothed over their neighbours, because a table
    has samples where a log has interval means. What a log notes beside its channels, such as its robot, is not written.

    Raises:
        LogError: a known force has no column.
        OutputError: the file cannot be written.
    """
    strange = [str(name) for name in log.measured.data_vars if str(name).startswith(KNOWN) and name != THRUSTERS]
    if strange:
        raise LogError(f"flight log: a table has no column for {', '.join(strange)}: drop the channel first")
    columns = {"time": log.time}
    for names, channels, labels in WRITTEN:
        for values in (log.measured[name] for name in channels if name in log.measured):
            table = values.values[:, None] if labels is None else values.sel({values.dims[1]: list(labels)}).values
            columns |= dict(zip(names, (table if values.dims[0] == "time" else _samples(table)).T, strict=True))
    header = ",".join(f"{name} [{UNITS[name]}]" for name in columns)
    rows = (",".join(f"{value:.10g}" for value in row) for row in np.column_stack(list(columns.values())).tolist())
    try:
        Path(path).write_text("\n".join([header, *rows]) + "\n", encoding="utf-8")
    except OSError as error:
        raise OutputError(f"log {path}: cannot be written: {error.strerror or error}") from error


def _columns(text: TextTable) -> dict[str, Array]:
    """Return the columns by name. Raises LogError for what is not a table of numbers with known names and units."""
    names = [_name(cell, text.path) for cell in text.header]
    twice = {name for name in names if names.count(name) > 1}
    if twice:
        raise LogError(f"log {text.path}: column '{twice.pop()}' is there twice")
    table = text.numbers()
    if len(table) < FEWEST_SAMPLES:
        raise LogError(
            f"log {text.path}: {len(table)} samples: a header and {FEWEST_SAMPLES} rows or more were expected"
        )
    return dict(zip(names, table.T, strict=True))


def _name(cell: str, path: Path) -> str:
    found = HEADER_CELL.fullmatch(cell)
    name = found["name"] if found else cell.strip()
    if name not in UNITS:
        close = difflib.get_close_matches(name, UNITS, n=1)
        hint = f"did you mean '{close[0]}'?" if close else f"known are {', '.join(UNITS)}"
        raise LogError(f"log {path}: unknown column '{name}'; {hint}")
    unit = found["unit"] if found else None
    if unit is not None and unit.strip().replace("·", " ") not in (UNITS[name], UNITS[name].replace(" ", "")):
        raise LogError(f"log {path}: column '{cell.strip()}': {UNITS[name]} was expected")
    return name


def _check(columns: dict[str, Array], text: TextTable) -> None:
    """Raise LogError unless the columns make a flight."""
    path = text.path
    missing = [name for name in ("time", *POSE) if name not in columns]
    if missing:
        raise LogError(f"log {path}: no column named {', '.join(missing)}")
    for group in ((*VELOCITY, *GYRO), JOINTS, RATES, WIND, TORQUE_COLUMNS, THRUST):
        there = [name for name in group if name in columns]
        if there and len(there) < len(group):
            absent = [name for name in group if name not in columns]
            raise LogError(f"log {path}: {', '.join(there)} without {', '.join(absent)}: all of them or none")
    if "crank_rate" in columns and "crank_angle" not in columns:
        raise LogError(f"log {path}: crank_rate without crank_angle: the linkage closes at an angle")
    if "crank_angle" not in columns and JOINTS[0] not in columns:
        raise LogError(f"log {path}: neither crank_angle nor the joints {', '.join(JOINTS)} are there")
    time = columns["time"]
    steps = np.diff(time)
    if np.any(steps <= 0.0):
        row = int(np.argmax(steps <= 0.0)) + 1
        what = "is repeated" if steps[row - 1] == 0.0 else "runs backwards"
        raise LogError(f"log {path}, line {text.line(row)}: time = {time[row]:g} s {what}: rising stamps were expected")
    step = float(np.median(steps))
    if step > LONGEST_SAMPLE_TIME:
        raise LogError(f"log {path}: time rises by {step:g} from row to row: seconds were expected")
    norm = np.linalg.norm(_stacked(columns, POSE[3:]), axis=1)
    if np.any(np.abs(norm - 1.0) > 0.01):
        row = int(np.argmax(np.abs(norm - 1.0) > 0.01))
        raise LogError(f"log {path}, line {text.line(row)}: the quaternion has length {norm[row]:.3g}: 1 was expected")
    if "crank_angle" in columns:
        rate = float(np.median(np.abs(np.diff(columns["crank_angle"]) / steps))) / (2.0 * np.pi)
        if rate > FASTEST_CRANK:
            raise LogError(f"log {path}: crank_angle turns at {rate:.0f} Hz: radians were expected")
    for name in JOINTS:
        if name in columns and np.max(np.abs(columns[name])) > 2.0 * np.pi:
            row = int(np.argmax(np.abs(columns[name])))
            raise LogError(f"log {path}, line {text.line(row)}: {name} = {columns[name][row]:g}: radians were expected")


def _stacked(columns: dict[str, Array], names: Sequence[str]) -> Array:
    return np.column_stack([columns[name] for name in names])


def _interval_means(samples: Array) -> Array:
    return np.asarray(0.5 * (samples[1:] + samples[:-1]))


def _samples(means: Array) -> Array:
    """Return samples (m + 1, c) of interval means (m, c): of both neighbours inside, straight on at the ends."""
    inside = 0.5 * (means[1:] + means[:-1])
    return np.concatenate([2.0 * means[:1] - inside[:1], inside, 2.0 * means[-1:] - inside[-1:]])
