"""The smoother's arithmetic, compiled: Bryson-Frazier, from the last interval of a record back to the first.

Along the filter's own steps run an adjoint l (n,) and its covariance N (n, n). With the filter's K^T = L^-T T, T and L
of its update, and the momentum's rows p,

    update, backwards:   l_p <- l_p + L^-T e - K^T l,   N <- C^T N C + [S^-1 in pp],   C = I - [K in columns p]
    interval, backwards: l <- F^T l,                    N <- F^T N F

and after each update's estimate x, P the smoothed one is x + P l with covariance P - P N P. No covariance is inverted.
"""

from __future__ import annotations

import numpy as np

from aerobat_pin.numerics import Array, add_product, add_row_product, copy_values, dot, kernel, mirror
from aerobat_pin.observers.kalman.kernels import report
from aerobat_pin.observers.kalman.memory import Step, kalman_in, step_in


@kernel
def smooth(step: Step, adjoint: Array, N: Array, work: Array) -> None:
    """Replace the coefficients and their covariance in a step by the smoothed ones.

    Args:
        step: `z` and the coefficients' part of `Z` change.
        adjoint: (n,) after the step's update.
        N: (n, n) its covariance.
        work: (h c, n + h c) scratch.
    """
    Z, h, n = step.Z, step.z.shape[0], adjoint.shape[0]
    nv, c = step.rows.shape[0], h // step.basis.shape[0]
    work[:, :] = 0.0
    add_product(work[:, :n], Z, N, 1.0)
    for a in range(h):
        step.z[a] += dot(Z[a], adjoint)
    for component in range(c):  # a component needs the covariance of its own coefficients alone
        for a in range(component, h, c):
            row, found = work[a, :n], work[a, n:]
            for b in range(component, h, c):
                found[b] = dot(row, Z[b])
    for component in range(c):
        for a in range(component, h, c):
            for b in range(component, h, c):
                Z[a, nv + b] -= work[a, n + b]


@kernel
def back_through_update(step: Step, adjoint: Array, N: Array, K: Array, work: Array) -> None:
    """Carry the adjoint and its covariance back over the step's measurement.

    Args:
        step: the filter's.
        adjoint: (n,) changes.
        N: (n, n) changes.
        K: (n, n) written: the filter's gain, then zeros.
        work: (nv, n) scratch.
    """
    n, nv = adjoint.shape[0], work.shape[0]
    T, whitening = step.rows[:, nv : nv + n], step.rows[:, nv + n : nv + 2 * n]
    K[:, :] = 0.0
    add_product(K, T.T, whitening, 1.0)
    copy_values(adjoint, work[0])
    add_row_product(adjoint, work[0], K, -1.0)
    add_row_product(adjoint, step.rows[:, nv + 2 * n], whitening, 1.0)
    for i in range(nv):
        copy_values(N[i], work[i])
    add_product(work, K[:, :nv].T, N, -1.0)
    for i in range(nv):
        copy_values(work[i], N[i])
    add_product(N[:nv], work, K, -1.0)
    add_product(N[:nv], whitening[:, :nv].T, whitening, 1.0)
    mirror(N, nv)


@kernel
def back_through_interval(step: Step, adjoint: Array, N: Array, mirrored: Array) -> None:
    """Carry the adjoint (n,) and its covariance N (n, n) back over shear and decay.

    Args:
        step: the filter's.
        adjoint: (n,) changes.
        N: (n, n) changes.
        mirrored: (nv, n) scratch, zero at first.
    """
    decay = step.decay
    nv, nz = mirrored.shape[0], decay.shape[0]
    shear, right = step.shear[:, :nv], mirrored[:, nv:]
    for a in range(nz):
        row = step.shear[a]
        for i in range(nv):
            right[i, a] = row[i]
    add_row_product(adjoint, adjoint[:nv], mirrored, 1.0)
    add_product(N[nv:], shear, N[:nv], 1.0)
    add_product(N, N[:, :nv], mirrored, 1.0)
    for a in range(nz):
        if decay[a] != 1.0:
            adjoint[nv + a] *= decay[a]
            for j in range(nv + nz):
                N[nv + a, j] *= decay[a]
            for j in range(nv + nz):
                N[j, nv + a] *= decay[a]


@kernel
def smooth_all(time: Array, memory: Array, steps: Array, out: Array) -> None:
    """Smooth a record that the filter has gone through.

    Args:
        time: (m + 1,) [s].
        memory: the filter.
        steps: (m, size of a step); they change.
        out: (m, nv + 2 c) written: residual, components, standard deviations.
    """
    latest = kalman_in(memory).step
    n, nv, h = latest.shear.shape[1], latest.e.shape[0], latest.z.shape[0]
    adjoint, N, K, work = np.zeros(n), np.zeros((n, n)), np.empty((n, n)), np.empty((nv, n))
    smoothing, mirrored = np.empty((h, n + h)), np.zeros((nv, n))
    for k in range(out.shape[0] - 1, -1, -1):
        dt = time[k + 1] - time[k]
        if dt > 0.0:
            step = step_in(steps[k], latest)
            smooth(step, adjoint, N, smoothing)
            report(step, dt, out[k])
            back_through_update(step, adjoint, N, K, work)
            back_through_interval(step, adjoint, N, mirrored)
