"""Recorded flights as text tables: one row per sample, one named column per quantity, units in the header.

The page docs/recorded.md lists the columns; a table of raw samples has other ones, and empty cells: see `raw_csv`.

A header cell is a column name, optionally with its unit as in `x [m]`. A table holds forces and torques as samples, a
log holds them as interval means: reading averages the samples at both ends of an interval, and writing averages the
intervals on both sides of a sample.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from aerobat_pin.aerobat.channels import (
    FASTEST_CRANK,
    KNOWN,
    LABELS,
    MEASURED,
    QUATERNION_ERROR,
    THRUST_CHANNEL,
    THRUSTERS,
    Channel,
    channel,
    did_you_mean,
    filled,
    is_unit,
)
from aerobat_pin.aerobat.flight_log import FlightLog
from aerobat_pin.aerobat.raw_csv import (
    ACCELEROMETER,
    POSITION,
    QUATERNION,
    RAW_UNITS,
    THRUST,
    is_raw,
    raw_log,
    raw_table,
    samples_of,
)
from aerobat_pin.errors import LogError, OutputError
from aerobat_pin.numerics import Array, guarded
from aerobat_pin.robot import JOINTS
from aerobat_pin.scenario import TextTable

LONGEST_SAMPLE_TIME = 0.5  # [s]: a flap is shorter, so if samples seem further apart, the time is in milliseconds
FEWEST_SAMPLES = 3  # fewer samples do not give rates
HEADER_CELL = re.compile(r"\s*(?P<name>[A-Za-z_]\w*)\s*(?:\[(?P<unit>[^\]]*)\])?\s*")


@dataclass(frozen=True)
class ColumnGroup:
    """Columns of which a table has all or none, and the log channel that they form.

    Attributes:
        channels: names of the log channels that can contain these columns; reading creates the last one.
        columns: column names by unit.
    """

    channels: tuple[str, ...]
    columns: dict[str, list[str]]

    @cached_property
    def units(self) -> dict[str, str]:
        """Unit of each column, by column name."""
        return {name: unit for unit, names in self.columns.items() for name in names}

    @property
    def row(self) -> Channel:
        """The channel that reading creates."""
        return THRUST_CHANNEL if self.channels[-1] == THRUSTERS else MEASURED[self.channels[-1]]

    @property
    def labels(self) -> tuple[str, ...]:
        """Names of the columns along the channel's second dimension."""
        return LABELS[self.row.dims[1]] if len(self.row.dims) > 1 else ()

    @property
    def means(self) -> bool:
        """Whether the channel has interval means instead of samples."""
        return self.row.dims[0] == "interval"


GROUPS = (
    ColumnGroup(("q", "pose"), {"m": POSITION, "-": QUATERNION}),
    ColumnGroup(("v", "twist"), {"m/s": ["vx", "vy", "vz"], "rad/s": ["wx", "wy", "wz"]}),
    ColumnGroup(("crank_angle",), {"rad": ["crank_angle"]}),
    ColumnGroup(("crank_rate",), {"rad/s": ["crank_rate"]}),
    ColumnGroup(("q", "joint_angle"), {"rad": list(JOINTS)}),
    ColumnGroup(("v", "joint_rate"), {"rad/s": [f"{name}_rate" for name in JOINTS]}),
    ColumnGroup(("airspeed",), {"m/s": ["airspeed"]}),
    ColumnGroup(("wind_W",), {"m/s": ["wind_x", "wind_y", "wind_z"]}),
    ColumnGroup(("crank_torque",), {"N m": ["crank_torque"]}),
    ColumnGroup(("motor_torque", "joint_torque"), {"N m": [f"torque_{name}" for name in JOINTS]}),
    ColumnGroup((THRUSTERS,), THRUST),
)
UNITS = {"time": "s"} | {name: unit for group in GROUPS for name, unit in group.units.items()} | RAW_UNITS


@guarded()
def read_csv(path: str | Path) -> FlightLog:
    """Read a recorded flight.

    Raises:
        LogError: the file cannot be read, or does not describe a flight; the message names file, column and line.
    """
    text = TextTable(Path(path), "log", LogError)
    columns = _columns(text)
    if set(columns) <= set(RAW_UNITS) and (is_raw(list(columns)) or np.any(np.isnan(list(columns.values())))):
        _check_time(columns, text)
        return raw_log(columns, text)
    _check(columns, text)
    quaternion = np.array([columns[name] for name in QUATERNION])
    columns |= dict(zip(QUATERNION, quaternion / np.linalg.norm(quaternion, axis=0), strict=True))
    if "crank_angle" in columns:
        columns["crank_angle"] = np.unwrap(columns["crank_angle"])
    time = columns["time"]
    coords: dict[str, Any] = {
        "time": channel(time, ("time",), "s", "sample time"),
        "interval": channel(time[:-1], ("interval",), "s", "start of the interval"),
    }
    made = {}
    for group in GROUPS:
        if all(name in columns for name in group.units):
            values = np.column_stack([columns[name] for name in group.units])
            values = 0.5 * (values[1:] + values[:-1]) if group.means else values
            if group.labels:
                coords[group.row.dims[1]] = list(group.labels)
            key = group.channels[-1]
            made[key] = filled(key, values if group.labels else values[:, 0], {key: group.row})
    return FlightLog(xr.Dataset(made, coords=coords, attrs={"scenario": Path(path).stem}), name=f"log {path}")


