"""Compiled recursions of the joint smoother: a Kalman filter of scalar samples, and Bryson and Frazier's way back.

    x+ = F x + s + noise,   sample: e = h x + white noise of variance R

Only the first rows of F differ from the identity, and only those are given; forces that are drawn anew in every
interval have zero rows. Each sample is one number. With the filter's P h = g and S = h P h + R, the way back carries an
adjoint l and its covariance N:

    over a sample:     l <- l - h (g l / S + e / S),   N <- C^T N C + h h^T / S,   C = I - g h^T / S
    over an interval:  l <- F^T l,                     N <- F^T N F

A smoothed state is x - P l, with covariance P - P N P (G. J. Bierman, Fixed interval smoothing with discrete
measurements, Int. J. Control 18, 1973). No covariance is inverted.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from aerobat_pin.numerics import Array, Integers, add_product, add_row_product, dot, inner, kernel, mirror

Flags = NDArray[np.bool_]


class SampleRows(NamedTuple):
    """Samples as rows, in the order of their knots.

    Attributes:
        start: (m + 2,) first row of each knot.
        h, e, R: (k, n) rows, (k,) samples less their prediction at x = 0, (k,) variances of their noise.
        sensor: (k,) index of the sensor.
    """

    start: Integers
    h: Array
    e: Array
    R: Array
    sensor: Integers


class Filtered(NamedTuple):
    """A filtered record of m intervals with k samples and n states.

    Attributes:
        x, P: (n,), (n, n) the last state and its covariance; before, the first ones.
        gains: (k, n) P h of each sample.
        innovations: (k, 2) innovation of each sample and its variance.
        states, covariances: (m + 1, n), (m + 1, n, n) at each knot, after its samples; or empty, if they are not kept.
    """

    x: Array
    P: Array
    gains: Array
    innovations: Array
    states: Array
    covariances: Array


class Smoothed(NamedTuple):
    """A smoothed record; the block are the b slowly changing forces.

    Attributes:
        filtered: what the filter has kept.
        states: (m + 1, n) smoothed states.
        blocks: (m + 1, b, b) covariance of the block; or empty, which saves time.
        pulls, informations: (m + 1, n) derivative of the log-likelihood by a sudden change of each state before each
            knot's samples, with the sign turned, and its variance; or empty, which saves more time.
        inside: (m + 1, b, b) covariance of the block's pulls, or empty.
    """

    filtered: Filtered
    states: Array
    blocks: Array
    pulls: Array
    informations: Array
    inside: Array


@kernel
def take_samples(x: Array, P: Array, h: Array, e: Array, R: Array, gains: Array, innovations: Array) -> float:
    """Update x (n,) and P (n, n) by samples h, e, R as in `SampleRows`; return their log-likelihood.

    Written are `gains` (k, n), that is P h, and `innovations` (k, 2), each with its variance.
    """
    n, score = x.shape[0], 0.0
    for i in range(h.shape[0]):
        row, gain = h[i], gains[i]
        gain[:] = 0.0
        add_row_product(gain, row, P, 1.0)
        innovation, variance = e[i] - dot(row, x), R[i] + dot(row, gain)
        innovations[i, 0], innovations[i, 1] = innovation, variance
        score -= 0.5 * (innovation * innovation / variance + np.log(variance))
        for a in range(n):
            share = gain[a] / variance
            x[a] += share * innovation
            for b in range(n):
                P[a, b] -= share * gain[b]
    return score


@kernel
def advance(x: Array, P: Array, F: Array, shift: Array, noise: Array, fresh: Integers) -> None:
    """Advance x (n,) and P (n, n) over one interval.

    Args:
        x: (n,) state, changes.
        P: (n, n) covariance, changes.
        F: (moving, n) rows of the transition; the others are the identity.
        shift: (moving,) shift of these states.
        noise: (n,) variances that the interval adds; of a fresh state: its variance.
        fresh: (2,) first and last (excluded) of the states that are drawn anew.
    """
    n, m = x.shape[0], F.shape[0]
    W, across = np.zeros((m, n)), np.empty((n, m))  # F P, and its transpose
    moved = shift.copy()
    add_product(W, F, P, 1.0)
    for i in range(m):
        moved[i] += dot(F[i], x)
        for j in range(n):
            across[j, i] = W[i, j]
            P[i, j] = P[j, i] = 0.0 if j < m else W[i, j]
    add_product(P[:m, :m], F, across, 1.0)
    mirror(P, m)
    for i in range(n):
        if i < m:
            x[i] = moved[i]
        if fresh[0] <= i < fresh[1]:
            x[i] = 0.0
            for j in range(n):
                P[i, j] = P[j, i] = 0.0
        P[i, i] += noise[i]


@kernel
def filter_record(F: Array, shift: Array, noise: Array, fresh: Integers, rows: SampleRows, filtered: Filtered) -> float:
    """Filter a record of m intervals, each with F, shift and noise as in `advance`; return the log-likelihood."""
    x, P, gains, innovations, states, covariances = filtered
    start, h, e, R, _ = rows
    m, score = F.shape[0], 0.0
    for k in range(m + 1):
        a, b = start[k], start[k + 1]
        score += take_samples(x, P, h[a:b], e[a:b], R[a:b], gains[a:b], innovations[a:b])
        if states.shape[0] > 0:
            states[k] = x
            covariances[k] = P
        if k < m:
            advance(x, P, F[k], shift[k], noise[k], fresh)
    return score


@inner
def back_over_interval(F: Array, replaced: Flags, wanted: bool, adjoint: Array, N: Array, T: Array) -> None:
    """Carry the adjoint (n,), and if it is wanted its covariance N (n, n), back over an interval.

    `replaced` (n,) are the states whose row of the transition is not that of the identity; T (n, n) is scratch.
    """
    n, moving, after = adjoint.shape[0], F.shape[0], adjoint.copy()
    for j in range(n):
        adjoint[j] = 0.0 if replaced[j] else after[j]
    add_row_product(adjoint, after[:moving], F, 1.0)
    if not wanted:
        return
    for i in range(n):
        for j in range(n):
            T[i, j] = 0.0 if replaced[j] else N[i, j]
    add_product(T, N[:, :moving], F, 1.0)  # T = N F
    for i in range(n):
        for j in range(n):
            N[i, j] = 0.0 if replaced[i] else T[i, j]
    add_product(N, F.T, T[:moving], 1.0)  # N = F^T T
    mirror(N, n)


@inner
def back_over_samples(h: Array, gains: Array, innovations: Array, wanted: bool, adjoint: Array, N: Array) -> None:
    """Carry the adjoint (n,), and if it is wanted its covariance N (n, n), back over the samples (k) of a knot."""
    n, w = adjoint.shape[0], np.empty(adjoint.shape[0])
    for i in range(h.shape[0] - 1, -1, -1):
        row, gain = h[i], gains[i]
        innovation, variance = innovations[i, 0], innovations[i, 1]
        if wanted:
            w[:] = 0.0
            add_row_product(w, gain, N, 1.0 / variance)
            across = (dot(w, gain) + 1.0) / variance
            for a in range(n):
                w[a] -= 0.5 * across * row[a]
            for a in range(n):
                for j in range(n):
                    N[a, j] -= row[a] * w[j] + row[j] * w[a]
        push = (innovation + dot(gain, adjoint)) / variance
        for a in range(n):
            adjoint[a] -= push * row[a]


@kernel
def smooth_record(F: Array, fresh: Integers, block: Integers, rows: SampleRows, smoothed: Smoothed) -> None:
    """Smooth a record that `filter_record` has filtered; `block` (2,) are first and last (excluded) state of it."""
    (_, _, gains, innovations, filtered, covariances), states, blocks, pulls, informations, inside = smoothed
    start, m, moving, n = rows.start, F.shape[0], F.shape[1], states.shape[1]
    wanted, spread, of_block = pulls.shape[0] > 0, blocks.shape[0] > 0, slice(block[0], block[1])
    adjoint, N, T, replaced = np.zeros(n), np.zeros((n, n)), np.zeros((n, n)), np.zeros(n, np.bool_)
    for j in range(n):
        replaced[j] = j < moving or fresh[0] <= j < fresh[1]
    for k in range(m, -1, -1):
        if k < m:
            back_over_interval(F[k], replaced, wanted, adjoint, N, T)
        P, first, last = covariances[k], start[k], start[k + 1]
        for i in range(n):
            states[k, i] = filtered[k, i] - dot(P[i], adjoint)
        if spread:
            T[:] = 0.0
            add_product(T, P, N, 1.0)
            blocks[k] = P[of_block, of_block]
            add_product(blocks[k], T[of_block], P[:, of_block], -1.0)
        back_over_samples(rows.h[first:last], gains[first:last], innovations[first:last], wanted, adjoint, N)
        if wanted:
            pulls[k] = adjoint
            for a in range(n):
                informations[k, a] = N[a, a]
            inside[k] = N[of_block, of_block]
