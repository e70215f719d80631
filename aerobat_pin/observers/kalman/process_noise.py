"""Process noise of the Kalman filter: the random walk that a gain asks for, and torques that are not known."""

from __future__ import annotations

from aerobat_pin.numerics import Array, add_product, factorise, kernel
from aerobat_pin.observers.kalman.memory import Filter
from aerobat_pin.observers.rows import BASE_ROWS

LEAST_INFORMATION = 1.0e-6  # share of the total information on all patterns of forces, added to every pattern
UNKNOWN_TORQUE = 1.0e8  # variance of the impulse of an unknown torque, relative to that of all other noise


@kernel
def set_walk_by_gain(before: Array, after: Array, filter_: Filter, rows: Array) -> None:
    """Set the random walk from the gain, in proportion to (J R^-1 J^T)^-1.

    R is the covariance of the momentum noise of one sample, so (J R^-1 J^T)^-1 is the covariance with which one sample
    determines the components' impulses. With this walk, every pattern of forces rises equally fast in every
    configuration. The share `LEAST_INFORMATION` of the total information is added to each pattern, which keeps the
    inverse finite. `rows` (nv, ...) is scratch.
    """
    c, information, scale = filter_.walk.shape[0], filter_.information, filter_.scale
    nv, blurred = rows.shape[0], filter_.blurred
    sensed = rows[:, : nv + c]
    sensed[:, :] = 0.0
    add_product(sensed[:, :nv], blurred.T, blurred, 1.0)
    if filter_.hidden.shape[0] > 0:
        add_unknown_torques(before, after, 0.0, filter_, sensed)
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
def add_unknown_torques(before: Array, after: Array, misfit: float, filter_: Filter, P: Array) -> None:
    """Add the covariance of unknown torques to P (nv, nv).

    The torques act along the generalised forces onto which `hidden` projects. If the joints' power is known, only
    torques that do not change this power are added. `misfit` is the sum of the variances that errors of the model give
    to these generalised forces.
    """
    hidden, noise, c = filter_.hidden, filter_.noise, filter_.walk.shape[0]
    nv, size, speed = noise.shape[0], 0.0, 0.0
    for k in range(nv):
        for i in range(nv):
            for j in range(nv):
                size += noise[k] * noise[k] * after[3 + c + k, i] * hidden[i, j] * after[3 + c + k, j]
    size = UNKNOWN_TORQUE * (size + misfit)
    for i in range(nv):
        for j in range(nv):
            P[i, j] += size * hidden[i, j]
    if filter_.power_known > 0:
        for i in range(BASE_ROWS, nv):
            mean = 0.5 * (before[2, i] + after[2, i])
            speed += mean * mean + 0.5 * filter_.sensed[i] * filter_.sensed[i]
        for i in range(BASE_ROWS, nv):
            along = 0.25 * size * (before[2, i] + after[2, i]) / speed
            for j in range(BASE_ROWS, nv):
                P[i, j] -= along * (before[2, j] + after[2, j])
