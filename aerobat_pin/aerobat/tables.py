"""Aerobat's own tables: the flight in one, and how one is written. What columns mean, their maps say."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from aerobat_description import MORPHOLOGIES
from aerobat_pin.aerobat.aerobat import load_aerobat
from aerobat_pin.aerobat.channels import (
    KNOWN,
    LABELS,
    MEASURED,
    THRUST_CHANNEL,
    THRUSTERS,
    channel,
    filled,
)
from aerobat_pin.aerobat.flight_log import FlightLog
from aerobat_pin.aerobat.flight_record import EXTRA_CHANNELS, RAW_KEYS, flight_channels, flight_map
from aerobat_pin.aerobat.kind_of_log import RAW_TABLE, STATE_TABLE, kind_of_log, table_map, table_requests
from aerobat_pin.aerobat.robot import AerobatRobot
from aerobat_pin.errors import LogError, OutputError
from aerobat_pin.numerics import Array, guarded
from aerobat_pin.records import EXTRA, Channel, Record, open_by_map
from aerobat_pin.scenario import ObserverSection

STATE_KEYS = {  # channel of a flight log -> keys whose columns it has, side by side
    "pose": ("base.position", "base.quaternion"),
    "twist": ("base.velocity", "base.rate"),
    "joint_angle": ("joints.position",),
    "joint_rate": ("joints.velocity",),
    "joint_torque": ("joints.effort",),
    **{name: (f"{EXTRA}{name}",) for name in EXTRA_CHANNELS},
}


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
    channels, table, clocks = {}, MEASURED | {THRUSTERS: THRUST_CHANNEL}, dict[str, Channel]()
    raw = record.robot.smooths(record.channels)
    sources = {name: (key,) for name, key in RAW_KEYS.items()} if raw else STATE_KEYS

    def values_of(keys: tuple[str, ...], *, means: bool) -> Array:
        if means:
            return record.means(keys[0], time)
        if raw:
            return np.asarray(record.channels[keys[0]].values[:])
        if keys == STATE_KEYS["pose"]:
            return np.asarray(np.hstack([record.at(keys[0], time), record.turns(time)]))
        return np.asarray(np.hstack([record.at(key, time) for key in keys]))

    for name, keys in {**sources, THRUSTERS: (f"{EXTRA}known.thrusters",)}.items():
        if not set(keys) <= record.channels.keys():
            continue
        row, column, means = table[name], record.channels[keys[0]], table[name].dims[0] == "interval"
        if raw and not means:
            first = clocks.setdefault(row.dims[0], column)
            if not np.array_equal(first.time[:], column.time[:]):
                raise LogError(
                    f"log {path}: cells of {', '.join(column.names)} and of {', '.join(first.names)} are filled in "
                    "different rows: both or none in a row, or one of the two channels, was expected"
                )
            coords[row.dims[0]] = channel(column.time[:], row.dims[:1], "s", "stamp of the sample")
        coords |= {dim: list(LABELS[dim]) for dim in row.dims[1:]}
        values = values_of(keys, means=means)
        channels[name] = filled(name, values if len(row.dims) > 1 else values[:, 0], table)
    return FlightLog(xr.Dataset(channels, coords=coords, attrs={"scenario": path.stem}), name=f"log {path}")


@guarded()
def write_csv(log: FlightLog, path: str | Path) -> None:
    """Write the measured channels of a flight as a table that `read_log` reads, with units in the header.

    Reading the table returns the samples to ten digits, times to 15, and forces and torques smoothed over neighbouring
    intervals: a table has them as samples, a log as means of intervals. Of raw samples, place and turn of the sensors
    are not written, nor are the log's attributes, such as the name of its robot.

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
    time = table.index if log.is_raw else log.time
    table.insert(0, "time [s]", [f"{stamp:.15g}" for stamp in time])  # seconds since 1970 have ten digits alone
    try:
        table.to_csv(path, index=False, float_format="%.10g", lineterminator="\n")  # a missing number is an empty cell
    except OSError as error:
        raise OutputError(f"log {path}: cannot be written: {error.strerror or error}") from error


def samples_of(means: Array) -> Array:
    """Return samples (m + 1, c) from interval means (m, c): mean of both neighbours, extrapolated at the two ends."""
    inside = 0.5 * (means[1:] + means[:-1])
    return np.concatenate([2.0 * means[:1] - inside[:1], inside, 2.0 * means[-1:] - inside[-1:]])
