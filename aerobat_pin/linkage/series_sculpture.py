"""The Kinetic Sculpture closed by Fourier series: as exact as the dyads, and faster at single crank angles."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from aerobat_pin.linkage.closure import Closure
from aerobat_pin.linkage.joint_series import joint_series, joints_along
from aerobat_pin.linkage.kinetic_sculpture import KineticSculpture
from aerobat_pin.linkage.moving import Angle


class SeriesSculpture(KineticSculpture):
    """A linkage whose closures have the joint angles and their derivatives alone: no pins, no other bars.

    Args:
        linkage: the linkage; its crank must turn through a full circle.

    Attributes:
        series: coefficients of `joint_series`.
    """

    def __init__(self, linkage: KineticSculpture) -> None:
        """Compute the series, see `joint_series`."""
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
