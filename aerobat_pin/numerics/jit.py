"""Decorators that compile functions to kernels with numba, the cache of compiled kernels, and news of compilation.

A call of Pinocchio from Python takes little longer than in C++, but small numpy operations between such calls take much
longer. A kernel replaces these operations by one compiled call: a function of arrays that reads Pinocchio's results in
place. The tests compare each kernel with an independent implementation in numpy.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import cache
from pathlib import Path
from typing import Any, TypeVar, cast

import numba
import numpy as np
from numba.core import event
from numpy.typing import NDArray

from aerobat_pin.numerics.kernel_cache import KernelCache

Function = TypeVar("Function", bound=Callable[..., Any])
Integers = NDArray[np.intp]
OURS = "aerobat_pin."
# Of files with kernels, and with their states.
KERNEL_MARKS = (b"\n@kernel\n", b"\n@inner\n", b"\n@inlined\n", b": Annotated[Array, ", b": Annotated[Integers, ")


def kernel(function: Function) -> Function:
    """Compile a function on its first call, and store the result on disk if a cache folder is writable."""
    return _compiled(function)


def inner(function: Function) -> Function:
    """Make a kernel that only other kernels can call. It compiles faster, because it needs no interface to Python."""
    return _compiled(function, no_cpython_wrapper=True)


def inlined(function: Function) -> Function:
    """Make a kernel that becomes part of those that call it, and is not compiled alone.

    Machine code of a kernel contains that of all which it calls: what stands between Python and long kernels, and has
    one or two callers, would be compiled once more at each level.
    """
    return _compiled(function, inline="always", no_cpython_wrapper=True)


def _compiled(function: Function, **more: Any) -> Function:
    options: dict[str, Any] = {
        "error_model": "numpy",  # fastmath is not used, so that results are the same on all machines: design note 4
        "no_cfunc_wrapper": True,  # kernels are not called from C
        **more,
    }
    compiled = numba.njit(**options)(function)  # without numba's own cache, which runs whatever file it finds
    # There is no cache if numba finds no folder to write to, or no file in which the function stands (RuntimeError), or
    # if another numba version keeps its files elsewhere.
    with suppress(AttributeError, RuntimeError):
        # numba checks only the kernel's own file for changes, but the kernels that it calls are compiled into it.
        compiled._cache = KernelCache(function, sources_stamp())
        compiled.compile = compiled._cache.by_one_process()(compiled.compile)
    return cast(Function, compiled)


@cache
def sources_stamp() -> tuple[tuple[str, int, int], ...]:
    """Return name, time and size of every file that kernels are made of; a change in any invalidates all kernels.

    They are those with a kernel or the table of a state, and those from which these import constants: by name, or by a
    room's door.
    """
    package, files = Path(__file__).parents[1], {Path(__file__)}
    doors = dict[bytes, Path]()
    for door in package.rglob("__init__.pyi"):
        for module, name in re.findall(rb"^from \.(\S+) import ([A-Z][A-Z_]+) as", door.read_bytes(), re.MULTILINE):
            doors[name] = door.parent / f"{module.decode().replace('.', '/')}.py"
    for file in package.rglob("*.py"):
        text = file.read_bytes()
        if any(mark in text for mark in KERNEL_MARKS):
            imported = re.findall(rb"^from aerobat_pin\.(\S+) import", text, re.MULTILINE)
            constants = doors.keys() & set(re.findall(rb"\b[A-Z][A-Z_]+\b", text))
            files |= {file, *(package / f"{name.decode().replace('.', '/')}.py" for name in imported)}
            files |= {doors[name] for name in constants}
    stats = ((file.relative_to(package), file.stat()) for file in sorted(files) if file.exists())
    return tuple((str(name), stat.st_mtime_ns, stat.st_size) for name, stat in stats)


def is_compiled(entry: Any) -> bool:
    """Return whether the cache holds an up-to-date compilation of a kernel, or the compiler is switched off."""
    if numba.config.DISABLE_JIT:
        return True
    try:
        return bool(entry._cache._cache_file._load_index())
    except AttributeError:  # no cache, or another numba version that stores it elsewhere
        return False


def announce_compilation(entry: Any) -> None:
    """Print on stderr that a kernel is about to be compiled, unless the cache already holds it."""
    if not (numba.config.DISABLE_JIT or entry.signatures or is_compiled(entry)):  # the last reads a file
        print("compiling the kernels: once per installation, 10 to 30 s", file=sys.stderr, flush=True)


def lock(entry: Any, *arguments: Any) -> None:
    """Compile a kernel by calling it with these arguments; after that, arguments of other types raise TypeError."""
    if not numba.config.DISABLE_JIT and not entry.signatures:
        entry(*arguments)
        entry.disable_compile()


def kernels_within(entry: Any) -> int:
    """Return how many kernels have to be compiled for one: itself, and those that it calls by their names."""
    kernels, waiting = {entry}, [entry]
    while waiting:
        function = waiting.pop().py_func
        for name in function.__code__.co_names:
            named = function.__globals__.get(name)
            if hasattr(named, "py_func") and named not in kernels and not named.signatures:
                kernels.add(named)
                waiting.append(named)
    return sum("inline" not in each.targetoptions for each in kernels)


class _Compilations(event.Listener):  # type: ignore[misc]  # numba has no types
    """Call a function when a kernel of ours that Python called begins to compile, and as those within it are done."""

    def __init__(self, tell: Callable[[str, float], None]) -> None:
        self._tell, self._depth, self._ours = tell, 0, False
        self._what, self._count, self._done = "", 0, 0

    def on_start(self, event: Any) -> None:
        entry = event.data["dispatcher"]
        if self._depth == 0:
            module = entry.py_func.__module__
            self._ours = module.startswith(OURS)
            self._what = f"compiling {entry.py_func.__name__} of {module.split('.')[1]}" if self._ours else ""
            self._count, self._done = kernels_within(entry) if self._ours else 0, 0
            self._say()
        self._depth += 1

    def on_end(self, event: Any) -> None:
        self._depth -= 1
        self._done += event.data["dispatcher"].py_func.__module__.startswith(OURS)
        self._say()

    def _say(self) -> None:
        if self._ours:
            # Some are compiled again for other types of arguments.
            self._count = max(self._count, self._done + self._depth, 1)
            remaining = f"{self._count - self._done} of {self._count} kernels left"
            self._tell(f"{self._what}, {remaining}, once per installation", self._done / self._count)


@contextmanager
def told_of_compilation(tell: Callable[[str, float], None]) -> Iterator[None]:
    """Call `tell` with a line of text and the share that is done while kernels are compiled during a `with` block."""
    with event.install_listener("numba:compile", _Compilations(tell)):
        yield
