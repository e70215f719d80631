"""Numpy references of the observers' kernels, by other means where there are any: least squares, expm, root finding."""

from collections.abc import Sequence

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray
from scipy.linalg import expm
from scipy.optimize import brentq

from aerobat_pin.observers import Expected

Vector = NDArray[np.float64]
ALIGNED = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
SETTLED = 2.1461932206205825  # (1 + x) exp(-x) = exp(-1)


def point_jacobian(model: pin.Model, frames: Sequence[str], q: Vector) -> Vector:
    """Return J (3n, nv): world velocities of the frames' origins per unit generalised velocity."""
    data = model.createData()
    pin.computeJointJacobians(model, data, q)
    pin.updateFramePlacements(model, data)
    rows = [pin.getFrameJacobian(model, data, model.getFrameId(name), ALIGNED)[:3] for name in frames]
    return np.vstack([np.zeros((0, model.nv)), *rows])


def remembered(model: pin.Model, frames: Sequence[str], q: Vector, v: Vector) -> Vector:
    """Return what a sample leaves behind, (3 + 3n, nv): momentum p = M v, drift C^T v - g, v, point Jacobians."""
    data = model.createData()
    momentum = pin.crba(model, data, q) @ v
    drift = pin.computeCoriolisMatrix(model, data, q, v).T @ v
    gravity = pin.computeGeneralizedGravity(model, data, q)
    return np.vstack([momentum, drift - gravity, v, point_jacobian(model, frames, q)])


def believed(model: pin.Model, rows: str, v: Vector) -> Vector:
    """Return the weighted choice W (rows, nv) of what is believed of a generalised force."""
    # 1 for base translation, one over 50 mm for moments: all, the base's six, or with the power v_j . phi_j / |v_j|.
    free = model.joints[1].nv == 6
    weighted = np.diag(np.concatenate([np.ones(3 * free), np.full(model.nv - 3 * free, 1.0 / 0.05)]))
    if rows == "all":
        return weighted
    speed = np.linalg.norm(v[6:])
    if rows == "base" or speed == 0.0:
        return weighted[:6]
    return np.vstack([weighted[:6], np.concatenate([np.zeros(6), v[6:] / speed / 0.05])])


def project(J: Vector, W: Vector, generalized: Vector) -> Vector:
    """Return argmin |W (phi - J^T f)|^2 + 1e-12 trace(W J^T J W^T) |f|^2, the forces (3n,), by least squares (QR)."""
    if not len(J):
        return np.zeros(0)
    weighted = W @ J.T
    stacked = np.vstack([weighted, 1.0e-6 * np.linalg.norm(weighted) * np.eye(len(J))])
    Q, R = np.linalg.qr(stacked)
    return np.linalg.solve(R, Q[: len(W)].T @ (W @ generalized))


class PosteriorTwin:
    """The components given rows and what was expected, by Kalman's gain over the rows in place of normal equations.

    With G = S^2 J (J^T S^2 J + k)^-1 over whitened rows:  P = S^2 - G J^T S^2,
    f = (1 + N - N^3) G y with N = P S^-2.
    """

    def __init__(self, expected: Expected, gain: float) -> None:
        self.expected, self.gain = expected, gain
        self.rest, self.mean, self.seconds = 0.0, 0.0, 0.0
        self.deviation, self.k = np.zeros(0), float("nan")

    def estimate(self, J: Vector, W: Vector, y: Vector, v: Vector, dt: float) -> Vector:
        """Return the components (c,) of an interval; `deviation` and `k` are those of this interval."""
        prior = self.expected
        R = prior.row_error**2 + prior.stiction**2 / 3.0 / np.cosh(v / prior.stiction_rate) ** 2
        W = W[np.any(W != 0.0, axis=1)]
        white = W / np.sqrt(np.einsum("ik,k,ik->i", W, R, W))[:, None]
        A, S2 = white @ J.T, np.diag(prior.force**2)

        def given(k: float) -> tuple[Vector, Vector]:
            gain = S2 @ A.T @ np.linalg.inv(A @ S2 @ A.T + k * np.eye(len(A)))
            P = S2 - gain @ A @ S2
            N = P @ np.linalg.inv(S2)
            return (np.eye(len(S2)) + N - N @ N @ N) @ gain @ white @ y, np.diag(P)

        force, variance = given(1.0)
        spare = len(A) - np.sum(1.0 - (variance / prior.force**2) ** 2)
        rest = white @ y - A @ force
        self.rest = rest + np.exp(-self.gain * dt) * (self.rest - rest)
        self.k, k = float("nan"), self.mean
        if spare >= 0.5:
            self.k = float(self.rest @ self.rest / spare)
            self.seconds += dt
            self.mean += min(dt / self.seconds + dt / 2.5, 1.0) * (self.k - self.mean)
            k = max(self.k, self.mean)
        force, variance = given(max(k, prior.doubt))
        self.deviation = np.sqrt(variance)
        return force


def first_order(gain: float, dt: float, value: float, state: Vector) -> Vector:
    """Advance x' = K (value - x)."""
    return np.array([value + np.exp(-gain * dt) * (state[0] - value), 0.0])


def second_order(gain: float, dt: float, value: float, state: Vector) -> Vector:
    """Advance x'' + 2 w x' + w^2 x = w^2 value by the matrix exponential, w = 2.146 K."""
    w = SETTLED * gain
    return expm(dt * np.array([[0.0, 1.0], [-w * w, -2.0 * w]])) @ (state - [value, 0.0]) + [value, 0.0]


def super_twisting(gain: float, dt: float, value: float, state: Vector, slope: float = 1.0) -> Vector:
    """Advance the super-twisting observer (z, e) by implicit Euler, its equation solved by bisection."""
    w = SETTLED * gain

    def z_after(e: float, sign: float) -> float:
        return state[0] + dt * (1.1 * slope * sign + w * w * e)

    def miss(e: float, sign: float) -> float:
        return e - state[1] - dt * (value - z_after(e, sign) - 1.5 * np.sqrt(slope * abs(e)) * sign - 2.0 * w * e)

    if miss(0.0, 1.0) >= 0.0 >= miss(0.0, -1.0):  # a sign between -1 and 1 keeps e at zero
        return np.array([state[0] + value - state[0] + state[1] / dt, 0.0])
    sign = 1.0 if miss(0.0, 1.0) < 0.0 else -1.0
    e = brentq(miss, 0.0, sign * (abs(state[1]) + dt * abs(value - state[0]) + 1e-9), args=(sign,), xtol=1e-18)
    return np.array([z_after(e, sign), e])
