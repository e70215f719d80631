"""Flying the air alone before a flight, so that it begins in the wake of its own flaps."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from aerobat_pin.arrays import Array
from aerobat_pin.jit import Integers, motions
from aerobat_pin.linkage import Closure
from aerobat_pin.plant_kernels import warm_up
from aerobat_pin.plant_layout import Tree
from aerobat_pin.robot import Aerobat
from aerobat_pin.wing import LINKS


def warmed_up(
    robot: Aerobat,
    data: pin.Data,
    kernel: tuple[Integers, Tree],
    placement: Array,
    twist: Array,
    motion: Array,
    dt: float,
    state: Array,
) -> None:
    """Fly the air with the body held and the wings flapping.

    Args:
        robot: the robot.
        data: of its model, that the kernel looks at.
        kernel: where everything lies (see `plant_layout`), and the tree.
        placement: (7,) of the body.
        twist: (6,) of the body against the air, body axes.
        motion: (2 n + 1, 3, 2) joints every half step.
        dt: step [s].
        state: (3N,) of the air; changed.
    """
    places, tree = kernel
    warm_up(places, None, link_twists(robot.model, data, tree, *held(robot, placement, twist, motion)), dt, state)


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
