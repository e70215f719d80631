"""Read a NetCDF file as columns: every variable over time, and the columns of tables by their labels."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from aerobat_pin.errors import LogError
from aerobat_pin.estimation.recordings.columns import Clock, Columns, increasing
from aerobat_pin.estimation.recordings.csv_columns import SECONDS
from aerobat_pin.estimation.recordings.map_tables import LogTable
from aerobat_pin.flight import read_netcdf
from aerobat_pin.numerics import Array

NETCDF_GROUPS = ("truth", "measured")
CLOCKS = ("time", "interval")  # dimensions that are clocks; the log may name another one


def read_netcdf_columns(path: Path, log: LogTable) -> Columns:
    """Read all variables over time of a NetCDF-4 file; those of a group are called `group/name`.

    A variable of two dimensions becomes one column for each label: `q.x`. Raises LogError if there is no time.
    """
    wanted = (log.time.column, *CLOCKS) if log.time.column else CLOCKS
    clocks: dict[str, Clock] = {}
    values: dict[str, Array] = {}
    clock_of: dict[str, str] = {}
    for group, data in read_netcdf(path, "log", NETCDF_GROUPS).items():
        prefix = f"{group}/" if group else ""
        for clock in wanted:
            if clock not in data.variables or data[clock].dims != (clock,):
                continue
            time = np.asarray(data[clock].values, float) * SECONDS[log.time.unit]
            keep, repeated, backward = increasing(time)
            clocks[f"{prefix}{clock}"] = Clock(time[keep], repeated, backward)
            for key, variable in data.data_vars.items():
                if variable.dims[:1] == (clock,) and variable.dtype.kind in "fiu":
                    for name, column in _flat(str(key), variable):
                        values[prefix + name], clock_of[prefix + name] = column[keep], f"{prefix}{clock}"
    if not clocks:
        raise LogError(
            f"log {path}: no dimension {' or '.join(map(str, wanted))}: name it as log.time.column of the map"
        )
    return Columns(path, tuple(values), clocks, clock_of, values)


def _flat(name: str, variable: Any) -> list[tuple[str, Array]]:
    """Return the columns (n,) of a variable of one dimension or more, with labels joined by points."""
    if variable.ndim == 1:
        return [(name, np.asarray(variable.values, float))]
    labels = []
    for index in np.ndindex(*variable.shape[1:]):
        parts = [
            str(variable[dim].values[i]) if dim in variable.coords else str(i)
            for dim, i in zip(variable.dims[1:], index, strict=True)
        ]
        labels.append((index, ".".join([name, *parts])))
    return [(label, np.asarray(variable.values[(slice(None), *index)], float)) for index, label in labels]
