"""Compiled kernels that write a sample of the Kalman filter: what every observer keeps, then M and D M^-1."""

from __future__ import annotations

from aerobat_pin.numerics import Array, array_at, factorise, inner
from aerobat_pin.observers.kalman.memory import Filter
from aerobat_pin.observers.kernels.memory import ObserverMemory
from aerobat_pin.observers.kernels.residual import dynamics_of, write_sample


@inner
def write_noisy_sample(observer: ObserverMemory, filter_: Filter, v: Array, sample: Array) -> None:
    """Write a sample: the rows (3 + c, nv) that `write_sample` writes, then M and D M^-1 (nv, nv each)."""
    M, nv = dynamics_of(observer).M, v.shape[0]
    top = sample.shape[0] - 2 * nv
    write_sample(observer, v, sample[:top])
    for k in range(nv):
        for i in range(nv):
            sample[top + k, i] = M[i, k]
    slope_by_momentum(dynamics_of(observer).C, filter_, sample[top : top + nv], sample[top + nv :])


@inner
def slope_by_momentum(C: Array, filter_: Filter, M: Array, slope: Array) -> None:
    """Write D M^-1 (nv, nv), with D = C + C^T + E - B the derivative of C^T v by v; see `slopes`."""
    nv, inverse = M.shape[0], filter_.inverse
    E = array_at(filter_.derivatives[0], (nv, nv))
    B = array_at(filter_.derivatives[1], (nv, nv))
    for i in range(nv):
        for j in range(nv):
            inverse[i, j], inverse[i, nv + j] = M[i, j], 0.0
        inverse[i, nv + i] = 1.0
    factorise(inverse)  # M = L L^T: the right half is L^-1, so M^-1 = L^-T L^-1
    root, turned = inverse[:, nv:], filter_.turned
    for i in range(nv):
        for k in range(nv):
            total = 0.0
            for j in range(k + 1):
                total += (C[i, j] + C[j, i] + E[i, j] - B[i, j]) * root[k, j]
            turned[i, k] = total
    for i in range(nv):
        for j in range(nv):
            slope[i, j] = 0.0
        for k in range(nv):
            for j in range(k + 1):
                slope[i, j] += turned[i, k] * root[k, j]
