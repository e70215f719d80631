"""Compiled kernels: numba with its cache on disk, and Pinocchio's results as arrays that never need copying.

Pinocchio's Python calls cost little more than their C++ time; numpy's small operations between them cost far more. A
kernel is one compiled call between two Pinocchio calls, a pure function of arrays. Each has a numpy twin in the tests.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any, TypeVar, cast

import numba
import numpy as np
from numpy.typing import NDArray

Function = TypeVar("Function", bound=Callable[..., Any])
Integers = NDArray[np.intp]
KERNEL_SOURCES = (
    "aerodynamics/added_mass.py",
    "aerodynamics/body_surfaces.py",
    "aerodynamics/lifting_line.py",
    "aerodynamics/links.py",
    "aerodynamics/memory.py",
    "aerodynamics/quasi_steady.py",
    "aerodynamics/robot_air.py",
    "aerodynamics/robot_in_air.py",
    "aerodynamics/strip_forces.py",
    "estimation/believed_air_kernels.py",
    "flight/attitude_hold.py",
    "flight/plant/kernels.py",
    "flight/plant/memory.py",
    "numerics/jit.py",
    "numerics/lie_runge_kutta.py",
    "numerics/matrix_products.py",
    "numerics/memory.py",
    "numerics/pinocchio_views.py",
    "numerics/small_matrices.py",
    "observers/kalman/kernels.py",
    "observers/kalman/memory.py",
    "observers/kalman/smoother_kernels.py",
    "observers/kernels/filters.py",
    "observers/kernels/memory.py",
    "observers/kernels/projection.py",
    "observers/kernels/residual.py",
    "robot/link_kernels.py",
)


def kernel(function: Function) -> Function:
    """Compile a function on its first call, and keep the result on disk where a cache can be written."""
    return _compiled(function)


def inner(function: Function) -> Function:
    """Make a kernel that only kernels call: it compiles faster, because Python cannot call it."""
    return _compiled(function, no_cpython_wrapper=True)


def merged(function: Function) -> Function:
    """Make a kernel that becomes part of the kernels that call it: a name in it that nobody uses costs nothing there.

    So are the layouts of a memory; Python reads them by `memory.fields_of`, which waits for no compiler.
    """
    return _compiled(function, inline="always")


def _compiled(function: Function, **more: Any) -> Function:
    options: dict[str, Any] = {
        "error_model": "numpy",  # and no fastmath: see design note 4 on the same numbers everywhere
        "no_cfunc_wrapper": True,  # nobody calls a kernel from C
        **more,
    }
    try:
        compiled = numba.njit(cache=True, **options)(function)
    except RuntimeError:  # numba found no folder for its cache
        return cast(Function, numba.njit(**options)(function))
    with suppress(AttributeError):  # a numba that keeps its stamp elsewhere
        # numba looks for changes in a kernel's own file only, but the kernels that it calls are compiled into it.
        compiled._cache._cache_file._source_stamp = sources_stamp()
        # What is outdated is not even unpickled: the classes in its signatures may be gone.
        compiled._cache._cache_file._version = f"{numba.__version__} {sources_stamp()}"
    return cast(Function, compiled)


@cache
def sources_stamp() -> tuple[tuple[str, int, int], ...]:
    """Return name, time and size of every file whose code ends up in a kernel: a change in one outdates all."""
    package = Path(__file__).parents[1]
    files = (package / name for name in KERNEL_SOURCES)
    return tuple((str(file.relative_to(package)), file.stat().st_mtime_ns, file.stat().st_size) for file in files)


def is_compiled(entry: Any) -> bool:
    """Tell whether the cache holds an up-to-date compilation of a kernel, or the compiler is switched off."""
    if numba.config.DISABLE_JIT:
        return True
    try:
        return bool(entry._cache._cache_file._load_index())
    except AttributeError:  # no cache, or a numba that keeps it elsewhere
        return False


def announce_compilation(entry: Any) -> None:
    """Say on stderr that a kernel is about to be compiled, unless an earlier run left it in the cache."""
    if not is_compiled(entry) and not entry.signatures:
        print("compiling the kernels: once per installation, about 20 s", file=sys.stderr, flush=True)


def lock(entry: Any, *arguments: Any) -> None:
    """Compile a kernel for the types of these arguments, by calling it; from then on other types raise TypeError."""
    if not numba.config.DISABLE_JIT and not entry.signatures:
        entry(*arguments)
        entry.disable_compile()
