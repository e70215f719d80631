"""The compiled part of `dynamics`: one interval after the other, from Pinocchio's derivatives to rows of the state."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from aerobat_pin.linkage import joints_at
from aerobat_pin.numerics import Array, Integers, inner, kernel

CRANK_STEP = 1.0e-4  # [rad]: difference quotient for the third derivative of the linkage
BODY_STATES = 6  # rows of the base; as many states each have pose and twist error, which come first


class Middle(NamedTuple):
    """The robot at the middle of m intervals, and the body's way there and to the end.

    Attributes:
        rotation: (m, 3, 3) body to world.
        ID, Dq, Dv: (m, nv), (m, nv, nv), (m, nv, nv) inverse dynamics, its derivatives by configuration and velocity.
        M: (m, nv, nv) inertia, added mass included.
        J: (m, b, nv) Jacobians of the points at which forces act, world axes.
        ad_half, ad: (m, 6, 6) from the pose error at the start to that at the middle, and to that at the end.
        defect: (m, 6) by how much the nominal motion's pose misses what its twist gives.
    """

    rotation: Array
    ID: Array
    Dq: Array
    Dv: Array
    M: Array
    J: Array
    ad_half: Array
    ad: Array
    defect: Array


class LinearDynamics(NamedTuple):
    """The linear model of m intervals with n states; x is the state at the start of the interval.

    Attributes:
        transition: (m, moving, n) rows of the transition of the first states, see `Layout.moving`.
        shift: (m, moving) their shift.
        acceleration: (m, 6, n) rows of the change of the body's acceleration; `push` (m, 6) its constant part.
        pose, twist: (m, 6, n) rows of pose and twist error at the middle; `kick` (m, 6) the constant part of the twist.
        torque: (m, 4, n) rows of the joint torques; `torque_at` (m, 4) the torques at x = 0.
        slope: (m, 4) derivative of the joint angles by crank angle, at the middle.
        middle_twist, middle_acceleration: (m, 6) of the nominal motion; `up` (m, 3) is R^T g.
    """

    transition: Array
    shift: Array
    acceleration: Array
    push: Array
    pose: Array
    twist: Array
    kick: Array
    torque: Array
    torque_at: Array
    slope: Array
    middle_twist: Array
    middle_acceleration: Array
    up: Array


@kernel
def wing_angles(series: Array, angles: Array, joints: Array) -> None:
    """Write angle and first to third derivative by crank angle (m, 4, 4) of the four joints, left wing, right wing.

    Args:
        series: of the linkage, see `joint_series`.
        angles: (m,) of the crank [rad].
        joints: (m, 4, 4) written.
    """
    centre, ahead, behind = np.empty((3, 2)), np.empty((3, 2)), np.empty((3, 2))
    for k in range(angles.shape[0]):
        joints_at(series, angles[k], centre)
        joints_at(series, angles[k] + CRANK_STEP, ahead)
        joints_at(series, angles[k] - CRANK_STEP, behind)
        for j in range(4):
            for i in range(3):
                joints[k, i, j] = centre[i, j % 2]
            joints[k, 3, j] = (ahead[2, j % 2] - behind[2, j % 2]) / (2.0 * CRANK_STEP)


@kernel
def half_step_motion(
    series: Array,
    at_q: Integers,
    at_v: Integers,
    ends: Array,
    twist: Array,
    crank: Array,
    span: float,
    q: Array,
    v: Array,
    a: Array,
) -> None:
    """Write configuration, velocity and acceleration at equal steps of an interval.

    Between the knots the body's position and quaternion are straight, as is its twist; the crank's acceleration stays.

    Args:
        series: of the linkage.
        at_q: (4,) places of the joints in a configuration.
        at_v: (4,) their places in a velocity.
        ends: (2, 7) placements of the body at both ends.
        twist: (2, 6) of the body.
        crank: (3,) angle, rate and acceleration at the start.
        span: length of the interval [s].
        q: (s, nq) written, as are `v` and `a` (s, nv).
        v: velocity.
        a: acceleration.
    """
    joints, last = np.empty((3, 2)), q.shape[0] - 1
    same = 0.0
    for i in range(3, 7):
        same += ends[0, i] * ends[1, i]
    for k in range(last + 1):
        share, size = k / last, 0.0
        for i in range(7):
            end = -ends[1, i] if i > 2 and same < 0.0 else ends[1, i]
            q[k, i] = ends[0, i] + share * (end - ends[0, i])
            if i > 2:
                size += q[k, i] ** 2
        for i in range(3, 7):
            q[k, i] /= np.sqrt(size)
        for i in range(6):
            change = twist[1, i] - twist[0, i]
            v[k, i], a[k, i] = twist[0, i] + share * change, change / span
        s = share * span
        rate = crank[1] + s * crank[2]
        joints_at(series, crank[0] + 0.5 * s * (crank[1] + rate), joints)
        for j in range(4):
            angle, slope, bend = joints[0, j % 2], joints[1, j % 2], joints[2, j % 2]
            q[k, at_q[j]], v[k, at_v[j]] = angle, slope * rate
            a[k, at_v[j]] = slope * crank[2] + bend * rate**2


@kernel
def linearise(
    at: Integers,
    joints: Integers,
    by_mode: Array,
    dt: Array,
    crank: Array,
    slopes: Array,
    middle: Middle,
    r: Array,
    air: Array,
    by_twist: Array,
    force: Array,
    linear: LinearDynamics,
) -> None:
    """Write the rows of `LinearDynamics` that follow from the equations of motion, and the transition.

    Args:
        at: (5,) `Layout.places`.
        joints: (4,) rows of the joints.
        by_mode: (b, b) from slow states to forces.
        dt: (m,) [s].
        crank: (m + 1, 3) angle, rate and acceleration of the crank at the knots.
        slopes: (m, 4, 4) of `wing_angles`.
        middle: the robot at the middle.
        r: (m, nv) inverse dynamics less all known forces.
        air: (m, nv) force of the air.
        by_twist: (m, nv, 6) its derivative by the twist.
        force: (m, b) forces of the last iteration, world axes.
        linear: written; `transition`, `pose` and `twist` are zero before.
    """
    (m, nv, _), M, J, Dq, Dv, ad_half = middle.M.shape, middle.M, middle.J, middle.Dq, middle.Dv, middle.ad_half
    A, push, n, b = linear.acceleration, linear.push, linear.transition.shape[2], J.shape[1]
    F, shift, moving = linear.transition, linear.shift, linear.shift.shape[1]
    walk, white, mass_at, air_at, phi = at
    Z, Zq, Zv = np.zeros((nv, n)), np.zeros((nv, BODY_STATES)), np.zeros((nv, BODY_STATES))
    rows, body_force = np.zeros((BODY_STATES, BODY_STATES + 1 + n)), np.zeros(3)
    solution = rows[:, BODY_STATES:]
    for k in range(m):
        half, bend = 0.5 * dt[k], crank[k, 2]
        rate = crank[k, 1] + half * bend
        for i in range(nv):
            for j in range(n):
                Z[i, j] = 0.0
            for j in range(b):
                Z[i, white + j] = -J[k, j, i]
            for j in range(b):
                total = 0.0
                for c in range(b):
                    total -= J[k, c, i] * by_mode[c, j]
                Z[i, walk + j] = total
            for j in range(BODY_STATES):
                Zq[i, j] = Dq[k, i, j]
                Zv[i, j] = Dv[k, i, j] - by_twist[k, i, j]
        for point in range(b // 3):
            for j in range(3):
                body_force[j] = 0.0
                for i in range(3):
                    body_force[j] += middle.rotation[k, i, j] * force[k, 3 * point + i]
            fx, fy, fz = body_force
            for i in range(nv):
                gx, gy, gz = 0.0, 0.0, 0.0  # row of J^T R
                for c in range(3):
                    lever = J[k, 3 * point + c, i]
                    gx += lever * middle.rotation[k, c, 0]
                    gy += lever * middle.rotation[k, c, 1]
                    gz += lever * middle.rotation[k, c, 2]
                Zq[i, 3] -= gy * fz - gz * fy
                Zq[i, 4] -= gz * fx - gx * fz
                Zq[i, 5] -= gx * fy - gy * fx
        for i in range(nv):
            by_angle, by_rate, by_bend = 0.0, 0.0, 0.0
            for j in range(joints.shape[0]):
                d1, d2, d3 = slopes[k, 1, j], slopes[k, 2, j], slopes[k, 3, j]
                q, v, a = Dq[k, i, joints[j]], Dv[k, i, joints[j]], M[k, i, joints[j]]
                by_angle += q * d1 + v * d2 * rate + a * (d3 * rate**2 + d2 * bend)
                by_rate += v * d1 + a * 2.0 * d2 * rate
                by_bend += a * d1
            Z[i, phi] = by_angle
            Z[i, phi + 1] = by_angle * half + by_rate
            Z[i, phi + 2] = by_angle * 0.5 * half**2 + by_rate * half + by_bend
            if mass_at >= 0:
                Z[i, mass_at] = middle.ID[k, i]
            if air_at >= 0:
                Z[i, air_at] = -air[k, i]
            for j in range(BODY_STATES):
                total = 0.0
                for c in range(BODY_STATES):
                    total += Zq[i, c] * ad_half[k, c, j]
                Z[i, j] += total
                Z[i, BODY_STATES + j] += Zq[i, j] * half + Zv[i, j]
        for i in range(BODY_STATES):
            for j in range(BODY_STATES):
                rows[i, j] = M[k, i, j] + half * Zv[i, j]
            solution[i, 0] = -r[k, i]
            for j in range(n):
                solution[i, 1 + j] = -Z[i, j]
        eliminate(rows)
        for i in range(BODY_STATES):
            push[k, i], linear.kick[k, i] = solution[i, 0], half * solution[i, 0]
            for j in range(n):
                A[k, i, j] = solution[i, 1 + j]
                linear.twist[k, i, j] = half * solution[i, 1 + j]
            linear.twist[k, i, BODY_STATES + i] += 1.0
            linear.pose[k, i, BODY_STATES + i] = half
            for j in range(BODY_STATES):
                linear.pose[k, i, j] = ad_half[k, i, j]
        for i in range(joints.shape[0]):
            row = joints[i]
            linear.torque_at[k, i] = r[k, row]
            for j in range(n):
                linear.torque[k, i, j] = Z[row, j]
            for c in range(BODY_STATES):
                through = M[k, row, c] + half * Zv[row, c]
                linear.torque_at[k, i] += through * push[k, c]
                for j in range(n):
                    linear.torque[k, i, j] += through * A[k, c, j]
        h = dt[k]  # from here on, the transition
        for i in range(BODY_STATES):
            shift[k, i] = middle.defect[k, i] + 0.5 * h * h * push[k, i]
            shift[k, BODY_STATES + i] = h * push[k, i]
            for j in range(n):
                F[k, i, j] = 0.5 * h * h * A[k, i, j]
                F[k, BODY_STATES + i, j] = h * A[k, i, j]
            for j in range(BODY_STATES):
                F[k, i, j] += middle.ad[k, i, j]
            F[k, i, BODY_STATES + i] += h
            F[k, BODY_STATES + i, BODY_STATES + i] += 1.0
        for i in range(3):
            F[k, phi + i, phi + i] = 1.0
        F[k, phi, phi + 1] = F[k, phi + 1, phi + 2] = h
        F[k, phi, phi + 2] = 0.5 * h * h
        for i in range(3):
            shift[k, phi + i] = -crank[k + 1, i]
            for j in range(i, 3):
                shift[k, phi + i] += F[k, phi + i, phi + j] * crank[k, j]
        for i in range(walk, moving):
            shift[k, i] = 0.0
            F[k, i, i] = 1.0
            F[k, i, i + moving - walk] = h


@inner
def eliminate(rows: Array) -> None:
    """Solve G X = B for rows [G, B] (n, n + ...) by Gauss's elimination with pivots: B becomes X."""
    n, width = rows.shape
    for c in range(n):
        best = c
        for i in range(c + 1, n):
            if abs(rows[i, c]) > abs(rows[best, c]):
                best = i
        if best != c:
            for j in range(width):
                rows[c, j], rows[best, j] = rows[best, j], rows[c, j]
        for i in range(n):
            if i != c and rows[i, c] != 0.0:
                factor = rows[i, c] / rows[c, c]
                for j in range(c, width):
                    rows[i, j] -= factor * rows[c, j]
    for c in range(n):
        for j in range(n, width):
            rows[c, j] /= rows[c, c]
