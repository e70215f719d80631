"""Products of small matrices in the processor's vectors, against numpy's."""

import numpy as np
import pytest
from support.kernel_cases import assert_equal

from aerobat_pin.numerics import kernel
from aerobat_pin.numerics import matrix_products as products

SIZES = [(1, 1, 1), (2, 3, 5), (3, 7, 2), (4, 1, 16), (5, 10, 17), (6, 16, 16), (10, 6, 31), (16, 10, 23), (27, 33, 48)]


@kernel
def multiply(C, A, B, scale):  # type: ignore[no-untyped-def]
    products.add_product(C, A, B, scale)


@kernel
def multiply_row(c, a, B, scale):  # type: ignore[no-untyped-def]
    products.add_row_product(c, a, B, scale)


@kernel
def factorise(rows):  # type: ignore[no-untyped-def]
    products.factorise(rows)


@pytest.mark.parametrize(("m", "k", "n"), SIZES)
def test_a_product_is_numpys_and_touches_nothing_beside_its_target(m: int, k: int, n: int) -> None:
    """All sizes of tiles, A as it is and transposed, and parts of wider arrays whose rest stays as it was."""
    rng = np.random.default_rng(m + k + n)
    wide, A, B = rng.normal(size=(m + 2, n + 3)), rng.normal(size=(m, k)), rng.normal(size=(k, n + 1))[:, :n]
    for left in (A, np.ascontiguousarray(A.T).T, rng.normal(size=(m, k + 2))[:, 1 : k + 1]):
        expected, found = wide.copy(), wide.copy()
        expected[1:-1, 1 : n + 1] += -0.7 * left @ B
        multiply(found[1:-1, 1 : n + 1], left, B, -0.7)
        assert_equal(found, expected)
        expected, found = wide[0].copy(), wide[0].copy()
        expected[:n] += 0.3 * left[0] @ B
        multiply_row(found[:n], left[0], B, 0.3)
        assert_equal(found, expected)


@pytest.mark.parametrize("m", [1, 4, 10, 27])
def test_elimination_is_choleskys(m: int) -> None:
    """L^T above the diagonal, and what stands to the right divided by L."""
    rng = np.random.default_rng(m)
    half = rng.normal(size=(m, 2 * m))
    S, B = half @ half.T, rng.normal(size=(m, 11))
    L, rows = np.linalg.cholesky(S), np.hstack([S, B])
    factorise(rows)
    assert_equal(np.triu(rows[:, :m]), L.T, 1e-10)
    assert_equal(rows[:, m:], np.linalg.solve(L, B), 1e-10)
