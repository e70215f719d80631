"""What turns the crank: a drive, known before the flight, or a motor, which the flight acts back on.

A drive is any function of time: `drive(time) -> (angle, rate, acceleration)`, arrays in, arrays out. The linkage fixes
the joint angles at each crank angle, so the drive alone decides how the joints move, however large the forces on the
wings are. With a motor, the crank angle is one more degree of freedom of the robot.

A motor with a rate controller turns the crank as the forces on body and wings let it:

    T = diag(1, g')         v = T (v_b, t1')          a = T (a_b, t1'') + (0, g'' t1'^2)         theta = g(t1)

    (T^T H T + rotor) (a_b, t1'') = T^T (F - h - H (0, g'' t1'^2)) + (0, torque - friction t1')

    lag torque' = sat(order) - torque
    order = kp miss + ki z        z' = miss - (order - sat(order)) / kp        miss = rate - t1'

g is the linkage: shoulder and elbow of both wings as functions of the crank angle t1. H, h and F are inertia, bias and
generalised force of the plant with free joints (see `aerobat_pin.flight.plant.plant`); their projection by T is
d'Alembert's principle. So air, body motion, gravity and unknown forces act back on the crank. H is symmetric with added
mass too, and so is the projected matrix.

`miss` is the error of the crank rate and `order` the commanded torque. z is the integral of the rate error, reduced
while the torque is at its limit so that it does not wind up. All constants are as seen at the crank: with a gear that
turns the motor G times per turn of the crank, inertia and friction of the motor count G^2 times, its torque G times.
The bars of the linkage have no mass.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from aerobat_pin.errors import CrankError
from aerobat_pin.numerics import Array, Integers, guarded, kernel
from aerobat_pin.scenario import Scenario

MISMATCH = 0.01  # allowed gap between a change and the integral of its rate, as a share of the total variation
CRANK_SIZE = 4  # entries of the crank's state: angle [rad], rate [rad/s], motor torque [N m], integral z [rad]


class CrankMotion(NamedTuple):
    """The crank at times (n,): absolute angle t1 [rad], rate [rad/s], acceleration [rad/s2]."""

    angle: Array
    rate: Array
    acceleration: Array


CrankDrive = Callable[[Array], tuple[ArrayLike, ArrayLike, ArrayLike]]


@guarded()
@dataclass(frozen=True)
class ConstantRate:
    """A crank that always turns at `rate` [rad/s], also before t = 0; its angle at t = 0 is `start` [rad]."""

    start: float
    rate: float

    @guarded()
    def __call__(self, time: Array) -> CrankMotion:
        """Return the motion at times (n,) [s]."""
        return CrankMotion(self.start + self.rate * time, np.full_like(time, self.rate), np.zeros_like(time))


@guarded(duration="positive")
@dataclass(frozen=True)
class SpinUp:
    """A crank that rests at `start` [rad] until t = 0 and turns at `rate` [rad/s] from t = `duration` [s] on.

    In between, the rate grows as 10 s^3 - 15 s^4 + 6 s^5 with s = t / duration. The first and second derivatives of
    this polynomial vanish at both ends, so the torque and its rate do not jump.
    """

    start: float
    rate: float
    duration: float

    @guarded()
    def __call__(self, time: Array) -> CrankMotion:
        """Return the motion at times (n,) [s]."""
        s = np.clip(time / self.duration, 0.0, 1.0)
        way = self.duration * s**4 * (2.5 - 3.0 * s + s**2) + np.maximum(time - self.duration, 0.0)
        share = s**3 * (10.0 - 15.0 * s + 6.0 * s**2)
        slope = 30.0 * s**2 * (1.0 - s) ** 2 / self.duration
        return CrankMotion(self.start + self.rate * way, self.rate * share, self.rate * slope)


def checked_motion(drive: CrankDrive, time: Array) -> CrankMotion:
    """Evaluate a drive at rising times (n,) [s] and check its result.

    Raises:
        CrankError: the drive does not return three finite quantities at these times, or its rate is not the derivative
            of its angle, or its acceleration is not the derivative of its rate.
    """
    motion = drive(time)
    if not isinstance(motion, tuple) or len(motion) != 3:
        raise CrankError("a crank drive must return a tuple (angle, rate, acceleration) at the times it is given")
    parts: list[Array] = []
    for part, name in zip(motion, CrankMotion._fields, strict=True):
        values = np.asarray(part, float)
        if values.shape not in ((), time.shape):
            raise CrankError(f"crank drive: {name} has shape {values.shape}: {time.shape} was expected, as for time")
        if not np.all(np.isfinite(values)):
            raise CrankError(
                f"crank drive: {name} is not finite everywhere from t = {time[0]:g} to {time[-1]:g} s; times before "
                "t = 0 are needed to warm up the aerodynamic state"
            )
        parts.append(np.broadcast_to(values, time.shape))
    checked = CrankMotion(*parts)
    _derivative("rate", "angle", checked.angle, checked.rate, time)
    _derivative("acceleration", "rate", checked.rate, checked.acceleration, time)
    return checked


def _derivative(name: str, of: str, values: Array, slopes: Array, time: Array) -> None:
    """Raise CrankError unless the integral of `slopes` matches the change of `values`, within sampling error and jumps.

    `of` is what an error calls the values, `name` what it calls their slopes.
    """
    step = np.diff(time)
    if step.size == 0:
        return
    gained = values[1:] - values[0]
    summed = np.cumsum(0.5 * step * (slopes[1:] + slopes[:-1]))
    way = np.sum(np.abs(np.diff(values))) + np.sum(step * np.abs(slopes[1:]))
    rounding = 1e-9 * np.max(np.abs(values))
    worst = int(np.argmax(np.abs(gained - summed)))
    if abs(gained[worst] - summed[worst]) > MISMATCH * way + np.max(step) * np.max(np.abs(slopes)) + rounding:
        raise CrankError(
            f"crank drive: from t = {time[0]:g} to {time[worst + 1]:g} s the {of} changes by {gained[worst]:.4g}, but "
            f"the {name} adds up to {summed[worst]:.4g}; it must be the {of}'s derivative, in radians and seconds"
        )


class RateControlledMotor(NamedTuple):
    """A motor that turns the crank, as numbers or as views of a kernel's memory.

    Attributes:
        start: crank angle at t = 0 [rad].
        rate: commanded crank rate [rad/s].
        start_rate: crank rate at t = 0, constant at all times before [rad/s].
        rotor_inertia: inertia of rotor and gear [kg m2].
        torque_limit: largest motor torque [N m].
        lag: time constant of the torque [s].
        gain: proportional gain kp [N m s/rad].
        integral_gain: integral gain ki [N m/rad].
        friction: torque that resists turning, per rate [N m s/rad].
    """

    start: Annotated[Any, ""]
    rate: Annotated[Any, ""]
    start_rate: Annotated[Any, ""]
    rotor_inertia: Annotated[Any, ""]
    torque_limit: Annotated[Any, ""]
    lag: Annotated[Any, ""]
    gain: Annotated[Any, ""]
    integral_gain: Annotated[Any, ""]
    friction: Annotated[Any, ""]

    @property
    def before(self) -> ConstantRate:
        """Drive of the crank before the flight."""
        return ConstantRate(self.start, self.start_rate)

    @property
    def state(self) -> Array:
        """State of the crank (4,) at t = 0: the motor is switched on then."""
        return np.array([self.start, self.start_rate, 0.0, 0.0])


@kernel
def add_crank(
    motor: RateControlledMotor,
    crank: Array,
    closed: Array,
    row_of: Integers,
    angle_of: Integers,
    H: Array,
    h: Array,
    aerodynamic: Array,
    unknown: Array,
    joints: Array,
    A: Array,
    b: Array,
) -> None:
    """Write the crank's row to the equations A x = b of base and crank; only the lower triangle of A is used.

    Args:
        motor: the motor's constants.
        crank: (4,) state of the crank.
        closed: (3, 2) joint angles and their derivatives by crank angle, see `joints_at`.
        row_of: (5,) row of each link's joint in v.
        angle_of: (5,) joint angle that moves the link: 0 shoulder, 1 elbow.
        H: (nv, nv) inertia.
        h: (nv,) bias.
        aerodynamic: (nv,) generalised force of the air; like the next one it has joint rows.
        unknown: (nv,) generalised force of the unknown forces.
        joints: (3, 2) angle, rate and acceleration of shoulder and elbow, the acceleration without that of the crank.
        A: (7, 7) row 6 is written.
        b: (7,) entry 6 is written.
    """
    for j in range(6):
        A[6, j] = 0.0
    A[6, 6] = motor.rotor_inertia[()]
    b[6] = crank[2] - motor.friction[()] * crank[1]
    for link in range(1, row_of.shape[0]):
        row, slope = row_of[link], closed[1, angle_of[link]]
        force = aerodynamic[row] + unknown[row] - h[row]
        for j in range(6):
            A[6, j] += slope * H[row, j]
        for other in range(1, row_of.shape[0]):
            column, angle = row_of[other], angle_of[other]
            A[6, 6] += slope * H[row, column] * closed[1, angle]
            force -= H[row, column] * joints[2, angle]
        b[6] += slope * force


@kernel
def crank_rates(motor: RateControlledMotor, crank: Array, acceleration: float, rates: Array) -> None:
    """Write the rates (4,) of the crank's state (4,) from its acceleration [rad/s2]."""
    gain, limit = motor.gain[()], motor.torque_limit[()]
    miss = motor.rate[()] - crank[1]
    order = gain * miss + motor.integral_gain[()] * crank[3]
    limited = min(max(order, -limit), limit)
    rates[0], rates[1] = crank[1], acceleration
    rates[2] = (limited - crank[2]) / motor.lag[()]
    rates[3] = miss - (order - limited) / gain


def crank_drive(scenario: Scenario) -> CrankDrive | RateControlledMotor:
    """Build a scenario's crank drive, or its motor."""
    crank = scenario.crank
    start, rate = float(np.radians(crank.start_deg)), 2.0 * np.pi * crank.frequency
    if crank.spin_up is not None:
        return SpinUp(start, rate, crank.spin_up.duration)
    if crank.motor is not None:
        constants = crank.motor.model_dump()
        return RateControlledMotor(
            start=start, rate=rate, start_rate=2.0 * np.pi * constants.pop("start_frequency"), **constants
        )
    return ConstantRate(start, rate)
