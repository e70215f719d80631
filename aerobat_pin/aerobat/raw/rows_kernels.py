"""The compiled part of `rows`: what an accelerometer feels, and its rows."""

from __future__ import annotations

import numpy as np

from aerobat_pin.aerobat.raw.dynamics_kernels import LinearDynamics
from aerobat_pin.numerics import Array, Integers, inner, kernel


@kernel
def felt_accelerations(d: LinearDynamics, place: Array, felt: Array) -> None:
    """Write the specific force felt (m, 3) at a place r (3,) in the body, body axes, at the middle of each interval.

    It is v' + w x v + w' x r + w x (w x r) - R^T g.
    """
    twist, rate, up = d.middle_twist, d.middle_acceleration, d.up
    total = np.empty(3)
    for k in range(twist.shape[0]):
        v, w = twist[k, :3], twist[k, 3:]
        cross(w, place, total)
        for i in range(3):
            felt[k, i] = rate[k, i] - up[k, i]
            total[i] += v[i]
        add_cross(w, total, felt[k])
        add_cross(rate[k, 3:], place, felt[k])


@kernel
def accelerometer_rows(
    d: LinearDynamics, of: Integers, turn: Array, place: Array, h: Array, constant: Array, by_place: Array
) -> None:
    """Write the rows of accelerometer samples, without bias, and their change at x = 0.

    Args:
        d: the linear model.
        of: (k,) interval of each sample.
        turn: (3, 3) sensor to body.
        place: (3,) of the sensor in the body.
        h: (k, 3, n) written.
        constant: (k, 3) written.
        by_place: (k, 3, 3) written: change with the place.
    """
    twist, rate, A, push = d.middle_twist, d.middle_acceleration, d.acceleration, d.push
    n = h.shape[2]
    D, by_pose, W, column = np.zeros((3, 6)), np.zeros((3, 3)), np.zeros((3, 3)), np.zeros(3)
    unit, moved, in_body = np.zeros(3), np.zeros(3), np.zeros((3, n + 1))
    for s in range(of.shape[0]):
        k = of[s]
        v, w, turning = twist[k, :3], twist[k, 3:], rate[k, 3:]
        cross(w, place, moved)
        for j in range(3):
            for i in range(3):
                unit[i] = 1.0 if i == j else 0.0
            cross(w, unit, column)
            for i in range(3):  # by the velocity: w x dv
                D[i, j], W[i, j] = column[i], column[i]
            cross(unit, v, column)  # by the rate: dw x v + dw x (w x r) + w x (dw x r)
            for i in range(3):
                D[i, 3 + j] = column[i]
            cross(unit, moved, column)
            for i in range(3):
                D[i, 3 + j] += column[i]
            cross(unit, place, column)
            add_cross(w, column, D[:, 3 + j])
            cross(unit, d.up[k], column)  # by the turn: -up x d
            for i in range(3):
                by_pose[i, j] = column[i]
            cross(turning, unit, column)
            for i in range(3):
                by_place[s, i, j] = column[i]
        for i in range(3):
            for j in range(3):
                for c in range(3):
                    by_place[s, i, j] += W[i, c] * W[c, j]
        for j in range(n):
            for i in range(3):
                total = A[k, i, j]
                for c in range(6):
                    total += D[i, c] * d.twist[k, c, j]
                for c in range(3):
                    total += by_pose[i, c] * d.pose[k, 3 + c, j]
                in_body[i, j] = total
            for i in range(3):
                unit[i] = A[k, 3 + i, j]
            cross(unit, place, column)
            for i in range(3):
                in_body[i, j] += column[i]
        for i in range(3):
            in_body[i, n] = push[k, i]
            for c in range(6):
                in_body[i, n] += D[i, c] * d.kick[k, c]
        cross(push[k, 3:], place, column)
        for i in range(3):
            in_body[i, n] += column[i]
        for i in range(3):
            for j in range(n):
                h[s, i, j] = turn[0, i] * in_body[0, j] + turn[1, i] * in_body[1, j] + turn[2, i] * in_body[2, j]
            constant[s, i] = turn[0, i] * in_body[0, n] + turn[1, i] * in_body[1, n] + turn[2, i] * in_body[2, n]


@inner
def cross(a: Array, b: Array, target: Array) -> None:
    """Write a x b."""
    target[0] = a[1] * b[2] - a[2] * b[1]
    target[1] = a[2] * b[0] - a[0] * b[2]
    target[2] = a[0] * b[1] - a[1] * b[0]


@inner
def add_cross(a: Array, b: Array, target: Array) -> None:
    """Add a x b."""
    target[0] += a[1] * b[2] - a[2] * b[1]
    target[1] += a[2] * b[0] - a[0] * b[2]
    target[2] += a[0] * b[1] - a[1] * b[0]
