"""Compiled kernels that write a sample of the Kalman filter: what every observer keeps, then M and M^-1 D^T.

D = d(C^T v)/dv follows from what `computeCoriolisMatrix` has computed anyhow. In world axes about the origin, row k of
the momentum is J_k . h_i: J_k is column k of the Jacobian, fixed in the link of its joint i, which moves with the twist
V_i; h_i is the momentum of the subtree behind this joint, and Y_i its inertia. Therefore

    (C^T v)_k = A_k . h_i,                             A_k = dJ_k/dt = V_i x J_k
    D_kl = J_l . (J_k x* h_i + Y_i A_k)                if velocity l moves joint i,
    D_kl = A_k . (Y_j J_l)                             if l belongs to a joint j further out, else 0

C^T v is quadratic in v, so differences of it with any step are exact: the tests compare D with them.
"""

from __future__ import annotations

from aerobat_pin.numerics import (
    Array,
    add_product,
    add_row_product,
    array_at,
    doubles_at,
    factorise,
    inner,
)
from aerobat_pin.observers.kalman.memory import Filter
from aerobat_pin.observers.kalman.slopes import ABOVE, BELOW, INERTIA_SIZE
from aerobat_pin.observers.kernels.memory import ObserverMemory
from aerobat_pin.observers.kernels.residual import dynamics_of, write_sample


@inner
def write_noisy_sample(observer: ObserverMemory, filter_: Filter, v: Array, sample: Array) -> None:
    """Write a sample: the rows (3 + c, nv) that `write_sample` writes, then M and M^-1 D^T (nv, nv each)."""
    write_inertia_and_gravity(observer, filter_)
    M, nv = dynamics_of(observer).M, v.shape[0]
    top = sample.shape[0] - 2 * nv
    write_sample(observer, v, sample[:top])
    equations = filter_.inverse
    for k in range(nv):
        for i in range(nv):
            sample[top + k, i] = M[i, k]
            equations[k, i] = M[i, k]
    write_slope(observer, filter_, v, equations[:, nv:])
    factorise(equations)  # [M, D^T] with M = L L^T becomes [L^T, L^-1 D^T]
    solved = sample[top + nv :]
    for k in range(nv - 1, -1, -1):
        inverse = 1.0 / equations[k, k]
        row, right = solved[k], equations[k, nv:]
        for i in range(nv):
            row[i] = right[i]
        add_row_product(row, equations[k, k + 1 : nv], solved[k + 1 :], -1.0)
        for i in range(nv):
            row[i] *= inverse


@inner
def write_inertia_and_gravity(observer: ObserverMemory, filter_: Filter) -> None:
    """Write M and g where Pinocchio would: M_kl = J_k . (Y_j J_l) for l in a joint j further out, g_k = -(Y_i J_k) . a.

    `computeCoriolisMatrix` has left Y_j J_l, so this costs a fifth of Pinocchio's own calls for M and g.
    """
    M, _, g, J, _ = dynamics_of(observer)
    nv, tree, a, product, rows = g.shape[0], filter_.tree, filter_.gravity, filter_.across, filter_.pushes
    carried = doubles_at(filter_.places[3], 6, nv)
    for k in range(nv):
        weight = 0.0
        for i in range(6):
            rows[i, k] = carried[i, k]
            weight += carried[i, k] * a[i]
        g[k, 0] = -weight
        for i in range(nv):
            product[k, i] = 0.0
    add_product(product, J.T, rows, 1.0)
    for k in range(nv):
        for i in range(nv):
            how = tree[k, 1 + i]
            M[k, i] = product[i, k] if how == ABOVE else product[k, i] if how == BELOW else 0.0
        M[k, k] += filter_.armature[k]


@inner
def write_slope(observer: ObserverMemory, filter_: Filter, v: Array, slope: Array) -> None:
    """Write D^T (nv, nv)."""
    nv, places, tree, J = v.shape[0], filter_.places, filter_.tree, dynamics_of(observer).J
    twists = array_at(places[0], (observer.sizes.joints, 6))
    inertias = array_at(places[1], (observer.sizes.joints, INERTIA_SIZE))
    rates, carried = doubles_at(places[2], 6, nv), doubles_at(places[3], 6, nv)
    pushes, turns, across = filter_.pushes, filter_.turns, filter_.across
    h, joint = filter_.subtree, 0
    for k in range(nv):
        S, A = J[:, k], rates[:, k]
        if tree[k, 0] != joint:  # a joint's twist moves the whole subtree, joints further out add to it
            joint = tree[k, 0]
            h[0], h[1], h[2], h[3], h[4], h[5] = momentum_of(inertias[joint], twists[joint])
            for other in range(nv):
                if tree[k, 1 + other] == BELOW:
                    for i in range(6):
                        h[i] += v[other] * carried[i, other]
        fx, fy, fz, mx, my, mz = momentum_of(inertias[joint], A)
        pushes[0, k] = fx + S[4] * h[2] - S[5] * h[1]
        pushes[1, k] = fy + S[5] * h[0] - S[3] * h[2]
        pushes[2, k] = fz + S[3] * h[1] - S[4] * h[0]
        pushes[3, k] = mx + S[4] * h[5] - S[5] * h[4] + S[1] * h[2] - S[2] * h[1]
        pushes[4, k] = my + S[5] * h[3] - S[3] * h[5] + S[2] * h[0] - S[0] * h[2]
        pushes[5, k] = mz + S[3] * h[4] - S[4] * h[3] + S[0] * h[1] - S[1] * h[0]
        for i in range(6):
            turns[i, k] = A[i]
    for k in range(nv):
        for other in range(nv):
            slope[k, other], across[k, other] = 0.0, 0.0
    add_product(slope, J.T, pushes, 1.0)
    add_product(across, carried.T, turns, 1.0)
    for k in range(nv):
        for other in range(nv):
            how = tree[k, 1 + other]
            if how != ABOVE:
                slope[other, k] = across[other, k] if how == BELOW else 0.0


@inner
def momentum_of(Y: Array, twist: Array) -> tuple[float, float, float, float, float, float]:
    """Return an inertia (mass, lever, moments about the centre of mass) times a twist (6,), about the origin."""
    mass, x, y, z, a, b, c = Y[0], Y[1], Y[2], Y[3], twist[3], twist[4], twist[5]
    fx, fy, fz = mass * (twist[0] + b * z - c * y), mass * (twist[1] + c * x - a * z), mass * (twist[2] + a * y - b * x)
    return (
        fx,
        fy,
        fz,
        Y[4] * a + Y[5] * b + Y[7] * c + y * fz - z * fy,
        Y[5] * a + Y[6] * b + Y[8] * c + z * fx - x * fz,
        Y[7] * a + Y[8] * b + Y[9] * c + x * fy - y * fx,
    )
