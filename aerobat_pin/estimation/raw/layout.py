"""Which state of the joint smoother stands where."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from aerobat_pin.numerics import Array

POSE_ERROR, TWIST_ERROR, CRANK_ERROR = slice(0, 6), slice(6, 12), slice(12, 15)
MOTION = 15  # the errors of the motion: pose, twist, crank
MOUNT_SIZE = 6


@dataclass(frozen=True)
class Layout:
    """The states: errors of pose (se(3), body axes), twist, crank; forces, biases, factors, mount, clock offsets.

    The first `moving` states change from knot to knot with others: those of the motion, and each force by its slope.

    Attributes:
        points: number of points at which a force is sought.
        mass: whether the factor of the mass is estimated.
        air: whether the factor of the air is estimated.
        mount: whether place and turn of the accelerometer are estimated.
        offsets: sensors whose clock offset is estimated.
    """

    points: int
    mass: bool = False
    air: bool = False
    mount: bool = False
    offsets: tuple[str, ...] = ()

    @cached_property
    def walk(self) -> slice:
        """Slowly changing forces, in modes, world axes [N]."""
        return slice(MOTION, MOTION + 3 * self.points)

    @cached_property
    def modes(self) -> Array:
        """Orthogonal matrix (points, points): forces of the points = modes times the slow states of each axis.

        The first mode is what the forces have in common, the others are how they differ.
        """
        made = np.zeros((self.points, self.points))
        made[:, 0] = self.points**-0.5
        for i in range(1, self.points):
            made[: i + 1, i] = [*[1.0] * i, -i]
            made[:, i] /= np.sqrt(i * (i + 1.0))
        return made

    @cached_property
    def by_mode(self) -> Array:
        """Matrix (3 points, 3 points) from slow states to forces, point after point."""
        return np.kron(self.modes, np.eye(3))

    @cached_property
    def moving(self) -> int:
        """Number of states whose change depends on other states."""
        return int(self.walk.stop)

    @cached_property
    def slope(self) -> slice:
        """Slopes of the slowly changing forces, in modes, world axes [N/s]."""
        return slice(self.walk.stop, self.walk.stop + 3 * self.points)

    @cached_property
    def white(self) -> slice:
        """Force of each point that is drawn anew in every interval, world axes [N]."""
        return slice(self.slope.stop, self.slope.stop + 3 * self.points)

    @cached_property
    def gyro_bias(self) -> slice:
        """Bias of the gyro [rad/s]."""
        return slice(self.white.stop, self.white.stop + 3)

    @cached_property
    def accelerometer_bias(self) -> slice:
        """Bias of the accelerometer [m/s2]."""
        return slice(self.white.stop + 3, self.white.stop + 6)

    @cached_property
    def mass_at(self) -> int | None:
        """Error of the mass's factor."""
        return self.accelerometer_bias.stop if self.mass else None

    @cached_property
    def air_at(self) -> int | None:
        """Error of the air's factor."""
        return self.accelerometer_bias.stop + int(self.mass) if self.air else None

    @cached_property
    def mount_at(self) -> slice | None:
        """Errors of the accelerometer's place, body axes [m], and of its turn, a rotation vector in its axes [rad]."""
        first = self.accelerometer_bias.stop + int(self.mass) + int(self.air)
        return slice(first, first + MOUNT_SIZE) if self.mount else None

    @cached_property
    def offset_at(self) -> dict[str, int]:
        """Sensor -> where its clock offset [s] stands."""
        first = self.size - len(self.offsets)
        return {name: first + i for i, name in enumerate(self.offsets)}

    def forces(self, states: Array) -> Array:
        """Return the slowly changing forces (k, points, 3) of states (k, n), world axes [N]."""
        return np.asarray(states[:, self.walk] @ self.by_mode.T).reshape(len(states), self.points, 3)

    @cached_property
    def size(self) -> int:
        """Number of states."""
        more = int(self.mass) + int(self.air) + MOUNT_SIZE * int(self.mount)
        return int(self.accelerometer_bias.stop) + more + len(self.offsets)
