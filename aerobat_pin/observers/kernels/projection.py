"""Unknown components from a generalised force, by weighted and damped least squares over the rows in use."""

from __future__ import annotations

import numpy as np

from aerobat_pin.numerics import Array, eigenvectors, inner, kernel, solve_positive
from aerobat_pin.observers.kernels.memory import ObserverMemory
from aerobat_pin.observers.rows import BASE_ROWS, ROWS, TIED

DAMPING = 1.0e-12  # added to the diagonal, as a share of the trace of J W J^T
SUSPECT = 1.0e-6  # share of the trace: a smaller pivot means that some pattern of components may leave no trace
UNSEEN_EIGENVALUE = 1.0e-10  # share of the trace: a smaller eigenvalue belongs to a pattern that leaves no trace
ALL_ROWS, POWER_ROW = ROWS.index("all"), ROWS.index("base+power")


@inner
def normal_equations(
    observer: ObserverMemory, J: Array, velocity: Array, generalized: Array, A: Array, b: Array
) -> float:
    """Write A = J W^2 J^T (lower triangle) and b = J W^2 phi over the rows in use; return the trace of A.

    Args:
        observer: rows and weights.
        J: (c, nv) Jacobians of the components.
        velocity: (nv,) velocity; its joint part is the direction of the power row.
        generalized: (nv,) generalised force phi.
        A: (c, c) written.
        b: (c,) written.
    """
    size, nv, rows = b.shape[0], generalized.shape[0], observer.sizes.rows
    for i in range(size):
        b[i] = 0.0
        for j in range(i + 1):
            A[i, j] = 0.0
    if rows == TIED:
        tied_equations(observer.metric, J, generalized, A, b)
    for k in range(nv if rows == ALL_ROWS else BASE_ROWS if rows < TIED else 0):
        squared = observer.weight[k] * observer.weight[k]
        for i in range(size):
            row = squared * J[i, k]
            b[i] += row * generalized[k]
            for j in range(i + 1):
                A[i, j] += row * J[j, k]
    if rows == POWER_ROW:  # the power of all joints, per unit of joint velocity
        speed, power = 0.0, 0.0
        for k in range(BASE_ROWS, nv):
            speed += velocity[k] * velocity[k]
            power += velocity[k] * generalized[k]
        squared = observer.weight[nv - 1] ** 2 / speed if speed > 0.0 else 0.0
        for i in range(size):
            along = 0.0
            for k in range(BASE_ROWS, nv):
                along += J[i, k] * velocity[k]
            b[i] += squared * along * power
            for j in range(i + 1):
                other = 0.0
                for k in range(BASE_ROWS, nv):
                    other += J[j, k] * velocity[k]
                A[i, j] += squared * along * other
    trace = 0.0
    for i in range(size):
        trace += A[i, i]
    return trace


@inner
def tied_equations(metric: Array, J: Array, generalized: Array, A: Array, b: Array) -> None:
    """Add J W J^T (lower triangle) to A and J W phi to b, where W is the metric of tied rows."""
    for i in range(J.shape[0]):
        for k in range(J.shape[1]):
            weighted = 0.0
            for m in range(J.shape[1]):
                weighted += J[i, m] * metric[m, k]
            b[i] += weighted * generalized[k]
            for j in range(i + 1):
                A[i, j] += weighted * J[j, k]


@kernel
def project(observer: ObserverMemory, before: Array, after: Array, generalized: Array, force: Array) -> None:
    """Write the components (c,) that best fit a generalised force (nv,), using the mid-interval Jacobian.

    Args:
        observer: rows, weights, Jacobian, scratch.
        before: (3 + c, nv) sample at the start of the interval, for the direction of the power row.
        after: (3 + c, nv) sample at the end of the interval.
        generalized: (nv,) generalised force.
        force: (c,) components, written.
    """
    if force.shape[0] == 0:
        return
    A, velocity = observer.equations, observer.velocity
    if observer.sizes.rows == POWER_ROW:
        for k in range(BASE_ROWS, velocity.shape[0]):
            velocity[k] = 0.5 * (before[2, k] + after[2, k])
    trace = normal_equations(observer, observer.jacobian, velocity, generalized, A, force)
    for i in range(force.shape[0]):
        A[i, i] += DAMPING * trace if trace > 0.0 else 1.0  # trace 0: no row depends on the forces, which become 0
    if solve_positive(A, force) < SUSPECT * trace:
        project_deficient(observer, after, generalized, force)


@inner
def project_deficient(observer: ObserverMemory, after: Array, generalized: Array, force: Array) -> None:
    """Do what `project` does if some pattern of forces leaves no trace; the result contains nothing of this pattern.

    The mean of two rank-deficient Jacobians has nearly, but not exactly, deficient rank, and least squares with it
    would magnify such patterns. They are therefore found with the exact Jacobian at the end of the interval.
    """
    A, size = observer.equations, force.shape[0]
    seen, V, unused = np.zeros((size, size)), np.empty((size, size)), np.empty(size)
    limit = UNSEEN_EIGENVALUE * normal_equations(observer, after[3:], after[2], generalized, seen, unused)
    for i in range(size):
        for j in range(i):
            seen[j, i] = seen[i, j]
    eigenvectors(seen, V)
    trace = normal_equations(observer, observer.jacobian, observer.velocity, generalized, A, force)
    for k in range(size):
        if seen[k, k] > limit:
            continue
        part = 0.0
        for i in range(size):
            part += V[i, k] * force[i]
        for i in range(size):
            force[i] -= part * V[i, k]
            for j in range(i + 1):
                A[i, j] += trace * V[i, k] * V[j, k]
    for i in range(size):
        A[i, i] += DAMPING * trace if trace > 0.0 else 1.0
    solve_positive(A, force)
