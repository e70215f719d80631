"""Aerobat's own tables: which file is one, the flight in it, and how one is written. What columns mean, their maps say.

| map | each row |
|---|---|
| `maps/states.toml` | a sample of configuration, velocity and further channels |
| `maps/raw_samples.toml` | samples of some sensors; an empty cell means that its channel has no sample there |
"""

from __future__ import annotations

import csv
import difflib
import os
import shlex
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from aerobat_description import MORPHOLOGIES
from aerobat_description.reading import did_you_mean
from aerobat_pin.aerobat.aerobat import JOINTS, load_aerobat
from aerobat_pin.aerobat.channels import KNOWN, LABELS, MEASURED, THRUST_CHANNEL, THRUSTERS, channel, filled
from aerobat_pin.aerobat.flight_log import FlightLog
from aerobat_pin.aerobat.flight_record import EXTRA_CHANNELS, RAW_KEYS, flight_channels, flight_map
from aerobat_pin.aerobat.robot import AerobatRobot
from aerobat_pin.errors import LARGEST_TABLE, LogError, OutputError, foreign_file
from aerobat_pin.numerics import Array, guarded
from aerobat_pin.records import BAGS, EXTRA, NETCDF, Map, Record, Request, header_of, load_map, open_by_map, requests_of
from aerobat_pin.scenario import ObserverSection

STATE_KEYS = {  # channel of a flight log -> keys whose columns it has, side by side
    "pose": ("base.position", "base.quaternion"),
    "twist": ("base.velocity", "base.rate"),
    "joint_angle": ("joints.position",),
    "joint_rate": ("joints.velocity",),
    "joint_torque": ("joints.effort",),
    **{name: (f"{EXTRA}{name}",) for name in EXTRA_CHANNELS},
}
STATE_TABLE, RAW_TABLE = "states", "raw_samples"
POSE = ("time", "x", "y", "z", "qx", "qy", "qz", "qw")
MOST_MISSING = 2  # columns that a table lacks, of which it is then told; one that lacks more is another robot's


@cache
def table_map(kind: str) -> Map:
    """Return the map of a kind of table, `STATE_TABLE` or `RAW_TABLE`."""
    return load_map(Path(__file__).parent / "maps" / f"{kind}.toml")


@cache
def table_requests(kind: str) -> list[Request]:
    """Return the channels that a kind of table can have."""
    return requests_of(table_map(kind), AerobatRobot.of(load_aerobat()), JOINTS)


@cache
def table_units(kind: str) -> dict[str, str]:
    """Return the units of all columns that a kind of table can have."""
    pairs = (zip(request.names, request.units, strict=True) for request in table_requests(kind))
    return {"time": "s"} | {name: unit for columns in pairs for name, unit in columns}


def kind_of_log(path: Path) -> str | None:
    """Return which kind of log a file is: one of Aerobat's tables, by its map's name, or None for a NetCDF file.

    A table is Aerobat's if it has time and pose, and the crank's angle or all joints. It has raw samples if its columns
    are those of sensors, and cells are empty, or there is an accelerometer, or a gyro without velocity.

    Raises:
        LogError: it is neither. The message names one or two columns that are missing, or a wrong one, or asks for a
            map, as bags and tables of other robots need one.
    """
    if os.path.isfile(path / "flight.nc"):
        raise LogError(f"log {path}: the folder of a run: its log {path / 'flight.nc'} was expected")
    if os.path.isdir(path) or path.suffix.lower() in BAGS:
        raise needs_map(path)
    if path.suffix.lower() in NETCDF or _begins_as_netcdf(path):
        return None
    foreign_file(path, f"log {path}", LARGEST_TABLE)
    separator, cells = header_of(path)
    names, sensors = [cell.partition("[")[0].strip() for cell in cells], table_units(RAW_TABLE)
    _check_columns(path, names)
    raw = "ax" in names or ("wx" in names and "vx" not in names)
    if set(names) <= sensors.keys() and (raw or _has_gaps(path, separator)):
        return RAW_TABLE
    if alone := [name for name in names if name not in table_units(STATE_TABLE)]:
        other = next(name for name in names if name not in sensors)
        raise LogError(f"log {path}: {alone[0]} with {other}: an accelerometer is read from raw samples only")
    return STATE_TABLE