@guarded()
def write_csv(log: FlightLog, path: str | Path) -> None:
    """Write the measured channels of a flight as a table that `read_csv` reads, with units in the header.

    Reading the table returns the samples to ten digits, and forces and torques smoothed over neighbouring intervals.
    The log's attributes, such as the name of its robot, are not written.

    Raises:
        LogError: the table has no column for one of the known forces.
        OutputError: the file cannot be written.
    """
    unwritten = [str(name) for name in log.measured.data_vars if str(name).startswith(KNOWN) and name != THRUSTERS]
    if unwritten:
        raise LogError(f"flight log: a table has no column for {', '.join(unwritten)}: drop the channel first")
    if log.is_raw:
        _write(raw_table(log), path)
        return
    columns = {"time": log.time}
    for group in GROUPS:
        for values in (log.measured[name] for name in group.channels if name in log.measured):
            array = values.sel({values.dims[1]: list(group.labels)}).values if group.labels else values.values[:, None]
            columns |= dict(zip(group.units, (samples_of(array) if group.means else array).T, strict=True))
    _write(pd.DataFrame({f"{name} [{UNITS[name]}]": values for name, values in columns.items()}), path)


def _write(table: pd.DataFrame, path: str | Path) -> None:
    """Write a table; a missing number becomes an empty cell. Raises OutputError."""
    try:
        table.to_csv(path, index=False, float_format="%.10g", lineterminator="\n")
    except OSError as error:
        raise OutputError(f"log {path}: cannot be written: {error.strerror or error}") from error


def _columns(text: TextTable) -> dict[str, Array]:
    """Return the columns by name. Raises LogError unless the text is a table of numbers with known names and units."""
    names = [_name(cell, text.path) for cell in text.header]
    twice = {name for name in names if names.count(name) > 1}
    if twice:
        raise LogError(f"log {text.path}: column '{twice.pop()}' appears twice")
    raw = set(names) <= set(RAW_UNITS) and (is_raw(names) or text.has_gaps())
    table = text.numbers_or_gaps() if raw else text.numbers()
    if len(table) < FEWEST_SAMPLES:
        raise LogError(
            f"log {text.path}: {len(table)} samples: a header and {FEWEST_SAMPLES} rows or more were expected"
        )
    return dict(zip(names, table.T, strict=True))


def _name(cell: str, path: Path) -> str:
    found = HEADER_CELL.fullmatch(cell)
    name = found["name"] if found else cell.strip()
    if name not in UNITS:
        raise LogError(f"log {path}: unknown column '{name[:60]}'; {did_you_mean(name[:60], UNITS)}")
    unit = found["unit"] if found else None
    if unit is not None and not is_unit(unit, UNITS[name]):
        raise LogError(f"log {path}: column '{cell.strip()}': {UNITS[name]} was expected")
    return name


def _check(columns: dict[str, Array], text: TextTable) -> None:
    """Raise LogError unless the columns describe a flight: complete, in order of time and in the right units."""
    path = text.path
    if alone := [name for name in ACCELEROMETER if name in columns]:
        other = next(name for name in columns if name not in RAW_UNITS)
        raise LogError(f"log {path}: {alone[0]} with {other}: an accelerometer is read from raw samples only")
    missing = [name for name in ("time", *GROUPS[0].units) if name not in columns]
    if missing:
        raise LogError(f"log {path}: no column named {', '.join(missing)}")
    for group in GROUPS:
        there = [name for name in group.units if name in columns]
        absent = [name for name in group.units if name not in columns]
        if there and absent:
            raise LogError(f"log {path}: {', '.join(there)} without {', '.join(absent)}: all of them or none")
    if "crank_rate" in columns and "crank_angle" not in columns:
        raise LogError(f"log {path}: crank_rate without crank_angle: the linkage needs the angle")
    if "crank_angle" not in columns and JOINTS[0] not in columns:
        raise LogError(f"log {path}: neither crank_angle nor the joints {', '.join(JOINTS)} are there")
    _check_time(columns, text)
    steps = np.diff(columns["time"])
    norm = np.linalg.norm([columns[name] for name in QUATERNION], axis=0)
    if np.any(np.abs(norm - 1.0) > QUATERNION_ERROR):
        row = int(np.argmax(np.abs(norm - 1.0) > QUATERNION_ERROR))
        raise LogError(f"log {path}, line {text.line(row)}: the quaternion has length {norm[row]:.3g}: 1 was expected")
    if "crank_angle" in columns:
        rate = float(np.median(np.abs(np.diff(columns["crank_angle"]) / steps))) / (2.0 * np.pi)
        if rate > FASTEST_CRANK:
            raise LogError(f"log {path}: crank_angle turns at {rate:.0f} Hz: radians were expected")


def _check_time(columns: dict[str, Array], text: TextTable) -> None:
    """Raise LogError unless there is a time that rises, in seconds."""
    path = text.path
    if "time" not in columns:
        raise LogError(f"log {path}: no column named time")
    time = columns["time"]
    steps = np.diff(time)
    if np.any(steps <= 0.0):
        row = int(np.argmax(steps <= 0.0)) + 1
        what = "is repeated" if steps[row - 1] == 0.0 else "runs backwards"
        raise LogError(f"log {path}, line {text.line(row)}: time = {time[row]:g} s {what}: rising times were expected")
    step = float(np.median(steps))
    if step > LONGEST_SAMPLE_TIME:
        raise LogError(f"log {path}: time rises by {step:g} from row to row: seconds were expected")
