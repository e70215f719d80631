"""Which state of the joint smoother stands where."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from aerobat_pin.numerics import Array, Integers

POSE_ERROR, TWIST_ERROR, CRANK_ERROR = slice(0, 6), slice(6, 12), slice(12, 15)
MOTION = 15  # the errors of the motion: pose, twist, crank
MOUNT_SIZE = 6


@dataclass
class Layout:
    """The states: errors of pose (se(3), body axes), twist, crank; forces, biases, factors, mount, clock offsets.

    The first `moving` states change from knot to knot with others: those of the motion, and each force by its slope.

    Args:
        points: number of points at which a force is sought.
        mass: whether the factor of the mass is estimated.
        air: whether the factor of the air is estimated.
        mount: whether place and turn of the accelerometer are estimated.
        offsets: sensors whose clock offset is estimated.

    Attributes:
        walk, slope: slowly changing forces, in modes, world axes [N], and their slopes [N/s].
        white: force of each point that is drawn anew in every interval, world axes [N].
        gyro_bias, accelerometer_bias: [rad/s], [m/s2].
        mass_at, air_at: errors of the factors of mass and air; None where they are no states.
        mount_at: errors of the accelerometer's place, body axes [m], and of its turn, a rotation vector in its axes
            [rad]; None where they are no states.
        offset_at: sensor -> where its clock offset [s] stands.
        moving, size: number of states whose change depends on other states, and of all states.
        places: (5,) where walk, white, factor of the mass, factor of the air and crank stand; -1: not a state.
        modes: orthogonal matrix (points, points): forces of the points = modes times the slow states of each axis. The
            first mode is what the forces have in common, the others are how they differ.
        by_mode: the same (3 points, 3 points) from all slow states to all forces, point after point.
    """

    points: int
    mass: bool = False
    air: bool = False
    mount: bool = False
    offsets: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        """Place one group of states behind the other."""
        self.size, forces = MOTION, 3 * self.points
        self.walk, self.slope, self.white = self._next(forces), self._next(forces), self._next(forces)
        self.gyro_bias, self.accelerometer_bias = self._next(3), self._next(3)
        self.mass_at = self._next(1).start if self.mass else None
        self.air_at = self._next(1).start if self.air else None
        self.mount_at = self._next(MOUNT_SIZE) if self.mount else None
        self.offset_at = {name: self._next(1).start for name in self.offsets}
        self.moving = self.walk.stop
        at = [self.walk.start, self.white.start, self.mass_at, self.air_at, CRANK_ERROR.start]
        self.places: Integers = np.array([-1 if place is None else place for place in at], dtype=np.intp)
        self.modes: Array = np.zeros((self.points, self.points))
        self.modes[:, 0] = self.points**-0.5
        for i in range(1, self.points):
            self.modes[: i + 1, i] = [*[1.0] * i, -i]
            self.modes[:, i] /= np.sqrt(i * (i + 1.0))
        self.by_mode = np.kron(self.modes, np.eye(3))

    def _next(self, count: int) -> slice:
        start, self.size = self.size, self.size + count
        return slice(start, self.size)

    def forces(self, states: Array) -> Array:
        """Return the slowly changing forces (k, points, 3) of states (k, n), world axes [N]."""
        return np.asarray(states[:, self.walk] @ self.by_mode.T).reshape(len(states), self.points, 3)
