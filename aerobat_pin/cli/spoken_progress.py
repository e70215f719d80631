"""What a command says while something takes long: a line whenever it was silent, from the first moment on.

Only the standard library is imported, so that it can speak while libraries are loaded.
"""

from __future__ import annotations

import os
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress

QUIET = 1.4  # [s]: a command that is faster says nothing about its stages, and none is silent for longer
LINE_EVERY, LONG = 10.0, 60.0  # [s] between lines of a command that takes longer than `LONG`
TICK_TIME = 0.1  # [s]
STARTING = "starting"


class Voice:
    """Prints what a command does whenever it was silent for `QUIET`, also while one step takes long."""

    def __init__(self) -> None:
        self._doing, self._said, self._resting = STARTING, "", True
        self._begin = self._last = time.monotonic()

    def __call__(self, label: str, share: float) -> None:
        """Update the name of the stage and the share of it that is done."""
        self._doing = label if share == 0.0 else f"{label}: {100.0 * share:.0f} %"

    def tick(self) -> None:
        """Print what is being done, if nothing was printed for a while; the same again with the seconds so far."""
        now = time.monotonic()
        if sys.stderr is not None and now - self._last > (QUIET if now - self._begin < LONG else LINE_EVERY):
            self._last = now
            again = f", {now - self._begin:.0f} s" if self._said == self._doing else ""
            self._said = self._doing
            # past Python's buffers, whose lock a process that is forked meanwhile would inherit
            with suppress(OSError):
                os.write(2, f"{self._doing}{again}\n".encode())

    @contextmanager
    def resting(self) -> Iterator[None]:
        """Say nothing during a `with` block, which shows itself."""
        before, self._resting = self._resting, True
        try:
            yield
        finally:
            self._resting, self._last = before, time.monotonic()

    @contextmanager
    def speaking(self) -> Iterator[None]:
        """Speak during a `with` block, by a thread, unless that runs already."""
        if not self._resting:
            yield
            return
        over = threading.Event()
        self._doing, self._said, self._resting = STARTING, "", False
        self._begin = self._last = time.monotonic()

        def watch() -> None:
            while not over.wait(TICK_TIME):
                if not self._resting:
                    self.tick()

        thread = threading.Thread(target=watch, daemon=True)
        thread.start()
        try:
            yield
        finally:
            self._resting = True
            over.set()
            thread.join()


voice = Voice()