def _check_columns(path: Path, names: list[str]) -> None:
    """Raise LogError unless columns are Aerobat's, each there once, and enough of them."""
    known, least = table_units(STATE_TABLE) | table_units(RAW_TABLE), [(*POSE, "crank_angle"), (*POSE, *JOINTS)]
    missing = min(([name for name in columns if name not in names] for columns in least), key=len)
    strangers = [name for name in names if name not in known]
    small = {name.lower(): name for name in strangers}
    close = {name: [small[alike] for alike in difflib.get_close_matches(name, small, n=1)] for name in missing}
    others = not any(name in known and "_" in name for name in names)  # torque_left_elbow is no other robot's
    renamed = len(missing) - len({*missing} & {*small})
    if others and (renamed > 2 * MOST_MISSING or sum(not alike for alike in close.values()) > MOST_MISSING):
        raise needs_map(path)
    if twice := [name for name in names if names.count(name) > 1]:
        raise LogError(f"log {path}: column '{twice[0]}' appears twice")
    if missing == ["crank_angle"] and not close["crank_angle"]:
        raise needs_map(path, f"neither crank_angle nor the joints {', '.join(JOINTS)} are there")
    if missing:
        hints = [f"{name} (is it '{alike[0]}'?)" if alike else name for name, alike in close.items()]
        raise needs_map(path, f"no column named {', '.join(hints)}")
    if strangers:
        raise LogError(f"log {path}: unknown column '{strangers[0][:60]}'; {did_you_mean(strangers[0][:60], known)}")


def _has_gaps(path: Path, separator: str) -> bool:
    """Return whether a cell of a table is empty. Raises LogError if its quotes do not end."""
    try:
        with path.open(newline="", encoding="utf-8-sig", errors="replace") as file:
            rows = ([cell.strip() for cell in row] for row in csv.reader(file, delimiter=separator))
            return any(not all(row) for row in rows if any(row))
    except csv.Error as error:
        raise LogError(f"log {path}: cannot be read as CSV: {error}") from error


def _begins_as_netcdf(path: Path) -> bool:
    if not os.path.isfile(path):  # also False for names that no file can have
        return False
    with path.open("rb") as file:
        return file.read(4) == b"\x89HDF"


def needs_map(path: Path, lacks: str = "", robot: str = "") -> LogError:
    """Return the error for a log that only a map explains; `lacks` says why it is none of Aerobat's, if it is not."""
    why = f"{lacks}; if it is another robot's, " if lacks else ""
    return LogError(
        f"log {path}: {why}a map says what its columns mean and which robot it was (--map MAP.toml of estimate, "
        f"calibrate, check and live; estimate writes a replay, too); `aerobat estimate {shlex.quote(str(path))} "
        f"--suggest{f' --urdf {shlex.quote(robot)}' if robot else ''}` prints one to begin with"
    )


@guarded()
def table_record(path: Path, robot: AerobatRobot, section: ObserverSection | None = None) -> Record:
    """Read one of Aerobat's tables as a record.

    The section names the observers, and the frames at whose origins unknown forces act; the usual ones when omitted.

    Raises:
        LogError: it is none of Aerobat's tables, or describes no flight; the message names file, column and line.
    """
    kind = kind_of_log(path)
    if kind is None:
        raise LogError(f"log {path}: a table was expected")
    flight = flight_map(section or ObserverSection())
    chosen = table_map(kind).model_copy(update={"robot": flight.robot, "observer": flight.observer})
    return open_by_map(path, chosen, path.parent, robot)


