"""States of kernels: a table names each field once, and what a state looks at lives as long as it does."""

import gc
import itertools
import weakref
from typing import Annotated, Any, NamedTuple

import numpy as np
import pytest

from aerobat_pin.numerics import ELSEWHERE, Array, Integers, directory_size, fields_of, fill, inner, kernel, new_state


class Part(NamedTuple):
    """A table in a table."""

    table: Annotated[Integers, "k, 3"]
    block: Annotated[Array, "2, n, 2 * k"]


class Whole(NamedTuple):
    """Fields of all kinds."""

    n: int
    first: Annotated[Array, "n"]
    part: Part
    last: Annotated[Array, "empty, empty"]
    number: Annotated[Array, ""]
    linked: Annotated[Part, ELSEWHERE]
    given: Annotated[Array, "2, 3", ELSEWHERE]


@inner
def write_part(part: Part, number: int) -> None:
    """Write a table that is a part of another, or lies elsewhere."""
    part.table[:] = number
    part.block[:] = float(number)


@kernel
def write_all(memory: Array) -> float:
    """Write every field, and return what one of them held."""
    whole = fields_of(memory, Whole)
    before = whole.first[0]
    whole.first[:] = 1.0
    write_part(whole.part, 2)
    whole.last[:] = 4.0
    whole.number[()] = whole.n
    write_part(whole.linked, 5)
    whole.given[1, 2] = 6.0
    return float(before)


def made(n: int = 4, k: int = 2, empty: int = 3) -> tuple[Array, Array, Array]:
    """Return a state, and the state and the array that it looks at."""
    linked, given = new_state(Part, n=1, k=1), np.zeros((2, 3))
    return new_state(Whole, n=n, k=k, empty=empty, linked=linked, given=given), linked, given


@pytest.mark.parametrize("empty", [0, 3])
def test_fields_lie_one_behind_the_other_and_fill_the_state(empty: int) -> None:
    """No gap, no overlap, nothing over the end; a kernel sees what Python sees."""
    memory, linked, given = made(empty=empty)
    whole = fields_of(memory, Whole)
    assert [field.shape for field in (whole.first, *whole.part, whole.last)] == [(4,), (2, 3), (2, 4, 4), (empty,) * 2]
    own = [field for field in (whole.first, *whole.part, whole.last, whole.number) if field.size]
    spans = [(field.ctypes.data, field.nbytes) for field in own]
    assert spans[0][0] == memory.ctypes.data + 8 * directory_size(Whole)
    assert all(start + size == after for (start, size), (after, _) in itertools.pairwise(spans))
    assert sum(spans[-1]) == memory.ctypes.data + memory.nbytes
    assert not any(field.any() for field in own)
    whole.first[0] = 7.0
    assert write_all(memory) == 7.0
    for field, number in zip((whole.first, *whole.part, whole.last), (1, 2, 2, 4), strict=True):
        np.testing.assert_array_equal(field, number)
    assert whole.n == whole.number == 4
    np.testing.assert_array_equal(fields_of(linked, Part).block, np.full((2, 1, 2), 5.0))
    np.testing.assert_array_equal(whole.linked.table, [[5, 5, 5]])
    assert given[1, 2] == whole.given[1, 2] == 6.0


def test_a_copy_of_a_state_is_a_state_of_its_own() -> None:
    """As a record is filtered on a copy while a stream goes on; also in the rows of a table of states."""
    memory = new_state(Part, n=4, k=2)
    rows = np.tile(memory, (3, 1))
    fill(fields_of(rows[1], Part), (7, np.full((2, 4, 4), 3.0)))
    assert np.shares_memory(fields_of(rows[1], Part).block, rows)
    assert not any(field.any() for part in (memory, rows[0], rows[2]) for field in fields_of(part, Part))
    np.testing.assert_array_equal(fields_of(rows[1].copy(), Part).table, np.full((2, 3), 7))


def test_what_a_state_looks_at_lives_as_long_as_the_state_or_a_view_of_it() -> None:
    """Else a kernel would read and write what has been given back."""

    class Owner:
        """Holds an array as `pin.Data` does."""

        def __init__(self) -> None:
            self.values = np.zeros((2, 3))

    def looked_at() -> tuple[Any, list[weakref.ref[Any]]]:
        owner, linked = Owner(), new_state(Part, n=1, k=1)
        memory = new_state(Whole, n=4, k=2, empty=0, linked=linked, given=owner.values)
        return memory, [weakref.ref(owner.values), weakref.ref(linked), weakref.ref(memory)]

    memory, alive = looked_at()
    gc.collect()
    assert all(one() is not None for one in alive)
    write_all(memory)
    field = fields_of(memory, Whole).given
    del memory
    gc.collect()
    assert all(one() is not None for one in alive)
    assert field[1, 2] == 6.0
    del field
    gc.collect()
    assert not any(one() is not None for one in alive)


def test_only_doubles_in_a_row_can_lie_elsewhere() -> None:
    """A kernel would read anything else as if it were."""
    for wrong in (np.zeros((2, 3), int), np.zeros((4, 6))[::2, ::2]):
        with pytest.raises(RuntimeError, match="contiguous arrays of doubles"):
            new_state(Whole, n=1, k=1, empty=0, linked=new_state(Part, n=1, k=1), given=wrong)


def test_one_compilation_serves_all_sizes() -> None:
    """A compilation for each size would take seconds."""
    for sizes in ((1, 1, 1), (5, 0, 2), (9, 9, 9)):
        write_all(made(*sizes)[0])
    assert len(getattr(write_all, "signatures", [0])) == 1
