"""Compiled kernels: numba with its cache on disk, and Pinocchio's results as arrays that never need copying.

Pinocchio's Python calls cost little more than their C++ time; numpy's small operations between them are what costs. A
kernel is one compiled call between two Pinocchio calls, a pure function of arrays. Each has a numpy twin in the tests.
"""

from __future__ import annotations

import ctypes
import sys
from collections.abc import Callable
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any, TypeVar, cast

import numba
import numpy as np
import pinocchio as pin
from numba import carray, farray, types
from numba.extending import intrinsic
from numpy.typing import NDArray

from aerobat_pin.arrays import Array

Function = TypeVar("Function", bound=Callable[..., Any])
Integers = NDArray[np.intp]
KERNEL_SOURCES = (
    "jit.py",
    "hold.py",
    "integrators.py",
    "plant_kernels.py",
    "plant_layout.py",
    "reconstruction_kernels.py",
    "added_mass.py",
    "aerodynamics/lifting_line.py",
    "aerodynamics/quasi_steady.py",
    "aerodynamics/robot_air.py",
    "aerodynamics/strips.py",
    "aerodynamics/surfaces.py",
    "observers/filters.py",
    "observers/kalman_kernels.py",
    "observers/kalman_store.py",
    "observers/kernels.py",
    "observers/products.py",
    "observers/projection.py",
    "observers/record.py",
    "observers/smoother_kernels.py",
    "observers/store.py",
)
DOUBLE = 8  # bytes
SE3_SIZE, MOTION_SIZE = 12, 6  # doubles: rotation by columns then translation; linear then angular


def kernel(function: Function) -> Function:
    """Compile a function on its first call, and keep the result on disk where a cache can be written."""
    return _compiled(function)


def inner(function: Function) -> Function:
    """Make a kernel that only kernels call: without a door for Python's arguments it compiles faster."""
    return _compiled(function, no_cpython_wrapper=True)


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
        compiled._cache._cache_file._source_stamp = sources_stamp()
    return cast(Function, compiled)


@cache
def sources_stamp() -> tuple[tuple[str, int, int], ...]:
    """Return name, time and size of every file whose code ends up in a kernel: a change in one outdates all."""
    package = Path(__file__).parent
    files = (package / name for name in KERNEL_SOURCES)
    return tuple((file.name, file.stat().st_mtime_ns, file.stat().st_size) for file in files)


def is_compiled(entry: Any) -> bool:
    """Tell whether an up-to-date compilation of a kernel lies in the cache (or none is wanted)."""
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
    """Compile a kernel for these arguments' types, by calling it, and for no others: they raise TypeError."""
    if not numba.config.DISABLE_JIT and not entry.signatures:
        entry(*arguments)
        entry.disable_compile()


def placements(vector: Any) -> Array:
    """View `data.oMi` or `data.liMi` as (njoints, 12): each rotation by columns, then the translation."""
    return _rows(vector[0].rotation, len(vector), SE3_SIZE)


def motions(vector: Any) -> Array:
    """View `data.v` or `data.a_gf` as (njoints, 6): linear, then angular."""
    return _rows(vector[0].vector, len(vector), MOTION_SIZE)


def _rows(first: Array, count: int, size: int) -> Array:
    """View `count` equal objects that lie one after the other in memory, from a view of the first one's start."""
    step = size * first.itemsize
    return np.lib.stride_tricks.as_strided(first.ravel(order="F")[:1], (count, size), (step, first.itemsize))


def check_views(model: pin.Model, data: pin.Data, oMi: Array, liMi: Array, v: Array, a_gf: Array | None = None) -> None:
    """Raise RuntimeError unless the views show what Pinocchio computes; its memory layout is not documented."""
    q = pin.integrate(model, pin.neutral(model), np.linspace(0.1, 0.4, model.nv))
    pin.forwardKinematics(model, data, q, np.linspace(-0.3, 0.2, model.nv))
    pin.nonLinearEffects(model, data, q, np.linspace(-0.3, 0.2, model.nv))
    for joint in range(model.njoints):
        for view, placement in ((oMi, data.oMi[joint]), (liMi, data.liMi[joint])):
            expected = np.concatenate([placement.rotation.ravel(order="F"), placement.translation])
            if joint > 0 and not np.array_equal(view[joint], expected):
                raise RuntimeError("Pinocchio's placements do not lie in memory as this version expects")
        if not np.array_equal(v[joint], data.v[joint].vector):
            raise RuntimeError("Pinocchio's velocities do not lie in memory as this version expects")
        if a_gf is not None and not np.array_equal(a_gf[joint], data.a_gf[joint].vector):
            raise RuntimeError("Pinocchio's accelerations do not lie in memory as this version expects")


