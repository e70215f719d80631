"""How early can any detector find a push? The bound that the noise of the sensors sets, whatever the statistic.

Known are the model, the air, the shape of the push and all samples before its onset; unknown is only whether it acts.
The best test is then the matched filter on the innovations of a Kalman filter of the momentum (Van Trees, Detection,
Estimation and Modulation Theory, part I, ch. 4), whose answer is normal with deviation 1 and mean

    d(t) = sqrt(sum of m^T S^-1 m over the samples until t)

m is what the push adds to the innovations, S their covariance. A level z that noise exceeds once in many looks is
exceeded by the push with probability Phi(d - z). A detector that must also find out where and along which axis
something pushes has six unknowns, and less: d is then the size of the force over its deviation.
"""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from aerobat_pin.robot import FORCE_POINTS
from aerobat_pin.scenario import UnknownForce

VELOCITIES = np.array([0.005] * 3 + [0.003] * 3 + [0.02] * 4)  # of `support.mismatch.NOISY`: m/s, rad/s, rad/s
TORQUE = 5e-4  # [N m]
BEFORE = 200  # samples
LEVEL = 3.09  # exceeded once in a thousand looks: twenty seconds of them, each of 20 ms, at one point and axis


def detectability(
    model: pin.Model, q: np.ndarray, dt: float, start: int, push: UnknownForce, before: int = BEFORE
) -> np.ndarray:
    """Return d (30 ms / dt, 2) after each sample from a push's onset on: told point and axis, and having to find them.

    Args:
        model: the robot, with the sensors of `NOISY`.
        q: (m, nq) configurations of the flight.
        dt: time between samples [s].
        start: index of the sample at the onset.
        push: the force, at the left point, along z of the world.
        before: samples from which the momentum before the push is known.
    """
    data, nv = model.createData(), int(model.nv)
    frames = [model.getFrameId(name) for name in FORCE_POINTS]

    def instant(k: int) -> tuple[np.ndarray, np.ndarray]:
        blurred = pin.crba(model, data, q[k]).copy() * VELOCITIES
        pin.computeJointJacobians(model, data, q[k])
        pin.updateFramePlacements(model, data)
        rows = [pin.getFrameJacobian(model, data, one, pin.LOCAL_WORLD_ALIGNED)[:3].copy() for one in frames]
        return blurred @ blurred.T, np.vstack(rows)

    def impulse(k: int) -> float:
        return float(push.impulse_until(np.array([dt * k]))[0])

    P, J = instant(start - before)
    drift = np.diag((np.arange(nv) >= 6) * (dt * TORQUE) ** 2)
    left, information, found = np.zeros((nv, len(J))), np.zeros((len(J), len(J))), []
    for k in range(start - before + 1, min(start + round(0.03 / dt), len(q) - 1) + 1):
        (R, now), last = instant(k), J
        J = now
        P = P + drift
        S, gain = P + R, P @ np.linalg.inv(P + R)
        if k > start:
            left += 0.5 * (last + J).T * (impulse(k) - impulse(k - 1))
            information += left.T @ np.linalg.solve(S, left)
            spread = np.linalg.inv(information + 1e-12 * np.trace(information) * np.eye(len(J)))
            found.append((np.sqrt(information[2, 2]), 1.0 / np.sqrt(spread[2, 2])))
        left, P = left - gain @ left, P - gain @ P
    return np.array(found)


def earliest(d: np.ndarray, dt: float) -> tuple[float, float]:
    """Return when half of such pushes can be found [s], for both columns of `detectability`; infinite if never."""
    after = [np.flatnonzero(column >= LEVEL) for column in d.T]
    told, searching = (dt * (1 + int(at[0])) if at.size else np.inf for at in after)
    return told, searching
