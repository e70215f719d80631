"""Pinocchio's results, and arrays of our own, as kernels see them: views of memory that cost nothing to make."""

from __future__ import annotations

import ctypes
from typing import Any

import numba
import numpy as np
import pinocchio as pin
from numba import carray, farray, types
from numba.extending import intrinsic

from aerobat_pin.numerics.arrays import Array
from aerobat_pin.numerics.jit import Integers, inner, kernel

DOUBLE = 8  # bytes
SE3_SIZE, MOTION_SIZE = 12, 6  # doubles: rotation by columns then translation; linear then angular


def placements(vector: Any) -> Array:
    """View `data.oMi` or `data.liMi` as (njoints, 12): each rotation by columns, then the translation."""
    return _view_rows(vector[0].rotation, len(vector), SE3_SIZE)


def motions(vector: Any) -> Array:
    """View `data.v` or `data.a_gf` as (njoints, 6): linear, then angular."""
    return _view_rows(vector[0].vector, len(vector), MOTION_SIZE)


def _view_rows(first: Array, count: int, size: int) -> Array:
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
    """Return where the doubles of some arrays lie, for `doubles_at`. The caller keeps the arrays alive."""
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
    """View doubles at an address, by rows. It costs nothing: unlike a slice, it counts no references."""
    return carray(_double(address), shape)


@inner
def integers_at(address: int, shape: tuple[int, ...]) -> Any:
    """View integers at an address, by rows."""
    return carray(_integer(address), shape)
