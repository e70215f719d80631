"""Compiled kernels of the Bryson-Frazier smoother, which runs from the last interval of a record to the first.

The smoother carries an adjoint l (n,) and its covariance N (n, n) backward over the steps of the filter. U, L and A are
those of the filter, K^T = L^-T U, and p marks the first nv rows: velocities after the update, momenta before it.

    update, backwards:   l_p <- L^-T e - K^T l,   N <- C^T N C + [S^-1 in pp],   C = [0, 0; 0, I] - [K in columns p]
    interval, backwards: l <- F^T l,              N <- F^T N F,                  F = [A, shear^T; 0, decay]

With the filter's estimate x, P after an update, the smoothed estimate is x + P l with covariance P - P N P. No
covariance is inverted.
"""

from __future__ import annotations

import numpy as np

from aerobat_pin.numerics import Array, add_product, add_row_product, copy_values, dot, fields_of, kernel, mirror
from aerobat_pin.observers.kalman.kalman_state import KalmanState, Step
from aerobat_pin.observers.kalman.kernels import report
from aerobat_pin.observers.kalman.learning import drop_unseen


@kernel
def smooth(step: Step, adjoint: Array, N: Array, work: Array) -> None:
    """Replace the coefficients `z` of a step, and their columns of `Z`, by the smoothed values.

    The adjoint (n,) and its covariance N (n, n) are those after the step's update; `work` (h c, n + h c) is scratch.
    """
    Z, h, n = step.Z, step.z.shape[0], adjoint.shape[0]
    nv, c = step.rows.shape[0], h // step.basis.shape[0]
    work[:, :] = 0.0
    add_product(work[:, :n], Z, N, 1.0)
    for a in range(h):
        step.z[a] += dot(Z[a], adjoint)
    for component in range(c):  # only covariances between coefficients of the same component are needed
        for a in range(component, h, c):
            row, reduction = work[a, :n], work[a, n:]
            for b in range(component, h, c):
                reduction[b] = dot(row, Z[b])
    for component in range(c):
        for a in range(component, h, c):
            for b in range(component, h, c):
                Z[a, nv + b] -= work[a, n + b]


@kernel
def back_through_update(step: Step, adjoint: Array, N: Array, K: Array, work: Array) -> None:
    """Carry the adjoint (n,) and its covariance N (n, n) backward over the measurement of a step.

    The filter's gain, then zeros, are written to K (n, n); `work` (nv, n) is scratch.
    """
    n, nv = adjoint.shape[0], work.shape[0]
    T, whitening = step.rows[:, nv : nv + n], step.rows[:, nv + n : nv + 2 * n]
    K[:, :] = 0.0
    add_product(K, T.T, whitening, 1.0)
    copy_values(adjoint, work[0])
    adjoint[:nv] = 0.0
    add_row_product(adjoint, work[0], K, -1.0)
    add_row_product(adjoint, step.rows[:, nv + 2 * n], whitening, 1.0)
    work[:, :] = 0.0
    add_product(work, K[:, :nv].T, N, -1.0)
    for i in range(nv):
        N[i, :nv] = 0.0
        copy_values(work[i, nv:], N[i, nv:])
    add_product(N[:nv], work, K, -1.0)
    add_product(N[:nv], whitening[:, :nv].T, whitening, 1.0)
    mirror(N, nv)


@kernel
def back_through_interval(step: Step, adjoint: Array, N: Array, mirrored: Array, old: Array) -> None:
    """Carry the adjoint (n,) and its covariance N (n, n) backward over the shear and decay of a step.

    `mirrored` (nv, n) and `old` (n, n) are scratch.
    """
    decay = step.decay
    nv, nz = mirrored.shape[0], decay.shape[0]
    right = mirrored[:, nv:]
    for i in range(nv):
        for j in range(nv):
            mirrored[j, i] = step.onward[i, j]
    for a in range(nz):
        row = step.shear[a]
        for i in range(nv):
            right[i, a] = row[i]
    copy_values(adjoint, old[0])
    adjoint[:nv] = 0.0
    add_row_product(adjoint, old[0, :nv], mirrored, 1.0)
    for i in range(nv):
        copy_values(N[i], old[i])
    N[:nv] = 0.0
    add_product(N, mirrored.T, old[:nv], 1.0)
    for i in range(nv + nz):
        copy_values(N[i, :nv], old[i, :nv])
    N[:, :nv] = 0.0
    add_product(N, old[:, :nv], mirrored, 1.0)
    if step.blind[0] > 0.0:
        drop_unseen(step, nv, adjoint.reshape((nv + nz, 1)))
        drop_unseen(step, nv, N)
        drop_unseen(step, nv, N.T)
    for a in range(nz):
        if decay[a] != 1.0:
            adjoint[nv + a] *= decay[a]
            for j in range(nv + nz):
                N[nv + a, j] *= decay[a]
            for j in range(nv + nz):
                N[j, nv + a] *= decay[a]


@kernel
def smooth_all(time: Array, memory: Array, steps: Array, out: Array) -> None:
    """Smooth a record, at times (m + 1,) [s], over which the filter has run.

    Its steps (m, step size) change. The first nv + 2 c columns of `out` are written: residual, components, deviations.
    """
    latest = fields_of(memory, KalmanState).step
    n, nv, h = latest.shear.shape[1], latest.e.shape[0], latest.z.shape[0]
    adjoint, N, K, work = np.zeros(n), np.zeros((n, n)), np.empty((n, n)), np.empty((nv, n))
    smoothing, mirrored, old = np.empty((h, n + h)), np.zeros((nv, n)), np.empty((n, n))
    for k in range(out.shape[0] - 1, -1, -1):
        dt = time[k + 1] - time[k]
        if dt > 0.0:
            step = fields_of(steps[k], Step)
            smooth(step, adjoint, N, smoothing)
            report(step, dt, out[k])
            back_through_update(step, adjoint, N, K, work)
            back_through_interval(step, adjoint, N, mirrored, old)
