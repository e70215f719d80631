"""Unknown components from a generalised force, by weighted and damped least squares over the rows in use."""

from __future__ import annotations

import numpy as np

from aerobat_pin.numerics import Array, copy_values, dot, eigenvectors, inner, kernel, solve_positive
from aerobat_pin.observers.kernels.observer_state import ObserverState
from aerobat_pin.observers.rows import BASE_ROWS, ROWS, TIED

DAMPING = 1.0e-12  # added to the diagonal, as a share of the trace of J W J^T
SUSPECT = 1.0e-4  # share of the trace: a smaller pivot means that some pattern of components may leave no trace
UNSEEN_EIGENVALUE = 1.0e-10  # share of the trace: a smaller eigenvalue belongs to a pattern that leaves no trace
ALL_ROWS, POWER_ROW = ROWS.index("all"), ROWS.index("base+power")


@inner
def normal_equations(
    observer: ObserverState, J: Array, velocity: Array, generalized: Array, A: Array, b: Array
) -> float:
    """Write A = (J L)(J L)^T (lower triangle) and b = J L L^T phi, L the weighted rows in use; return the trace of A.

    The rows J L, then phi^T L, are written to `observer.span`. The joints' velocities are the direction of the power
    row.
    """
    size, span, given, trace = b.shape[0], observer.span, observer.given, 0.0
    for i in range(size):
        copy_values(J[i], given[i])
    copy_values(generalized, given[size])
    put_rows(observer, given, velocity, power_unit(observer, velocity), span)
    for i in range(size):  # b = B y, A = B B^T with B = J L
        b[i] = dot(span[i], span[size])
        for j in range(i + 1):
            A[i, j] = dot(span[i], span[j])
        trace += A[i, i]
    return trace


@inner
def put_rows(observer: ObserverState, generalized: Array, velocity: Array, unit: float, rows: Array) -> None:
    """Write the weighted rows in use of generalised forces (m, nv), padded with zeros; unit is `power_unit`."""
    weight, kind, tied, (count, nv) = observer.weight, observer.sizes.rows, observer.tied, rows.shape
    if kind == ALL_ROWS:
        for i in range(count):
            for k in range(nv):
                rows[i, k] = weight[k] * generalized[i, k]
        return
    rows[:, :] = 0.0
    for i in range(count):
        force, row = generalized[i], rows[i]
        if kind == TIED:
            for k in range(nv):
                for s in range(tied.shape[1]):
                    row[s] += tied[k, s] * force[k]
            continue
        for k in range(BASE_ROWS):
            row[k] = weight[k] * force[k]
        if kind == POWER_ROW:  # the power of all joints, per unit of joint velocity
            for k in range(BASE_ROWS, nv):
                row[BASE_ROWS] += unit * velocity[k] * force[k]


@inner
def power_unit(observer: ObserverState, velocity: Array) -> float:
    """Return the weight of the row of the joints' power, over the joints' speed; 0 if they stand still."""
    nv, speed = velocity.shape[0], 0.0
    if observer.sizes.rows == POWER_ROW:
        for k in range(BASE_ROWS, nv):
            speed += (velocity[k] / observer.weight[k]) ** 2
    return float(1.0 / np.sqrt(speed)) if speed > 0.0 else 0.0


@kernel
def project(observer: ObserverState, before: Array, after: Array, generalized: Array, force: Array) -> float:
    """Write the components `force` (c,) that best fit a generalised force (nv,), using the mid-interval Jacobian.

    Returns the smallest pivot of the equations as a share of their trace. The number of patterns that leave no trace is
    written to `observer.blind`, and the projector onto them to `observer.unseen`.
    """
    observer.blind[0] = 0
    if force.shape[0] == 0:
        return 1.0
    A, velocity = observer.equations, observer.velocity
    if observer.sizes.rows == POWER_ROW:
        for k in range(BASE_ROWS, velocity.shape[0]):
            velocity[k] = 0.5 * (before[2, k] + after[2, k])
    trace = normal_equations(observer, observer.jacobian, velocity, generalized, A, force)
    for i in range(force.shape[0]):
        A[i, i] += DAMPING * trace if trace > 0.0 else 1.0  # trace 0: no row depends on the forces, which become 0
    least = solve_positive(A, force)  # A f = b
    if least < SUSPECT * trace:
        project_deficient(observer, after, generalized, force)
    return least / trace if trace > 0.0 else 0.0


@inner
def fit_forces(observer: ObserverState, before: Array, after: Array, generalized: Array, remainder: Array) -> None:
    """Split a generalised force into what forces can explain and what no force explains.

    The components that fit best are written to `observer.fitted`. What remains of the weighted rows in use is

        r = L^T (phi - J^T f)       L: the rows in use, moments over a lever arm of 50 mm (see `BelievedRows.map`)

    It is written to `remainder` (nv + 1,): r, padded with zeros, and the equations' smallest pivot over their trace.
    """
    nv, force, span = generalized.shape[0], observer.fitted, observer.span
    remainder[nv] = project(observer, before, after, generalized, force)
    if force.shape[0] == 0:
        remainder[:nv] = 0.0
        return
    copy_values(span[force.shape[0]], remainder[:nv])
    for i in range(force.shape[0]):
        for k in range(nv):
            remainder[k] -= force[i] * span[i, k]


@inner
def project_deficient(observer: ObserverState, after: Array, generalized: Array, force: Array) -> None:
    """Do what `project` does if some pattern of forces leaves no trace, see `momentum_equations.Projection.of`."""
    A, size = observer.equations, force.shape[0]
    seen, V, unused = np.zeros((size, size)), np.empty((size, size)), np.empty(size)
    limit = UNSEEN_EIGENVALUE * normal_equations(observer, after[3:], after[2], generalized, seen, unused)
    for i in range(size):
        for j in range(i):
            seen[j, i] = seen[i, j]
    eigenvectors(seen, V)
    trace = normal_equations(observer, observer.jacobian, observer.velocity, generalized, A, force)
    observer.unseen[:, :] = 0.0
    for k in range(size):
        if seen[k, k] > limit:
            continue
        observer.blind[0] += 1
        for i in range(size):
            for j in range(size):
                observer.unseen[i, j] += V[i, k] * V[j, k]
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
