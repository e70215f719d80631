"""Views of Pinocchio's results and of other arrays in memory, which kernels make from addresses without copying."""

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
SE3_SIZE, MOTION_SIZE = 12, 6  # number of doubles: rotation by columns, then translation; linear, then angular part


def placements(vector: Any) -> Array:
    """Return a view (njoints, 12) of `data.oMi` or `data.liMi`: each rotation by columns, then the translation."""
    return _view_rows(vector[0].rotation, len(vector), SE3_SIZE)


def motions(vector: Any) -> Array:
    """Return a view (njoints, 6) of `data.v` or `data.a_gf`: linear part, then angular part."""
    return _view_rows(vector[0].vector, len(vector), MOTION_SIZE)


def _view_rows(first: Array, count: int, size: int) -> Array:
    """Return a view (count, size) of consecutive equal objects in memory; `first` views the start of the first."""
    step = size * first.itemsize
    return np.lib.stride_tricks.as_strided(first.ravel(order="F")[:1], (count, size), (step, first.itemsize))


def check_views(model: pin.Model, data: pin.Data, oMi: Array, liMi: Array, v: Array, a_gf: Array | None = None) -> None:
    """Raise RuntimeError unless the views show Pinocchio's results, whose layout in memory is not documented."""
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


def _pointer_function() -> Any:
    """Return a function that turns an address into a pointer to a double."""
    if numba.config.DISABLE_JIT:  # kernels run as plain Python
        return lambda address: ctypes.cast(int(address), ctypes.POINTER(ctypes.c_double))

    @intrinsic  # type: ignore[untyped-decorator]
    def pointer(_: Any, address: Any) -> Any:
        kind = types.CPointer(types.float64)
        return kind(types.intp), lambda context, builder, _, args: builder.inttoptr(
            args[0], context.get_value_type(kind)
        )

    return pointer


_double = _pointer_function()


def addresses(*arrays: Array) -> Integers:
    """Return the memory addresses of arrays of doubles, for `doubles_at`. The caller must keep the arrays alive."""
    for array in arrays:
        if array.dtype != np.float64 or not (array.flags.f_contiguous or array.flags.c_contiguous):
            raise RuntimeError("only contiguous arrays of doubles can be passed by address")
    return np.array([array.ctypes.data for array in arrays], dtype=np.intp)


@kernel
def doubles_at(address: int, rows: int, columns: int) -> Any:
    """Return a view (rows, columns) of doubles at an address, stored by columns as in Eigen."""
    return farray(_double(address), (rows, columns))


@inner
def array_at(address: int, shape: tuple[int, ...]) -> Any:
    """Return a row-major view of doubles at an address. Unlike a slice, it costs nothing: no references are counted."""
    return carray(_double(address), shape)
