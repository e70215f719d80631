"""Read any recording as columns: by its ending, a table, a bag or NetCDF, whose variables over time they are."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping
from pathlib import Path

import numpy as np

from aerobat_pin.errors import LogError
from aerobat_pin.numerics import Array
from aerobat_pin.records.channels import SI_FACTORS
from aerobat_pin.records.columns import Clock, Columns, GrowingTable, same_unit
from aerobat_pin.records.csv_columns import ROWS_AT_ONCE, SECONDS, read_csv_columns, without_units
from aerobat_pin.records.map_tables import LogTable
from aerobat_pin.records.netcdf import StoredVariable, netcdf_variables
from aerobat_pin.records.spool import Series, Spool

BAGS, NETCDF = (".mcap", ".db3", ".bag"), (".nc", ".nc4", ".h5")
VARIABLES_TOLD = 10  # variables
NETCDF_GROUPS = ("truth", "measured")
KNOWN_UNITS = {unit for units in SI_FACTORS.values() for unit in units} - {"1"}
CLOCKS = ("time", "interval")  # dimensions that are clocks; the log may name another one


def read_columns(path: Path, log: LogTable, wanted: Iterable[str] | None = None) -> Columns:
    """Read a recording.

    Args:
        path: a table, a NetCDF file, an MCAP file, or the folder of a ROS 2 bag.
        log: the table `log` of the map.
        wanted: names of the columns to read; None reads all.

    Raises:
        LogError: it cannot be read.
    """
    if not os.path.exists(path):
        raise LogError(f"log {path}: there is no such file")
    if os.path.isdir(path) and not os.path.isfile(path / "metadata.yaml"):
        raise LogError(f"log {path}: a folder without metadata.yaml: a ROS 2 bag was expected")
    if os.path.isdir(path) or path.suffix.lower() in BAGS:
        from aerobat_pin.records.bag_columns import read_bag_columns  # slow to import

        return read_bag_columns(path, log, wanted)
    if path.suffix.lower() in NETCDF:
        return read_netcdf_columns(path, log, wanted)
    return read_csv_columns(path, log, wanted)


def read_netcdf_columns(path: Path, log: LogTable, wanted: Iterable[str] | None) -> Columns:
    """Read all variables over time of a NetCDF-4 file; those of a group are called `group/name`.

    A variable of two dimensions becomes one column for each label: `q.x`. Its unit is that of a table's header,
    `q.x [rad]`. Raises LogError if there is no time.
    """
    times = (log.time.column, *CLOCKS) if log.time.column else CLOCKS
    spool = Spool()
    clocks: dict[str, Clock] = {}
    values: dict[str, Series] = {}
    clock_of: dict[str, str] = {}
    arrays = list[str]()
    with netcdf_variables(path, "log", NETCDF_GROUPS) as groups:
        series = [name for name, variable in groups[""].items() if len(variable.dims) == 1 and variable.kind in "fiu"]
        for group, variables in groups.items():
            prefix, over = f"{group}/" if group else "", set[str]()
            arrays += [f"{prefix}{name}." for name, variable in variables.items() if len(variable.dims) > 1]
            for clock in times:
                if clock not in variables or len(variables[clock].dims) != 1 or not variables[clock].shape[0]:
                    continue
                (dim,) = variables[clock].dims
                if dim in over:  # which has a clock: the map's, or the first
                    continue
                over.add(dim)
                unit = SECONDS[log.time.unit] if log.time.unit else variables[clock].seconds
                table = _read_clock(variables, clock, unit, spool)
                clocks[f"{prefix}{clock}"], columns = table.finished()
                for name, column in columns.items():
                    values[prefix + name], clock_of[prefix + name] = column, f"{prefix}{clock}"
    if not clocks:
        raise LogError(
            f"log {path}: no {' or '.join(map(str, times))} over one dimension: name the time as log.time.column of "
            f"the map (it has {', '.join(series[:VARIABLES_TOLD]) or 'none'})"
        )
    names, units = without_units([*values], {*(wanted or ())})
    clock_of = dict(zip(names, clock_of.values(), strict=True))
    values = dict(zip(names, values.values(), strict=True))
    of_arrays = frozenset(name for name in names if name.startswith(tuple(arrays)))
    return Columns(path, tuple(names), clocks, clock_of, values, units=units, of_arrays=of_arrays)


def _read_clock(variables: Mapping[str, StoredVariable], clock: str, unit: float, spool: Spool) -> GrowingTable:
    """Read all numbers over the dimension of one clock, piece by piece."""
    (over,) = variables[clock].dims
    labels = {
        name: _labels(variable, variables, over)
        for name, variable in variables.items()
        if name != clock and variable.dims.count(over) == 1 and variable.kind in "fiu"
    }
    table = GrowingTable(spool)
    for first in range(0, variables[clock].shape[0], ROWS_AT_ONCE):
        rows = slice(first, first + ROWS_AT_ONCE)
        columns: dict[str, Array] = {}
        for name, ends in labels.items():
            at = variables[name].dims.index(over)
            piece: Array = np.moveaxis(np.asarray(variables[name][(slice(None),) * at + (rows,)], float), at, 0)
            piece = piece.reshape(len(piece), len(ends))
            columns |= {f"{name}{end}": piece[:, k] for k, end in enumerate(ends)}
        table.add(np.asarray(variables[clock][rows], float) * unit, columns)
    return table


def _labels(variable: StoredVariable, variables: Mapping[str, StoredVariable], over: str) -> list[str]:
    """Return what is added to a variable's name for each column over a clock: `.x`, ` [rad]`, or nothing."""
    labels = [""]
    for dim, size in zip(variable.dims, variable.shape, strict=True):
        if dim == over:
            continue
        coordinate = variables.get(dim)
        entries = range(size) if coordinate is None or coordinate.dims != (dim,) else coordinate[:]
        labels = [f"{label}.{entry}" for label in labels for entry in entries]
    unit = next((known for known in KNOWN_UNITS if same_unit(variable.unit, known)), None)
    return [f"{label} [{unit}]" if unit else label for label in labels]
