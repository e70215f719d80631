"""A motor with a rate controller on the crank, which turns as the forces on body and wings let it.

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

from typing import Annotated, Any, NamedTuple

import numpy as np

from aerobat_pin.flight.crank.drives import ConstantRate
from aerobat_pin.numerics import Array, Integers, kernel

CRANK_SIZE = 4  # entries of the crank's state: angle [rad], rate [rad/s], motor torque [N m], integral z [rad]


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
        rest = aerodynamic[row] + unknown[row] - h[row]
        for j in range(6):
            A[6, j] += slope * H[row, j]
        for other in range(1, row_of.shape[0]):
            column, angle = row_of[other], angle_of[other]
            A[6, 6] += slope * H[row, column] * closed[1, angle]
            rest -= H[row, column] * joints[2, angle]
        b[6] += slope * rest


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
