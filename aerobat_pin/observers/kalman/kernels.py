"""Compiled kernels of the Kalman filter: one call for each sample, after Pinocchio has computed M, C and g.

The state is the momentum p (nv,) and coefficients z (nz,). The coefficients are the forces, their harmonics, and the
errors of the factors of known forces and mass. With G (nz, nv), the generalised force of each coefficient, one interval
is

    z <- a z + noise,   p <- p + dt (u + mean(C^T v - g)) + dt G^T z,   then p is measured: M v, covariance B B^T

where a is the decay factor and B = M diag(s) for velocity sensors with standard deviations s. The update uses the
Cholesky factor of the innovation's covariance S = L L^T, with T = L^-1 P_p and P <- P - T^T T.
"""

from __future__ import annotations

import numpy as np

from aerobat_pin.numerics import Array, add_product, add_row_product, copy_values, factorise, inner, kernel, mirror
from aerobat_pin.observers.kalman.memory import Filter, Step, kalman_in, step_in
from aerobat_pin.observers.kernels.memory import ObserverMemory
from aerobat_pin.observers.kernels.residual import (
    TOO_LARGE,
    dynamics_of,
    is_configuration,
    next_in_record,
    repeat_interval,
    write_sample,
)
from aerobat_pin.observers.rows import BASE_ROWS

LEAST_INFORMATION = 1.0e-6  # share of the total information on all patterns of forces, added to every pattern
UNKNOWN_TORQUE = 1.0e8  # variance of the impulse of an unknown torque, relative to that of the sensor noise


@inner
def write_noisy_sample(observer: ObserverMemory, noise: Array, v: Array, sample: Array) -> None:
    """Write a sample: the rows (3 + c, nv) that `write_sample` writes, then B^T (nv, nv)."""
    M, nv = dynamics_of(observer).M, v.shape[0]
    top = sample.shape[0] - nv
    write_sample(observer, v, sample[:top])
    for k in range(nv):
        for i in range(nv):
            sample[top + k, i] = noise[k] * M[i, k]


@kernel
def predict_momentum(before: Array, after: Array, u: Array, dt: float, filter_: Filter, step: Step) -> bool:
    """Write shear and decay of an interval, and the innovation `step.e`: measured minus predicted momentum.

    The estimate does not change yet. Returns False if the innovation is NaN or huge.

    Args:
        before: (3 + c + nv, nv) sample at the start.
        after: (3 + c + nv, nv) sample at the end.
        u: (nv,) known generalised force, mean over the interval.
        dt: length of the interval [s].
        filter_: the filter.
        step: written.
    """
    x, c, nv, errors = filter_.x, filter_.walk.shape[0], u.shape[0], filter_.errors
    shear, e, nz, h, z = step.shear, step.e, step.shear.shape[0], step.z.shape[0], filter_.x[u.shape[0] :]
    angle = filter_.pulsation[0] * (filter_.elapsed[0] + 0.5 * dt)
    step.basis[0] = 1.0
    if step.basis.shape[0] == 3:
        step.basis[1], step.basis[2] = np.cos(angle), np.sin(angle)
    shear[:, :] = 0.0
    for block in range(step.basis.shape[0]):
        half = 0.5 * dt * step.basis[block]
        for a in range(c):
            row, start, end = shear[block * c + a], before[3 + a], after[3 + a]
            for i in range(nv):
                row[i] = half * (start[i] + end[i])
    for a in range(errors.shape[0]):
        for i in range(nv):
            shear[h + a, i] = dt * errors[a, i]
    for a in range(nz):
        step.decay[a] = np.exp(-filter_.rate[a] * dt) if filter_.rate[a] > 0.0 else 1.0
    if filter_.mass_in_doubt > 0:  # an error of the mass scales known and estimated forces
        for i in range(nv):
            shear[nz - 1, i] = dt * u[i]
        for a in range(h):
            for i in range(nv):
                shear[nz - 1, i] += shear[a, i] * z[a]
    for i in range(nv):
        e[i] = after[0, i] - x[i] - dt * (u[i] + 0.5 * (before[1, i] + after[1, i]))
    for a in range(nz):
        now = step.decay[a] * z[a]
        for i in range(nv):
            e[i] -= now * shear[a, i]
    for i in range(nv):
        if not abs(e[i]) < TOO_LARGE * min(dt, 1.0):  # NaN too
            return False
    return True


