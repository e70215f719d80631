"""Which kind of log a file is: one of Aerobat's tables, by the columns of their maps, a NetCDF file, or another's.

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

from aerobat_description.reading import did_you_mean
from aerobat_pin.aerobat.aerobat import JOINTS, load_aerobat
from aerobat_pin.aerobat.robot import AerobatRobot
from aerobat_pin.errors import LARGEST_TABLE, LogError, foreign_file
from aerobat_pin.records import BAGS, NETCDF, Map, Request, header_of, load_map, requests_of

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
