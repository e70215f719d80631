"""Compiled kernels of the Kalman filter: one call for each sample, after Pinocchio has computed M.

The state is the error y (nv,) of the measured velocity v (sought minus measured), and coefficients z (nz,): the forces,
their harmonics, and the errors of the factors of known forces and mass. With G (nz, nv), the generalised force of each
coefficient, and p = M v, an interval from sample 0 to sample 1 is

    z <- a z + noise,    V y_1 = A y_0 + dt G^T z + noise - (p_1 - p_0 - dt (u + mean(C^T v - g)))
    A = M_0 + D_0 dt/2,  V = M_1 - D_1 dt/2

where a is the decay factor. C^T v is that of the velocity sought, to first order with its slope D (see `noisy_sample`).
The sensors say that y_1 is zero with standard deviations s: that is the prior, and the interval is what is measured of
it. Nothing is solved for V then: with X the covariance of the equation's right side, B = V diag(s) and S = X_p + B B^T,

    S = L L^T,    U = L^-1 [-B diag(s), X_pz],    P <- [diag(s^2), 0; 0, X_z] - U^T U,    [y; z] <- [0; z] + U^T L^-1 e

Patterns of forces that leave no trace in the rows are held at zero. Unless the gain sets the walk, the noise of v and u
and the errors of the model are taken from the record itself (see `learning`). Arguments are those of
`kernels.residual`, with the samples (3 + c + 2 nv, nv) of `noisy_sample`.
"""

from __future__ import annotations

import numpy as np

from aerobat_pin.numerics import (
    Array,
    add_product,
    add_row_product,
    copy_values,
    factorise,
    fields_of,
    inlined,
    kernel,
    mirror,
)
from aerobat_pin.observers.kalman.kalman_state import Filter, KalmanState, Step
from aerobat_pin.observers.kalman.learning import (
    DIFFERENCES,
    MEMORY_TIME,
    MISFIT_LAG,
    MISFIT_TIME,
    add_unknown_torques,
    drop_unseen,
    leak_of_noise,
    learn_misfit,
    learn_noise,
    let_jump,
    misfit_variance,
    set_walk_by_gain,
    write_row_errors,
)
from aerobat_pin.observers.kalman.noisy_sample import repeat_interval, write_noisy_sample
from aerobat_pin.observers.kernels.observer_state import ObserverState
from aerobat_pin.observers.kernels.projection import fit_forces
from aerobat_pin.observers.kernels.residual import TOO_LARGE, is_configuration, mean_residual
from aerobat_pin.observers.rows import UNSEEN_SHARE


@kernel
def predict_momentum(before: Array, after: Array, u: Array, dt: float, filter_: Filter, step: Step) -> bool:
    """Write shear, decay and A^T of an interval, and the innovation `step.e`: measured minus predicted momentum.

    The estimate does not change yet. Returns False if the innovation is NaN or huge.
    """
    x, c, nv, errors, onward = filter_.x, filter_.walk.shape[0], u.shape[0], filter_.errors, step.onward
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
    # The decay, and what is wrong with the mass, which scales known and estimated forces.
    for a in range(nz):
        step.decay[a] = np.exp(-filter_.rate[a] * dt) if filter_.rate[a] > 0.0 else 1.0
    if step.blind[0] > 0.0:
        drop_unseen(step, 0, z.reshape((nz, 1)))
    if filter_.mass_in_doubt > 0:
        for i in range(nv):
            shear[nz - 1, i] = dt * u[i]
        for a in range(h):
            for i in range(nv):
                shear[nz - 1, i] += shear[a, i] * z[a]
    # A^T, and the innovation.
    for k in range(nv):
        M, slope, row = before[3 + c + k], before[3 + c + nv + k], onward[k]
        for i in range(nv):
            row[i] = M[i] + 0.5 * dt * slope[i]
    for i in range(nv):
        e[i] = after[0, i] - before[0, i] - dt * (u[i] + 0.5 * (before[1, i] + after[1, i]))
    add_row_product(e, x[:nv], onward, -1.0)
    for a in range(nz):
        now = step.decay[a] * z[a]
        for i in range(nv):
            e[i] -= now * shear[a, i]
    for i in range(nv):
        if not abs(e[i]) < TOO_LARGE * min(dt, 1.0):  # NaN too
            return False
    return True