@kernel
def predict_covariance(before: Array, after: Array, dt: float, filter_: Filter, step: Step) -> None:
    """Advance the covariance P over the interval by noise, shear, misfit, unknown torques; then fill `step.rows`."""
    P, shear, rows, by_gain = filter_.P, step.shear, step.rows, filter_.walk_gain[0] > 0.0
    nz, n, c = shear.shape[0], shear.shape[1], filter_.walk.shape[0]
    nv = n - nz
    if by_gain:
        set_walk_by_gain(before, after, filter_, rows)
    grown = dt * (dt if by_gain else 1.0) + dt * filter_.head_start[0]
    filter_.head_start[0] = 0.0
    for a in range(nz):
        decay = step.decay[a]
        if decay != 1.0:
            for j in range(n):
                P[nv + a, j] *= decay
            for j in range(n):
                P[j, nv + a] *= decay
            P[nv + a, nv + a] += (1.0 - decay * decay) * filter_.variance[a]
    for first in range(nv, nv + step.z.shape[0], c):
        for a in range(c):
            row = P[first + a, first:]
            for b in range(c):
                row[b] += grown * filter_.walk[a, b]
    add_product(P[:nv], shear[:, :nv].T, P[nv:], 1.0)
    add_product(P, P[:, nv:], shear, 1.0)
    if nz > step.z.shape[0]:
        decay = step.decay[nz - 1] if filter_.elapsed[0] > 0.0 else 0.0
        for i in range(nv):
            square = 0.0
            for a in range(step.z.shape[0], nz):
                square += filter_.variance[a] * shear[a, i] * shear[a, i]
            square /= dt * dt
            filter_.doubt[i] = square + decay * (filter_.doubt[i] - square)
            P[i, i] += filter_.misfit[0] * filter_.misfit[0] * dt * filter_.doubt[i]
    if filter_.hidden.shape[0] > 0:
        add_unknown_torques(before, after, filter_, P)
    for i in range(nv):
        unit = rows[i, nv + n :]
        copy_values(P[i], rows[i, :nv])
        copy_values(P[i], rows[i, nv : nv + n])
        for j in range(unit.shape[0]):
            unit[j] = 0.0
        unit[i], unit[n] = 1.0, step.e[i]
    blurred = after[3 + c :]
    add_product(rows[:, :nv], blurred.T, blurred, 1.0)


@kernel
def set_walk_by_gain(before: Array, after: Array, filter_: Filter, rows: Array) -> None:
    """Set the random walk from the gain, in proportion to (J R^-1 J^T)^-1.

    R is the covariance of the momentum noise of one sample, so (J R^-1 J^T)^-1 is the covariance with which one sample
    determines the components' impulses. With this walk, every pattern of forces rises equally fast in every
    configuration. The share `LEAST_INFORMATION` of the total information is added to each pattern, which keeps the
    inverse finite. `rows` (nv, ...) is scratch.
    """
    c, information, scale = filter_.walk.shape[0], filter_.information, filter_.scale
    nv, blurred = rows.shape[0], after[3 + c :]
    sensed = rows[:, : nv + c]
    sensed[:, :] = 0.0
    add_product(sensed[:, :nv], blurred.T, blurred, 1.0)
    if filter_.hidden.shape[0] > 0:
        add_unknown_torques(before, after, filter_, sensed)
    for a in range(c):
        start, end = before[3 + a], after[3 + a]
        for i in range(nv):
            sensed[i, nv + a] = 0.5 * scale[a] * (start[i] + end[i])
    factorise(sensed)
    information[:, :] = 0.0
    add_product(information[:, :c], sensed[:, nv:].T, sensed[:, nv:], 1.0)
    total = 0.0
    for a in range(c):
        total += information[a, a]
    for a in range(c):
        information[a, a] += LEAST_INFORMATION * total
        information[a, c + a] = 1.0
    factorise(information)
    filter_.walk[:, :] = 0.0
    add_product(filter_.walk, information[:, c:].T, information[:, c:], filter_.walk_gain[0])
    for a in range(c):
        for b in range(c):
            filter_.walk[a, b] *= scale[a] * scale[b]


@kernel
def add_unknown_torques(before: Array, after: Array, filter_: Filter, P: Array) -> None:
    """Add the covariance of unknown torques to P (nv, nv).

    The torques act along the generalised forces onto which `hidden` projects. If the joints' power is known, only
    torques that do not change this power are added.
    """
    hidden, noise, c = filter_.hidden, filter_.noise, filter_.walk.shape[0]
    nv, size, speed = noise.shape[0], 0.0, 0.0
    for k in range(nv):
        for i in range(nv):
            for j in range(nv):
                size += after[3 + c + k, i] * hidden[i, j] * after[3 + c + k, j]
    size *= UNKNOWN_TORQUE
    for i in range(nv):
        for j in range(nv):
            P[i, j] += size * hidden[i, j]
    if filter_.power_known > 0:
        for i in range(BASE_ROWS, nv):
            mean = 0.5 * (before[2, i] + after[2, i])
            speed += mean * mean + 0.5 * noise[i] * noise[i]
        for i in range(BASE_ROWS, nv):
            along = 0.25 * size * (before[2, i] + after[2, i]) / speed
            for j in range(BASE_ROWS, nv):
                P[i, j] -= along * (before[2, j] + after[2, j])


@kernel
def correct(x: Array, P: Array, step: Step) -> None:
    """Apply the measurement: turn `step.rows` into L^T, T, L^-1 and L^-1 e, and update x (n,) and P (n, n)."""
    rows, nv, n = step.rows, step.rows.shape[0], x.shape[0]
    factorise(rows)
    T = rows[:, nv : nv + n]
    add_row_product(x, rows[:, nv + 2 * n], T, 1.0)
    add_product(P, T.T, T, -1.0)
    mirror(P, n)


