"""State of compiled kernels: the arrays of a table, one behind the other in one flat array.

Each array that is passed to a compiled call costs time, so a kernel gets a single one. It starts with a directory: for
each field of the table where the array lies and its shape; then come the arrays. `fields_of` reads it. In Python it
returns the table, a named tuple of numpy views. In a kernel it returns a pointer, and `filter_.gain` reads the two or
three numbers of that field where it stands: fields that are not used cost nothing, and neither does passing the state
on to another kernel. Shapes are not part of a type, so that other sizes need no new compilation.

    class Filter(NamedTuple):
        gain: Annotated[Array, "n"]
        state: Annotated[Array, "2, n"]

    memory = new_state(Filter, n=3)
    fields_of(memory, Filter).gain[:] = 1000.0

Places are counted from the directory's own numbers, so a copy of a state is a state of its own. A field marked
`ELSEWHERE` lies in another array, which the state keeps alive (a copy does not): a kernel never looks at what has been
given back.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache
from math import prod
from typing import Annotated, Any, NamedTuple, TypeVar, cast, get_args, get_origin, get_type_hints

import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.core.typing.templates import AttributeTemplate
from numba.extending import infer_getattr, lower_builtin, lower_getattr_generic, models, register_model, type_callable

from aerobat_pin.numerics.arrays import Array
from aerobat_pin.numerics.jit import Integers
from aerobat_pin.numerics.pinocchio_views import DOUBLE, addresses

Fields = TypeVar("Fields")
ELSEWHERE = "elsewhere"  # in an annotation: this array, or this table, lies in an array that `new_state` is given


class Field(NamedTuple):
    """A field of a table: its name, the index of its first word in the directory, and what it is.

    `kind` is `Array`, `Integers`, `int` or another table; `shape` its text, split at the commas.
    """

    name: str
    word: int
    kind: Any
    shape: tuple[str, ...] = ()
    elsewhere: bool = False

    @property
    def is_table(self) -> bool:
        """Whether the field is a table in the table."""
        return hasattr(self.kind, "_fields")

    @property
    def words(self) -> int:
        """Number of words of the directory that describe this field."""
        return directory_size(self.kind) if self.is_table and not self.elsewhere else 1 + len(self.shape)


@cache
def fields_in(table: Any) -> tuple[Field, ...]:
    """Return the fields of a table."""
    fields: list[Field] = []
    for name, hint in get_type_hints(table, include_extras=True).items():
        kind, *notes = get_args(hint) if get_origin(hint) is Annotated else (hint,)
        shape = tuple(part.strip() for note in notes if note != ELSEWHERE for part in note.split(",") if note)
        word = fields[-1].word + fields[-1].words if fields else 0
        fields.append(Field(name, word, Array if kind is Any else kind, shape, ELSEWHERE in notes))
    return tuple(fields)


def directory_size(table: Any) -> int:
    """Return the number of words in the directory of a table."""
    return fields_in(table)[-1].word + fields_in(table)[-1].words


def new_state(table: type[Any], **given: Any) -> Array:
    """Return the state of a table, with all its arrays zero.

    Args:
        table: a named tuple. The annotation of an array holds its shape in terms of sizes. An `int` is the size of the
            same name; any other field is a table in the table.
        given: the sizes, and the arrays and states of fields that lie elsewhere, by their names; and what else is to
            live as long as the state.
    """
    directory: list[int] = []
    end = directory_size(table)

    def sizes(field: Field) -> list[int]:
        return [int(eval(_expression(part), {}, given)) for part in field.shape]

    for field in _all_fields(table):
        if field.kind is int:
            directory.append(int(given[field.name]))
        elif field.elsewhere:
            directory += [int(addresses(given[field.name])[0]), *sizes(field)]
        else:
            shape = sizes(field)
            directory += [DOUBLE * (end - len(directory)), *shape]
            end += prod(shape)
    values = np.zeros(end)
    values[: len(directory)].view(np.intp)[:] = directory
    return _view(values.ctypes.data, values.shape, float, (values, given))


@cache
def _expression(part: str) -> Any:
    return compile(part, part, "eval")


def fields_of(memory: Array, table: type[Fields]) -> Fields:
    """Return the fields of a state: in Python as views that keep it alive, in a kernel as a pointer to them."""
    return cast(Fields, _fields_at(memory.ctypes.data, table, memory))


class Viewed:
    """A base of classes that keep views of a memory: a copy, or what is unpickled, makes its own by `_view`."""

    def __setstate__(self, state: dict[str, Any]) -> None:
        vars(self).update(state)
        self._view()

    def _view(self) -> Any:
        """Keep views of the memory."""
        raise NotImplementedError


def fill(fields: tuple[Any, ...], values: tuple[Any, ...]) -> None:
    """Copy values into the fields of a state, in order; nested tuples into nested fields."""
    for field, value in zip(fields, values, strict=True):
        if isinstance(field, tuple):
            fill(field, value)
        else:
            field[...] = value


def _all_fields(table: Any) -> Iterator[Field]:
    """Yield the fields of a table and of the tables in it, in the order of the directory."""
    for field in fields_in(table):
        if field.is_table and not field.elsewhere:
            yield from _all_fields(field.kind)
        else:
            yield field


def _fields_at(address: int, table: Any, owner: Any) -> Any:
    directory = _view(address, (directory_size(table),), np.intp, owner)
    values: list[Any] = []
    for field in fields_in(table):
        first, place = int(directory[field.word]), address + DOUBLE * field.word
        if field.is_table:
            values.append(_fields_at(first if field.elsewhere else place, field.kind, owner))
        elif field.kind is int:
            values.append(first)
        else:
            shape = tuple(directory[field.word + 1 : field.word + 1 + len(field.shape)].tolist())
            kind = np.intp if field.kind is Integers else float
            values.append(_view(first if field.elsewhere else place + first, shape, kind, owner))
    return table(*values)


class _Memory:
    """Memory at an address, which numpy takes for an array; the array keeps this object and so the memory's owner."""

    def __init__(self, address: int, shape: tuple[int, ...], kind: Any, owner: Any) -> None:
        self.owner = owner
        typestr = np.dtype(kind).str
        self.__array_interface__ = {"data": (address, False), "shape": shape, "typestr": typestr, "version": 3}


