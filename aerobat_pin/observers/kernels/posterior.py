"""Unknown components from a generalised force, given what was expected of the components and of the rows' errors."""

from __future__ import annotations

import numpy as np

from aerobat_pin.numerics import Array, copy_values, dot, inner, solve_factored, solve_positive
from aerobat_pin.observers.kernels.observer_state import ObserverState
from aerobat_pin.observers.kernels.projection import POWER_ROW, power_unit, put_rows
from aerobat_pin.observers.rows import BASE_ROWS, TIED

LEAST_SPARE = 0.5  # rows beyond what the components take up, below which nothing shows the size of the errors
# Rows of `ObserverState.posterior`: of components S^-2 and scratch; of rows the variance where nothing touches, what
# stiction adds at rest, the rate at which that fades, whitened remainders behind the filter, and scratch; then the k
# that is expected, its mean over some seconds, and the time [s] over which that was taken.
INFORMATION, COLUMN, ROW_VARIANCE, STICTION, STICTION_RATE, REMAINDER, VARIANCE, LEVELS = range(8)
MEMORY_OF_K = 2.5  # [s]: how long errors of the rows last


@inner
def estimate_posterior(
    observer: ObserverState, before: Array, after: Array, generalized: Array, dt: float, force: Array, doubt: Array
) -> None:
    """Write the components `force` (c,), given the generalised force (nv,): one row of `momentum_equations.posterior`.

    To `doubt` (c + 1,) are written their standard deviations, then k of this instant alone; NaN without a row to spare.
    """
    c, span, remainder = force.shape[0], observer.span, observer.posterior[REMAINDER]
    information, levels = observer.posterior[INFORMATION], observer.posterior[LEVELS]
    whiten_rows(observer, before, after, generalized)
    solve_for_components(observer, 1.0, force, doubt)
    spare = float(observer.sizes.believed)
    for i in range(c):
        spare -= 1.0 - (doubt[i] * doubt[i] * information[i]) ** 2
    kept, size = np.exp(-observer.gain[0] * dt), 0.0
    for s in range(span.shape[1]):  # of y - J^T f, whitened
        unfiltered = span[c, s]
        for i in range(c):
            unfiltered -= force[i] * span[i, s]
        remainder[s] = unfiltered + kept * (remainder[s] - unfiltered)
        size += remainder[s] * remainder[s]
    k = size / spare if spare >= LEAST_SPARE else np.nan
    doubt[c] = k
    if k > 0.0:
        levels[2] += dt
        levels[1] += min(dt / levels[2] + dt / MEMORY_OF_K, 1.0) * (k - levels[1])
    k = max(k, levels[1], levels[0]) if k > 0.0 else max(levels[1], levels[0])
    if k > 1.0:
        solve_for_components(observer, k, force, doubt)


@inner
def whiten_rows(observer: ObserverState, before: Array, after: Array, generalized: Array) -> None:
    """Write the rows in use of the Jacobians, and then of the generalised force, over the rows' standard deviations."""
    c, nv, span, given = observer.fitted.shape[0], generalized.shape[0], observer.span, observer.given
    velocity, table = observer.velocity, observer.posterior
    variance = table[VARIANCE]
    weight, kind, tied = observer.weight, observer.sizes.rows, observer.tied
    for k in range(nv):
        velocity[k] = 0.5 * (before[2, k] + after[2, k])
        sliding = np.tanh(velocity[k] / table[STICTION_RATE, k])
        variance[k] = table[ROW_VARIANCE, k] + table[STICTION, k] * (1.0 - sliding * sliding)
    for i in range(c):
        copy_values(observer.jacobian[i], given[i])
    copy_values(generalized, given[c])
    unit = power_unit(observer, velocity)
    put_rows(observer, given, velocity, unit, span)
    for s in range(min(observer.sizes.believed, nv)):  # a base without joints has no row of power
        size = 0.0
        if kind == TIED:
            for k in range(nv):
                size += tied[k, s] * tied[k, s] * variance[k]
        elif kind == POWER_ROW and s == BASE_ROWS:
            for k in range(BASE_ROWS, nv):
                size += (unit * velocity[k]) ** 2 * variance[k]
        else:
            size = weight[s] * weight[s] * variance[s]
        scale = 1.0 / np.sqrt(size) if size > 0.0 else 0.0
        for i in range(c + 1):
            span[i, s] *= scale


@inner
def solve_for_components(observer: ObserverState, k: float, force: Array, doubt: Array) -> None:
    """Write the components and their standard deviations, given whitened rows and k."""
    A, span, c = observer.equations, observer.span, force.shape[0]
    information, column = observer.posterior[INFORMATION], observer.posterior[COLUMN, :c]
    for i in range(c):
        force[i] = dot(span[i], span[c]) / k
        for j in range(i + 1):
            A[i, j] = dot(span[i], span[j]) / k
        A[i, i] += information[i]
    solve_positive(A, force)
    for i in range(c):
        column[i] = information[i] * force[i]
    solve_factored(A, column)
    for i in range(c):
        force[i] += column[i]
    for _ in range(2):
        for i in range(c):
            column[i] *= information[i]
        solve_factored(A, column)
    for i in range(c):
        force[i] -= column[i]
    for j in range(c):  # P_jj = |L^-1 e_j|^2 with the Cholesky factor L that is left in A
        size = 0.0
        for i in range(j, c):
            column[i] = 1.0 if i == j else 0.0
            for m in range(j, i):
                column[i] -= A[i, m] * column[m]
            column[i] /= A[i, i]
            size += column[i] * column[i]
        doubt[j] = np.sqrt(size)


@inner
def forget_errors(observer: ObserverState) -> None:
    """Begin without errors of the rows."""
    if observer.sizes.expected > 0:
        observer.posterior[REMAINDER, :] = 0.0
        observer.posterior[LEVELS, 1:3] = 0.0
