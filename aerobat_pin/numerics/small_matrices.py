"""Compiled linear algebra for about ten rows, where the call of LAPACK alone would cost several times as much."""

from __future__ import annotations

import numpy as np

from aerobat_pin.numerics.arrays import Array
from aerobat_pin.numerics.jit import inlined, inner, kernel


@inner
def copy_values(source: Array, target: Array) -> None:
    """Copy a vector. `target[:] = source` would take two seconds longer to compile, because of its error message."""
    for i in range(target.shape[0]):
        target[i] = source[i]


@inner
def dot(a: Array, b: Array) -> float:
    """Return the inner product of two vectors, computed as four independent sums, which is faster."""
    n = a.shape[0]
    first, second, third, fourth = 0.0, 0.0, 0.0, 0.0
    for i in range(n // 4):
        first += a[4 * i] * b[4 * i]
        second += a[4 * i + 1] * b[4 * i + 1]
        third += a[4 * i + 2] * b[4 * i + 2]
        fourth += a[4 * i + 3] * b[4 * i + 3]
    for i in range(n - n % 4, n):
        first += a[i] * b[i]
    return (first + second) + (third + fourth)


@inner
def saturated(value: float, limit: float) -> float:
    """Clip a number to [-limit, limit]."""
    return min(max(value, -limit), limit)


@inlined
def rotated(R: Array, x: float, y: float, z: float) -> tuple[float, float, float]:
    """Rotate a vector by a matrix (3, 3)."""
    return (
        R[0, 0] * x + R[0, 1] * y + R[0, 2] * z,
        R[1, 0] * x + R[1, 1] * y + R[1, 2] * z,
        R[2, 0] * x + R[2, 1] * y + R[2, 2] * z,
    )


@inlined
def in_outer_axes(P: Array, x: float, y: float, z: float) -> tuple[float, float, float]:
    """Rotate a vector by the rotation of a placement (12,), see `placements`."""
    return (P[0] * x + P[3] * y + P[6] * z, P[1] * x + P[4] * y + P[7] * z, P[2] * x + P[5] * y + P[8] * z)


@inlined
def in_inner_axes(P: Array, x: float, y: float, z: float) -> tuple[float, float, float]:
    """Rotate a vector back by the rotation of a placement (12,)."""
    return (P[0] * x + P[1] * y + P[2] * z, P[3] * x + P[4] * y + P[5] * z, P[6] * x + P[7] * y + P[8] * z)


@inlined
def solve_factored(L: Array, b: Array) -> None:
    """Solve L L^T x = b for a lower triangle L (n, n); x overwrites b."""
    n = b.shape[0]
    # The processor can compute the reciprocals of the diagonal early; a division of b would have to wait for b.
    for i in range(n):
        for k in range(i):
            b[i] -= L[i, k] * b[k]
        b[i] *= 1.0 / L[i, i]
    for i in range(n - 1, -1, -1):
        for k in range(i + 1, n):
            b[i] -= L[k, i] * b[k]
        b[i] *= 1.0 / L[i, i]


@kernel
def solve_positive(A: Array, b: Array) -> float:
    """Solve A x = b by Cholesky's method for A (n, n) symmetric positive definite; return the smallest pivot.

    x overwrites b, and L of A = L L^T the lower triangle of A, which alone is read. The smallest pivot shows how
    close A is to singular. Meant for n of about six, where the call of LAPACK alone would cost several times as much.
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
    solve_factored(A, b)
    return least


@inner
def eigenvectors(A: Array, V: Array) -> None:
    """Diagonalise a symmetric A (n, n) in place by cyclic Jacobi, and write its eigenvectors to the columns of V."""
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
