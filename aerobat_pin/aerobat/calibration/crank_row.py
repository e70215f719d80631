"""What a single motor shows of the joint rows: one torque at the crank, in place of one at each joint.

If only the motor's torque is known, its share in each joint is a guess that has the right power and nothing else
(`spread_crank_torque`). What a belief leaves unexplained of the joint rows is then no smooth function of the crank's
angle, but its power divided by the crank's rate is one: a torque at the crank. On `paper` with quasi-steady air six
harmonics of this torque leave the smoother R2 0.96 of Fy, those of four joint torques -0.8.
"""

from __future__ import annotations

import numpy as np

from aerobat_pin.aerobat.motion import Motion
from aerobat_pin.aerobat.torque import spread_crank_torque
from aerobat_pin.numerics import Array
from aerobat_pin.robot import BASE_SIZE, Aerobat


def at_the_crank(residual: Array, moved: Motion, torque: str) -> Array:
    """Return a generalised force (m, nv) whose joint rows are one torque at the crank, followed by zeros.

    Args:
        residual: (m, nv) generalised force in each interval.
        moved: the motion, with its crank.
        torque: which joint torque is known; the force is returned as it is unless that is the motor's alone.
    """
    if torque != "motor_only" or moved.crank is None:
        return residual
    rate = 0.5 * (moved.crank[1, 1:] + moved.crank[1, :-1])
    v = 0.5 * (moved.v[1:] + moved.v[:-1])
    power = np.sum(v[:, BASE_SIZE:] * residual[:, BASE_SIZE:], axis=1)
    reduced = residual.copy()
    reduced[:, BASE_SIZE:] = 0.0
    reduced[:, BASE_SIZE] = np.divide(power, rate, out=np.zeros_like(power), where=rate != 0.0)
    return reduced


def at_the_joints(force: Array, robot: Aerobat, moved: Motion, torque: str) -> Array:
    """Return the generalised force (m, nv) of which `at_the_crank` is the reduced form, as far as its power."""
    if torque != "motor_only":
        return force
    spread = spread_crank_torque(robot, moved, force[:, BASE_SIZE])
    spread[:, :BASE_SIZE] = force[:, :BASE_SIZE]
    return spread
