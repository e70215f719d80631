"""The observers' arithmetic, compiled: one call after Pinocchio's M, C and g, on any model.

A sample is remembered as `memory` (3 + 3n, nv): the momentum p = M v, the drift C^T v - g, the velocity v, and the
translational Jacobians of the n force points in world axes. From two samples

    phi = (p_1 - p_0) / dt - (drift_0 + drift_1) / 2 - u            mean external generalised force of the interval
    J   = (J_0 + J_1) / 2                                           Jacobian in its middle, to second order
    f   = argmin |W (phi - J^T f)|^2 + damping |f|^2                forces that explain a generalised force best

Where joint torques are not measured, the joint rows of phi say nothing and only the six base rows are explained; where
the power of one motor that drives all joints is measured, one more row, v_j . phi_j, holds.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from aerobat_pin.arrays import Array
from aerobat_pin.jit import Integers, copy_values, doubles_at, eigenvectors, kernel, solve_positive

DAMPING = 1.0e-12  # of the trace of W J^T J W
SUSPECT = 1.0e-6  # of the trace: a pivot below it asks for a closer look
UNSEEN = 1.0e-10  # of the trace: an eigenvalue below it belongs to forces that leave no trace
TOO_LARGE = 1.0e150  # of a residual: its square still is a number
BASE = 6  # rows of a free-flyer base
ALL_ROWS, BASE_ROWS, POWER_ROW = 0, 1, 2


class Store(NamedTuple):
    """What an observer keeps between calls. The kernels get it as one flat array, since each array costs a call time.

    `flags` (3,): which of the two memories is the newer, whether to project first, which rows to project. `gain`
    (size,) of the filtered quantities. `weight` (nv,) of the rows. `points` (n, 4): joint that carries a point, its
    place there. `support` (n, nv): 1 where a velocity moves the point. `memory` (2, 3 + 3n, nv): samples. `filtered`
    (size,): the filter. `velocity` (nv,), `jacobian` (3n, nv) and `equations` (3n, 3n): scratch.
    """

    flags: Array
    gain: Array
    weight: Array
    points: Array
    support: Array
    memory: Array
    filtered: Array
    velocity: Array
    jacobian: Array
    equations: Array


def new_store(
    places: Integers, gain: Array, weight: Array, points: Array, support: Array, *, project_first: bool, rows: int
) -> Array:
    """Return a store as its flat array, with an empty memory and the filter at zero.

    It is headed by the six integers of `look`, bit for bit in the place of doubles, and by nv, n and size.
    """
    nv, n, size = len(weight), len(points), len(gain)
    head = (nv, n, size, 0, project_first, rows)
    empty = np.zeros(2 * (3 + 3 * n) * nv + size + nv + 3 * n * (nv + 3 * n))
    return np.concatenate(
        [places.view(float), np.array(head, float), gain, weight, points.ravel(), support.ravel(), empty]
    )


@kernel
def unpack(flat: Array) -> Store:
    """Give the flat store its names and shapes, without copying."""
    nv, n, size = int(flat[6]), int(flat[7]), int(flat[8])
    a = 12 + size
    b = a + nv
    c = b + 4 * n
    d = c + n * nv
    e = d + 2 * (3 + 3 * n) * nv
    f = e + size
    g = f + nv
    h = g + 3 * n * nv
    return Store(
        flat[9:12],
        flat[12:a],
        flat[a:b],
        flat[b:c].reshape((n, 4)),
        flat[c:d].reshape((n, nv)),
        flat[d:e].reshape((2, 3 + 3 * n, nv)),
        flat[e:f],
        flat[f:g],
        flat[g:h].reshape((3 * n, nv)),
        flat[h:].reshape((3 * n, 3 * n)),
    )


class Measured(NamedTuple):
    """Pinocchio's results at a sample: M, C (nv, nv), g (nv, 1), the world Jacobians J (6, nv), oMi (12, njoints)."""

    M: Array
    C: Array
    g: Array
    J: Array
    oMi: Array


@kernel
def look(flat: Array) -> Measured:
    """View Pinocchio's results where they lie: five arrays handed over one by one would cost a fifth of the call."""
    places, nv = flat[:6].view(np.int64), int(flat[6])
    return Measured(
        doubles_at(places[0], nv, nv),
        doubles_at(places[1], nv, nv),
        doubles_at(places[2], nv, 1),
        doubles_at(places[3], 6, nv),
        doubles_at(places[4], 12, places[5]),
    )


