"""Compiled kernels of the observers: one call for each sample, after Pinocchio has computed M, C and g.

From each sample (3 + c, nv) numbers are kept: the momentum p = M v, the drift C^T v - g, the velocity v, and the
Jacobian of the c unknown components (see `applications`). From two samples, the kernels compute

    phi = (p_1 - p_0) / dt - (drift_0 + drift_1) / 2 - u            mean external generalised force of the interval
    J   = (J_0 + J_1) / 2                                           Jacobian in mid-interval, to second order
    f   = argmin |W (phi - J^T f)|^2 + damping |f|^2                components that best fit phi

Without measured joint torques the joint rows of phi contain no information, and f is fitted only to the six rows of
the base. If one motor drives all joints and its power is measured, one more row can be used: v_j . phi_j. For tied
coordinates, the sums of their rows are used. The kind of observer determines whether phi or f is filtered, and how.
`equations` computes the same over a whole record.

In all kernels, `before` and `after` are the samples at the start and the end of an interval of `dt` [s], over which
`u` (nv,) is the mean of the known generalised force. `observer` is the state of the observer, which changes.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from aerobat_pin.numerics import Array, dot, doubles_at, fields_of, in_outer_axes, inlined, inner, kernel
from aerobat_pin.observers.kernels.filters import low_pass, rotate
from aerobat_pin.observers.kernels.observer_state import ObserverState
from aerobat_pin.observers.kernels.posterior import estimate_posterior, forget_errors
from aerobat_pin.observers.kernels.projection import project

TOO_LARGE = 1.0e150  # limit for a residual: its square is still a finite number
FARTHEST = 1.0e6  # [m or rad]: largest coordinate of a configuration; further out, positions lose their digits
LENGTH_TOLERANCE = 1.0e-3  # largest deviation of a unit vector's length


class Dynamics(NamedTuple):
    """Pinocchio's results at a sample: M and C (nv, nv), g (nv, 1), world Jacobian J (6, nv), oMi (12, njoints)."""

    M: Array
    C: Array
    g: Array
    J: Array
    oMi: Array


@inner
def dynamics_of(observer: ObserverState) -> Dynamics:
    """Return views of Pinocchio's results in place; passing five arrays instead would cost a fifth of the call."""
    places, nv = observer.robot, observer.sizes.nv
    return Dynamics(
        M=doubles_at(places[0], nv, nv),
        C=doubles_at(places[1], nv, nv),
        g=doubles_at(places[2], nv, 1),
        J=doubles_at(places[3], 6, nv),
        oMi=doubles_at(places[4], 12, observer.sizes.joints),
    )


@inner
def write_sample(observer: ObserverState, v: Array, sample: Array) -> None:
    """Write a sample (3 + c, nv) at a velocity (nv,); `computeCoriolisMatrix` leaves J in the WORLD frame."""
    _, C, g, _, _ = dynamics_of(observer)
    for i in range(v.shape[0]):
        sample[1, i] = dot(C[:, i], v) - g[i, 0]  # b = C^T v - g
    write_momentum_and_jacobian(observer, v, sample)


@inner
def write_momentum_and_jacobian(observer: ObserverState, v: Array, sample: Array) -> None:
    """Write all of a sample but its drift."""
    M, _, _, J, oMi = dynamics_of(observer)
    nv, momentum, rate = v.shape[0], sample[0], sample[2]
    for i in range(nv):
        momentum[i], rate[i] = 0.0, v[i]
    for j in range(nv):  # p = M v; M is symmetric, so whole columns can be read
        for i in range(nv):
            momentum[i] += M[i, j] * v[j]
    for row in range(observer.components.shape[0]):
        joint, a, b, c, dx, dy, dz, mx, my, mz, turns = observer.components[row]
        P = oMi[:, int(joint)]
        if turns > 0.0:
            dx, dy, dz = in_outer_axes(P, dx, dy, dz)
            mx, my, mz = in_outer_axes(P, mx, my, mz)
        x, y, z = in_outer_axes(P, a, b, c)
        x, y, z = x + P[9], y + P[10], z + P[11]
        mx, my, mz = mx + y * dz - z * dy, my + z * dx - x * dz, mz + x * dy - y * dx
        for i in range(nv):
            along = dx * J[0, i] + dy * J[1, i] + dz * J[2, i] + mx * J[3, i] + my * J[4, i] + mz * J[5, i]
            sample[3 + row, i] = observer.support[row, i] * along


