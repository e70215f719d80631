"""The cells of a table: as many in each row as in its header, and numbers where a map reads them."""

from __future__ import annotations

import itertools
import json
import os
import re
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from aerobat_pin.errors import LogError
from aerobat_pin.numerics import Array

BYTES_AT_ONCE = 1_000_000  # also the longest row
LIST = re.compile(r"\[[\[\s]*(?:[-+.\d\]]|NaN|nan|Inf|null|true|false)")  # its beginning, unlike a unit's, [m]
QUOTED = re.compile(rb'(?<![\w.])"(?:[^"\n]|"")*"')
CUT = "the last row is cut short, as by a logger that was killed: it is left out"


def cut_row(path: Path, separator: str, columns: int, *, strict: bool) -> tuple[int, int] | None:
    """Return where the last row of a table begins [bytes], and how many are above it, if it is cut; else None.

    A row without an end of line is cut: its last number may lack digits. If not `strict`, so is one with fewer cells
    than the header's `columns`.
    """
    with path.open("rb") as file:
        size = file.seek(0, os.SEEK_END)
        file.seek(max(0, size - BYTES_AT_ONCE))
        tail = file.read()
        text = tail.rstrip(b"\r\n ")
        begin = text.rfind(b"\n") + 1
        row = QUOTED.sub(b"0", text[begin:])
        cells = len(row.split()) if separator == " " else row.count(separator.encode()) + 1
        short = not strict and cells < columns
        if not begin or not (short or b"\n" not in tail[len(text) :]):
            return None
        file.seek(0)
        return size - len(tail) + begin, sum(bool(line.strip()) for line in file) - 2


def check_rows(path: Path, separator: str, columns: int, end: int | None) -> None:
    """Raise LogError if a row has not as many cells as the header, or more than `BYTES_AT_ONCE` bytes.

    Rows of cells in quotes that go over several lines are not counted. Looked at are the first `end` bytes, or all.
    """
    row, tail = 2, b""
    with path.open("rb") as file:
        while not file.readline().strip():  # the header, and what is empty above it
            row += 1
        while block := file.read(BYTES_AT_ONCE if end is None else min(BYTES_AT_ONCE, end - file.tell())):
            text = tail + block
            cut = text.rfind(b"\n") + 1
            lines, tail = text[:cut], text[cut:]
            if len(tail) > BYTES_AT_ONCE:
                raise LogError(f"log {path}, line {row}: more than {BYTES_AT_ONCE} bytes: a table was expected")
            row += _check_lines(path, lines, separator, columns, row)
    _check_lines(path, tail + b"\n", separator, columns, row)


def _check_lines(path: Path, lines: bytes, separator: str, columns: int, first: int) -> int:
    """Check whole lines, of which the first is row `first` of the file; return their number."""
    lines = QUOTED.sub(b"0", lines) if b'"' in lines else lines
    data, spaced = np.frombuffer(lines, np.uint8), separator == " "
    ends = np.flatnonzero(data == ord("\n"))
    signs = (data > ord(" ")) & (np.roll(data, 1) <= ord(" ")) if spaced else data == ord(separator)
    cells = np.diff(np.searchsorted(np.flatnonzero(signs), ends), prepend=0) + (not spaced)
    starts = np.append(0, ends + 1)[:-1]
    filled = (ends - starts > 1) | ((ends - starts == 1) & (data[starts] > ord(" ")))  # a blank line is no row
    wrong = filled & (cells != columns)
    if wrong.any() and b'"' not in lines:
        k = int(np.argmax(wrong))
        raise LogError(f"log {path}, line {first + k}: {cells[k]} cells: {columns}, as in the header, were expected")
    return len(ends)


def line_of(path: Path, row: int) -> int:
    """Return the line, counted from 1 as editors do, of a row of a table; row 0 follows the header."""
    with path.open("rb") as file:
        full = (number for number, line in enumerate(file, start=1) if line.strip())
        return next(itertools.islice(full, row + 1, None), row + 2)


def decimal_sign(cells: Any) -> str:
    """Return the signs before the decimals in a column of cells, a pandas series: `.`, `,`, both, or none.

    A point in a column with decimal commas separates thousands, or the column was joined from two kinds.
    """
    if cells.dtype.kind == "f":
        numbers = cells.to_numpy()
        return "." if np.any(np.mod(numbers[np.isfinite(numbers)], 1.0)) else ""
    if cells.dtype.kind in "iub":
        return ""
    texts = cells.dropna().astype(str)
    return "".join(sign for sign in ".," if texts.str.contains(sign, regex=False).any())


def numbers_of(path: Path, name: str, cells: Any, first: int, *, strict: bool) -> dict[str, Array]:
    """Return the columns that cells (n,), a pandas series with `first` rows before it, contain.

    They are one column of this name, or the entries of its lists. A cell that is no finite number is a LogError; if not
    `strict`, the column is NaN throughout.
    """
    if cells.dtype.kind in "fiub":
        numbers, wrong = np.asarray(cells, float), np.zeros(len(cells), bool)
    elif holds_lists(cells):
        return _lists(path, name, cells, strict=strict)
    else:
        numbers = np.asarray(pd.to_numeric(cells, errors="coerce"), float)
        if np.any(np.isnan(numbers) & cells.notna()):
            numbers = np.asarray(pd.to_numeric(cells.astype(str).str.replace(",", "."), errors="coerce"), float)
        wrong = np.asarray(np.isnan(numbers) & cells.notna())
    wrong = wrong | np.isinf(numbers)
    if not wrong.any():
        return {name: numbers}
    if not strict:
        return {name: np.full(len(cells), np.nan)}
    k = int(np.argmax(wrong))
    where = f"log {path}, line {line_of(path, first + k)}: {name} ="
    if np.isinf(numbers[k]):
        raise LogError(f"{where} {numbers[k]:g}: a finite number was expected")
    rule = "a number was expected, or an empty cell where there is no sample"
    rule += "; a unit stands behind the column's name, as 'x [m]'" * (first + k == 0)
    raise LogError(f"{where} '{str(cells.iloc[k])[:40]}': {rule}")


def holds_lists(cells: Any) -> bool:
    """Return whether the first cell of a pandas series that is not empty is a list."""
    return LIST.match(str(next(iter(cells.dropna().head(1)), ""))) is not None


def _lists(path: Path, name: str, cells: Any, *, strict: bool) -> dict[str, Array]:
    try:
        lists = np.array([np.ravel(json.loads(str(text))) for text in cells.dropna()], float)
    except (ValueError, RecursionError) as error:
        if not strict:
            return {name: np.full(len(cells), np.nan)}
        raise LogError(f"log {path}: '{name}' has lists of different lengths or of no numbers") from error
    table = np.full((len(cells), lists.shape[1]), np.nan)
    table[cells.notna()] = lists
    if table.shape[1] == 1:
        return {name: table[:, 0]}
    return {f"{name}.{k}": table[:, k] for k in range(table.shape[1])}
