"""Check what a shell gives a program: standard streams, a current folder, memory. Imports the standard library only."""

from __future__ import annotations

import os
import resource
import sys

LEAST_MEMORY = 1_000_000_000  # [bytes] of addresses; numpy, Pinocchio and numba alone take 700,000,000


def prepare_surroundings() -> None:
    """End the program with one line and exit code 2 where it could not work; make good what it does not need."""
    missing = []
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:
            missing.append(number)  # or the next file that is opened would get this number, and what is printed
            os.open(os.devnull, os.O_RDWR)
    if sys.stderr is None:
        sys.stderr = open(2, "w", closefd=False)
    os.environ["MPLBACKEND"] = "agg"  # no window is opened, whatever the user's other programs show
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # of small matrices, more only wait for each other
    if reason := _refusal(missing):
        print(f"error: {reason}", file=sys.stderr)
        raise SystemExit(2)


def _refusal(missing: list[int]) -> str:
    """Return what no command can do without, and how to get it, or nothing."""
    if 1 in missing:
        return "standard output is closed; a file or a terminal was expected, such as >/dev/null"
    try:
        os.getcwd()
    except OSError as error:
        return f"the current folder: {error.strerror}; a folder that exists was expected"
    limit = resource.getrlimit(resource.RLIMIT_AS)[0]
    if 0 <= limit < LEAST_MEMORY:
        return f"{limit / 1e6:.0f} MB of memory (ulimit -v); {LEAST_MEMORY / 1e6:.0f} MB at least were expected"
    return ""
