"""The door for files of others: what a file must be before it is read. Only the standard library is imported.

| a file | must be | before |
|---|---|---|
| that the user names | a regular file (a named pipe waits for ever), of a size | every reader of this package |
| that is found in a folder | that, and no link; private, where it is code | it is read, or passed on in a page |
| JSON | finite, and not too deep | what it says is believed |
| XML | at most `DEEPEST_XML` levels and `MOST_ELEMENTS` elements | Pinocchio, which calls itself for each level |
| compressed | at most `MOST_UNPACKED` bytes at a time, `MOST_TIMES_LARGER` than the file in all | rosbags |

NetCDF: `records/checked_netcdf.py`. TOML: `aerobat_description/toml_text.py`.
"""

from __future__ import annotations

import errno
import io
import json
import math
import os
import re
import stat
from pathlib import Path
from typing import TYPE_CHECKING, Any

from aerobat_pin.errors.exceptions import LogError
from aerobat_pin.errors.other_kinds import check_kind

if TYPE_CHECKING:
    from xml.etree.ElementTree import Element

LARGEST_XML = 100_000_000  # bytes: a mesh as Collada
LARGEST_TABLE = 100_000_000  # bytes, of one that is kept in memory: five minutes of 25 columns at 1 kHz
DEEPEST_XML, MOST_ELEMENTS = 100, 200_000
MOST_UNPACKED = 50_000_000  # bytes in memory at a time: a chunk of a recorder has some 1e6
MOST_TIMES_LARGER = 300  # than its file is all that a file unpacks to; LZ4 cannot make it more than 255 times
NO_TRICKS = os.O_NOFOLLOW | os.O_NONBLOCK  # follow no link, wait for no pipe


def foreign_file(path: str | Path, name: str, largest: float = float("inf")) -> Path:
    """Return the path of a regular file of at most so many bytes; LogError, that begins with `name`, for any other."""
    if not os.path.isfile(path):  # False also for names that no file can have
        reason = "a folder, pipe or device: a file was expected" if os.path.exists(path) else "there is no such file"
        raise LogError(f"{name}: {reason}")
    if (size := os.path.getsize(path)) > largest:
        raise LogError(f"{name}: {size} bytes: at most {largest} were expected")
    check_kind(path, name)
    return Path(path)


def foreign_xml(path: Path, name: str, tag: str, largest: int = LARGEST_XML) -> Element:
    """Return the outermost element of an XML file; LogError, that begins with `name`, if it nests too deep or is none.

    It must have the name `tag`, without its namespace, and the file at most `largest` bytes.
    """
    from xml.etree import ElementTree

    level, count = 0, 0
    root: Element | None = None
    try:
        content = foreign_file(path, name, largest).read_bytes().removeprefix(b"\xef\xbb\xbf").lstrip()  # as ROS does
        whole = re.sub(rb"(</?[\w-]+):", rb"\1.", content)  # a prefix may be one that nobody declared
        for event, element in ElementTree.iterparse(io.BytesIO(whole), ("start", "end")):
            root = element if root is None else root
            level, count = (level + 1, count + 1) if event == "start" else (level - 1, count)
            if level > DEEPEST_XML:
                raise LogError(f"{name}: more than {DEEPEST_XML} levels of elements")
            if count > MOST_ELEMENTS:
                raise LogError(f"{name}: more than {MOST_ELEMENTS} elements")
    except (ElementTree.ParseError, ValueError, OSError) as error:
        if isinstance(error, LogError):
            raise
        raise LogError(f"{name}: cannot be read as XML: {error}") from error
    if root is None or re.split("[}.]", root.tag)[-1] != tag:
        raise LogError(f"{name}: an outermost element <{tag}> was expected")
    return root


def content_of(path: Path, most: int, *, private: bool = False) -> bytes:
    """Return what a file in somebody's folder contains: at most so many bytes; if `private`, of this user alone.

    Raises:
        OSError: there is none, it is a pipe, a link or a folder, is larger, or cannot be read; `strerror` says which.
    """
    try:
        descriptor = os.open(path, os.O_RDONLY | NO_TRICKS)
    except OSError as error:
        reason = "is a link; a file was expected" if error.errno == errno.ELOOP else error.strerror
        raise OSError(error.errno, reason, str(path)) from error
    with open(descriptor, "rb") as file:
        status = os.fstat(descriptor)
        if not stat.S_ISREG(status.st_mode):
            raise OSError(errno.EINVAL, "is no file", str(path))
        if private:
            check_private(status, path)
        if status.st_size > most:
            raise OSError(errno.EFBIG, f"{status.st_size} bytes, at most {most} were expected", str(path))
        return file.read(most)


def check_private(status: os.stat_result, path: Path) -> None:
    """Raise PermissionError if a file or folder is another user's, or others may change it."""
    others = status.st_mode & (stat.S_IWGRP | stat.S_IWOTH)
    if others or status.st_uid != os.geteuid():
        reason = "can be changed by other users" if others else "belongs to another user"
        raise PermissionError(errno.EPERM, reason, str(path))


def plain_json(text: bytes) -> dict[str, Any]:
    """Read a JSON object. Raises ValueError, also for NaN, infinity and what nests too deep."""
    try:
        return dict(json.loads(text, parse_float=_finite, parse_constant=_finite))
    except (TypeError, RecursionError) as error:
        raise ValueError(f"an object was expected: {error}") from error


def _finite(text: str) -> float:
    if not math.isfinite(number := float(text)):
        raise ValueError(f"{text}: a finite number was expected")
    return number
