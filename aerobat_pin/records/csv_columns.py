"""Read any table of numbers: separator, unit and column of the time are found, or asked for."""

from __future__ import annotations

import csv
import re
from collections.abc import Collection, Iterable
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from aerobat_pin.errors import LogError, foreign_file
from aerobat_pin.numerics import Array
from aerobat_pin.records.columns import Columns, GrowingTable, same_unit
from aerobat_pin.records.map_tables import LogTable
from aerobat_pin.records.spool import Spool
from aerobat_pin.records.table_cells import CUT, check_rows, cut_row, decimal_sign, holds_lists, line_of, numbers_of

SECONDS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
TIME_NAMES = "t,time,timestamp,stamp,time_s,t_s,time [s],seconds,elapsed,time_stamp,duration,__time".split(",")
ROWS_AT_ONCE = 50_000
LONGEST_HEADER, MOST_CELLS = 1_000_000, 10_000  # characters; columns
NUMBER, LETTER = re.compile(r"nan|inf|(?<=[\d.])e(?=[-+\d])", re.IGNORECASE), re.compile(r"[^\W\d]")
DATE = re.compile(r"\d{4}-\d\d-\d\d[T ]\d\d:")
THOUSANDS = r"\s*[-+]?[1-9]\d{0,2},\d{3}\s*"
COMMENT_SIGN = re.compile(r"^\s*[#%]+\s*")  # before a header, as numpy.savetxt writes it
ABOVE_HEADER = re.compile(r"\s*(#|%|\"?(?!nan|inf)[a-z_])", re.IGNORECASE)  # what follows a comment that is no header
NAME_AND_UNIT = re.compile(r"(?P<name>.*\S)\s*\[(?P<unit>[^\]]*)\]")


def header_of(path: Path, log: LogTable = LogTable()) -> tuple[str, list[str]]:  # noqa: B008 - it is frozen
    """Return the separator and the cells of the header of a table. Raises LogError if it is none."""
    foreign_file(path, f"log {path}")
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            line = file.readline(LONGEST_HEADER)
            while line and not line.strip():  # empty lines before the header
                line = file.readline(LONGEST_HEADER)
            comment = COMMENT_SIGN.match(line) and ABOVE_HEADER.match(file.readline(LONGEST_HEADER))
            if comment or line.startswith("sep="):  # as Excel reads it
                raise LogError(f"log {path}: '{line[:40].strip()}': take off what stands above the columns' names")
            line = COMMENT_SIGN.sub("", line.strip("\r\n"))
    except (OSError, UnicodeDecodeError) as error:
        raise LogError(
            f"log {path}: is no text in UTF-8: a table, .nc, .mcap or a bag was expected ({error})"
        ) from error
    separator = log.delimiter or max((sign for sign in ",;\t" if sign in line), key=line.count, default=" ")
    try:
        names = [name.strip() for name in next(csv.reader([line], delimiter=separator), [])]
        names = [name for name in names if name or separator != " "]  # spaces may be repeated
    except csv.Error as error:
        raise LogError(f"log {path}: its first line cannot be read as a header: {error}") from error
    if len(line) >= LONGEST_HEADER or len(names) > MOST_CELLS:
        raise LogError(
            f"log {path}: its first line has {len(names)} cells or more, and {len(line)} characters: a header of at "
            f"most {MOST_CELLS} columns was expected"
        )
    if len(names) < 2:
        raise LogError(
            f"log {path}: its first line has {len(names)} cells: a header of two columns or more was expected"
        )
    if not LETTER.search(NUMBER.sub("", line)) and names != [str(k) for k in range(len(names))]:  # as pandas names them
        raise LogError(
            f"log {path}: its first line has numbers alone ({line[:40]}...), so the table has no header: write a line "
            "above it that names each column, such as time,q1,q2,tau1,tau2; the map then uses these names"
        )
    return separator, names


