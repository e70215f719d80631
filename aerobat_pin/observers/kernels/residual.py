"""The observers' arithmetic, compiled: one call after Pinocchio's M, C and g, on any model.

A sample is remembered as `memory` (3 + c, nv): the momentum p = M v, the drift C^T v - g, the velocity v, and the
Jacobian of the c unknown components (see `applications`). From two samples

    phi = (p_1 - p_0) / dt - (drift_0 + drift_1) / 2 - u            mean external generalised force of the interval
    J   = (J_0 + J_1) / 2                                           Jacobian in its middle, to second order
    f   = argmin |W (phi - J^T f)|^2 + damping |f|^2                components that explain a generalised force best

Where joint torques are not measured, the joint rows of phi say nothing and only the six base rows are explained; where
the power of one motor that drives all joints is measured, one more row, v_j . phi_j, holds; of tied coordinates their
sums. What is filtered, phi or f, and how, is the observer's kind.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from aerobat_pin.numerics import Array, Integers, copy_values, dot, doubles_at, inner, kernel
from aerobat_pin.observers.kernels.filters import low_pass, rotate
from aerobat_pin.observers.kernels.memory import Store, unpack
from aerobat_pin.observers.kernels.projection import project
from aerobat_pin.observers.kernels.record import proceed, sample

TOO_LARGE = 1.0e150  # of a residual: its square still is a number


class Measured(NamedTuple):
    """Pinocchio's results at a sample: M, C (nv, nv), g (nv, 1), the world Jacobians J (6, nv), oMi (12, njoints)."""

    M: Array
    C: Array
    g: Array
    J: Array
    oMi: Array


@inner
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


@inner
def remember(measured: Measured, v: Array, store: Store, memory: Array) -> None:
    """Write a sample's momentum, drift and point Jacobians.

    Args:
        measured: Pinocchio's results at the sample; its J after the Coriolis matrix is in WORLD.
        v: (nv,) velocity.
        store: the observer's constants.
        memory: (3 + c, nv) written.
    """
    M, C, g, J, oMi = measured
    nv = v.shape[0]
    momentum, drift, rate = memory[0], memory[1], memory[2]
    for i in range(nv):
        momentum[i], drift[i], rate[i] = 0.0, dot(C[:, i], v) - g[i, 0], v[i]
    for j in range(nv):  # M is symmetric: whole columns at a time
        for i in range(nv):
            momentum[i] += M[i, j] * v[j]
    for row in range(store.components.shape[0]):
        joint, a, b, c, dx, dy, dz, mx, my, mz, turns = store.components[row]
        P = oMi[:, int(joint)]
        if turns > 0.0:
            dx, dy, dz = turned(P, dx, dy, dz)
            mx, my, mz = turned(P, mx, my, mz)
        x, y, z = turned(P, a, b, c)
        x, y, z = x + P[9], y + P[10], z + P[11]
        mx, my, mz = mx + y * dz - z * dy, my + z * dx - x * dz, mz + x * dy - y * dx
        for i in range(nv):
            along = dx * J[0, i] + dy * J[1, i] + dz * J[2, i] + mx * J[3, i] + my * J[4, i] + mz * J[5, i]
            memory[3 + row, i] = store.support[row, i] * along


@inner
def turned(P: Array, x: float, y: float, z: float) -> tuple[float, float, float]:
    """Rotate a vector by a placement (12,)."""
    return (
        P[0] * x + P[3] * y + P[6] * z,
        P[1] * x + P[4] * y + P[7] * z,
        P[2] * x + P[5] * y + P[8] * z,
    )


@kernel
def observe(before: Array, after: Array, u: Array, dt: float, store: Store, out: Array) -> bool:
    """Turn one interval into an estimate; False where it is NaN or huge.

    Args:
        before: (3 + c, nv) remembered sample at the start.
        after: (3 + c, nv) remembered sample at the end.
        u: (nv,) known generalised force, mean over the interval.
        dt: its length [s].
        store: constants; its filter changes.
        out: (nv + c,) written: generalised residual, then forces.
    """
    nv = u.shape[0]
    residual, force = out[:nv], out[nv:]
    if not dt < TOO_LARGE:
        return False
    for i in range(nv):
        residual[i] = (after[0, i] - before[0, i]) / dt - 0.5 * (before[1, i] + after[1, i]) - u[i]
        if not abs(residual[i]) < TOO_LARGE:  # NaN too
            return False
    J, project_first = store.jacobian, store.flags[1] > 0.0
    for row in range(J.shape[0]):
        for i in range(nv):
            J[row, i] = 0.5 * (before[3 + row, i] + after[3 + row, i])
    if project_first:
        project(store, before, after, residual, force)
    value = force if project_first else residual
    if store.basis.shape[0] > 0:
        rotate(store.basis, value, store.value, False)
        low_pass(store, dt, store.value)
        rotate(store.basis, store.value, value, True)
    else:
        low_pass(store, dt, value)
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
    store.filtered[:, :] = 0.0
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
def collect(flat: Array, place: Integers) -> None:
    """Remember a record's sample and go on to the next (see `open_record`)."""
    v, memory = sample(place)
    remember(look(flat), v, unpack(flat), memory)
    proceed(place)


@inner
def repeat(memory: Array, out: Array, k: int) -> None:
    """Let a repeated stamp change nothing: interval k has the result of the one before, and ends as it began."""
    if k > 0:
        copy_values(out[k - 1], out[k])
    else:
        out[k] = 0.0
    for row in range(memory.shape[1]):
        copy_values(memory[k, row], memory[k + 1, row])


@kernel
def observe_all(memory: Array, time: Array, u: Array, flat: Array, out: Array) -> int:
    """`observe` every interval of a record into out (m, nv + c); return the first that is not finite, or -1."""
    store = unpack(flat)
    store.filtered[:, :] = 0.0
    for k in range(u.shape[0]):
        dt = time[k + 1] - time[k]
        if dt == 0.0:
            repeat(memory, out, k)
        elif not observe(memory[k], memory[k + 1], u[k], dt, store, out[k]):
            return k
    return -1
