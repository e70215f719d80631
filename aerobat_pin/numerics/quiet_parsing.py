"""Call Pinocchio's parsers, which print their reasons to standard error and can leave parts out."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

from aerobat_pin.errors import LogError

Loaded = TypeVar("Loaded")
LONGEST_REASON = 300  # characters


def read_robot(path: Path, read: Callable[[], Loaded]) -> Loaded:
    """Call a function of Pinocchio that reads a robot's file.

    Args:
        path: the file, for the message.
        read: the function.

    Raises:
        LogError: with the parser's reasons, if it fails or leaves something out.
    """
    with tempfile.TemporaryFile() as said:
        stderr = os.dup(2)
        os.dup2(said.fileno(), 2)
        try:
            loaded, reason = read(), ""
        except (ValueError, RuntimeError) as error:
            reason = " ".join(str(error).rpartition("message: ")[2].partition("\nHint")[0].split()) or "no reason given"
        finally:
            os.dup2(stderr, 2)
            os.close(stderr)
        said.seek(0)
        lines = said.read().decode(errors="replace").splitlines()
    errors = [line.removeprefix("Error:").strip() for line in lines if line.startswith("Error:")]
    if errors or reason:
        raise LogError(f"robot {path}: Pinocchio cannot read it: {'; '.join(errors) or reason[:LONGEST_REASON]}")
    return loaded
