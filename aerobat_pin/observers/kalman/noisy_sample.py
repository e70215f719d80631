"""A sample of the Kalman filter: what `crba` leaves of the robot, kernels that read it, and what noise of v does to it.

A sample is what every observer keeps, then M and D^T, with D = d(C^T v)/dv. It follows, like C^T v itself, from what
`crba` leaves in world axes about the world's origin: J_k, column k of the Jacobian, fixed in the link of its joint i,
and Y_i, the inertia of the subtree behind this joint. With the twist V_i of the joint and the momentum h_i of the
subtree, row k of the momentum is J_k . h_i, and

    (C^T v)_k = A_k . h_i,     A_k = dJ_k/dt = V_i x J_k,     g_k = -a . (Y_i J_k) in the field a
    D_kl = J_l . (J_k x* h_i + Y_i A_k)                if velocity l moves joint i,
    D_kl = A_k . (Y_j J_l)                             if l belongs to a joint j further out, else 0

C^T v is quadratic in v, so differences of it with any step are exact: the tests compare D with them, and C^T v with
Pinocchio's Coriolis matrix. That call alone costs as much as all of this.

Noise n of the measured velocity enters the momentum as M n, and the impulse of C^T v over an interval as D n dt/2 at
each of its ends. Both belong together:

    (M_1 - D_1 dt/2) n_1    is what the noise at the end of an interval adds to its momentum equation,
    (M_0 + D_0 dt/2) n_0    and that at its start takes off
"""

from __future__ import annotations

import ctypes

import numpy as np
import pinocchio as pin

from aerobat_pin.numerics import DOUBLE, Array, Integers, add_product, array_at, copy_values, inlined, inner
from aerobat_pin.observers.kalman.kalman_state import Filter
from aerobat_pin.observers.kernels.observer_state import ObserverState
from aerobat_pin.observers.kernels.residual import dynamics_of, write_momentum_and_jacobian

INERTIA_SIZE = 10  # number of doubles: mass, lever, moments of inertia xx, xy, yy, xz, yz, zz
ABOVE, BELOW = 1, 2  # of a velocity: it moves the joint of another one; the other one moves it, and not the reverse


def kinship_of(model: pin.Model) -> Integers:
    """Return a table (nv, nv + 1): the joint of each velocity, then how each other velocity stands to it.

    That is `ABOVE` if the other one moves the joint, `BELOW` if it is in a joint further out, else 0.
    """
    joint = np.repeat(np.arange(model.njoints), model.nvs.tolist())
    above = np.array([np.isin(joint, model.supports[index].tolist()) for index in joint.tolist()])
    return np.column_stack([joint, np.where(above, ABOVE, np.where(above.T, BELOW, 0))])


def inertias_at(model: pin.Model, data: pin.Data) -> int:
    """Return the address of what `crba` in the world's convention leaves in `data`: the inertias of the subtrees.

    They are `INERTIA_SIZE` numbers for each joint, in world axes about the world's origin.

    Raises:
        RuntimeError: they do not lie in memory as this version expects.
    """
    pin.crba(
        model, data, pin.integrate(model, pin.neutral(model), np.linspace(0.1, 0.4, model.nv)), pin.Convention.WORLD
    )
    first, count = int(data.oYcrb[0].lever.ctypes.data) - DOUBLE, int(model.njoints)
    seen = np.reshape((ctypes.c_double * (count * INERTIA_SIZE)).from_address(first), (count, INERTIA_SIZE))
    for joint in range(1, count):
        subtree = data.oYcrb[joint]
        moments = subtree.inertia[[0, 0, 1, 0, 1, 2], [0, 1, 1, 2, 2, 2]]
        if not np.array_equal(seen[joint], [subtree.mass, *subtree.lever, *moments]):
            raise RuntimeError("Pinocchio's inertias do not lie in memory as this version expects")
    return first


@inner
def write_noisy_sample(observer: ObserverState, filter_: Filter, v: Array, sample: Array) -> None:
    """Write a sample: the rows (3 + c, nv) that other observers write, then M and D^T (nv, nv each)."""
    M, nv = dynamics_of(observer).M, v.shape[0]
    top = sample.shape[0] - 2 * nv
    write_momentum_and_jacobian(observer, v, sample[:top])
    for k in range(nv):
        for i in range(nv):
            sample[top + k, i] = M[i, k]
    write_drift_and_slope(observer, filter_, v, sample[1], sample[top + nv :])


