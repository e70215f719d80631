"""A robot in its air: its memory for kernels, the twists of its links, and a warmed-up state to start from."""

from __future__ import annotations

from typing import Annotated, NamedTuple

import numpy as np
import pinocchio as pin

from aerobat_pin.aerodynamics.added_mass import AddedMass, factored
from aerobat_pin.aerodynamics.links import Links, PinocchioResults
from aerobat_pin.aerodynamics.robot_air import RobotAir, air_loads
from aerobat_pin.aerodynamics.strip_forces import STRIP_ROWS, AirConstants, air_in
from aerobat_pin.numerics import (
    HALF_STEPS,
    Array,
    addresses,
    array_at,
    check_views,
    copy_values,
    fields_of,
    fill,
    guarded,
    kernel,
    layout_of,
    merged,
    motions,
    new_memory,
    next_size,
    next_state,
    placements,
    rewind,
)
from aerobat_pin.robot import LINKS, Aerobat, Tree, tree_of

LINK_COUNT = len(LINKS)


class RobotMemory(NamedTuple):
    """Memory of a robot in its air.

    `gravity` () [m/s2]. `H` (nv, nv) and `h` (nv,) are scratch arrays for inertia and bias. `loads` (9, N) are the
    strips' loads. For a Runge-Kutta step of the aerodynamic state (S,): its `rates` (4, S) at the stages, the state at
    the step's `start` (S,), and the current `state` (S,).
    """

    air: AirConstants
    added_mass: AddedMass
    gravity: Annotated[Array, ""]
    tree: Tree
    found: PinocchioResults
    links: Links
    H: Annotated[Array, "nv, nv"]
    h: Annotated[Array, "nv"]
    loads: Annotated[Array, "strip_rows, n"]
    rates: Annotated[Array, "4, states"]
    start: Annotated[Array, "states"]
    state: Annotated[Array, "states"]


robot_fields = layout_of(RobotMemory, "air", "found", "link_count", "nv", "strip_rows", "n", "states")


@merged
def robot_in(memory: Array) -> RobotMemory:
    """Lay out a robot in its air.

    Sizes: addresses of the memory of `air_in` and of Pinocchio's M, nle, liMi, v, a_gf; then nv, njoints, number of
    strips, number of aerodynamic states.
    """
    cursor = rewind(memory)
    air, M, nle, liMi = next_size(cursor), next_size(cursor), next_size(cursor), next_size(cursor)
    v, a_gf, nv, joints = next_size(cursor), next_size(cursor), next_size(cursor), next_size(cursor)
    n, states = next_size(cursor), next_size(cursor)
    found = PinocchioResults(
        M=array_at(M, (nv, nv)),
        nle=array_at(nle, (nv,)),
        liMi=array_at(liMi, (joints, 12)),
        v=array_at(v, (joints, 6)),
        a_gf=array_at(a_gf, (joints, 6)),
    )
    return robot_fields(cursor, air_in(array_at(air, (1,))), found, LINK_COUNT, nv, STRIP_ROWS, n, states)


@kernel
def warm_up(memory: Array, twists: Array, dt: float) -> None:
    """Integrate the aerodynamic state, which is stored in `memory`, over n steps of size dt [s].

    `twists` (2 n + 1, 5, 6) are the twists of the links relative to the air at every half step.
    """
    robot = robot_in(memory)
    air, wrenches, loads = robot.air, robot.links.wrenches, robot.loads
    rates, start, state = robot.rates, robot.start, robot.state
    for i in range(twists.shape[0] // 2):
        copy_values(state, start)
        for stage in range(4):
            air_loads(air, twists[2 * i + HALF_STEPS[stage]], state, wrenches, rates[stage], loads)
            next_state(stage, dt, rates, start, state)


class RobotInAir:
    """A robot in its air, laid out for the kernels.

    Args:
        robot: the robot.
        air: the robot's aerodynamic model.

    Attributes:
        data: the `pin.Data` in which the kernels find Pinocchio's results.
        memory: flat array that is a kernel's first argument; `fields` are named views of its parts.
    """

    @guarded()
    def __init__(self, robot: Aerobat, air: RobotAir) -> None:
        """Lay out the memory and fill in its constants."""
        self.robot, self.air, self.data = robot, air, robot.model.createData()
        model, data = robot.model, self.data
        liMi, v, a_gf = placements(data.liMi), motions(data.v), motions(data.a_gf)
        check_views(model, data, placements(data.oMi), liMi, v, a_gf)
        places = addresses(air.memory, data.M, data.nle, liMi, v, a_gf)
        sizes = (int(model.nv), model.njoints, air.line.strips, air.state_size)
        self.memory = new_memory(robot_in, *places.tolist(), *sizes)
        self.fields = fields_of(robot_in, self.memory)
        fill(self.fields.added_mass, factored(air.added_mass))
        fill(self.fields.tree, tree_of(model))
        self.fields.gravity[...] = -model.gravity.linear[2]

    @guarded(q=("n", "nq"), v=("n", "nv"))
    def link_twists(self, q: Array, v: Array) -> Array:
        """Return the links' twists (n, 5, 6) for configurations q (n, nq) and velocities v (n, nv).

        Each twist is at the origin and in the axes of the link's frame.
        """
        joints, found, model, data = self.fields.tree.joint, motions(self.data.v), self.robot.model, self.data
        twists, forward = np.empty((len(q), len(joints), 6)), pin.forwardKinematics
        for row, placement, velocity in zip(twists, list(q), list(v), strict=True):
            forward(model, data, placement, velocity)
            row[:] = found[joints]
        return twists

    @guarded(placement=(7,), twist=(6,), motion=("n", 3, 2))
    def flapping_twists(self, placement: Array, twist: Array, motion: Array) -> Array:
        """Return the links' twists (n, 5, 6) while the wings flap and placement and twist of the body stay constant.

        Args:
            placement: (7,) placement of the body.
            twist: (6,) twist of the body relative to the air, body axes.
            motion: (n, 3, 2) angle, rate and acceleration of shoulder and elbow.
        """
        still = np.ones((len(motion), 1))
        q = self.robot.configuration(still * placement, motion[:, 0, 0], motion[:, 0, 1])
        return self.link_twists(q, self.robot.velocity(still * twist, motion[:, 1, 0], motion[:, 1, 1]))

    @guarded(placement=(7,), twist=(6,), motion=("n", 3, 2), dt="positive")
    def warmed_up(self, placement: Array, twist: Array, motion: Array, dt: float) -> Array:
        """Return the aerodynamic state (S,) after the wings have flapped, starting from air at rest.

        A flight that starts from this state starts in the wake of its own wings.

        Args:
            placement: (7,) placement of the body.
            twist: (6,) twist of the body relative to the air, body axes.
            motion: (2 n + 1, 3, 2) angle, rate and acceleration of shoulder and elbow at every half step.
            dt: time step [s].
        """
        self.fields.state[:] = 0.0
        warm_up(self.memory, self.flapping_twists(placement, twist, motion), dt)
        return self.fields.state.copy()