@kernel
def report(step: Step, dt: float, out: Array) -> None:
    """Write residual, components and standard deviations (nv + 2 c,) from the coefficients and their covariance."""
    nv, blocks = step.rows.shape[0], step.basis.shape[0]
    c = step.z.shape[0] // blocks
    for i in range(nv):
        out[i] = 0.0
    for a in range(c):
        force, variance = 0.0, 0.0
        for block in range(blocks):
            force += step.basis[block] * step.z[block * c + a]
            for other in range(blocks):
                variance += step.basis[block] * step.basis[other] * step.Z[block * c + a, nv + other * c + a]
        out[nv + a] = force
        out[nv + c + a] = np.sqrt(max(variance, 0.0))
        for i in range(nv):
            out[i] += step.shear[a, i] / dt * force


@kernel
def filter_interval(before: Array, after: Array, u: Array, dt: float, filter_: Filter, step: Step) -> bool:
    """Advance the filter over one interval. If the innovation is NaN or huge, change no estimate and return False.

    Args:
        before: (3 + c + nv, nv) sample at the start.
        after: (3 + c + nv, nv) sample at the end.
        u: (nv,) known generalised force, mean over the interval.
        dt: length of the interval [s].
        filter_: the filter; changes.
        step: written.
    """
    x, P, nv = filter_.x, filter_.P, u.shape[0]
    n = x.shape[0]
    if not predict_momentum(before, after, u, dt, filter_, step):
        return False
    predict_covariance(before, after, dt, filter_, step)
    for i in range(nv):
        x[i] = after[0, i] - step.e[i]
    for a in range(n - nv):
        x[nv + a] *= step.decay[a]
    correct(x, P, step)
    for a in range(step.z.shape[0]):
        step.z[a] = x[nv + a]
        copy_values(P[nv + a], step.Z[a])
    filter_.elapsed[0] += dt
    return True


@kernel
def update_filter(memory: Array, q: Array, v: Array, u: Array, dt: float, out: Array) -> bool:
    """Take a sample and apply `filter_interval` to the interval since the previous sample.

    Returns False and changes no estimate if q is no configuration, v or u does not have the model's size, or the
    innovation is NaN or huge.
    """
    kalman = kalman_in(memory)
    filter_, step, nv, newest = kalman.filter, kalman.step, kalman.observer.sizes.nv, kalman.observer.newest[0]
    if v.shape[0] != nv or u.shape[0] != nv or not dt < TOO_LARGE or not is_configuration(kalman.observer, q):
        return False
    before, after = filter_.samples[newest], filter_.samples[1 - newest]
    write_noisy_sample(kalman.observer, filter_.noise, v, after)
    if not filter_interval(before, after, u, dt, filter_, step):
        return False
    report(step, dt, out)
    kalman.observer.newest[0] = 1 - newest
    return True


@kernel
def start_filter(memory: Array, v: Array) -> None:
    """Write the first sample of a stream."""
    kalman = kalman_in(memory)
    write_noisy_sample(kalman.observer, kalman.filter.noise, v, kalman.filter.samples[0])


@kernel
def record_noisy_sample(memory: Array) -> None:
    """Write the next sample (3 + c + nv, nv) of a record, for which Pinocchio has just computed M, C and g."""
    kalman = kalman_in(memory)
    v, sample = next_in_record(kalman.observer, kalman.filter.samples.shape[1])
    write_noisy_sample(kalman.observer, kalman.filter.noise, v, sample)


@kernel
def filter_all(samples: Array, time: Array, u: Array, errors: Array, memory: Array, steps: Array, out: Array) -> int:
    """Apply `filter_interval` to a whole record; return the first interval that is not finite, or -1.

    Args:
        samples: (m + 1, 3 + c + nv, nv) samples; one with a repeated time is overwritten by the previous sample.
        time: (m + 1,) sample times [s].
        u: (m, nv) known generalised force, interval means.
        errors: (ne, m, nv) the known forces that have an uncertain factor.
        memory: memory of the filter, started at the first sample.
        steps: (m, step size) written if a smoother follows, which then writes `out`; otherwise (0, step size).
        out: (m, nv + 2 c) written if `steps` has no rows.
    """
    kalman, smoothed = kalman_in(memory), steps.shape[0] > 0
    filter_ = kalman.filter
    for k in range(u.shape[0]):
        dt = time[k + 1] - time[k]
        if dt == 0.0:
            repeat_interval(samples, out, k)
            continue
        for a in range(errors.shape[0]):
            copy_values(errors[a, k], filter_.errors[a])
        step = step_in(steps[k], kalman.step) if smoothed else kalman.step
        if not filter_interval(samples[k], samples[k + 1], u[k], dt, filter_, step):
            return k
        if not smoothed:
            report(step, dt, out[k])
    return -1
