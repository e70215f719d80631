"""The door for files of strangers: what a file must be before a library sees it.

| a file | must be | before |
|---|---|---|
| any | a regular file (a named pipe waits for ever), of a size | every reader of this package |
| XML | at most `DEEPEST_XML` levels and `MOST_ELEMENTS` elements | Pinocchio, which calls itself for each level |
| compressed | at most `MOST_UNPACKED` bytes at a time, `MOST_TIMES_LARGER` than the file in all | rosbags |

NetCDF: `records/checked_netcdf.py`. TOML: `aerobat_description/toml_text.py`. Only the
standard library is imported.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING

from aerobat_pin.errors.exceptions import LogError

if TYPE_CHECKING:
    from xml.etree.ElementTree import Element

LARGEST_XML = 100_000_000  # bytes: a mesh as Collada
DEEPEST_XML, MOST_ELEMENTS = 100, 200_000
MOST_UNPACKED = 50_000_000  # bytes in memory at a time: a chunk of a recorder has some 1e6
MOST_TIMES_LARGER = 300  # than its file is all that a file unpacks to; LZ4 cannot make it more than 255 times


def foreign_file(path: str | Path, name: str, largest: float = float("inf")) -> Path:
    """Return the path of a regular file that is not too large.

    Args:
        path: the file.
        name: what it is, with its path; the message begins with it.
        largest: number of bytes that it may have.

    Raises:
        LogError: there is no such file, it is a folder, pipe or device, or too large.
    """
    if not os.path.isfile(path):  # False also for names that no file can have
        found = os.path.exists(path)
        raise LogError(
            f"{name}: {'a folder, pipe or device: a file was expected' if found else 'there is no such file'}"
        )
    if (size := os.path.getsize(path)) > largest:
        raise LogError(f"{name}: {size} bytes: at most {largest} were expected")
    return Path(path)


def foreign_xml(path: Path, name: str, tag: str, largest: int = LARGEST_XML) -> Element:
    """Return the outermost element of an XML file.

    Args:
        path: the file.
        name: what it is; the message begins with it.
        tag: name that the outermost element must have, without its namespace.
        largest: number of bytes that it may have.

    Raises:
        LogError: it is no XML, nests too deep, has too many elements, or has another outermost element.
    """
    from xml.etree import ElementTree

    foreign_file(path, name, largest)
    level, count = 0, 0
    root: Element | None = None
    try:
        for event, element in ElementTree.iterparse(path, ("start", "end")):
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
    if root is None or root.tag.rpartition("}")[2] != tag:
        raise LogError(f"{name}: an outermost element <{tag}> was expected")
    return root
