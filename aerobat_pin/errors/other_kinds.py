"""What a file is that no reader of this package knows, by its first bytes, and what to do with it."""

from __future__ import annotations

import os
from contextlib import suppress
from pathlib import Path

from aerobat_pin.errors.exceptions import LogError

OTHER_KINDS = {
    (b"\x1f\x8b",): "is gzip-compressed: unpack it first",
    (b"PK\x03\x04",): "is a zip archive or a spreadsheet: unpack it, or save it as CSV, first",
    (b"PAR1",): "is in the Parquet format: save it as CSV or NetCDF first",
    (b"ULog",): "is a ULog file of PX4: make a table of its topics first, as by ulog2csv",
    (b"MATL",): "is a MATLAB file: save its numbers as CSV, as by writetable, first",
    (b'{"', b"{\n", b"[{", b"[\n"): "is JSON: save it as CSV, a column for each number, first",
    (b"\xff\xfe", b"\xfe\xff"): "is text in UTF-16: save it as UTF-8 first",
}


def check_kind(path: str | Path, name: str) -> None:
    """Raise LogError, that begins with `name`, for a file of `OTHER_KINDS`, or whose own name is not in UTF-8.

    One that cannot be read passes.
    """
    if os.fsencode(path).decode(errors="replace") != str(path):  # no result could name it
        raise LogError(f"{name}: its name is not in UTF-8: another name was expected")
    with suppress(OSError), open(path, "rb") as file:
        beginning = file.read(4)
        for signs, kind in OTHER_KINDS.items():
            if beginning.startswith(signs):
                raise LogError(f"{name}: {kind}")
