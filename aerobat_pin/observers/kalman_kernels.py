"""The Kalman filter's arithmetic, compiled: one call after Pinocchio's M, C and g, on any model.

The state is the momentum p (nv) and coefficients z: forces, their harmonics, and errors of what is taken as known.
With G (nz, nv), one generalised force per coefficient, one interval is

    z <- a z + noise,   p <- p + dt (u + mean(C^T v - g)) + dt G^T z,   then p is measured: M v, covariance B B^T

and B = M diag(s) for velocity sensors of standard deviations s. The update is by Cholesky of the innovation's
covariance S = L L^T with T = L^-1 P_p, P <- P - T^T T.
"""

from __future__ import annotations

import numpy as np

from aerobat_pin.arrays import Array
from aerobat_pin.jit import copy_values, kernel
from aerobat_pin.observers import kernels, store
from aerobat_pin.observers.kalman_store import (
    ELAPSED,
    HEAD_START,
    MASS,
    MISFIT,
    NEWER,
    POWER,
    PULSATION,
    WALK_PER_SAMPLE,
    Filter,
    Step,
    unpack,
    unpack_step,
)
from aerobat_pin.observers.kernels import TOO_LARGE
from aerobat_pin.observers.rows import BASE

UNKNOWN_TORQUE = 1.0e8  # variance of an unknown torque's impulse over that of its row's sensors


@kernel
def remember(flat: Array, v: Array, memory: Array) -> None:
    """Write a sample: what `kernels.remember` does (3 + c, nv), then B^T (nv, nv)."""
    measured, noise = kernels.look(flat), unpack(flat).noise
    nv = v.shape[0]
    top = memory.shape[0] - nv
    kernels.remember(measured, v, store.unpack(flat[: int(flat[-1])]), memory[:top])
    for k in range(nv):
        for i in range(nv):
            memory[top + k, i] = noise[k] * measured.M[i, k]


@kernel
def predict(before: Array, after: Array, u: Array, dt: float, filter_: Filter, step: Step) -> bool:
    """Write the interval's shear and decay, and into `step.e` what the prediction misses of the measured momentum.

    The estimate does not change yet. False where the innovation is NaN or huge.

    Args:
        before: (3 + c + nv, nv) remembered sample at the start.
        after: (3 + c + nv, nv) remembered sample at the end.
        u: (nv,) known generalised force, mean over the interval.
        dt: the interval's length [s].
        filter_: the filter.
        step: written.
    """
    settings, x, c, nv, errors = filter_.settings, filter_.x, filter_.walk.shape[0], u.shape[0], filter_.errors
    shear, nz, h, first = step.shear, step.shear.shape[0], step.z.shape[0], nv
    angle = settings[PULSATION] * (settings[ELAPSED] + 0.5 * dt)
    step.basis[0] = 1.0
    if step.basis.shape[0] == 3:
        step.basis[1], step.basis[2] = np.cos(angle), np.sin(angle)
    for a in range(h):
        block = a // c
        for i in range(nv):
            shear[a, i] = 0.5 * dt * step.basis[block] * (before[3 + a % c, i] + after[3 + a % c, i])
    for a in range(errors.shape[0]):
        for i in range(nv):
            shear[h + a, i] = dt * errors[a, i]
    for a in range(nz):
        step.decay[a] = np.exp(-filter_.rate[a] * dt) if filter_.rate[a] > 0.0 else 1.0
    if settings[MASS] > 0.0:  # an error of the mass stretches whatever accelerates the robot, found forces included
        for i in range(nv):
            shear[nz - 1, i] = dt * u[i]
        for a in range(h):
            for i in range(nv):
                shear[nz - 1, i] += shear[a, i] * x[first + a]
    for i in range(nv):
        missing = after[0, i] - x[i] - dt * (u[i] + 0.5 * (before[1, i] + after[1, i]))
        for a in range(nz):
            missing -= shear[a, i] * step.decay[a] * x[first + a]
        step.e[i] = missing
        if not abs(missing) < TOO_LARGE * min(dt, 1.0):  # NaN too
            return False
    return True


