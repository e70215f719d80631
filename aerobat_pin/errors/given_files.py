"""Read files that somebody else may have made: no link, no pipe, no more than expected, no JSON that cannot be."""

from __future__ import annotations

import errno
import json
import math
import os
import stat
from pathlib import Path
from typing import Any

NO_TRICKS = os.O_NOFOLLOW | os.O_NONBLOCK  # follow no link, wait for no pipe


def content_of(path: Path, most: int, *, private: bool = False) -> bytes:
    """Return what a file in somebody's folder contains.

    Args:
        path: the file.
        most: number of bytes that it may have.
        private: it must belong to this user, and nobody else may be allowed to change it.

    Raises:
        FileNotFoundError: there is none.
        OSError: it is a pipe, a link, a folder or another thing that this package does not write, or it is larger than
            `most` bytes, or it cannot be read; `strerror` says which.
    """
    try:
        descriptor = os.open(path, os.O_RDONLY | NO_TRICKS)
    except OSError as error:
        if error.errno == errno.ELOOP:
            raise OSError(error.errno, "is a link; a file was expected", str(path)) from error
        raise
    with open(descriptor, "rb") as file:
        found = os.fstat(descriptor)
        if not stat.S_ISREG(found.st_mode):
            raise OSError(errno.EINVAL, "is no file", str(path))
        if private:
            check_private(found, path)
        if found.st_size > most:
            raise OSError(errno.EFBIG, f"{found.st_size} bytes, at most {most} were expected", str(path))
        return file.read(most)


def check_private(found: os.stat_result, path: Path) -> None:
    """Raise PermissionError if a file or folder is another user's, or others may change it."""
    if found.st_uid != os.geteuid():
        raise PermissionError(errno.EPERM, "belongs to another user", str(path))
    if found.st_mode & (stat.S_IWGRP | stat.S_IWOTH):
        raise PermissionError(errno.EPERM, "can be changed by other users", str(path))


def plain_json(text: bytes) -> dict[str, Any]:
    """Read a JSON object. Raises ValueError, also for NaN, infinity and what nests too deep."""
    try:
        return dict(json.loads(text, parse_float=_finite, parse_constant=_finite))
    except (TypeError, RecursionError) as error:
        raise ValueError(f"an object was expected: {error}") from error


def _finite(text: str) -> float:
    number = float(text)
    if not math.isfinite(number):
        raise ValueError(f"{text}: a finite number was expected")
    return number