@guarded()
def read_log(path: Path) -> FlightLog:
    """Read a flight log: a NetCDF file written by this package, or one of Aerobat's tables. Raises LogError.

    A robot of the user's own that a log notes is the copy beside the log, which a run writes, if there is one.
    """
    if kind_of_log(path) is None:
        log, copy = FlightLog.load(path), path.with_name("morphology.toml")
        if log.measured.attrs.get("morphology", "aerobat") not in MORPHOLOGIES and copy.is_file():
            log.measured.attrs["morphology"] = str(copy)
        return log
    record = table_record(path, AerobatRobot.of(load_aerobat()))
    time = record.times(record.parts[0][0], record.parts[-1][1])
    coords: dict[str, Any] = {"time": channel(time, ("time",), "s", "sample time")}
    coords["interval"] = channel(time[:-1], ("interval",), "s", "start of the interval")
    channels, table = {}, MEASURED | {THRUSTERS: THRUST_CHANNEL}
    raw = record.robot.smooths(record.channels)
    sources = {name: (key,) for name, key in RAW_KEYS.items()} if raw else STATE_KEYS
    for name, keys in {**sources, THRUSTERS: (f"{EXTRA}known.thrusters",)}.items():
        if all(key in record.channels for key in keys):
            row, column = table[name], record.channels[keys[0]]
            if row.dims[0] == "interval":
                values = record.means(keys[0], time)
            elif raw:
                coords[row.dims[0]] = channel(column.time[:], row.dims[:1], "s", "stamp of the sample")
                values = column.values[:]
            elif name == "pose":
                values = np.hstack([record.at(keys[0], time), record.turns(time)])
            else:
                values = np.hstack([record.at(key, time) for key in keys])
            coords |= {dim: list(LABELS[dim]) for dim in row.dims[1:]}
            channels[name] = filled(name, values if len(row.dims) > 1 else values[:, 0], table)
    return FlightLog(xr.Dataset(channels, coords=coords, attrs={"scenario": path.stem}), name=f"log {path}")


@guarded()
def write_csv(log: FlightLog, path: str | Path) -> None:
    """Write the measured channels of a flight as a table that `read_log` reads, with units in the header.

    Reading the table returns the samples to ten digits, and forces and torques smoothed over neighbouring intervals:
    a table has them as samples, a log as means of intervals. Of raw samples, place and turn of the sensors are not
    written, nor are the log's attributes, such as the name of its robot.

    Raises:
        LogError: the table has no column for one of the known forces.
        OutputError: the file cannot be written.
    """
    unwritten = [str(name) for name in log.measured.data_vars if str(name).startswith(KNOWN) and name != THRUSTERS]
    if unwritten:
        raise LogError(f"flight log: a table has no column for {', '.join(unwritten)}: drop the channel first")
    channels, parts = flight_channels(log, load_aerobat()), []
    for request in table_requests(RAW_TABLE if log.is_raw else STATE_TABLE):
        if (samples := channels.get(request.key)) is not None:
            values, stamps = samples.values[:][:, : len(request.names)], samples.time[:]
            values = samples_of(values) if samples.means else values
            header = [f"{name} [{unit}]" for name, unit in zip(request.names, request.units, strict=True)]
            rows = np.round(log.time if samples.means else stamps, 9) if log.is_raw else None
            parts.append(pd.DataFrame(values, index=rows, columns=header))
    table = pd.concat(parts, axis=1).sort_index()
    table.insert(0, "time [s]", table.index if log.is_raw else log.time)
    try:
        table.to_csv(path, index=False, float_format="%.10g", lineterminator="\n")  # a missing number is an empty cell
    except OSError as error:
        raise OutputError(f"log {path}: cannot be written: {error.strerror or error}") from error


def samples_of(means: Array) -> Array:
    """Return samples (m + 1, c) from interval means (m, c): mean of both neighbours, extrapolated at the two ends."""
    inside = 0.5 * (means[1:] + means[:-1])
    return np.concatenate([2.0 * means[:1] - inside[:1], inside, 2.0 * means[-1:] - inside[-1:]])