@kernel
def predict_covariance(
    before: Array, after: Array, dt: float, observer: ObserverState, filter_: Filter, step: Step
) -> None:
    """Advance the covariance of z in P over the interval, and fill `step.rows` with S, -B diag(s), X_pz, 1 and e."""
    P, shear, rows, by_gain = filter_.P, step.shear, step.rows, filter_.walk_gain[0] > 0.0
    nz, n, c = shear.shape[0], shear.shape[1], filter_.walk.shape[0]
    nv, blurred, S = n - nz, filter_.blurred, rows[:, : n - nz]
    # B^T, and how the coefficients z decay and walk.
    for k in range(nv):
        M, slope, row, size = after[3 + c + k], after[3 + c + nv + k], blurred[k], filter_.sensed[k]
        for i in range(nv):
            row[i] = size * (M[i] - 0.5 * dt * slope[i])
    if by_gain:
        set_walk_by_gain(before, after, filter_, rows)
    grown, filter_.head_start[0] = dt * (dt if by_gain else 1.0) + dt * filter_.head_start[0], 0.0
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
    if step.blind[0] > 0.0:
        drop_unseen(step, nv, P)
        drop_unseen(step, nv, P.T)
    # S = X_p + B B^T with the shear of z, the misfit of the model and the noise of known forces.
    onward, right = step.onward, filter_.right
    right[:, :], S[:, :] = 0.0, 0.0
    add_product(right, onward.T, P[:nv], 1.0)
    add_product(right, shear[:, :nv].T, P[nv:], 1.0)
    add_product(S, right[:, :nv], onward, 1.0)
    add_product(S, right[:, nv:], shear[:, :nv], 1.0)
    if nz > step.z.shape[0]:
        decay = step.decay[nz - 1] if filter_.elapsed[0] > 0.0 else 0.0
        for i in range(nv):
            square = 0.0
            for a in range(step.z.shape[0], nz):
                square += filter_.variance[a] * shear[a, i] * shear[a, i]
            square /= dt * dt
            filter_.doubt[i] = square + decay * (filter_.doubt[i] - square)
            S[i, i] += filter_.misfit[0] * filter_.misfit[0] * dt * filter_.doubt[i]
    misfit = 0.0
    if not by_gain:
        doubt = MISFIT_TIME * dt * misfit_variance(filter_)
        for i in range(nv):
            noise = dt * filter_.known_sensed[i]
            wrong = doubt / (observer.weight[i] * observer.weight[i]) + noise * noise
            S[i, i] += wrong
            if filter_.hidden.shape[0] > 0:
                misfit += filter_.hidden[i, i] * wrong
    if filter_.hidden.shape[0] > 0:
        add_unknown_torques(before, after, misfit, filter_, S)
    add_product(S, blurred.T, blurred, 1.0)
    # The further columns of the rows.
    for i in range(nv):
        row, along, unit = rows[i, nv : 2 * nv], rows[i, 2 * nv : nv + n], rows[i, nv + n :]
        for k in range(nv):
            row[k] = -filter_.sensed[k] * blurred[k, i]
        copy_values(right[i, nv:], along)
        unit[:] = 0.0
        unit[i], unit[n] = 1.0, step.e[i]


@kernel
def correct(x: Array, P: Array, filter_: Filter, step: Step) -> None:
    """Turn `step.rows` into L^T, U, L^-1 and L^-1 e, and update x (n,) and P (n, n), of which only z is read.

    Forces of a limited size may jump: else lasting errors of rows would share a blow, and keep their share.
    """
    rows, nv, n, sensed = step.rows, step.rows.shape[0], x.shape[0], filter_.sensed
    factorise(rows)
    if filter_.rate[0] > 0.0:
        let_jump(P, filter_.variance, step)
    U = rows[:, nv : nv + n]
    x[:nv], P[:nv] = 0.0, 0.0
    for k in range(nv):
        P[k, k] = sensed[k] * sensed[k]
    add_row_product(x, rows[:, nv + 2 * n], U, 1.0)
    add_product(P, U.T, U, -1.0)
    mirror(P, n)


@kernel
def report(step: Step, dt: float, out: Array) -> None:
    """Write residual, components and standard deviations (nv + 2 c,) from the coefficients and their covariance.

    A component that is part of an unseen pattern has an infinite standard deviation.
    """
    nv, blocks = step.rows.shape[0], step.basis.shape[0]
    c = step.z.shape[0] // blocks
    out[:nv] = 0.0
    for a in range(c):
        force, variance = 0.0, 0.0
        for block in range(blocks):
            force += step.basis[block] * step.z[block * c + a]
            for other in range(blocks):
                variance += step.basis[block] * step.basis[other] * step.Z[block * c + a, nv + other * c + a]
        out[nv + a] = force
        out[nv + c + a] = np.sqrt(max(variance, 0.0))
        if step.blind[0] > 0.0 and step.unseen[a, a] > UNSEEN_SHARE * UNSEEN_SHARE:
            out[nv + c + a] = np.inf
        for i in range(nv):
            out[i] += step.shear[a, i] / dt * force


