"""How much of the error of rows, and of the components that they show, other rows check."""

from __future__ import annotations

import numpy as np

from aerobat_pin.numerics import Array

LEAST_TRACE = 1e-9  # of the largest singular value: a fainter force leaves none


def spare_share(J: Array, force: Array, error: Array) -> Array:
    """Return which share (k,) of each row's error the other rows show whatever the forces are: 1 - its leverage."""
    return np.asarray(np.mean(_pseudo_inverse(J, force, error)[1], axis=0))


def checked_share(J: Array, force: Array, error: Array) -> tuple[Array, Array]:
    """Return how much of the rows that show each component others check (c,), and each row's share in it (c, k).

    The first is the mean of `spare_share`, by the shares of the rows, which are those of what errors make of it.

    Args:
        J: (m, c, k) Jacobian of the components.
        force: (c,) or (m, c) what is expected of these [N or N m].
        error: (k,), or (m, 1, k), of each row [N or N m].
    """
    inverse, spare = _pseudo_inverse(J, force, error)
    shares = inverse**2 / np.maximum(np.sum(inverse**2, axis=1, keepdims=True), np.finfo(float).tiny)
    return np.einsum("mic,mi->c", shares, spare) / len(J), shares.mean(axis=0).T


def _pseudo_inverse(J: Array, force: Array, error: Array) -> tuple[Array, Array]:
    """Return what whitened rows make of components over their sizes (m, k, c), and 1 - leverage of each row (m, k)."""
    B = force[..., None] * J / error
    inverse = np.linalg.pinv(B, rcond=LEAST_TRACE)
    return inverse, 1.0 - np.einsum("mic,mci->mi", inverse, B)
