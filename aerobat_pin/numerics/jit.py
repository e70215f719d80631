"""Compiled kernels: numba with its cache on disk, and Pinocchio's results as arrays that never need copying.

Pinocchio's Python calls cost little more than their C++ time; numpy's small operations between them cost far more. A
kernel is one compiled call between two Pinocchio calls, a pure function of arrays. Each has a numpy twin in the tests.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from contextlib import suppress
from functools import cache, partial
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
    "aerodynamics/quasi_steady.py",
    "aerodynamics/robot_air.py",
    "aerodynamics/strips.py",
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


def layout(function: Function) -> Function:
    """Make a kernel that is compiled into its callers: what takes views of a memory then costs nothing (see `memory`).

    As a call, the Kalman filter's layout alone would cost a tenth of its update.
    """
    return _compiled(function, forceinline=True)


def _compiled(function: Function, **more: bool) -> Function:
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
        file = compiled._cache._cache_file
        file._source_stamp, file._load_index = sources_stamp(), partial(_index_of, file._load_index)
    return cast(Function, compiled)


def _index_of(load: Callable[[], Any]) -> Any:
    """Read the index of a kernel's cache, or nothing where it names a class that has since been renamed or moved."""
    try:
        return load()
    except (AttributeError, ImportError):
        return {}


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
