"""Memory of compiled kernels: one flat array whose fields one function names, each once and with its shape.

A compiled call pays for every array it is handed, so a kernel gets a single one, and finds its parts by address. How
they lie there is said by a layout: a kernel that reads the sizes, then takes the fields one after the other from a
cursor, an address that moves on by what is taken. A view costs nothing to make, and no shape is part of a type.

    class Filter(NamedTuple):
        gain: Array
        state: Array

    @merged
    def filter_in(memory: Array) -> Filter:
        cursor = rewind(memory)
        n = next_size(cursor)
        return Filter(gain=take(cursor, (n,)), state=take(cursor, (2, n)))

    memory = new_memory(filter_in, 3)  # runs the layout once to learn how much it takes
    fields_of(filter_in, memory).gain[:] = 1000.0
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from math import prod
from types import FunctionType
from typing import Any, TypeVar, cast

import numpy as np

from aerobat_pin.numerics.arrays import Array
from aerobat_pin.numerics.jit import Integers, inner
from aerobat_pin.numerics.pinocchio_views import DOUBLE, array_at, integers_at

Fields = TypeVar("Fields")


@inner
def rewind(memory: Array) -> Integers:
    """Return the cursor (1,) of a memory, at its first size. It lies in the memory's first cell."""
    start = memory.ctypes.data
    cursor: Integers = integers_at(start, (1,))
    cursor[0] = start + DOUBLE
    return cursor


@inner
def next_size(cursor: Integers) -> int:
    """Return the size at the cursor and move on. A layout reads all sizes before it takes the first field."""
    cursor[0] += DOUBLE
    return int(integers_at(cursor[0] - DOUBLE, (1,))[0])


@inner
def take(cursor: Integers, shape: tuple[int, ...]) -> Any:
    """View the doubles at the cursor, by rows, and move on behind them."""
    view = array_at(cursor[0], shape)
    cursor[0] += DOUBLE * view.size
    return view


@inner
def take_integers(cursor: Integers, shape: tuple[int, ...]) -> Any:
    """View the integers at the cursor, by rows, and move on behind them; addresses of other arrays too lie so."""
    view = integers_at(cursor[0], shape)
    cursor[0] += DOUBLE * view.size  # an integer is as long as a double
    return view


def new_memory(layout: Callable[[Array], Any], *sizes: int) -> Array:
    """Return memory for the fields of a layout, all of them zero.

    Args:
        layout: a kernel that names the fields of a memory, of these and of no other sizes.
        sizes: in the order in which the layout reads them.
    """
    head = np.zeros(1 + len(sizes))
    head[1:].view(np.intp)[:] = sizes
    fields_of(layout, head)  # its views lie behind the end, where nobody reads them: what counts is the cursor's way
    memory = np.zeros((int(head.view(np.intp)[0]) - head.ctypes.data) // DOUBLE)
    memory[: len(head)] = head
    return memory


def fields_of(layout: Callable[[Array], Fields], memory: Array) -> Fields:
    """Return the fields that a layout names in a memory, as arrays that live as long as the memory does."""
    return cast(Fields, _in_python(layout)(memory))


def _in_python(function: Any) -> Any:
    """Return what a kernel was compiled from, calling what its own callees were compiled from."""
    if function in _PLAIN:
        return _PLAIN[function]
    plain = getattr(function, "py_func", function)  # the same where nothing is compiled
    used = {name: plain.__globals__[name] for name in plain.__code__.co_names if name in plain.__globals__}
    names = {name: _in_python(value) if hasattr(value, "py_func") else value for name, value in used.items()}
    return FunctionType(plain.__code__, {**plain.__globals__, **names})


def _view(kind: Any) -> Callable[[int, tuple[int, ...]], Array]:
    return lambda address, shape: np.ctypeslib.as_array((kind * prod(shape)).from_address(int(address))).reshape(shape)


_PLAIN = {array_at: _view(ctypes.c_double), integers_at: _view(ctypes.c_ssize_t)}
