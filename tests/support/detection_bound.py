"""How early can any detector find a push? The bound that the noise of the sensors sets, whatever the statistic."""

# Matched filter (Van Trees, Detection, Estimation and Modulation Theory, part I, ch. 4): normal, deviation 1, mean
# d(t) = sqrt(s^T C^-1 s), s what the push adds to the momentum, C the covariance of what is measured of it: the first
# sample's, the walk of the torques' errors, each sample's noise. Phi(d - z) exceeds a level z; who must find point
# and axis as well has six unknowns: d is then the size of the force over its deviation.

import numpy as np
import pinocchio as pin
from scipy.linalg import block_diag, cholesky, solve_triangular

from aerobat_pin.aerobat import FORCE_POINTS
from aerobat_pin.scenario import UnknownForce
from support.observer_twins import point_jacobian

VELOCITIES = np.array([0.005] * 3 + [0.003] * 3 + [0.02] * 4)  # of `support.mismatch.NOISY`: m/s, rad/s, rad/s
TORQUE = 5e-4  # [N m]
BEFORE = 200  # samples from which the momentum before the push is known
LEVEL = 3.09  # exceeded once in a thousand looks: twenty seconds of them, each of 20 ms, at one point and axis


def detectability(model: pin.Model, q: np.ndarray, dt: float, start: int, push: UnknownForce) -> np.ndarray:
    """Return d (30 ms / dt, 2) after each sample from a push's onset on: told point and axis, or having to find it."""
    data, nv = model.createData(), int(model.nv)
    first, last, noise, rows = start - BEFORE, start + round(0.03 / dt), [], []
    for one in q[first : last + 1]:
        blurred = pin.crba(model, data, one).copy() * VELOCITIES
        noise.append(blurred @ blurred.T)
        rows.append(point_jacobian(model, FORCE_POINTS, one))
    count, J = len(rows) - 1, np.array(rows)
    given = np.diff(push.impulse_until(dt * np.arange(first, first + count + 1))) * (np.arange(count) >= BEFORE)
    added = np.cumsum(0.5 * given[:, None, None] * (J[1:] + J[:-1]), axis=0)
    since, drift = np.arange(1.0, count + 1.0), np.diag((np.arange(nv) >= 6) * (dt * TORQUE) ** 2)
    C = np.kron(np.ones((count, count)), noise[0]) + np.kron(np.minimum.outer(since, since), drift)
    C += block_diag(*noise[1:])
    white = solve_triangular(cholesky(C, lower=True), added.swapaxes(1, 2).reshape(count * nv, -1), lower=True)
    white = white.reshape(count, nv, -1)
    information = np.cumsum(white.swapaxes(1, 2) @ white, axis=0)[BEFORE:]
    least = 1e-12 * np.trace(information, axis1=1, axis2=2)[:, None, None] * np.eye(J.shape[1])
    spread = np.linalg.inv(information + least)
    return np.sqrt(np.stack([information[:, 2, 2], 1.0 / spread[:, 2, 2]], axis=1))


def earliest(d: np.ndarray, dt: float) -> tuple[float, float]:
    """Return when half of such pushes can be found [s], for both columns of `detectability`; infinite if never."""
    after = [np.flatnonzero(column >= LEVEL) for column in d.T]
    told, searching = (dt * (1 + int(at[0])) if at.size else np.inf for at in after)
    return told, searching