@inlined
def filter_interval(
    before: Array, after: Array, u: Array, dt: float, observer: ObserverState, filter_: Filter, step: Step, out: Array
) -> bool:
    """Advance the filter over one interval. If the innovation is NaN or huge, change no estimate and return False.

    Of `out` (nv + 2 c + nv + 1 + nv,) only the last columns are written: what `fit_forces` writes, then L^-1 e.
    """
    x, P, nv, c = filter_.x, filter_.P, u.shape[0], step.unseen.shape[0]
    n, remainder = x.shape[0], out[u.shape[0] + 2 * c :]
    if not mean_residual(before, after, u, dt, observer, filter_.phi):
        return False
    write_row_errors(before, after, filter_)
    for a in range(filter_.errors.shape[0]):  # what uncertain factors explain is no misfit
        factor = x[nv + step.z.shape[0] + a]
        for i in range(nv):
            filter_.phi[i] -= factor * filter_.errors[a, i]
    if filter_.mass_in_doubt > 0:
        for i in range(nv):
            filter_.phi[i] -= x[n - 1] * u[i]
    fit_forces(observer, before, after, filter_.phi, remainder)
    step.blind[0] = 0.0 if filter_.rate[0] > 0.0 else observer.blind[0]  # forces of a limited size need no trace
    if step.blind[0] > 0.0:
        for a in range(c):
            copy_values(observer.unseen[a], step.unseen[a])
    if not predict_momentum(before, after, u, dt, filter_, step):
        return False
    if not filter_.walk_gain[0] > 0.0:
        f, seen, recent = filter_, filter_.intervals[0] - DIFFERENCES, 1.0 - np.exp(-dt / MEMORY_TIME)
        learn_noise(after[2], seen + 2.0, recent, f.noise, f.differences, f.roots, f.sensed)
        learn_noise(u, seen + 1.0, recent, f.known_noise, f.known_differences, f.known_roots, f.known_sensed)
        redundant, share = observer.sizes.believed - c + observer.blind[0], 1.0 - np.exp(-dt / MISFIT_LAG)
        leak = leak_of_noise(before, after, dt, share, observer, filter_) if redundant > 0 else 0.0
        learn_misfit(remainder[:nv], redundant, share, recent, leak, filter_)
    predict_covariance(before, after, dt, observer, filter_, step)
    for a in range(n - nv):
        x[nv + a] *= step.decay[a]
    correct(x, P, filter_, step)
    for a in range(step.z.shape[0]):
        step.z[a] = x[nv + a]
        copy_values(P[nv + a], step.Z[a])
    copy_values(step.rows[:, nv + 2 * n], remainder[nv + 1 :])
    filter_.elapsed[0] += dt
    filter_.intervals[0] += 1.0
    return True


@kernel
def update_filter(memory: Array, q: Array, v: Array, u: Array, dt: float, out: Array) -> bool:
    """Take a sample and apply `filter_interval` to the interval since the previous sample.

    Returns False and changes no estimate if q is no configuration, v or u does not have the model's size, or the
    innovation is NaN or huge.
    """
    kalman = fields_of(memory, KalmanState)
    filter_, step, nv, newest = kalman.filter, kalman.step, kalman.observer.sizes.nv, kalman.observer.newest[0]
    if v.shape[0] != nv or u.shape[0] != nv or not dt < TOO_LARGE or not is_configuration(kalman.observer, q):
        return False
    before, after = filter_.samples[newest], filter_.samples[1 - newest]
    write_noisy_sample(kalman.observer, filter_, v, after)
    if not filter_interval(before, after, u, dt, kalman.observer, filter_, step, out):
        return False
    report(step, dt, out)
    kalman.observer.newest[0] = 1 - newest
    return True


@kernel
def record_noisy_sample(memory: Array, v: Array, sample: Array) -> None:
    """Write a sample (3 + c + 2 nv, nv) at a velocity (nv,), for which Pinocchio has computed M."""
    kalman = fields_of(memory, KalmanState)
    write_noisy_sample(kalman.observer, kalman.filter, v, sample)


@kernel
def filter_all(samples: Array, time: Array, u: Array, errors: Array, memory: Array, steps: Array, out: Array) -> int:
    """Apply `filter_interval` to a whole record; return the first interval that is not finite, or -1.

    Args:
        samples: (m + 1, 3 + c + 2 nv, nv) samples; one with a repeated time is overwritten by the previous sample.
        time: (m + 1,) sample times [s].
        u: (m, nv) known generalised force, interval means.
        errors: (ne, m, nv) the known forces that have an uncertain factor.
        memory: state of the filter, started at the first sample.
        steps: (m, step size) written if a smoother follows, which then writes `out`; otherwise (0, step size).
        out: (m, nv + 2 c + nv + 1 + nv) written; the first nv + 2 c columns only if `steps` has no rows.
    """
    kalman, smoothed = fields_of(memory, KalmanState), steps.shape[0] > 0
    filter_ = kalman.filter
    for k in range(u.shape[0]):
        dt = time[k + 1] - time[k]
        if dt == 0.0:
            repeat_interval(samples, out, k)
            continue
        for a in range(errors.shape[0]):
            copy_values(errors[a, k], filter_.errors[a])
        step = fields_of(steps[k], Step) if smoothed else kalman.step
        if not filter_interval(samples[k], samples[k + 1], u[k], dt, kalman.observer, filter_, step, out[k]):
            return k
        if not smoothed:
            report(step, dt, out[k])
    return -1
