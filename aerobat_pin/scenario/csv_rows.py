"""Read CSV files: a header line, then rows of numbers. Error messages name the line by its number in an editor."""

from __future__ import annotations

import csv
import itertools
import math
import os
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import numpy as np
import pandas as pd

from aerobat_pin.errors import AerobatError
from aerobat_pin.numerics import Array, guarded

LARGEST_TABLE = 100_000_000  # of a table: five minutes of 25 columns at 1 kHz
SAMPLE = 100_000  # bytes in which rows are counted


class TextTable:
    """A CSV file. Creating the table reads only the header; empty lines do not count as rows.

    Args:
        path: path of the file.
        what: what the file is, such as `motion`; every error message begins with it.
        error: error class to raise.

    Raises:
        AerobatError: of the class `error`: there is no such file, it is not text or too large, or semicolons or tabs
            separate its cells.
    """

    @guarded()
    def __init__(self, path: Path, what: str, error: Callable[[str], AerobatError]) -> None:
        if not os.path.isfile(path):  # also False for names that no file can have
            raise error(f"{what} {path}: there is no such file")
        self.path, self._name, self._error = path, f"{what} {path}", error
        if (size := os.path.getsize(path)) > LARGEST_TABLE:
            with path.open("rb") as file:
                start = file.read(SAMPLE)
            rows = size / len(start) * max(start.count(b"\n"), 1)
            rule = f"at most {LARGEST_TABLE / 1e6:g} MB are read: fewer rows were expected"
            raise error(f"{self._name}: {size / 1e6:.0f} MB, about {rows:.2g} rows; {rule}")
        self._header_line, self.header = next(self._rows(), (0, []))
        for sign, name in ((";", "semicolons"), ("\t", "tabs")):
            if len(self.header) == 1 and sign in self.header[0]:
                raise error(f"{self._name}: {name} separate its columns: commas were expected, and points in numbers")

    @property
    def names(self) -> list[str]:
        """The column names: the cells of the header without the units in brackets."""
        return [cell.partition("[")[0].strip() for cell in self.header]

    def numbers(self, columns: Sequence[int] | None = None) -> Array:
        """Return the numbers below the header as an array (rows, columns).

        Args:
            columns: indices of the columns to read; all columns when omitted.

        Raises:
            AerobatError: of the class given on creation: a cell is not a finite number, or a row is too short or too
                long.
        """
        chosen = list(range(len(self.header)) if columns is None else columns)
        try:  # from pandas 3.1 on, the numbers are exactly those that Python's `float` reads
            frame = pd.read_csv(
                self.path,
                skiprows=self._header_line,
                header=None,
                names=range(len(self.header)),
                dtype=dict.fromkeys(chosen, float),
                encoding="utf-8-sig",
            )
        except ValueError:
            return self._numbers_by_cell(chosen)
        values = frame[chosen].to_numpy()
        # Where rows are too long, pandas moves their surplus cells into the index, which is then no RangeIndex.
        good = isinstance(frame.index, pd.RangeIndex) and np.all(np.isfinite(values))
        return values if good else self._numbers_by_cell(chosen)

    def has_gaps(self) -> bool:
        """Return whether a cell below the header is empty."""
        return any(not cell.strip() for _, row in self._rows() for cell in row)

    def line(self, row: int) -> int:
        """Return the line number, counted from 1, of a row of data; row 0 is the first one below the header."""
        return [line for line, _ in self._rows()][row + 1]

    def _numbers_by_cell(self, columns: Sequence[int]) -> Array:
        """Read the numbers cell by cell: slower than `numbers`, but with a message for each kind of mistake."""
        rows, infinite, names = [], [], self.names
        for line, row in itertools.islice(self._rows(), 1, None):
            where = f"{self._name}, line {line}"
            if len(row) != len(self.header):
                raise self._error(f"{where}: {len(row)} values: {len(self.header)} were expected")
            values = []
            for k in columns:
                try:
                    values.append(float(row[k]))
                except ValueError:
                    raise self._error(f"{where}: {names[k]} = {row[k]!r}: a number was expected") from None
                if not math.isfinite(values[-1]):
                    infinite.append((where, names[k]))
            rows.append(values)
        if infinite:
            (where, name), count = infinite[0], len(dict(infinite))
            rule = "leave those rows out; gaps in time are allowed"
            raise self._error(f"{where}: {name} is not finite ({count} such rows): {rule}")
        return np.array(rows, float).reshape(len(rows), len(columns))

    def _rows(self) -> Iterator[tuple[int, list[str]]]:
        """Yield (line number, cells) of each row that is not empty, starting with the header."""
        try:
            with self.path.open(newline="", encoding="utf-8-sig") as file:
                reader = csv.reader(file)
                for row in reader:
                    if any(cell.strip() for cell in row):
                        yield reader.line_num, row
        except (OSError, UnicodeDecodeError, csv.Error) as cause:
            raise self._error(f"{self._name}: cannot be read as CSV: {cause}") from cause
