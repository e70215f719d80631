"""Products of small matrices, computed with the processor's vector instructions.

For about ten rows, BLAS spends most of its time on the call itself. In plain loops the compiler cannot know whether
target and factors overlap, so it keeps no sums in registers: a sample takes 6 to 28 % longer (design note 7). The
instructions are therefore written here: blocks of up to four rows times sixteen columns of the target are summed in
registers over all k. Rows must be contiguous and can start at any address.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numba
import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

from aerobat_pin.numerics.arrays import Array
from aerobat_pin.numerics.jit import inner
from aerobat_pin.numerics.pinocchio_views import DOUBLE

TILES = ((4, (16, 8, 4, 2, 1)), (2, (16, 8, 4, 2, 1)), (1, (32, 16, 8, 4, 2, 1)))  # rows, then possible columns
WORD, REAL = ir.IntType(64), ir.DoubleType()


def _emit_tiles(_context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
    """Emit the instructions for C += scale A B, given the addresses and the strides in bytes."""
    c, c_row, a, a_row, a_column, b, b_row, m, depth, n, scale = arguments

    def place(start: Any, row: Any, stride: Any, offset: Any, kind: Any) -> Any:
        return builder.inttoptr(builder.add(builder.add(start, builder.mul(row, stride)), offset), kind.as_pointer())

    def read(where: Any) -> Any:
        value = builder.load(where)
        value.align = DOUBLE
        return value

    def repeated(value: Any, columns: int) -> Any:
        if columns == 1:
            return value
        empty = ir.Constant(ir.VectorType(REAL, columns), ir.Undefined)
        first = builder.insert_element(empty, value, ir.Constant(ir.IntType(32), 0))
        return builder.shuffle_vector(first, empty, ir.Constant(ir.VectorType(ir.IntType(32), columns), [0] * columns))

    def tile(i: Any, rows: int, j: Any, columns: int) -> None:
        kind = REAL if columns == 1 else ir.VectorType(REAL, columns)
        zero = ir.Constant(kind, 0.0 if columns == 1 else [0.0] * columns)
        name = "llvm.fma.f64" if columns == 1 else f"llvm.fma.v{columns}f64"  # fused multiply-add, which rounds once
        fused = cgutils.get_or_insert_function(builder.module, ir.FunctionType(kind, [kind] * 3), name)
        offset = builder.mul(j, WORD(DOUBLE))
        sums = [cgutils.alloca_once(builder, kind) for _ in range(rows)]  # become registers when compiled
        for total in sums:
            builder.store(zero, total)
        with cgutils.for_range(builder, depth) as loop:
            row, along = read(place(b, loop.index, b_row, offset, kind)), builder.mul(loop.index, a_column)
            for r, total in enumerate(sums):
                factor = repeated(read(place(a, builder.add(i, WORD(r)), a_row, along, REAL)), columns)
                builder.store(builder.call(fused, [factor, row, builder.load(total)]), total)
        for r, total in enumerate(sums):
            target = place(c, builder.add(i, WORD(r)), c_row, offset, kind)
            summed = builder.call(fused, [repeated(scale, columns), builder.load(total), read(target)])
            builder.store(summed, target).align = DOUBLE

    def spans(count: Any, sizes: Sequence[int]) -> Iterator[tuple[Any, Any]]:
        """Divide `count` among block sizes; yield start and end of the part that each size covers."""
        start = WORD(0)
        for size in sizes:
            end = builder.and_(count, WORD(-size))
            yield start, end
            start = end

    heights = [rows for rows, _ in TILES]
    for (rows, widths), (top, bottom) in zip(TILES, spans(m, heights), strict=True):
        with cgutils.for_range_slice(builder, top, bottom, WORD(rows), WORD) as (i, _):
            for columns, (left, right) in zip(widths, spans(n, widths), strict=True):
                with cgutils.for_range_slice(builder, left, right, WORD(columns), WORD) as (j, _):
                    tile(i, rows, j, columns)


@intrinsic
def _tiles(_, c, c_row, a, a_row, a_column, b, b_row, m, k, n, scale):  # type: ignore[no-untyped-def]
    """Insert the instructions of `_emit_tiles` into a kernel."""
    return types.void(*[types.intp] * 10, types.float64), _emit_tiles


@inner
def _multiply(
    c: int, c_row: int, a: int, a_row: int, a_column: int, b: int, b_row: int, m: int, k: int, n: int, scale: float
) -> None:
    """Compute C += scale A B from addresses and strides; compiled once for all kernels."""
    _tiles(c, c_row, a, a_row, a_column, b, b_row, m, k, n, scale)


def _add_product(C: Array, A: Array, B: Array, scale: float) -> None:
    """Add scale A B to C (m, n), which overlaps neither A (m, k), of any strides, nor B (k, n), of contiguous rows."""
    (m, n), k, c, a, b = C.shape, B.shape[0], C.ctypes.data, A.ctypes.data, B.ctypes.data
    _multiply(c, C.strides[0], a, A.strides[0], A.strides[1], b, B.strides[0], m, k, n, scale)


def _add_row_product(c: Array, a: Array, B: Array, scale: float) -> None:
    """Add scale a B to c (n,), contiguous, which overlaps neither a (k,), of any stride, nor B as above."""
    k, n = B.shape
    _multiply(c.ctypes.data, 0, a.ctypes.data, 0, a.strides[0], B.ctypes.data, B.strides[0], 1, k, n, scale)


def _factorise(rows: Array) -> None:
    """Replace rows [S, B] by L^-1 [S, B] with S = L L^T positive definite; below the diagonal they are undefined."""
    (m, n), stride, start = rows.shape, rows.strides[0], rows.ctypes.data
    for k in range(m):
        _multiply(start + stride * k, stride, start + DOUBLE * k, 0, stride, start, stride, 1, k, n, -1.0)
        row = rows[k]
        inverse = 1.0 / np.sqrt(row[k])
        for j in range(n):
            row[j] *= inverse


@inner
def mirror(A: Array, columns: int) -> None:
    """Copy the upper triangle of A (n, n) to the lower one in the first columns, so that rounding errors stay small."""
    for i in range(A.shape[0]):
        row = A[i]
        for j in range(min(i, columns)):
            row[j] = A[j, i]


def _add_product_slowly(C: Array, A: Array, B: Array, scale: float) -> None:
    C += scale * (A @ B)


def _factorise_slowly(rows: Array) -> None:
    for k in range(len(rows)):
        rows[k] -= rows[:k, k] @ rows[:k]
        rows[k] /= np.sqrt(rows[k, k])


COMPILED = not numba.config.DISABLE_JIT  # otherwise kernels run as plain Python
add_product: Any = inner(_add_product if COMPILED else _add_product_slowly)
add_row_product: Any = inner(_add_row_product if COMPILED else _add_product_slowly)
factorise: Any = inner(_factorise if COMPILED else _factorise_slowly)
