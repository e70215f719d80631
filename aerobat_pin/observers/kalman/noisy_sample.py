"""Compiled kernels for what a noisy velocity does to a sample of the Kalman filter.

Noise n of the measured velocity enters the momentum as M n and, with D the derivative of C^T v (see `slopes`), the
impulse of C^T v over an interval as D n dt/2 at each of its ends. Both belong together:

    (M_1 - D_1 dt/2) n_1    is the noise of what is measured at the end of an interval
    (M_0 + D_0 dt/2) n_0    is what the error of the velocity at its start is at its end
"""

from __future__ import annotations

from aerobat_pin.numerics import Array, array_at, copy_values, factorise, inner
from aerobat_pin.observers.kalman.memory import Filter
from aerobat_pin.observers.kernels.memory import ObserverMemory
from aerobat_pin.observers.kernels.residual import dynamics_of, write_sample

LEAST_PIVOT = 0.1  # of M's: with smaller pivots of M - D dt/2, dt is too long for the trapezoid of C^T v


@inner
def write_noisy_sample(observer: ObserverMemory, filter_: Filter, v: Array, sample: Array) -> None:
    """Write a sample: the rows (3 + c, nv) that `write_sample` writes, then M and D^T (nv, nv each)."""
    dynamics, nv = dynamics_of(observer), v.shape[0]
    top, C = sample.shape[0] - 2 * nv, dynamics.C
    write_sample(observer, v, sample[:top])
    E = array_at(filter_.derivatives[0], (nv, nv))
    B = array_at(filter_.derivatives[1], (nv, nv))
    for k in range(nv):
        for i in range(nv):
            sample[top + k, i] = dynamics.M[i, k]
            sample[top + nv + k, i] = C[i, k] + C[k, i] + E[i, k] - B[i, k]


@inner
def own_velocity_until(sample: Array, half: float, filter_: Filter) -> float:
    """Write (D (M - half D)^-1)^T into the right half of `filter_.inverse`; return half, or 0 where 0 was taken for it.

    With 0 the interval's C^T v is that of the measured velocity, as it must be where M - half D is nearly singular.

    Args:
        sample: (3 + c + 2 nv, nv) sample at the end of an interval.
        half: half the length of the interval [s].
        filter_: the filter; `inverse` and `turned` are written.
    """
    rows, least, nv = filter_.inverse, filter_.turned[0], sample.shape[1]
    M, slope = sample[sample.shape[0] - 2 * nv : sample.shape[0] - nv], sample[sample.shape[0] - nv :]
    for i in range(nv):
        copy_values(M[i], rows[i, :nv])
    factorise(rows[:, :nv])
    for i in range(nv):
        least[i] = LEAST_PIVOT * rows[i, i] * rows[i, i]
    if divided(slope, M, half, least, rows):
        return half
    divided(slope, M, 0.0, least, rows)
    return 0.0


@inner
def divided(slope: Array, M: Array, half: float, least: Array, rows: Array) -> bool:
    """Write (D (M - half D)^-1)^T into the right half of rows (nv, 2 nv), slope being D^T; False at a small pivot."""
    nv = M.shape[0]
    for i in range(nv):
        for j in range(nv):
            rows[i, j], rows[i, nv + j] = M[i, j] - half * slope[i, j], slope[i, j]
    for k in range(nv):
        if not rows[k, k] > least[k]:
            return False
        inverse = 1.0 / rows[k, k]
        for j in range(k + 1, 2 * nv):
            rows[k, j] *= inverse
        for i in range(nv):
            if i != k:
                factor = rows[i, k]
                for j in range(k + 1, 2 * nv):
                    rows[i, j] -= factor * rows[k, j]
    return True