def _view(address: int, shape: tuple[int, ...], kind: Any, owner: Any) -> Array:
    return np.asarray(_Memory(address, shape, kind, owner))


# What follows tells numba how kernels read a state.


class KernelState(types.Type):  # type: ignore[misc]  # numba has no types
    """The type of a state in kernels: a pointer to the directory of a table."""

    def __init__(self, table: Any) -> None:
        self.table = table
        super().__init__(name=f"KernelState({table.__module__}.{table.__qualname__})")

    def field(self, name: str) -> Field | None:
        """Return a field by its name."""
        return next((field for field in fields_in(self.table) if field.name == name), None)


register_model(KernelState)(models.OpaqueModel)


@type_callable(fields_of)  # type: ignore[untyped-decorator]
def _type_fields_of(_: Any) -> Any:
    return lambda memory, table: KernelState(table.instance_class) if isinstance(memory, types.Array) else None


@infer_getattr
class _Fields(AttributeTemplate):  # type: ignore[misc]
    key = KernelState

    def generic_resolve(self, state: KernelState, name: str) -> Any:
        field = state.field(name)
        if field is None:
            return None
        if field.is_table:
            return KernelState(field.kind)
        if field.kind is int:
            return types.intp
        return types.Array(types.intp if field.kind is Integers else types.float64, len(field.shape), "C")


@lower_builtin(fields_of, types.Array, types.NamedTupleClass)  # type: ignore[untyped-decorator]
def _lower_fields_of(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
    memory = context.make_array(signature.args[0])(context, builder, arguments[0])
    return builder.bitcast(memory.data, cgutils.voidptr_t)


@lower_getattr_generic(KernelState)  # type: ignore[untyped-decorator]
def _lower_field(context: Any, builder: Any, state: KernelState, pointer: Any, name: str) -> Any:
    field, word = state.field(name), ir.IntType(64)
    assert field is not None
    start = builder.bitcast(pointer, word.as_pointer())

    def place(index: int) -> Any:
        return builder.gep(start, [word(index)])

    def number(index: int) -> Any:
        """Read a word of the directory, which never changes: the compiler may read it once for many uses."""
        read = builder.load(place(index))
        read.set_metadata("invariant.load", builder.module.add_metadata([]))
        return read

    if field.kind is int:
        return number(field.word)
    address = builder.ptrtoint(place(field.word), word)
    if field.elsewhere:
        address = number(field.word)
    elif not field.is_table:
        address = builder.add(address, number(field.word))
    if field.is_table:
        return builder.inttoptr(address, cgutils.voidptr_t)
    kind = types.intp if field.kind is Integers else types.float64
    shape = [number(field.word + 1 + axis) for axis in range(len(field.shape))]
    step: Any = word(DOUBLE)
    strides: list[Any] = []
    for size in reversed(shape):
        strides.insert(0, step)
        step = builder.mul(step, size)
    result = types.Array(kind, len(shape), "C")
    array = context.make_array(result)(context, builder)
    data = builder.inttoptr(address, context.get_value_type(kind).as_pointer())
    context.populate_array(array, data=data, shape=shape, strides=strides, itemsize=word(DOUBLE), meminfo=None)
    return array._getvalue()
