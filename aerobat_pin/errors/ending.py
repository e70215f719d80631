"""How Ctrl-C (SIGINT), SIGTERM and SIGHUP end the program: clean up, say in one line what was written, exit.

The handler does all of this itself and does not raise an exception: libraries lose an exception that comes in one of
their callbacks, and turn one that comes while they are imported into a traceback.
"""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from types import FrameType

SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


class _Now:
    """What the handler has to know at this moment."""

    def __init__(self) -> None:
        self.cleanups: list[Callable[[], object]] = []
        self.written: list[Path] = []
        self.depth = 0  # blocks `undisturbed` that are entered
        self.waiting = 0  # number of a signal that came in such a block
        self.raising = False


_now = _Now()


def end_on_signals() -> None:
    """From now on, signals end the program; one that is ignored stays so (in background jobs, under nohup)."""
    for number in SIGNALS:
        if signal.getsignal(number) != signal.SIG_IGN:
            signal.signal(number, _end)
    signal.signal(signal.SIGPIPE, signal.SIG_DFL)  # end quietly when the reader of a pipe closes it


@contextmanager
def cleaned(cleanup: Callable[[], object]) -> Iterator[None]:
    """Call a function when the `with` block ends, also if a signal ends the program in it; perhaps twice."""
    _now.cleanups.append(cleanup)
    try:
        yield
    finally:
        cleanup()
        _now.cleanups.remove(cleanup)


@contextmanager
def undisturbed() -> Iterator[None]:
    """Let signals wait until the `with` block has ended."""
    _now.depth += 1
    try:
        yield
    finally:
        _now.depth -= 1
        if _now.waiting and not _now.depth:
            waiting, _now.waiting = _now.waiting, 0
            _end(waiting, None)


@contextmanager
def raising() -> Iterator[Callable[[], bool]]:
    """Let the first signal raise KeyboardInterrupt (Ctrl-C) or SystemExit in the `with` block.

    For blocks in which other processes or threads have to be ended in order; a second signal ends the program at once.
    The function that it provides says whether a signal came, for loops whose callbacks may have lost the exception.
    """
    _now.raising = True
    try:
        yield lambda: not _now.raising
    finally:
        _now.raising = False


def until_signal(step: Callable[[], object]) -> None:
    """Repeat a step until a signal comes, also one whose exception was lost in a callback. Ctrl-C returns."""
    with suppress(KeyboardInterrupt), raising() as interrupted:
        while not interrupted():
            step()


def written(path: Path) -> None:
    """Record that a file or folder was written, for the last line of an interrupted program."""
    _now.written.append(path)


def _end(number: int, frame: FrameType | None) -> None:
    """Handle a signal: end the program with exit code 128 + number, or do what the block around says."""
    if _now.depth:
        _now.waiting = number
        return
    if _now.raising:
        _now.raising = False
        raise KeyboardInterrupt if number == signal.SIGINT else SystemExit(128 + number)
    for other in (*SIGNALS, signal.SIGPIPE):  # a pool's thread may write to a helper that is gone
        signal.signal(other, signal.SIG_IGN)
    for step in (*reversed(_now.cleanups), _end_helpers, sys.stdout.flush, sys.stderr.flush, _say_what_was_written):
        with suppress(Exception):  # a closed pipe, for instance
            step()
    os._exit(128 + number)


def _end_helpers() -> None:
    """End the processes of a pool, which would wait for its next task, also when the program is gone."""
    if "multiprocessing" in sys.modules:
        for process in sys.modules["multiprocessing"].active_children():
            with suppress(Exception):
                process.kill()


def _say_what_was_written() -> None:
    line = "nothing was written"
    if _now.written:
        first, *others = _now.written
        line = f"{first} had been written and is whole"
        if others:
            line = f"{first} and {len(others)} more had been written and are whole"
    os.write(2, f"interrupted: {line}\n".encode())
