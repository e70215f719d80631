"""Factors of the efforts of legs, by the weight that they hold up."""

from __future__ import annotations

import numpy as np

from aerobat_pin.numerics import Array

FACTOR_SIZES = np.linspace(0.05, 1.0, 20)  # of g, over the largest: one is as likely as another before
BALANCE_STRETCHES = 8  # of a record, whose means show how far its momentum changes


def factors_by_balance(
    y: Array, J: Array, G: Array, legs: list[int], efforts: Array, attitude: Array, least: Array, largest: float
) -> tuple[Array, Array]:
    """Return errors d (n,) of the factors of efforts, and their standard deviations (n,), by the weight of a robot.

    Its momentum hardly changes over a record, so in the mean all forces on it, and all moments about its base, cancel.
    With the most likely forces on the feet, f = G (y_l - X d) by the rows y_l of the legs, the base's rows y_b say

        mean(y_b - J_b^T G y_l) + A d = e,    A = mean(J_b^T G X),    d ~ N(0, g^2),    e ~ N(0, s^2)

    where X are the efforts. Six numbers show how large g is, and which efforts hold up too much or too little.

    Args:
        y: (m, nv) rows, of which the first six are the base's; friction is taken out of the others.
        J: (m, c, nv) Jacobian of the forces on the feet.
        G: (m, c, n) these forces by the rows of the legs.
        legs: the n rows of the legs.
        efforts: (m, n) behind the low-pass of the rows.
        attitude: (m, 3, 3) from the base's axes to the world's.
        least: (6,) of s.
        largest: g.
    """
    base = np.swapaxes(J[:, :, :6], 1, 2) @ G
    remainder, moved = y[:, :6] - np.einsum("mbk,mk->mb", base, y[:, legs]), base * efforts[:, None]
    table = np.concatenate([moved, remainder[..., None]], axis=2).reshape(len(y), 2, 3, -1)
    table = np.einsum("mij,mbjk->mbik", attitude, table).reshape(len(y), 6, -1)  # in the world's axes
    A, z = (part := table.mean(axis=0))[:, :-1], part[:, -1]
    means = np.stack([part[..., -1].mean(axis=0) for part in np.array_split(table, BALANCE_STRETCHES)])
    s = np.hypot(least, means.std(axis=0, ddof=1) / np.sqrt(BALANCE_STRETCHES))
    solutions = []
    for g in largest * FACTOR_SIZES:
        cov = g**2 * A @ A.T + np.diag(s**2)
        gain = g**2 * np.linalg.solve(cov, A).T
        likely = -0.5 * (np.linalg.slogdet(cov)[1] + z @ np.linalg.solve(cov, z))
        solutions.append((likely, -gain @ z, g**2 - g**2 * np.einsum("ib,bi->i", gain, A)))
    likely, d, variance = (np.stack(part) for part in zip(*solutions, strict=True))
    share = np.exp(likely - likely.max())
    share /= share.sum()
    mean = share @ d
    return mean, np.sqrt(share @ (variance + d**2) - mean**2)