def _pointers(here: Any, there: Any) -> Any:
    """Return a function that turns an address into a pointer, to a ctypes or to a numba kind of number."""
    if numba.config.DISABLE_JIT:  # kernels run as plain Python
        return lambda address: ctypes.cast(int(address), ctypes.POINTER(here))

    @intrinsic  # type: ignore[untyped-decorator]
    def pointer(_: Any, address: Any) -> Any:
        kind = types.CPointer(there)
        return kind(types.intp), lambda context, builder, _, args: builder.inttoptr(
            args[0], context.get_value_type(kind)
        )

    return pointer


_double, _integer = _pointers(ctypes.c_double, types.float64), _pointers(ctypes.c_ssize_t, types.intp)


def addresses(*arrays: Array) -> Integers:
    """Return where the doubles of some arrays lie, for `doubles_at`. Whoever keeps this keeps the arrays alive too."""
    for array in arrays:
        if array.dtype != np.float64 or not (array.flags.f_contiguous or array.flags.c_contiguous):
            raise RuntimeError("only contiguous arrays of doubles can be handed over by address")
    return np.array([array.ctypes.data for array in arrays], dtype=np.intp)


@kernel
def doubles_at(address: int, rows: int, columns: int) -> Any:
    """View (rows, columns) doubles at an address, by columns, as Eigen keeps a matrix."""
    return farray(_double(address), (rows, columns))


@inner
def array_at(address: int, shape: tuple[int, ...]) -> Any:
    """View doubles at an address, by rows. Unlike a slice or `reshape` it costs nothing: nobody counts who looks."""
    return carray(_double(address), shape)


@inner
def integers_at(address: int, shape: tuple[int, ...]) -> Any:
    """View integers at an address, by rows."""
    return carray(_integer(address), shape)


@inner
def copy_values(source: Array, target: Array) -> None:
    """Copy a vector. `target[:] = source` would compile for two seconds more, for the sake of its error message."""
    for i in range(target.shape[0]):
        target[i] = source[i]


@inner
def dot(a: Array, b: Array) -> float:
    """Return the inner product of two vectors, summed in four lanes that need not wait for each other."""
    n = a.shape[0]
    one, two, three, four = 0.0, 0.0, 0.0, 0.0
    for i in range(n // 4):
        one += a[4 * i] * b[4 * i]
        two += a[4 * i + 1] * b[4 * i + 1]
        three += a[4 * i + 2] * b[4 * i + 2]
        four += a[4 * i + 3] * b[4 * i + 3]
    for i in range(n - n % 4, n):
        one += a[i] * b[i]
    return (one + two) + (three + four)


@kernel
def solve_positive(A: Array, b: Array) -> float:
    """Solve A x = b in place (x overwrites b, A is destroyed), A (n, n) symmetric positive definite, by Cholesky.

    For n of some six: LAPACK's call alone costs several times as much. Only the lower triangle is read. Returns the
    smallest pivot, which shows how near to singular A is.
    """
    n = b.shape[0]
    least = np.inf
    for j in range(n):
        for k in range(j):
            A[j, j] -= A[j, k] * A[j, k]
        least = min(least, A[j, j])
        A[j, j] = np.sqrt(A[j, j])
        scale = 1.0 / A[j, j]
        for i in range(j + 1, n):
            for k in range(j):
                A[i, j] -= A[i, k] * A[j, k]
            A[i, j] *= scale
    # Reciprocals of the diagonal wait for nothing, where a division of b would wait for b.
    for i in range(n):
        for k in range(i):
            b[i] -= A[i, k] * b[k]
        b[i] *= 1.0 / A[i, i]
    for i in range(n - 1, -1, -1):
        for k in range(i + 1, n):
            b[i] -= A[k, i] * b[k]
        b[i] *= 1.0 / A[i, i]
    return least


@inner
def eigenvectors(A: Array, V: Array) -> None:
    """Diagonalise A (n, n), symmetric, in place, and write its eigenvectors into the columns of V: cyclic Jacobi."""
    n = A.shape[0]
    V[:] = 0.0
    for i in range(n):
        V[i, i] = 1.0
    for _ in range(30):
        off, size = 0.0, 0.0
        for i in range(n):
            size += A[i, i] * A[i, i]
            for j in range(i):
                off += A[i, j] * A[i, j]
        if not off > 1e-32 * size:
            return
        for p in range(n - 1):
            for q in range(p + 1, n):
                if A[p, q] == 0.0:
                    continue
                slope = 0.5 * (A[q, q] - A[p, p]) / A[p, q]
                t = (1.0 if slope >= 0.0 else -1.0) / (abs(slope) + np.sqrt(slope * slope + 1.0))
                c = 1.0 / np.sqrt(t * t + 1.0)
                s = t * c
                for k in range(n):
                    A[k, p], A[k, q] = c * A[k, p] - s * A[k, q], s * A[k, p] + c * A[k, q]
                for k in range(n):
                    A[p, k], A[q, k] = c * A[p, k] - s * A[q, k], s * A[p, k] + c * A[q, k]
                    V[k, p], V[k, q] = c * V[k, p] - s * V[k, q], s * V[k, p] + c * V[k, q]
