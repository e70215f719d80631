"""Which state of the joint smoother stands where."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

from aerobat_pin.estimation.raw.recursion import MOVING

POSE_ERROR, TWIST_ERROR, CRANK_ERROR = slice(0, 6), slice(6, 12), slice(12, 15)
GYRO_BIAS, ACCELEROMETER_BIAS = slice(15, 18), slice(18, 21)
FIRST_FORCE, MOUNT_SIZE = 21, 6
assert CRANK_ERROR.stop == MOVING


@dataclass(frozen=True)
class Layout:
    """The states: errors of pose (se(3), body axes), twist, crank; then biases, forces, factors, mount, clock offsets.

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

    @property
    def walk(self) -> slice:
        """Slowly changing force of each point, world axes [N]."""
        return slice(FIRST_FORCE, FIRST_FORCE + 3 * self.points)

    @property
    def white(self) -> slice:
        """Force of each point that is drawn anew in every interval, world axes [N]."""
        return slice(self.walk.stop, self.walk.stop + 3 * self.points)

    @property
    def mass_at(self) -> int | None:
        """Error of the mass's factor."""
        return self.white.stop if self.mass else None

    @property
    def air_at(self) -> int | None:
        """Error of the air's factor."""
        return self.white.stop + int(self.mass) if self.air else None

    @property
    def mount_at(self) -> slice | None:
        """Errors of the accelerometer's place, body axes [m], and of its turn, a rotation vector in its axes [rad]."""
        first = self.white.stop + int(self.mass) + int(self.air)
        return slice(first, first + MOUNT_SIZE) if self.mount else None

    @cached_property
    def offset_at(self) -> dict[str, int]:
        """Sensor -> where its clock offset [s] stands."""
        first = self.size - len(self.offsets)
        return {name: first + i for i, name in enumerate(self.offsets)}

    @property
    def size(self) -> int:
        """Number of states."""
        more = int(self.mass) + int(self.air) + MOUNT_SIZE * int(self.mount)
        return FIRST_FORCE + 6 * self.points + more + len(self.offsets)
