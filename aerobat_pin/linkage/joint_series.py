"""Shoulder and elbow angle as Fourier series of the crank angle, for kernels that close the linkage at every stage.

    theta(t1) = sum over n of A_n cos(n t1) + B_n sin(n t1)

`SeriesSculpture` closes the linkage by them: as exact as the dyads, and faster at single crank angles.
The closed linkage is analytic in the crank angle, so the coefficients fall geometrically: by a factor of 2 per harmonic
for the shipped linkage. Some 50 harmonics give the angles to 1e-14 rad and their second derivatives to 1e-11.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from aerobat_pin.linkage.closure import Angle, Closure
from aerobat_pin.linkage.kinetic_sculpture import KineticSculpture
from aerobat_pin.numerics import Array, kernel

SAMPLES = 1024  # crank angles at which the linkage is closed
NEGLIGIBLE = 1.0e-15  # harmonics after the last one above this share of the largest are left out: they are rounding


def joint_series(linkage: KineticSculpture) -> Array:
    """Return the coefficients (n + 1, 4) of the joint angles: A and B of the shoulder, A and B of the elbow [rad].

    Raises:
        LinkageError: the crank cannot turn through a full circle.
    """
    closed = linkage.solve(2.0 * np.pi / SAMPLES * np.arange(SAMPLES))
    angles = np.unwrap(np.stack([closed.theta_s, closed.theta_e]))
    series = 2.0 / SAMPLES * np.fft.rfft(angles)
    series[:, 0] *= 0.5
    size = np.max(np.abs(series), axis=0)
    last = np.flatnonzero(size > NEGLIGIBLE * np.max(size))[-1]
    shoulder, elbow = series[:, : last + 1]
    return np.stack([shoulder.real, -shoulder.imag, elbow.real, -elbow.imag], axis=-1)


@kernel
def joints_at(series: Array, crank_angle: float, joints: Array) -> None:
    """Write the joint angles and their first two derivatives by crank angle.

    Args:
        series: (n + 1, 4) coefficients, see `joint_series`.
        crank_angle: absolute t1 [rad].
        joints: (3, 2) written: angle [rad], first and second derivative of shoulder and elbow.
    """
    turn, lift = np.cos(crank_angle), np.sin(crank_angle)
    c, s = 1.0, 0.0  # cosine and sine of n t1
    shoulder, shoulder_d, shoulder_d2 = series[0, 0], 0.0, 0.0
    elbow, elbow_d, elbow_d2 = series[0, 2], 0.0, 0.0
    for n in range(1, series.shape[0]):
        c, s = c * turn - s * lift, s * turn + c * lift
        wave = series[n, 0] * c + series[n, 1] * s
        shoulder += wave
        shoulder_d += n * (series[n, 1] * c - series[n, 0] * s)
        shoulder_d2 -= n * n * wave
        wave = series[n, 2] * c + series[n, 3] * s
        elbow += wave
        elbow_d += n * (series[n, 3] * c - series[n, 2] * s)
        elbow_d2 -= n * n * wave
    joints[0, 0], joints[1, 0], joints[2, 0] = shoulder, shoulder_d, shoulder_d2
    joints[0, 1], joints[1, 1], joints[2, 1] = elbow, elbow_d, elbow_d2


@kernel
def joints_along(series: Array, crank_angles: Array, joints: Array) -> None:
    """Write what `joints_at` writes, (n, 3, 2), for each of n crank angles (n,) [rad]."""
    for k in range(crank_angles.shape[0]):
        joints_at(series, crank_angles[k], joints[k])


class SeriesSculpture(KineticSculpture):
    """A linkage whose closures have the joint angles and their derivatives alone: no pins, no other bars.

    Args:
        linkage: the linkage; its crank must turn through a full circle.

    Attributes:
        series: coefficients of `joint_series`.
    """

    def __init__(self, linkage: KineticSculpture) -> None:
        super().__init__(linkage.lengths)
        self.series = joint_series(linkage)
        self._judged = True

    def solve(
        self, crank_angle: ArrayLike, crank_velocity: ArrayLike = 0.0, crank_acceleration: ArrayLike = 0.0
    ) -> Closure:
        """Return the joint angles as `KineticSculpture.solve` does; shapes are broadcast, values are not checked."""
        t1, rate, acceleration = np.broadcast_arrays(
            np.asarray(crank_angle, float), np.asarray(crank_velocity, float), np.asarray(crank_acceleration, float)
        )
        joints = np.empty((t1.size, 3, 2))
        joints_along(self.series, t1.ravel(), joints)
        shoulder, elbow = (tuple(joints[:, i, j].reshape(t1.shape) for i in range(3)) for j in range(2))
        bars = {"t5": Angle(*shoulder), "t6": Angle(*(x + y for x, y in zip(shoulder, elbow, strict=True)))}
        return Closure(self.lengths, t1[()], rate[()], acceleration[()], bars, {})
