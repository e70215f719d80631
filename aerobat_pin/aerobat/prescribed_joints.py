"""Forward dynamics with prescribed joint motion.

The linkage prescribes the joint angles theta. With the rows of M a + nle = F + u_m split into base (b) and joints (j):

    M_bb a_b = F_b - nle_b - M_bj theta''                      six equations for the base acceleration
    u_m      = M_jb a_b + M_jj theta'' + nle_j - F_j           the motor's generalised torque at the joints

Here nle = C v + g, and F is the sum of all generalised forces other than the motor torque u_m.
"""

from __future__ import annotations

import numpy as np

from aerobat_pin.linkage import Closure
from aerobat_pin.numerics import Array, guarded

BASE_SIZE = 6  # number of velocities of a free-flyer base


def prescribed_joint_dynamics(M: Array, nle: Array, force: Array, joint_acceleration: Array) -> tuple[Array, Array]:
    """Compute base acceleration and motor torque for joints that follow a given motion.

    Args:
        M: (nv, nv) joint-space inertia, base rows first.
        nle: (nv,) C v + g.
        force: (nv,) sum of the generalised forces other than the motor torque.
        joint_acceleration: (nv - 6,) prescribed theta'' [rad/s2].

    Returns:
        Acceleration (nv,) and motor torque u_m (nv,), zero in the base rows [N m].
    """
    acceleration = np.empty_like(nle)
    acceleration[BASE_SIZE:] = joint_acceleration
    push = force[:BASE_SIZE] - nle[:BASE_SIZE] - M[:BASE_SIZE, BASE_SIZE:] @ joint_acceleration
    acceleration[:BASE_SIZE] = np.linalg.solve(M[:BASE_SIZE, :BASE_SIZE], push)
    torque = np.zeros_like(nle)
    torque[BASE_SIZE:] = M[BASE_SIZE:] @ acceleration + nle[BASE_SIZE:] - force[BASE_SIZE:]
    return acceleration, torque


@guarded()
def joint_table(closure: Closure) -> Array:
    """Return angle, rate and acceleration of shoulder and elbow as one array (n, 3, 2)."""
    angles, rates = (closure.theta_s, closure.theta_e), (closure.theta_s_dot, closure.theta_e_dot)
    accelerations = closure.theta_s_ddot, closure.theta_e_ddot
    return np.stack([np.stack(pair, axis=-1) for pair in (angles, rates, accelerations)], axis=1)
