"""Memory whose layout names each field once."""

from __future__ import annotations

import os
import subprocess
import sys
from typing import Annotated, NamedTuple

import numpy as np
import pytest

from aerobat_pin.numerics.arrays import Array
from aerobat_pin.numerics.jit import Integers, kernel
from aerobat_pin.numerics.memory import layout_of, new_memory, next_size, rewind


class Part(NamedTuple):
    """A field of fields."""

    table: Annotated[Integers, "k, 3"]
    block: Annotated[Array, "2, n, k"]


class Whole(NamedTuple):
    """Fields of all kinds."""

    n: int
    first: Annotated[Array, "n"]
    part: Part
    last: Annotated[Array, "empty, empty"]


whole_fields = layout_of(Whole, "n", "k", "empty")


@kernel
def whole_in(memory: Array) -> Whole:
    """Lay out n numbers, k rows of integers, a block of three dimensions and a square that may be empty."""
    cursor = rewind(memory)
    n, k, empty = next_size(cursor), next_size(cursor), next_size(cursor)
    return whole_fields(cursor, n, k, empty)


@kernel
def fill(memory: Array) -> float:
    """Write every field, and return what one of them held."""
    whole = whole_in(memory)
    before = whole.first[0]
    whole.first[:] = 1.0
    whole.part.table[:] = 2
    whole.part.block[:] = 3.0
    whole.last[:] = 4.0
    return float(before)


@pytest.mark.parametrize("empty", [0, 3])
def test_fields_lie_one_behind_the_other_and_fill_the_memory(empty: int) -> None:
    """No gap, no overlap, nothing over the end: head of a cursor and three sizes, then the fields in their order."""
    memory = new_memory(whole_in, 4, 2, empty)
    assert memory.shape == (1 + 3 + 4 + 2 * 3 + 2 * 4 * 2 + empty**2,)
    assert not memory[4:].any()
    whole_in(memory).first[0] = 7.0
    assert fill(memory) == 7.0
    np.testing.assert_array_equal(memory.view(np.intp)[1:4], [4, 2, empty])
    np.testing.assert_array_equal(memory[4:8], 1.0)
    np.testing.assert_array_equal(memory[8:14].view(np.intp), 2)
    np.testing.assert_array_equal(memory[14:30], 3.0)
    np.testing.assert_array_equal(memory[30:], 4.0)
    whole = whole_in(memory)
    assert [field.shape for field in (whole.first, *whole.part, whole.last)] == [(4,), (2, 3), (2, 4, 2), (empty,) * 2]


def test_fields_are_views_and_a_copy_of_the_memory_has_its_own() -> None:
    """As a record is filtered on a copy while a stream goes on."""
    memory = new_memory(whole_in, 4, 2, 3)
    copy = memory.copy()
    whole_in(copy).last[1, 2] = 5.0
    assert np.shares_memory(whole_in(copy).last, copy)
    assert not whole_in(memory).last.any()
    assert whole_in(copy).last[1, 2] == 5.0


def test_one_compilation_serves_all_sizes() -> None:
    """A compilation for each size would take seconds."""
    for sizes in ((1, 1, 1), (5, 0, 2), (9, 9, 9)):
        fill(new_memory(whole_in, *sizes))
    assert len(getattr(fill, "signatures", [0])) == 1


def test_layouts_work_as_plain_python_too() -> None:
    """With numba's compiler off."""
    if os.environ.get("NUMBA_DISABLE_JIT") == "1":
        pytest.skip("it is off")
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", __file__]
    finished = subprocess.run(command, env=os.environ | {"NUMBA_DISABLE_JIT": "1"}, capture_output=True, text=True)
    assert finished.returncode == 0, finished.stdout + finished.stderr
