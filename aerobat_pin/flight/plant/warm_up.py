"""Flying the air alone before a flight, so that it begins in the wake of its own flaps."""

from __future__ import annotations

import pinocchio as pin

from aerobat_pin.flight.plant.kernels import warm_up
from aerobat_pin.numerics import Array, Integers
from aerobat_pin.robot import Aerobat, Tree, held, link_twists


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
