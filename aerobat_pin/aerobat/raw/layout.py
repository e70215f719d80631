"""Which state of the joint smoother stands where."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from aerobat_pin.aerobat.raw.nominal_motion import NominalMotion
from aerobat_pin.numerics import Array
from aerobat_pin.scenario import RawSection

POSE_ERROR, TWIST_ERROR, CRANK_ERROR = slice(0, 6), slice(6, 12), slice(12, 15)
MOTION = 15  # the errors of the motion: pose, twist, crank
MOUNT_SIZE = 6
START = (0.03,) * 3 + (0.1,) * 3 + (1.0,) * 3 + (3.0,) * 3 + (0.01, 1.0, 100.0)
BIAS_PRIOR = (0.05,) * 3 + (0.5,) * 3
SLOPE_PRIOR = 100.0  # of the robot's weight, per second
FORCE_PRIOR = 2.0  # of the robot's weight
MOUNT_PRIOR = (0.02,) * 3 + (0.05,) * 3  # of the accelerometer [m, rad]


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
        mass_at, air_at: errors of the factors of mass and air; empty where they are no states, as the next.
        mount_at: errors of the accelerometer's place, body axes [m], and of its turn, a rotation vector in its axes
            [rad].
        offset_at: sensor -> where its clock offset [s] stands.
        moving, size: number of states whose change depends on other states, and of all states.
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
        self.size, forces = MOTION, 3 * self.points
        self.walk, self.slope, self.white = self._next(forces), self._next(forces), self._next(forces)
        self.gyro_bias, self.accelerometer_bias = self._next(3), self._next(3)
        self.mass_at, self.air_at = self._next(1 * self.mass), self._next(1 * self.air)
        self.mount_at = self._next(MOUNT_SIZE * self.mount)
        self.offset_at = {name: self._next(1).start for name in self.offsets}
        self.moving = self.walk.stop
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


@dataclass(frozen=True)
class Prior:
    """State at a first knot: the motion there, the other states (n,), and the covariance (n, n) of all."""

    motion: NominalMotion
    mean: Array
    covariance: Array

    def about(self, nominal: NominalMotion) -> Array:
        """Return the mean (n,) as errors of a nominal motion's first knot."""
        x = self.mean.copy()
        x[POSE_ERROR] = pin.log6(nominal.body(0).actInv(self.motion.body(0))).vector
        x[TWIST_ERROR] = self.motion.twist[0] - nominal.twist[0]
        x[CRANK_ERROR] = self.motion.crank[0] - nominal.crank[0]
        return x

    def padded(self, spreads: Array) -> Prior:
        """Return the prior with further states of mean 0 and standard deviations `spreads` (c,)."""
        size, more = len(self.mean), len(spreads)
        covariance = np.zeros((size + more, size + more))
        covariance[:size, :size] = self.covariance
        covariance[size:, size:] = np.diag(spreads**2)
        return Prior(self.motion, np.append(self.mean, np.zeros(more)), covariance)


def first_prior(layout: Layout, nominal: NominalMotion, weight: float, settings: RawSection) -> Prior:
    """Return a wide prior about the first knot of a first guess; `weight` is the robot's [N]."""
    spread = np.zeros(layout.size)
    spread[: len(START)] = START
    spread[layout.walk], spread[layout.slope] = FORCE_PRIOR * weight, SLOPE_PRIOR * weight
    spread[layout.gyro_bias], spread[layout.accelerometer_bias] = BIAS_PRIOR[:3], BIAS_PRIOR[3:]
    spread[layout.mass_at], spread[layout.air_at] = settings.mass_error, settings.air_error
    spread[layout.mount_at] = MOUNT_PRIOR[: MOUNT_SIZE * layout.mount]
    return prior_at(nominal, 0, np.zeros(layout.size), np.diag(spread**2))


def prior_at(nominal: NominalMotion, k: int, x: Array, covariance: Array) -> Prior:
    """Return the prior of knot k, given errors x (n,) of the nominal motion there and their covariance."""
    return Prior(nominal.part(k, k).moved(x[None, :MOTION]), x.copy(), covariance.copy())
