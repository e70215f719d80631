"""Unknown components from a generalised force, by weighted and damped least squares over the rows in use."""

from __future__ import annotations

import numpy as np

from aerobat_pin.numerics import Array, eigenvectors, inner, merged, solve_positive
from aerobat_pin.observers.kernels.memory import ObserverMemory
from aerobat_pin.observers.rows import BASE_ROWS, ROWS, TIED

DAMPING = 1.0e-12  # added to the diagonal, as a share of the trace of J W J^T
SUSPECT = 1.0e-4  # share of the trace: a smaller pivot means that some pattern of components may leave no trace
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
        tied_equations(observer.tied, J, generalized, A, b)
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
            speed += in_unit_of_last_row(observer, velocity, k) ** 2
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
def in_unit_of_last_row(observer: ObserverMemory, velocity: Array, k: int) -> float:
    """Return a joint's velocity, divided by the lever arm if it slides and the last joint turns (or the reverse)."""
    ratio: float = observer.weight[observer.weight.shape[0] - 1] / observer.weight[k]
    return ratio * float(velocity[k])


@inner
def tied_equations(tied: Array, J: Array, generalized: Array, A: Array, b: Array) -> None:
    """Add (J L)(J L)^T (lower triangle) to A and J L L^T phi to b, where L (nv, ns) are the weighted tied rows."""
    row = np.empty(b.shape[0])
    for s in range(tied.shape[1]):
        known = 0.0
        for k in range(tied.shape[0]):
            known += tied[k, s] * generalized[k]
        for i in range(b.shape[0]):
            row[i] = 0.0
            for k in range(tied.shape[0]):
                row[i] += J[i, k] * tied[k, s]
            b[i] += row[i] * known
            for j in range(i + 1):
                A[i, j] += row[i] * row[j]


@merged
def project(observer: ObserverMemory, before: Array, after: Array, generalized: Array, force: Array) -> float:
    """Write the components (c,) that best fit a generalised force (nv,), using the mid-interval Jacobian.

    Returns the smallest pivot of the equations as a share of their trace. The number of patterns that leave no trace is
    written to `observer.blind`, and the projector onto them to `observer.unseen`.

    Args:
        observer: rows, weights, Jacobian, scratch.
        before: (3 + c, nv) sample at the start of the interval, for the direction of the power row.
        after: (3 + c, nv) sample at the end of the interval.
        generalized: (nv,) generalised force.
        force: (c,) components, written.
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
    least = solve_positive(A, force)
    if least < SUSPECT * trace:
        project_deficient(observer, after, generalized, force)
    return least / trace if trace > 0.0 else 0.0


@merged
def fit_forces(observer: ObserverMemory, before: Array, after: Array, generalized: Array, rest: Array) -> None:
    """Split a generalised force into what forces can explain and what no force explains.

    The components that fit best are written to `observer.fitted`. What remains of the weighted rows in use is

        r = L^T (phi - J^T f)       L: the rows in use, moments over a lever arm of 50 mm (see `BelievedRows.map`)

    Args:
        observer: rows, weights, Jacobian; `fitted`, `unseen` and `blind` change.
        before: (3 + c, nv) sample at the start of the interval.
        after: (3 + c, nv) sample at the end of the interval.
        generalized: (nv,) generalised force phi.
        rest: (nv + 1,) written: r, padded with zeros, and the smallest pivot of the equations over their trace.
    """
    nv, force, J = generalized.shape[0], observer.fitted, observer.jacobian
    rest[nv] = project(observer, before, after, generalized, force)
    for k in range(nv):
        rest[k] = 0.0
    if force.shape[0] == 0:
        return
    unit = power_unit(observer)
    for k in range(nv):
        left = generalized[k]
        for i in range(force.shape[0]):
            left -= J[i, k] * force[i]
        add_to_rows(observer, k, left, unit, rest)


@inner
def power_unit(observer: ObserverMemory) -> float:
    """Return the weight of the row of the joints' power, over the joints' speed; 0 if they stand still."""
    nv, speed = observer.velocity.shape[0], 0.0
    if observer.sizes.rows == POWER_ROW:
        for k in range(BASE_ROWS, nv):
            speed += in_unit_of_last_row(observer, observer.velocity, k) ** 2
    return float(observer.weight[nv - 1] / np.sqrt(speed)) if speed > 0.0 else 0.0


@inner
def add_to_rows(observer: ObserverMemory, k: int, value: float, unit: float, rows: Array) -> None:
    """Add an entry k of a generalised force to the weighted rows in use (nv,); unit is `power_unit`."""
    if observer.sizes.rows == TIED:
        for s in range(observer.tied.shape[1]):
            rows[s] += observer.tied[k, s] * value
    elif observer.sizes.rows == ALL_ROWS or k < BASE_ROWS:
        rows[k] += observer.weight[k] * value
    elif observer.sizes.rows == POWER_ROW:
        rows[BASE_ROWS] += unit * observer.velocity[k] * value


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