@inlined
def mean_residual(before: Array, after: Array, u: Array, dt: float, observer: ObserverState, residual: Array) -> bool:
    """Write phi (nv,) and `observer.jacobian` of an interval; return False if phi is NaN or huge."""
    if not dt < TOO_LARGE:
        return False
    for i in range(u.shape[0]):  # phi = (p_1 - p_0) / dt - (b_0 + b_1) / 2 - u
        residual[i] = (after[0, i] - before[0, i]) / dt - 0.5 * (before[1, i] + after[1, i]) - u[i]
        if not abs(residual[i]) < TOO_LARGE:  # NaN too
            return False
    J = observer.jacobian
    for row in range(J.shape[0]):  # J = (J_0 + J_1) / 2
        for i in range(u.shape[0]):
            J[row, i] = 0.5 * (before[3 + row, i] + after[3 + row, i])
    return True


@inlined
def observe(before: Array, after: Array, u: Array, dt: float, observer: ObserverState, out: Array) -> bool:
    """Compute the estimate for one interval; return False if the residual is NaN or huge.

    Generalised residual and components are written to `out` (nv + c,), and with expected forces the `doubt` (c + 1,) of
    `estimate_posterior`.
    """
    nv, end, expected = u.shape[0], u.shape[0] + observer.sizes.components, observer.sizes.expected > 0
    residual, force, doubt = out[:nv], out[nv:end], out[end:]
    if not mean_residual(before, after, u, dt, observer, residual):
        return False
    J, project_first = observer.jacobian, observer.sizes.project_first > 0
    if project_first and expected:
        estimate_posterior(observer, before, after, residual, dt, force, doubt)
    elif project_first:
        project(observer, before, after, residual, force)
    filtered = force if project_first else residual
    if observer.basis.shape[0] > 0:
        rotate(observer.basis, filtered, observer.value, False)
        low_pass(observer, dt, observer.value)
        rotate(observer.basis, observer.value, filtered, True)
    else:
        low_pass(observer, dt, filtered)
    if not project_first:
        if expected:
            estimate_posterior(observer, before, after, residual, dt, force, doubt)
        else:
            project(observer, before, after, residual, force)
        return True
    for i in range(nv):  # r = J^T f
        residual[i] = 0.0
        for row in range(force.shape[0]):
            residual[i] += J[row, i] * force[row]
    return True


@inlined
def is_configuration(observer: ObserverState, q: Array) -> bool:
    """Return whether every coordinate is finite and near, and quaternions and other directions have length one."""
    for i in range(q.shape[0]):
        if not abs(q[i]) <= FARTHEST:  # NaN too
            return False
    for row in range(observer.directions.shape[0]):
        start, square = observer.directions[row, 0], 0.0
        for i in range(start, start + observer.directions[row, 1]):
            square += q[i] * q[i]
        if not abs(np.sqrt(square) - 1.0) < LENGTH_TOLERANCE:
            return False
    return True


@kernel
def start_observer(memory: Array, v: Array) -> None:
    """Take the first sample of a stream and set the filter to zero."""
    observer = fields_of(memory, ObserverState)
    observer.newest[0] = 0
    observer.filtered[:, :] = 0.0
    forget_errors(observer)
    write_sample(observer, v, observer.samples[0])


@kernel
def update_observer(memory: Array, q: Array, v: Array, u: Array, dt: float, out: Array) -> bool:
    """Take a sample and apply `observe` to the interval since the previous sample.

    Returns False and keeps the filter's state if q is no configuration, v or u does not have the model's size, or the
    residual is not finite.
    """
    observer = fields_of(memory, ObserverState)
    if v.shape[0] != observer.sizes.nv or u.shape[0] != observer.sizes.nv or not is_configuration(observer, q):
        return False
    newest = observer.newest[0]
    before, after = observer.samples[newest], observer.samples[1 - newest]
    write_sample(observer, v, after)
    if not observe(before, after, u, dt, observer, out):
        return False
    observer.newest[0] = 1 - newest
    return True
