"""How the links move when joints and body are prescribed."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from aerobat_pin.linkage import Closure
from aerobat_pin.numerics import Array, motions
from aerobat_pin.robot.aerobat import Aerobat
from aerobat_pin.robot.link_tree import Tree
from aerobat_pin.robot.wing import LINKS


def held(robot: Aerobat, placement: Array, twist: Array, motion: Array) -> tuple[Array, Array]:
    """Return q and v of a body that is held, placement (7,) and twist (6,), while joints (n, 3, 2) move."""
    still = np.ones((len(motion), 1))
    q = robot.configuration(still * placement, motion[:, 0, 0], motion[:, 0, 1])
    return q, robot.velocity(still * twist, motion[:, 1, 0], motion[:, 1, 1])


def link_twists(model: pin.Model, data: pin.Data, tree: Tree, q: Array, v: Array) -> Array:
    """Return the twists of the links (n, 5, 6), at and in their own frames, along q (n, nq) and v (n, nv)."""
    table = np.empty((len(q), len(LINKS), 6))
    twists, order, forward = motions(data.v), tree.table[:, 0], pin.forwardKinematics
    for one, one_q, one_v in zip(table, list(q), list(v), strict=True):
        forward(model, data, one_q, one_v)
        one[:] = twists[order]
    return table


def joint_table(closure: Closure) -> Array:
    """Stack angle, rate and acceleration of shoulder and elbow as (n, 3, 2)."""
    return np.stack(
        [
            np.stack([closure.theta_s, closure.theta_e], axis=-1),
            np.stack([closure.theta_s_dot, closure.theta_e_dot], axis=-1),
            np.stack([closure.theta_s_ddot, closure.theta_e_ddot], axis=-1),
        ],
        axis=1,
    )
