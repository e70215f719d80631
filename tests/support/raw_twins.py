"""The joint smoother's kernels in numpy, independently: rows of the dynamics and of an accelerometer."""

from __future__ import annotations

import numpy as np

from aerobat_pin.aerobat.raw.air import AirForces
from aerobat_pin.aerobat.raw.dynamics import cross_matrices
from aerobat_pin.aerobat.raw.dynamics_kernels import LinearDynamics
from aerobat_pin.aerobat.raw.layout import CRANK_ERROR, POSE_ERROR, TWIST_ERROR, Layout
from aerobat_pin.numerics import Array

BASE = slice(0, 6)


def twin_rows(
    layout: Layout,
    joints: list[int],
    dt: Array,
    crank: Array,
    slopes: Array,
    ad_half: Array,
    rotation: Array,
    derivatives: tuple[Array, Array, Array, Array],
    air: AirForces,
    known: Array,
    J: Array,
    force: Array,
) -> tuple[Array, Array, Array, Array]:
    """Return acceleration, push, torque and torque_at of `LinearDynamics`.

    Args:
        layout: places of the states.
        joints: (4,) rows of the joints.
        dt: (m,) [s].
        crank: (m, 2) rate and acceleration at the middle.
        slopes: (m, 4, 4) angle and its first to third derivative by crank angle.
        ad_half: (m, 6, 6) from the pose error at the start to that at the middle.
        rotation: (m, 3, 3) body to world.
        derivatives: inverse dynamics (m, nv), its derivatives by q and v, and M (m, nv, nv), without air.
        air: the air.
        known: (m, nv) other known forces.
        J: (m, 3 points, nv) Jacobians, world axes.
        force: (m, points, 3) world axes.
    """
    ID, Dq, Dv, M = derivatives
    m, nv, n = len(dt), M.shape[1], layout.size
    M = M + air.added_mass
    Jt, half = np.swapaxes(J, 1, 2), 0.5 * dt[:, None]
    Z = np.zeros((m, nv, n))
    Z[:, :, layout.white] = -Jt
    Z[:, :, layout.walk] = -Jt @ np.kron(layout.modes, np.eye(3))
    Zq, Zv = Dq[:, :, BASE].copy(), Dv[:, :, BASE] - air.by_twist
    for i in range(layout.points):
        in_body = np.einsum("kji,kj->ki", rotation, force[:, i])
        Zq[:, :, 3:] -= Jt[:, :, 3 * i : 3 * i + 3] @ rotation @ cross_matrices(in_body)
    d1, d2, d3 = (slopes[:, i, :, None] for i in (1, 2, 3))
    rate, bend = crank[:, :1, None], crank[:, 1:, None]
    q, v, a = Dq[:, :, joints], Dv[:, :, joints], M[:, :, joints]
    by_angle = (q @ d1 + v @ (d2 * rate) + a @ (d3 * rate**2 + d2 * bend))[:, :, 0]
    by_rate, by_bend = (v @ d1 + a @ (2.0 * d2 * rate))[:, :, 0], (a @ d1)[:, :, 0]
    Z[:, :, CRANK_ERROR] = np.stack(
        [by_angle, by_angle * half + by_rate, 0.5 * by_angle * half**2 + by_rate * half + by_bend], axis=2
    )
    if layout.mass_at is not None:
        Z[:, :, layout.mass_at] = ID
    if layout.air_at is not None:
        Z[:, :, layout.air_at] = -air.force
    Z[:, :, POSE_ERROR] += Zq @ ad_half
    Z[:, :, TWIST_ERROR] += Zq * half[:, :, None] + Zv
    r = ID - air.force - known
    through = M[:, :, BASE] + half[:, :, None] * Zv
    found = -np.linalg.solve(through[:, BASE], np.concatenate([r[:, BASE, None], Z[:, BASE]], axis=2))
    push, A = found[:, :, 0], found[:, :, 1:]
    torque = Z[:, joints] + through[:, joints] @ A
    return A, push, torque, r[:, joints] + np.einsum("kij,kj->ki", through[:, joints], push)


def twin_accelerometer(d: LinearDynamics, place: Array, turn: Array) -> tuple[Array, Array, Array]:
    """Return what an accelerometer feels (m, 3), its rows (m, 3, n) without bias, and their constant part (m, 3)."""
    v, w, turning = d.middle_twist[:, :3], d.middle_twist[:, 3:], d.middle_acceleration[:, 3:]
    W, lever = cross_matrices(w), cross_matrices(place[None])[0]
    felt = d.middle_acceleration[:, :3] + np.cross(w, v + np.cross(w, place)) - d.up + np.cross(turning, place)
    by_rate = np.concatenate([np.eye(3), -lever], axis=1)
    moved = cross_matrices(v) + cross_matrices(np.cross(w, place))
    by_twist = np.concatenate([W, -moved - W @ lever], axis=2)
    by_pose = np.concatenate([np.zeros((len(w), 3, 3)), -cross_matrices(d.up)], axis=2)
    h = by_rate @ d.acceleration + by_twist @ d.twist + by_pose @ d.pose
    constant = d.push @ by_rate.T + np.einsum("kij,kj->ki", by_twist, d.kick)
    return felt @ turn, turn.T @ h, constant @ turn
