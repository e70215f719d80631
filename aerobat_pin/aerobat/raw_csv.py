"""Raw samples as text tables: each row is a time, and an empty cell means that the channel has no sample there.

The page docs/recorded.md lists the columns.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from aerobat_pin.aerobat.channels import LABELS, MEASURED, THRUST_CHANNEL, THRUSTERS, channel, filled
from aerobat_pin.aerobat.flight_log import FlightLog
from aerobat_pin.errors import LogError
from aerobat_pin.numerics import Array, Integers
from aerobat_pin.robot import JOINTS
from aerobat_pin.scenario import TextTable

POSITION, QUATERNION = "x y z".split(), "qx qy qz qw".split()
GYRO, ACCELEROMETER = "wx wy wz".split(), "ax ay az".split()
THRUST = {"N": "thrust_fx thrust_fy thrust_fz".split(), "N m": "thrust_mx thrust_my thrust_mz".split()}  # by unit
RAW_COLUMNS = {  # channel -> its columns
    "mocap_position": POSITION,
    "mocap_quaternion": QUATERNION,
    "gyro": GYRO,
    "accelerometer": ACCELEROMETER,
    "encoder": ["crank_angle"],
    "joint_torque_sample": [f"torque_{name}" for name in JOINTS],
    "crank_torque_sample": ["crank_torque"],
}
RAW_UNITS = {"time": "s"} | {cell: MEASURED[name].unit for name, cells in RAW_COLUMNS.items() for cell in cells}
RAW_UNITS |= {cell: unit for unit, cells in THRUST.items() for cell in cells}
FEWEST_RAW_SAMPLES = 8


def is_raw(names: list[str]) -> bool:
    """Return whether columns are those of raw samples: an accelerometer, or a gyro without a velocity."""
    return "ax" in names or ("wx" in names and "vx" not in names)


def raw_log(columns: dict[str, Array], text: TextTable) -> FlightLog:
    """Return the log of a table of raw samples.

    Args:
        columns: column -> values, NaN where the cell is empty.
        text: the table, for error messages.

    Raises:
        LogError: columns are missing, or a channel has too few samples.
    """
    path = text.path
    missing = [name for name in ("time", *POSITION, *QUATERNION, "crank_angle") if name not in columns]
    if missing:
        raise LogError(f"log {path}: no column named {', '.join(missing)}")
    time = columns["time"]
    if np.any(np.isnan(time)):
        raise LogError(f"log {path}, line {text.line(int(np.argmax(np.isnan(time))))}: time is empty")
    made: dict[str, Any] = {}
    coords: dict[str, Any] = {}
    stamps: dict[str, Array] = {}
    for name, cells in RAW_COLUMNS.items():
        table = _group_of_cells(cells, columns, text)
        if table is None:
            continue
        rows, values = table
        row = MEASURED[name]
        stamps[row.dims[0]] = time[rows]
        coords[row.dims[0]] = channel(time[rows], row.dims[:1], "s", "stamp of the sample")
        if len(row.dims) > 1:
            coords[row.dims[1]] = list(LABELS[row.dims[1]])
        if name == "mocap_quaternion":
            values = values / np.linalg.norm(values, axis=1, keepdims=True)
        made[name] = filled(name, values if len(row.dims) > 1 else values[:, 0])
    grid = max(stamps.values(), key=len)
    coords["time"] = channel(grid, ("time",), "s", "knots: the stamps of the channel with most samples")
    coords["interval"] = channel(grid[:-1], ("interval",), "s", "start of the interval")
    thrust = _group_of_cells([*THRUST["N"], *THRUST["N m"]], columns, text)
    if thrust is not None:
        rows, values = thrust
        at = np.column_stack([np.interp(grid, time[rows], column) for column in values.T])
        coords["twist_axis"] = list(LABELS["twist_axis"])
        made[THRUSTERS] = filled(THRUSTERS, 0.5 * (at[1:] + at[:-1]), {THRUSTERS: THRUST_CHANNEL})
    return FlightLog(xr.Dataset(made, coords=coords, attrs={"scenario": path.stem}), name=f"log {path}")


def _group_of_cells(cells: list[str], columns: dict[str, Array], text: TextTable) -> tuple[Integers, Array] | None:
    """Return the rows (k,) in which a channel has a sample, and the samples (k, c); None without columns."""
    there = [cell for cell in cells if cell in columns]
    if not there:
        return None
    if len(there) < len(cells):
        absent = ", ".join(cell for cell in cells if cell not in columns)
        raise LogError(f"log {text.path}: {', '.join(there)} without {absent}: all of them or none")
    values = np.column_stack([columns[cell] for cell in cells])
    empty = np.isnan(values)
    part = np.any(empty, axis=1) & ~np.all(empty, axis=1)
    if np.any(part):
        row = int(np.argmax(part))
        cell = cells[int(np.argmax(empty[row]))]
        raise LogError(f"log {text.path}, line {text.line(row)}: {cell} is empty: all of {', '.join(cells)} or none")
    rows = np.flatnonzero(~empty[:, 0])
    if len(rows) < FEWEST_RAW_SAMPLES:
        raise LogError(
            f"log {text.path}: {len(rows)} samples of {', '.join(cells)}: {FEWEST_RAW_SAMPLES} or more were expected"
        )
    return rows, values[rows]


def raw_table(log: FlightLog) -> pd.DataFrame:
    """Return the raw samples of a log as a table that `raw_log` reads; place and turn of sensors are not written.

    Known forces are given at the knots, as means of the intervals on both sides.
    """
    parts = []
    for name, cells in RAW_COLUMNS.items():
        if name in log.measured:
            data = log.measured[name]
            values = np.asarray(data.values, float).reshape(data.shape[0], -1)
            parts.append(pd.DataFrame(values, index=data[data.dims[0]].values, columns=cells))
    if THRUSTERS in log.measured:
        values = samples_of(np.asarray(log.measured[THRUSTERS].values, float)[:, :6])
        parts.append(pd.DataFrame(values, index=log.time, columns=[*THRUST["N"], *THRUST["N m"]]))
    for part in parts:
        part.index = pd.Index(np.round(part.index.to_numpy(float), 9))
    table = pd.concat(parts, axis=1).sort_index()
    table.insert(0, "time", table.index)
    return table.rename(columns={name: f"{name} [{RAW_UNITS[name]}]" for name in table.columns})


def samples_of(means: Array) -> Array:
    """Return samples (m + 1, c) from interval means (m, c): mean of both neighbours, extrapolated at the two ends."""
    inside = 0.5 * (means[1:] + means[:-1])
    return np.concatenate([2.0 * means[:1] - inside[:1], inside, 2.0 * means[-1:] - inside[-1:]])
