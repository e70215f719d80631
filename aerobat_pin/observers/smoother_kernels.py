"""The smoother's arithmetic, compiled: Bryson-Frazier, from the last interval of a record back to the first.

Along the filter's own steps run an adjoint l (n,) and its covariance N (n, n). With K^T = L^-T T, from T and L of
the filter's update, and the momentum's rows p,

    update, backwards:   l_p <- l_p + L^-T (e - T l),   N <- C^T N C + [S^-1 in pp],   C = I - [K in columns p]
    interval, backwards: l <- F^T l,                    N <- F^T N F

and after each update's estimate x, P the smoothed one is x + P l with covariance P - P N P. No covariance is inverted.
"""

from __future__ import annotations

import numpy as np

from aerobat_pin.arrays import Array
from aerobat_pin.jit import kernel
from aerobat_pin.observers.kalman_kernels import report
from aerobat_pin.observers.kalman_store import PULSATION, Step, unpack, unpack_step


@kernel
def smooth(step: Step, adjoint: Array, N: Array) -> None:
    """Replace the coefficients and their covariance in a step by the smoothed ones.

    Args:
        step: `z` and the coefficients' part of `Z` change.
        adjoint: (n,) after the step's update.
        N: (n, n) its covariance.
    """
    Z, h, n, nv = step.Z, step.z.shape[0], adjoint.shape[0], step.e.shape[0]
    c, row, found = h // step.basis.shape[0], np.empty(n), np.empty((h, h))
    for a in range(h):
        for j in range(n):
            row[j] = 0.0
        for k in range(n):
            factor = Z[a, k]
            for j in range(n):
                row[j] += factor * N[k, j]
        for j in range(n):
            step.z[a] += Z[a, j] * adjoint[j]
        for b in range(a % c, h, c):
            taken = 0.0
            for j in range(n):
                taken += row[j] * Z[b, j]
            found[a, b] = Z[a, nv + b] - taken
    for a in range(h):
        for b in range(a % c, h, c):
            Z[a, nv + b] = found[a, b]


@kernel
def back_substitute(L: Array, B: Array, first: int) -> None:
    """Solve L^T X = B in place, L lower triangular, for the columns from `first` on."""
    for i in range(L.shape[0] - 1, -1, -1):
        for k in range(i + 1, L.shape[0]):
            factor = L[k, i]
            for j in range(first, B.shape[1]):
                B[i, j] -= factor * B[k, j]
        inverse = 1.0 / L[i, i]
        for j in range(first, B.shape[1]):
            B[i, j] *= inverse


@kernel
def back_through_update(step: Step, adjoint: Array, N: Array, work: Array) -> None:
    """Carry the adjoint and its covariance back over the step's measurement.

    N_p <- N_p - L^-T T N and its mirror image, then N_pp <- N_pp + L^-T (T N T^T + I) L^-1.

    Args:
        step: the filter's.
        adjoint: (n,) changes.
        N: (n, n) changes.
        work: (nv, n + nv + 1) scratch.
    """
    L, T = step.L, step.T
    nv, n = T.shape
    last = n + nv
    for i in range(nv):
        row, missing = work[i], step.e[i]
        for j in range(n):
            missing -= T[i, j] * adjoint[j]
            entry = 0.0
            for k in range(n):
                entry += T[i, k] * N[j, k]
            row[j] = entry
        row[last] = missing
        for j in range(i + 1):
            entry = 0.0
            for k in range(n):
                entry += row[k] * T[j, k]
            row[n + j] = entry
            work[j, n + i] = entry
        row[n + i] += 1.0
    back_substitute(L, work, 0 * n)  # an int like n: a literal would compile a second version
    for i in range(nv):
        adjoint[i] += work[i, last]
        for j in range(n):
            N[i, j] -= work[i, j]
    for i in range(nv):
        for j in range(n):
            N[j, i] -= work[i, j]
    for i in range(nv):
        for j in range(i):
            work[i, n + j], work[j, n + i] = work[j, n + i], work[i, n + j]
    back_substitute(L, work, n)
    for i in range(nv):
        for j in range(nv):
            N[i, j] += work[i, n + j]


@kernel
def back_through_interval(step: Step, adjoint: Array, N: Array, half: Array) -> None:
    """Carry the adjoint (n,) and its covariance N (n, n) back over shear and decay; half (nz, nv) is scratch."""
    shear, decay = step.shear, step.decay
    nz, nv = shear.shape
    for a in range(nz):
        for i in range(nv):
            half[a, i] = 0.0
            adjoint[nv + a] += shear[a, i] * adjoint[i]
        for k in range(nv):
            factor = 0.5 * shear[a, k]
            for i in range(nv):
                half[a, i] += factor * N[k, i]
    for a in range(nz):
        for i in range(nv):
            N[nv + a, i] += half[a, i]
    for a in range(nz):
        for b in range(a + 1):
            entry = 0.0
            for i in range(nv):
                entry += shear[a, i] * N[nv + b, i] + N[nv + a, i] * shear[b, i]
            N[nv + a, nv + b] += entry
            N[nv + b, nv + a] = N[nv + a, nv + b]
    for a in range(nz):
        for i in range(nv):
            N[nv + a, i] += half[a, i]
            N[i, nv + a] = N[nv + a, i]
    for a in range(nz):
        if decay[a] != 1.0:
            adjoint[nv + a] *= decay[a]
            for j in range(nv + nz):
                N[nv + a, j] *= decay[a]
            for j in range(nv + nz):
                N[j, nv + a] *= decay[a]


@kernel
def smooth_all(time: Array, flat: Array, steps: Array, out: Array) -> None:
    """Smooth a record that the filter has gone through.

    Args:
        time: (m + 1,) [s].
        flat: the observer's store.
        steps: (m, size of a step); they change.
        out: (m, nv + 2 c) written: residual, components, standard deviations.
    """
    filter_ = unpack(flat)
    n, nv, c = filter_.x.shape[0], filter_.noise.shape[0], filter_.walk.shape[0]
    adjoint, N = np.zeros(n), np.zeros((n, n))
    work, half = np.empty((nv, n + nv + 1)), np.empty((n - nv, nv))
    for k in range(out.shape[0] - 1, -1, -1):
        dt = time[k + 1] - time[k]
        if dt > 0.0:
            step = unpack_step(steps[k], nv, n - nv, c, filter_.settings[PULSATION] > 0.0)
            smooth(step, adjoint, N)
            report(step, dt, out[k])
            back_through_update(step, adjoint, N, work)
            back_through_interval(step, adjoint, N, half)
