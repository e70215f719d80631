"""The wings' moment of inertia as seen by the crank."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from aerobat_pin.numerics import Array, guarded
from aerobat_pin.robot import Aerobat

SAMPLES = 360  # crank angles at which the inertia is computed
HARMONICS = 60  # number of harmonics kept; each is about 1.8 times smaller than the one before


class WingInertia:
    """Moment of inertia of both wings as seen by the crank with the body at rest, as a function of the crank angle t1.

    I(t1) = d^T M d, where d holds the derivatives of the joint angles by t1 and M is the joints' mass matrix. The
    wings' kinetic energy is I t1'^2 / 2.
    """

    @guarded()
    def __init__(self, robot: Aerobat) -> None:
        """Compute the Fourier series of the inertia over one turn of the crank."""
        crank = 2.0 * np.pi / SAMPLES * np.arange(SAMPLES)
        closed = robot.linkage.solve(crank)
        data, still = robot.model.createData(), np.zeros((SAMPLES, 6))
        placement = np.broadcast_to([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0], (SAMPLES, 7))
        poses = robot.configuration(placement, closed.theta_s, closed.theta_e)
        motions = robot.velocity(still, closed.dtheta_s, closed.dtheta_e)
        inertia = np.array([d @ pin.crba(robot.model, data, q) @ d for q, d in zip(poses, motions, strict=True)])
        series = 2.0 / SAMPLES * np.fft.rfft(inertia)[: HARMONICS + 1]
        series[0] *= 0.5
        self._orders = 1j * np.arange(HARMONICS + 1)
        self._series = np.stack([series, self._orders * series], axis=-1)

    @guarded()
    def __call__(self, crank_angle: Array) -> tuple[Array, Array]:
        """Return the inertia [kg m2] and its derivative by crank angle [kg m2/rad]."""
        both = (np.exp(np.multiply.outer(crank_angle, self._orders)) @ self._series).real
        return both[..., 0], both[..., 1]