@kernel
def spread(before: Array, after: Array, dt: float, filter_: Filter, step: Step) -> None:
    """Carry the covariance P over the interval: coefficients' noise, shear, misfit, unknown torques; S into L."""
    settings, P, shear, L = filter_.settings, filter_.P, step.shear, step.L
    nz, nv, c = shear.shape[0], shear.shape[1], filter_.walk.shape[0]
    grown = dt * (dt if settings[WALK_PER_SAMPLE] > 0.0 else 1.0) + dt * settings[HEAD_START]
    settings[HEAD_START] = 0.0
    for a in range(nz):
        decay = step.decay[a]
        if decay != 1.0:
            for j in range(nv + nz):
                P[nv + a, j] *= decay
            for j in range(nv + nz):
                P[j, nv + a] *= decay
            P[nv + a, nv + a] += (1.0 - decay * decay) * filter_.variance[a]
    for a in range(step.z.shape[0]):
        block = c * (a // c)
        for b in range(c):
            P[nv + a, nv + block + b] += grown * filter_.walk[a - block, b]
    rows = P[nv:]
    for a in range(nz):
        added = L[0]
        for i in range(nv):
            added[i] = 0.0
        for b in range(nz):
            factor = rows[a, nv + b]
            for i in range(nv):
                added[i] += factor * shear[b, i]
        for i in range(nv):
            rows[a, i] += 0.5 * added[i]
        for i in range(nv):
            one, other = shear[a, i], rows[a, i]
            for j in range(nv):
                P[i, j] += one * rows[a, j] + other * shear[a, j]
        for i in range(nv):
            rows[a, i] += 0.5 * added[i]
            P[i, nv + a] = rows[a, i]
    if nz > step.z.shape[0]:
        decay = step.decay[nz - 1] if settings[ELAPSED] > 0.0 else 0.0
        for i in range(nv):
            square = 0.0
            for a in range(step.z.shape[0], nz):
                square += filter_.variance[a] * shear[a, i] * shear[a, i]
            square /= dt * dt
            filter_.doubt[i] = square + decay * (filter_.doubt[i] - square)
            P[i, i] += settings[MISFIT] * settings[MISFIT] * dt * filter_.doubt[i]
    if filter_.hidden.shape[0] > 0:
        forget_torques(before, after, filter_)
    for i in range(nv):
        for j in range(nv):
            L[i, j] = P[i, j]
        for k in range(nv):
            factor = after[3 + c + k, i]
            for j in range(nv):
                L[i, j] += factor * after[3 + c + k, j]


@kernel
def forget_torques(before: Array, after: Array, filter_: Filter) -> None:
    """Let unknown torques act on P: any in `hidden` rows; where the joints' power is known, any that leave it so."""
    P, hidden, noise, c = filter_.P, filter_.hidden, filter_.noise, filter_.walk.shape[0]
    nv, size, speed = noise.shape[0], 0.0, 0.0
    for k in range(nv):
        for i in range(nv):
            for j in range(nv):
                size += after[3 + c + k, i] * hidden[i, j] * after[3 + c + k, j]
    size *= UNKNOWN_TORQUE
    for i in range(nv):
        for j in range(nv):
            P[i, j] += size * hidden[i, j]
    if filter_.settings[POWER] > 0.0:
        for i in range(BASE, nv):
            mean = 0.5 * (before[2, i] + after[2, i])
            speed += mean * mean + 0.5 * noise[i] * noise[i]
        for i in range(BASE, nv):
            along = 0.25 * size * (before[2, i] + after[2, i]) / speed
            for j in range(BASE, nv):
                P[i, j] -= along * (before[2, j] + after[2, j])


@kernel
def correct(x: Array, P: Array, step: Step) -> None:
    """Take the measurement: factorise S in `step.L`, whiten `step.e`, and update x (n,) and P (n, n)."""
    L, T, e = step.L, step.T, step.e
    nv, n = T.shape
    for j in range(nv):
        for k in range(j):
            factor = L[j, k]
            for i in range(j, nv):
                L[i, j] -= factor * L[i, k]
        inverse = 1.0 / np.sqrt(L[j, j])
        for i in range(j, nv):
            L[i, j] *= inverse
    for i in range(nv):
        for j in range(n):
            T[i, j] = P[i, j]
        for k in range(i):
            factor = L[i, k]
            e[i] -= factor * e[k]
            for j in range(n):
                T[i, j] -= factor * T[k, j]
        inverse = 1.0 / L[i, i]
        e[i] *= inverse
        for j in range(n):
            T[i, j] *= inverse
            x[j] += T[i, j] * e[i]
    for i in range(n):
        for k in range(nv):
            factor = T[k, i]
            for j in range(n):
                P[i, j] -= factor * T[k, j]


@kernel
def report(step: Step, dt: float, out: Array) -> None:
    """Write residual, forces and standard deviations (nv + 2 c,) from the forces' coefficients and covariance."""
    nv, blocks = step.e.shape[0], step.basis.shape[0]
    c = step.z.shape[0] // blocks
    for i in range(nv):
        out[i] = 0.0
    for a in range(c):
        force, variance = 0.0, 0.0
        for one in range(blocks):
            force += step.basis[one] * step.z[one * c + a]
            for other in range(blocks):
                variance += step.basis[one] * step.basis[other] * step.Z[one * c + a, nv + other * c + a]
        out[nv + a] = force
        out[nv + c + a] = np.sqrt(max(variance, 0.0))
        for i in range(nv):
            out[i] += step.shear[a, i] / dt * force


@kernel
def update(flat: Array, v: Array, u: Array, dt: float, out: Array) -> bool:
    """Remember a sample and take the interval since the one before.

    False, and nothing changed, where v or u does not have the model's size or the innovation is NaN or huge.

    Args:
        flat: the observer's store.
        v: (nv,) velocity.
        u: (nv,) known generalised force, mean over the interval.
        dt: the interval's length [s].
        out: (nv + 2 c,) written: generalised residual, components, their standard deviations.
    """
    filter_ = unpack(flat)
    x, P, nv, nz = filter_.x, filter_.P, filter_.noise.shape[0], filter_.rate.shape[0]
    if v.shape[0] != nv or u.shape[0] != nv or not dt < TOO_LARGE:
        return False
    step = unpack_step(filter_.step, nv, nz, filter_.walk.shape[0], filter_.settings[PULSATION] > 0.0)
    older = int(filter_.settings[NEWER])
    before, after = filter_.memory[older], filter_.memory[1 - older]
    remember(flat, v, after)
    if not predict(before, after, u, dt, filter_, step):
        return False
    spread(before, after, dt, filter_, step)
    for i in range(nv):
        x[i] = after[0, i] - step.e[i]
    for a in range(nz):
        x[nv + a] *= step.decay[a]
    correct(x, P, step)
    for a in range(step.z.shape[0]):
        step.z[a] = x[nv + a]
        copy_values(P[nv + a], step.Z[a])
    report(step, dt, out)
    filter_.settings[ELAPSED] += dt
    filter_.settings[NEWER] = 1.0 - older
    return True