@kernel
def remember(measured: Measured, v: Array, store: Store, memory: Array) -> None:
    """Write a sample's momentum, drift and point Jacobians.

    Args:
        measured: Pinocchio's results at the sample; its J after the Coriolis matrix is in WORLD.
        v: (nv,) velocity.
        store: the observer's constants.
        memory: (3 + 3n, nv) written.
    """
    M, C, g, J, oMi = measured
    nv = v.shape[0]
    for i in range(nv):
        momentum, drift = 0.0, -g[i, 0]
        for j in range(nv):
            momentum += M[j, i] * v[j]
            drift += C[j, i] * v[j]
        memory[0, i], memory[1, i], memory[2, i] = momentum, drift, v[i]
    for point in range(store.points.shape[0]):
        P = oMi[:, int(store.points[point, 0])]
        a, b, c = store.points[point, 1:]
        x = P[0] * a + P[3] * b + P[6] * c + P[9]
        y = P[1] * a + P[4] * b + P[7] * c + P[10]
        z = P[2] * a + P[5] * b + P[8] * c + P[11]
        row = 3 + 3 * point
        for i in range(nv):
            carried = store.support[point, i]
            memory[row, i] = carried * (J[0, i] + J[4, i] * z - J[5, i] * y)
            memory[row + 1, i] = carried * (J[1, i] + J[5, i] * x - J[3, i] * z)
            memory[row + 2, i] = carried * (J[2, i] + J[3, i] * y - J[4, i] * x)


@kernel
def normal_equations(store: Store, J: Array, velocity: Array, generalized: Array, A: Array, b: Array) -> float:
    """Write A = J W^2 J^T (lower triangle) and b = J W^2 phi over the rows believed; return the trace of A.

    Args:
        store: rows and weights.
        J: (3n, nv) point Jacobians.
        velocity: (nv,) whose joint part is the direction of the power row.
        generalized: (nv,) phi.
        A: (3n, 3n) written.
        b: (3n,) written.
    """
    size, nv, rows = b.shape[0], generalized.shape[0], int(store.flags[2])
    for i in range(size):
        b[i] = 0.0
        for j in range(i + 1):
            A[i, j] = 0.0
    for k in range(nv if rows == ALL_ROWS else BASE):
        squared = store.weight[k] * store.weight[k]
        for i in range(size):
            row = squared * J[i, k]
            b[i] += row * generalized[k]
            for j in range(i + 1):
                A[i, j] += row * J[j, k]
    if rows == POWER_ROW:  # the power of all joints, per unit of joint velocity
        speed, power = 0.0, 0.0
        for k in range(BASE, nv):
            speed += velocity[k] * velocity[k]
            power += velocity[k] * generalized[k]
        squared = store.weight[nv - 1] ** 2 / speed if speed > 0.0 else 0.0
        for i in range(size):
            along = 0.0
            for k in range(BASE, nv):
                along += J[i, k] * velocity[k]
            b[i] += squared * along * power
            for j in range(i + 1):
                other = 0.0
                for k in range(BASE, nv):
                    other += J[j, k] * velocity[k]
                A[i, j] += squared * along * other
    trace = 0.0
    for i in range(size):
        trace += A[i, i]
    return trace


@kernel
def project(store: Store, before: Array, after: Array, generalized: Array, force: Array) -> None:
    """Write the forces (3n,) that explain a generalised force (nv,) best, with the store's mid-interval Jacobian.

    Args:
        store: rows, weights, Jacobian, scratch.
        before: (3 + 3n, nv) remembered sample, for the direction of the power row.
        after: (3 + 3n, nv) the next one.
        generalized: (nv,) to be explained.
        force: (3n,) written, world axes.
    """
    if force.shape[0] == 0:
        return
    A, velocity = store.equations, store.velocity
    if store.flags[2] == POWER_ROW:
        for k in range(BASE, velocity.shape[0]):
            velocity[k] = 0.5 * (before[2, k] + after[2, k])
    trace = normal_equations(store, store.jacobian, velocity, generalized, A, force)
    for i in range(force.shape[0]):
        A[i, i] += DAMPING * trace if trace > 0.0 else 1.0  # points that nothing moves get no force
    if solve_positive(A, force) < SUSPECT * trace:
        project_deficient(store, after, generalized, force)


