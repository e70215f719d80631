"""Read any recording as columns: by its ending, a table, NetCDF or a bag."""

from __future__ import annotations

import os
from collections.abc import Iterable
from pathlib import Path

from aerobat_pin.errors import LogError
from aerobat_pin.records.columns import Columns
from aerobat_pin.records.csv_columns import read_csv_columns
from aerobat_pin.records.map_tables import LogTable
from aerobat_pin.records.netcdf_columns import read_netcdf_columns

BAGS, NETCDF = (".mcap", ".db3", ".bag"), (".nc", ".nc4", ".h5")


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
        return read_netcdf_columns(path, log)
    return read_csv_columns(path, log, wanted)