@inner
def write_drift_and_slope(observer: ObserverState, filter_: Filter, v: Array, drift: Array, slope: Array) -> None:
    """Write C^T v - g (nv,) and D^T (nv, nv)."""
    nv, tree, J, a = v.shape[0], filter_.tree, dynamics_of(observer).J, filter_.gravity
    inertias = array_at(filter_.inertias[0], (observer.sizes.joints, INERTIA_SIZE))
    V, h, carried, turns, pushes = filter_.twist, filter_.subtree, filter_.carried, filter_.turns, filter_.pushes
    joint = 0
    for k in range(nv):
        S, Y = J[:, k], inertias[tree[k, 0]]
        if tree[k, 0] != joint:
            joint = tree[k, 0]
            V[:] = 0.0
            for other in range(nv):
                if tree[k, 1 + other] == ABOVE:
                    for i in range(6):
                        V[i] += v[other] * J[i, other]
        put_motion_product(V, S, turns[:, k])
        put_momentum(Y, S[0], S[1], S[2], S[3], S[4], S[5], carried[:, k])
        drift[k] = 0.0
        for i in range(6):
            drift[k] += a[i] * carried[i, k]
    joint = 0
    for k in range(nv):
        S, Y, A, push = J[:, k], inertias[tree[k, 0]], turns[:, k], pushes[:, k]
        if tree[k, 0] != joint:  # velocities that move the joint move the whole subtree, those further out their own
            joint = tree[k, 0]
            V[:], h[:] = 0.0, 0.0
            for other in range(nv):
                how = tree[k, 1 + other]
                for i in range(6):
                    if how == ABOVE:
                        V[i] += v[other] * J[i, other]
                    elif how == BELOW:
                        h[i] += v[other] * carried[i, other]
            put_momentum(Y, V[0], V[1], V[2], V[3], V[4], V[5], push)
            for i in range(6):
                h[i] += push[i]
        put_momentum(Y, A[0], A[1], A[2], A[3], A[4], A[5], push)
        add_force_product(S, h, push)
        for i in range(6):
            drift[k] += A[i] * h[i]
    across = filter_.across
    slope[:], across[:] = 0.0, 0.0
    add_product(slope, J.T, pushes, 1.0)
    add_product(across, carried.T, turns, 1.0)
    for k in range(nv):
        for other in range(nv):
            how = tree[k, 1 + other]
            if how != ABOVE:
                slope[other, k] = across[other, k] if how == BELOW else 0.0


@inlined
def put_motion_product(V: Array, S: Array, product: Array) -> None:
    """Write V x S of two twists (6,), linear part first."""
    product[0] = V[4] * S[2] - V[5] * S[1] + V[1] * S[5] - V[2] * S[4]
    product[1] = V[5] * S[0] - V[3] * S[2] + V[2] * S[3] - V[0] * S[5]
    product[2] = V[3] * S[1] - V[4] * S[0] + V[0] * S[4] - V[1] * S[3]
    product[3] = V[4] * S[5] - V[5] * S[4]
    product[4] = V[5] * S[3] - V[3] * S[5]
    product[5] = V[3] * S[4] - V[4] * S[3]


@inlined
def add_force_product(S: Array, h: Array, force: Array) -> None:
    """Add S x* h of a twist and a momentum (6,) to a force (6,)."""
    force[0] += S[4] * h[2] - S[5] * h[1]
    force[1] += S[5] * h[0] - S[3] * h[2]
    force[2] += S[3] * h[1] - S[4] * h[0]
    force[3] += S[4] * h[5] - S[5] * h[4] + S[1] * h[2] - S[2] * h[1]
    force[4] += S[5] * h[3] - S[3] * h[5] + S[2] * h[0] - S[0] * h[2]
    force[5] += S[3] * h[4] - S[4] * h[3] + S[0] * h[1] - S[1] * h[0]


@inner
def put_momentum(Y: Array, x: float, y: float, z: float, a: float, b: float, c: float, momentum: Array) -> None:
    """Write an inertia (mass, lever, moments about the centre of mass) times a twist (x, y, z, a, b, c)."""
    mass, s, t, u = Y[0], Y[1], Y[2], Y[3]
    fx, fy, fz = mass * (x + b * u - c * t), mass * (y + c * s - a * u), mass * (z + a * t - b * s)
    momentum[0], momentum[1], momentum[2] = fx, fy, fz
    momentum[3] = Y[4] * a + Y[5] * b + Y[7] * c + t * fz - u * fy
    momentum[4] = Y[5] * a + Y[6] * b + Y[8] * c + u * fx - s * fz
    momentum[5] = Y[7] * a + Y[8] * b + Y[9] * c + s * fy - t * fx


@inner
def repeat_interval(samples: Array, out: Array, k: int) -> None:
    """Handle a repeated time stamp: copy the previous result to interval k, and its first sample to its last."""
    if k > 0:
        copy_values(out[k - 1], out[k])
    else:
        out[k] = 0.0
    for row in range(samples.shape[1]):
        copy_values(samples[k, row], samples[k + 1, row])