def read_csv_columns(path: Path, log: LogTable, wanted: Iterable[str] | None) -> Columns:
    """Read columns of a table, as `read_columns`; cells such as `[1, 2]` become columns `name.0` and `name.1`.

    Raises LogError if it is no table, a cell is no number, or the time is not found.
    """
    separator, cells = header_of(path, log)
    strict, wanted = wanted is not None, set(wanted or ())
    names, units = without_units(cells, {log.time.column, *wanted})
    column = None if log.time.rate else log.time.column or _time_column(path, names)
    if column is not None and column not in names:
        raise LogError(f"log {path}: no column '{column}' (log.time.column of the map); there are {', '.join(names)}")
    if column in units and not same_unit(units[column], log.time.unit or "s"):
        raise LogError(f"log {path}: column '{column} [{units[column]}]': {log.time.unit or 's'} was expected")
    read = {column, *wanted, *(name.rpartition(".")[0] for name in wanted)}
    used = [i for i, name in enumerate(names) if not strict or name in read]
    if twice := [names[i] for i in used if strict and names.count(names[i]) > 1]:
        raise LogError(f"log {path}: column '{twice[0]}' appears twice")
    table, last = GrowingTable(Spool()), -np.inf
    signs: dict[str, str] = {}
    end, rows = cut_row(path, separator, len(names), strict=log.times == "own") or (None, None)
    check_rows(path, separator, len(names), end)
    try:
        with pd.read_csv(
            path,
            sep=separator,
            header=0,
            names=list(range(len(names))),  # as the header says them
            usecols=used,
            nrows=rows,
            chunksize=ROWS_AT_ONCE,
            encoding="utf-8-sig",
            skipinitialspace=True,
            keep_default_na=log.times == "even",
            na_values=[""],  # at own times a written NaN is no empty cell
        ) as chunks:
            for chunk in chunks:
                values: dict[str, Array] = {}
                for i, label in zip(used, chunk.columns, strict=True):
                    cells = _by_date(chunk[label], log.time.unit or "s") if names[i] == column else chunk[label]
                    values |= numbers_of(path, names[i], cells, len(table), strict=strict)
                    if strict and (separator != "," or cells.dtype.kind not in "fiub"):
                        before = signs.get(names[i], "")
                        signs[names[i]] = _one_sign(path, names[i], before, cells, len(table) + 2, separator)
                if len(chunk):
                    stamps = _stamps(path, log, column, values, len(table), len(chunk))
                    if log.times == "own":
                        _check_rising(path, stamps, last, len(table))
                        last = float(stamps[-1])
                    table.add(stamps, values)
    except (ValueError, OSError) as error:
        if isinstance(error, LogError):
            raise
        raise LogError(f"log {path}: {' '.join(str(error).split())[:200]}") from error
    if len(table) < 2:
        raise LogError(f"log {path}: {len(table)} rows: two or more were expected")
    clock, values_of = table.finished()
    every = tuple(dict.fromkeys([*names, *values_of]))
    clock_of = dict.fromkeys(values_of, "table")
    return Columns(path, every, {"table": clock}, clock_of, values_of, units=units, notes=() if end is None else (CUT,))


def without_units(cells: list[str], wanted: Collection[str | None]) -> tuple[list[str], dict[str, str]]:
    """Return the names of columns, and the units of those that are wanted without the unit of their cell, `x [m]`."""
    names, units = list(cells), {}
    for k, cell in enumerate(cells):
        match = NAME_AND_UNIT.fullmatch(cell)
        if match is not None and cell not in wanted and match["name"] in wanted:
            names[k], units[match["name"]] = match["name"], match["unit"]
    return names, units


def _by_date(cells: Any, unit: str) -> Any:
    """Return cells that say dates and times, by ISO 8601, as the time since 1970 in a unit; other cells as they are."""
    if cells.dtype.kind in "fiub" or not len(cells) or not DATE.match(str(cells.iloc[0])):
        return cells
    dates = pd.to_datetime(cells.astype(str).str.replace(",", "."), utc=True, format="ISO8601", errors="coerce")
    return (dates - pd.Timestamp(0, tz="UTC")) / pd.Timedelta(seconds=SECONDS[unit])


def _check_rising(path: Path, stamps: Array, last: float, before: int) -> None:
    """Raise LogError unless stamps (n,) rise, from `last` on; there are `before` rows before them."""
    steps = np.diff(stamps, prepend=last)
    if np.any(steps <= 0.0):
        k = int(np.argmax(steps <= 0.0))
        what = "is repeated" if steps[k] == 0.0 else "runs backwards"
        where = f"log {path}, line {line_of(path, before + k)}"
        raise LogError(f"{where}: time = {stamps[k]:g} s {what}: rising times were expected")


def _one_sign(path: Path, name: str, before: str, cells: Any, first: int, separator: str) -> str:
    """Return the decimal sign of a column so far.

    Raises LogError if rows from `first` on have another one, or commas between commas that may part thousands.
    """
    signs = decimal_sign(cells)
    if signs in ("", before) or holds_lists(cells):
        return before
    if before or len(signs) > 1:
        raise LogError(
            f"log {path}: '{name}' has decimal points and decimal commas (rows {first} to {first + len(cells) - 1}): "
            "one of them was expected, and nothing between thousands"
        )
    texts = cells.dropna().astype(str)
    commas = texts[texts.str.contains(",", regex=False)]
    if separator == "," == signs and commas.str.fullmatch(THOUSANDS).all():
        raise LogError(
            f"log {path}: '{name}' = '{commas.iloc[0]}' (rows {first} to {first + len(cells) - 1}): decimals, or "
            "thousands? A point before decimals was expected, and nothing between thousands"
        )
    return signs


def _stamps(path: Path, log: LogTable, column: str | None, values: dict[str, Array], before: int, count: int) -> Array:
    """Return the stamps [s] of `count` rows with `before` rows before them, and take their column out of the values."""
    if column is None:
        return np.asarray((before + np.arange(count)) / (log.time.rate or 1.0))
    time = np.asarray(values.pop(column) * SECONDS[log.time.unit or "s"])
    if not np.all(np.isfinite(time)):
        line = line_of(path, before + int(np.argmin(np.isfinite(time))))
        raise LogError(f"log {path}, line {line}: no time in '{column}'")
    return time


def _time_column(path: Path, names: list[str]) -> str:
    """Return the name of the column that looks like a time. Raises LogError, which asks for it, if none does."""
    if columns := [name for wanted in TIME_NAMES for name in names if name.lower() == wanted]:
        return columns[0]
    raise LogError(
        f"log {path}: which column is the time? Write [log] time = {{column = ..., unit = ...}} into the map, or "
        f"time = {{rate = 1000}} if there is none; columns: {', '.join(names[:40])}"
    )
