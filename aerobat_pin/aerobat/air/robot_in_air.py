"""A robot in its air: its memory for kernels, the twists of its links, and a warmed-up state to start from."""

from __future__ import annotations

from typing import Annotated, Any, NamedTuple

import numpy as np
import pinocchio as pin

from aerobat_pin.aerobat.aerobat import Aerobat
from aerobat_pin.aerobat.air.added_mass import AddedMass, factored
from aerobat_pin.aerobat.air.robot_air import RobotAir, air_loads
from aerobat_pin.aerobat.link_kernels import Links, PinocchioResults, Tree, tree_of
from aerobat_pin.aerobat.wing import LINKS
from aerobat_pin.aerodynamics import STRIP_ROWS, AirConstants
from aerobat_pin.numerics import (
    ELSEWHERE,
    HALF_STEPS,
    Array,
    check_views,
    copy_values,
    fields_of,
    fill,
    guarded,
    kernel,
    motions,
    new_state,
    next_state,
    placements,
)

LINK_COUNT = len(LINKS)


class RobotState(NamedTuple):
    """State of the kernels of a robot in its air, whose constants `air` are a state of their own.

    `gravity` () [m/s2]. `H` (nv, nv) and `h` (nv,) are scratch arrays for inertia and bias. `loads` (9, N) are the
    strips' loads. For a Runge-Kutta step of the aerodynamic state (S,): its `rates` (4, S) at the stages, the state at
    the step's `start` (S,), and the current `state` (S,).
    """

    air: Annotated[AirConstants, ELSEWHERE]
    added_mass: AddedMass
    gravity: Annotated[Array, ""]
    tree: Tree
    results: PinocchioResults
    links: Links
    H: Annotated[Array, "nv, nv"]
    h: Annotated[Array, "nv"]
    loads: Annotated[Array, "strip_rows, n"]
    rates: Annotated[Array, "4, states"]
    start: Annotated[Array, "states"]
    state: Annotated[Array, "states"]


@kernel
def warm_up(memory: Array, twists: Array, dt: float) -> None:
    """Integrate the aerodynamic state, which is stored in `memory`, over n steps of size dt [s].

    `twists` (2 n + 1, 5, 6) are the twists of the links relative to the air at every half step.
    """
    robot = fields_of(memory, RobotState)
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
        self.robot, self.air, self.data = robot, air, robot.model.createData()
        model, data = robot.model, self.data
        liMi, v, a_gf = placements(data.liMi), motions(data.v), motions(data.a_gf)
        check_views(model, data, placements(data.oMi), liMi, v, a_gf)
        results = {"data": data, "M": data.M, "nle": data.nle, "liMi": liMi, "v": v, "a_gf": a_gf}
        sizes = {"nv": model.nv, "joints": model.njoints, "n": air.line.strips, "states": air.state_size}
        counts = {"link_count": LINK_COUNT, "strip_rows": STRIP_ROWS}
        self.memory = new_state(RobotState, air=air.memory, **results, **sizes, **counts)
        self.fields = fields_of(self.memory, RobotState)
        fill(self.fields.added_mass, factored(air.added_mass))
        fill(self.fields.tree, tree_of(model))
        self.fields.gravity[...] = -model.gravity.linear[2]

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle and copy as one laid out anew, in the same aerodynamic state: its memory points into `data`."""
        return type(self), (self.robot, self.air), (self.fields.start, self.fields.state)

    def __setstate__(self, wake: tuple[Array, Array]) -> None:
        self.fields.start[:], self.fields.state[:] = wake

    @guarded(q=("n", "nq"), v=("n", "nv"))
    def link_twists(self, q: Array, v: Array) -> Array:
        """Return the links' twists (n, 5, 6) for configurations q (n, nq) and velocities v (n, nv).

        Each twist is at the origin and in the axes of the link's frame.
        """
        velocities, model, data, forward = motions(self.data.v), self.robot.model, self.data, pin.forwardKinematics
        twists = np.empty((len(q), model.njoints, 6))
        for row, placement, velocity in zip(twists, q, v, strict=True):
            forward(model, data, placement, velocity)
            row[:] = velocities
        return twists[:, self.fields.tree.joint]

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
