"""Say which kernel is being compiled, whoever calls it: numba tells of all that its cache does not hold."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from numba.core import event

OURS = "aerobat_pin."


class _Compilations(event.Listener):  # type: ignore[misc]  # numba has no types
    """Call a function when a kernel of ours that Python called begins to compile; those within it are part of it."""

    def __init__(self, tell: Callable[[str], None]) -> None:
        self._tell, self._depth = tell, 0

    def on_start(self, found: Any) -> None:
        function = found.data["dispatcher"].py_func
        if self._depth == 0 and function.__module__.startswith(OURS):
            room = function.__module__.split(".")[1]
            self._tell(f"compiling {function.__name__} of {room}, once per installation: some seconds to a minute")
        self._depth += 1

    def on_end(self, found: Any) -> None:
        self._depth -= 1


@contextmanager
def told_of_compilation(tell: Callable[[str], None]) -> Iterator[None]:
    """Call `tell` with a line of text whenever a kernel begins to compile during a `with` block."""
    with event.install_listener("numba:compile", _Compilations(tell)):
        yield