@kernel
def project_deficient(store: Store, after: Array, generalized: Array, force: Array) -> None:
    """As `project`, where some pattern of forces leaves no trace: its part of the answer is zero.

    The mean of two Jacobians that have lost rank has not quite lost it, and would blow the unseen part up. Which
    patterns cannot be seen is asked of the interval's end, where the Jacobian is exact.
    """
    A, size = store.equations, force.shape[0]
    seen, V, unused = np.zeros((size, size)), np.empty((size, size)), np.empty(size)
    limit = UNSEEN * normal_equations(store, after[3:], after[2], generalized, seen, unused)
    for i in range(size):
        for j in range(i):
            seen[j, i] = seen[i, j]
    eigenvectors(seen, V)
    trace = normal_equations(store, store.jacobian, store.velocity, generalized, A, force)
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


@kernel
def observe(before: Array, after: Array, u: Array, dt: float, store: Store, out: Array) -> bool:
    """Turn one interval into an estimate by an exact-exponential first-order filter; False where it is NaN or huge.

    Args:
        before: (3 + 3n, nv) remembered sample at the start.
        after: (3 + 3n, nv) remembered sample at the end.
        u: (nv,) known generalised force, mean over the interval.
        dt: its length [s].
        store: constants; its filter changes.
        out: (nv + 3n,) written: generalised residual, then forces.
    """
    nv = u.shape[0]
    residual, force = out[:nv], out[nv:]
    if not dt < TOO_LARGE:
        return False
    for i in range(nv):
        residual[i] = (after[0, i] - before[0, i]) / dt - 0.5 * (before[1, i] + after[1, i]) - u[i]
        if not abs(residual[i]) < TOO_LARGE:  # NaN too
            return False
    J, filtered, project_first = store.jacobian, store.filtered, store.flags[1] > 0.0
    for row in range(J.shape[0]):
        for i in range(nv):
            J[row, i] = 0.5 * (before[3 + row, i] + after[3 + row, i])
    if project_first:
        project(store, before, after, residual, force)
    value = force if project_first else residual
    decay = 0.0
    for i in range(filtered.shape[0]):
        if i == 0 or store.gain[i] != store.gain[i - 1]:
            decay = np.exp(-store.gain[i] * dt)
        filtered[i] = value[i] + decay * (filtered[i] - value[i])
        value[i] = filtered[i]
    if project_first:
        for i in range(nv):
            residual[i] = 0.0
            for row in range(force.shape[0]):
                residual[i] += J[row, i] * force[row]
        return True
    project(store, before, after, residual, force)
    return True


@kernel
def start(flat: Array, v: Array) -> None:
    """Remember the first sample, with the filter at zero."""
    store = unpack(flat)
    store.flags[0] = 0.0
    store.filtered[:] = 0.0
    remember(look(flat), v, store, store.memory[0])


@kernel
def update(flat: Array, v: Array, u: Array, dt: float, out: Array) -> bool:
    """Remember a sample and `observe` the interval since the one before.

    False, and nothing changed, where v or u does not have the model's size or the result is not finite.
    """
    store = unpack(flat)
    if v.shape[0] != store.weight.shape[0] or u.shape[0] != store.weight.shape[0]:
        return False
    older = int(store.flags[0])
    before, after = store.memory[older], store.memory[1 - older]
    remember(look(flat), v, store, after)
    if not observe(before, after, u, dt, store, out):
        return False
    store.flags[0] = 1.0 - older
    return True


@kernel
def collect(flat: Array, v: Array, k: int, memory: Array) -> None:
    """Remember sample k of a record: v (m + 1, nv), memory (m + 1, 3 + 3n, nv)."""
    remember(look(flat), v[k], unpack(flat), memory[k])


@kernel
def observe_all(memory: Array, time: Array, u: Array, flat: Array, out: Array) -> int:
    """`observe` every interval of a record into out (m, nv + 3n); return the first that is not finite, or -1."""
    store = unpack(flat)
    store.filtered[:] = 0.0
    for k in range(u.shape[0]):
        dt = time[k + 1] - time[k]
        if dt == 0.0:  # a repeated stamp changes nothing
            if k > 0:
                copy_values(out[k - 1], out[k])
            else:
                out[k] = 0.0
            for row in range(memory.shape[1]):
                copy_values(memory[k, row], memory[k + 1, row])
        elif not observe(memory[k], memory[k + 1], u[k], dt, store, out[k]):
            return k
    return -1
