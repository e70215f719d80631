"""Memory of compiled kernels: one flat array, and a layout function that defines its fields.

Every array that is passed to a compiled call costs time. A kernel therefore gets a single flat array and finds its
fields by address. A layout is a kernel that defines the fields. It first reads the sizes at the start of the array, and
then takes one field after the other from a cursor, an address that advances by the size of each field. Making such
views costs nothing, and because shapes are not part of a type, other sizes need no new compilation. `memory_layout`
writes the layout from a table of names and shapes; `layout_of` only the part that takes the fields, where sizes follow
from others.

    class Filter(NamedTuple):
        gain: Annotated[Array, "n"]
        state: Annotated[Array, "2, n"]

    filter_in = memory_layout(Filter, "n")
    memory = new_memory(filter_in, 3)  # runs the layout once to find the total size
    fields_of(filter_in, memory).gain[:] = 1000.0
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from math import prod
from types import FunctionType
from typing import Annotated, Any, TypeVar, cast, get_origin, get_type_hints

import numpy as np

from aerobat_pin.numerics.arrays import Array
from aerobat_pin.numerics.jit import Integers, inner, merged
from aerobat_pin.numerics.pinocchio_views import DOUBLE, array_at, integers_at

Fields = TypeVar("Fields")


@inner
def rewind(memory: Array) -> Integers:
    """Return the cursor (1,) of a memory, set to the first size. The cursor is stored in the memory's first cell."""
    start = memory.ctypes.data
    cursor: Integers = integers_at(start, (1,))
    cursor[0] = start + DOUBLE
    return cursor


@inner
def next_size(cursor: Integers) -> int:
    """Return the size at the cursor and advance. A layout reads all sizes before it takes the first field."""
    cursor[0] += DOUBLE
    return int(integers_at(cursor[0] - DOUBLE, (1,))[0])


@inner
def take(cursor: Integers, shape: tuple[int, ...]) -> Any:
    """Return a row-major view of the doubles at the cursor and advance the cursor past them."""
    view = array_at(cursor[0], shape)
    cursor[0] += DOUBLE * view.size
    return view


@inner
def take_integers(cursor: Integers, shape: tuple[int, ...]) -> Any:
    """Return a row-major view of the integers (or addresses) at the cursor and advance the cursor past them."""
    view = integers_at(cursor[0], shape)
    cursor[0] += DOUBLE * view.size  # an integer takes as many bytes as a double
    return view


def layout_of(fields: type[Fields], *sizes: str) -> Callable[..., Fields]:
    """Return the kernel that lays out a table, given a cursor and the sizes.

    Args:
        fields: the table, a named tuple. The annotation of an array holds its shape in terms of the sizes. Any other
            field is the size of the same name, or else a table in the table, or a whole number in the memory.
        sizes: names of the sizes.
    """
    values, name_of_kernel = [], f"{fields.__name__}_fields"
    scope: dict[str, Any] = {"take": take, "take_integers": take_integers, "next_size": next_size, "fields": fields}
    scope["__name__"] = fields.__module__  # names of compiled functions must differ
    for name, hint in get_type_hints(fields, include_extras=True).items():
        if get_origin(hint) is Annotated:
            taking = "take_integers" if hint.__origin__ == Integers else "take"
            shape = hint.__metadata__[0]
            values.append(f"{taking}(cursor, ({shape},))" if shape else f"{taking}(cursor, ())")
        elif name in sizes:
            values.append(name)
        elif hint is int:
            values.append("next_size(cursor)")
        else:
            scope[f"lay_out_{name}"] = layout_of(hint, *sizes)
            values.append(f"lay_out_{name}(cursor, {', '.join(sizes)})")
    exec(f"def {name_of_kernel}(cursor, {', '.join(sizes)}):\n    return fields({', '.join(values)})", scope)
    return cast(Callable[..., Fields], merged(scope[name_of_kernel]))


def memory_layout(fields: type[Fields], *sizes: str) -> Callable[[Array], Fields]:
    """Return the layout of a memory that begins with these sizes, in this order, and holds one table.

    Args:
        fields: the table, as for `layout_of`.
        sizes: names of the sizes.
    """
    name = f"{fields.__name__}_in"
    scope: dict[str, Any] = {"rewind": rewind, "next_size": next_size, "lay_out": layout_of(fields, *sizes)}
    scope["__name__"] = fields.__module__  # names of compiled functions must differ
    reading = ", next_size(cursor)" * len(sizes)
    exec(f"def {name}(memory):\n    cursor = rewind(memory)\n    return lay_out(cursor{reading})", scope)
    return cast(Callable[[Array], Fields], merged(scope[name]))


def new_memory(layout: Callable[[Array], Any], *sizes: int) -> Array:
    """Return memory for the fields of a layout, with all fields zero.

    Args:
        layout: a kernel that defines the fields of a memory and reads these sizes.
        sizes: the sizes in the order in which the layout reads them.
    """
    head = np.zeros(1 + len(sizes))
    head[1:].view(np.intp)[:] = sizes
    fields_of(layout, head)  # the views point past the end and are not read; only the final cursor is used
    memory = np.zeros((int(head.view(np.intp)[0]) - head.ctypes.data) // DOUBLE)
    memory[: len(head)] = head
    return memory


def fields_of(layout: Callable[[Array], Fields], memory: Array) -> Fields:
    """Return the fields that a layout defines in a memory. They are valid only as long as the memory exists."""
    return cast(Fields, _in_python(layout)(memory))


def fill(fields: tuple[Any, ...], values: tuple[Any, ...]) -> None:
    """Copy values into the fields of a memory, in order; nested tuples into nested fields."""
    for field, value in zip(fields, values, strict=True):
        if isinstance(field, tuple):
            fill(field, value)
        else:
            field[...] = value


def _in_python(function: Any) -> Any:
    """Return the Python function of a kernel, with the kernels that it calls replaced by their Python functions."""
    if function in _PLAIN:
        return _PLAIN[function]
    plain = getattr(function, "py_func", function)  # the function itself if nothing is compiled
    used = {name: plain.__globals__[name] for name in plain.__code__.co_names if name in plain.__globals__}
    names = {name: _in_python(value) if hasattr(value, "py_func") else value for name, value in used.items()}
    return FunctionType(plain.__code__, {**plain.__globals__, **names})


def _view(kind: Any) -> Callable[[int, tuple[int, ...]], Array]:
    return lambda address, shape: np.ctypeslib.as_array((kind * prod(shape)).from_address(int(address))).reshape(shape)


_PLAIN = {array_at: _view(ctypes.c_double), integers_at: _view(ctypes.c_ssize_t)}
