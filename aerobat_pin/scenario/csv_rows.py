"""A table of text: rows of cells between commas, each with the number of its line as an editor shows it."""

from __future__ import annotations

import csv
from collections.abc import Callable
from pathlib import Path

from aerobat_pin.errors import AerobatError


def read_rows(path: Path, what: str, error: Callable[[str], AerobatError]) -> tuple[list[list[str]], list[int]]:
    """Read the rows that are not empty, the header first.

    Args:
        path: of the file.
        what: it is, to begin a message with.
        error: what to raise with a message.

    Returns:
        The rows' cells, and the lines on which the rows stand, counted from 1.

    Raises:
        AerobatError: of the given kind: there is no such file, it is no text, or another sign separates its cells.
    """
    if not path.is_file():
        raise error(f"{what} {path}: there is no such file")
    rows, lines = [], []
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            reader = csv.reader(file)
            for row in reader:
                if any(cell.strip() for cell in row):
                    rows.append(row)
                    lines.append(reader.line_num)
    except (OSError, UnicodeDecodeError, csv.Error) as cause:
        raise error(f"{what} {path}: cannot be read as CSV: {cause}") from cause
    for sign, name in ((";", "semicolons"), ("\t", "tabs")):
        if rows and len(rows[0]) == 1 and sign in rows[0][0]:
            raise error(f"{what} {path}: {name} separate its columns: commas were expected, and points in numbers")
    return rows, lines
