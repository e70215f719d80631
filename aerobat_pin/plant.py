"""The plant: the robot in its scenario, as one compiled call after Pinocchio's M and nle.

At each instant the air, the hold and the unknown forces push on the links; their generalised forces run up the tree,
and with the joints prescribed the base acceleration and the motor torque follow (see `dynamics`):

    M_bb a_b = F_b - nle_b - M_bj theta''          u_m = M_jb a_b + M_jj theta'' + nle_j - F_j

The kernel `advance` is one stage of the integrator: it evaluates this, adds to the step's means, and prepares the
next stage by the tableau of `integrators`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin

from aerobat_pin.aerodynamics import RobotAir
from aerobat_pin.arrays import Array, shaped
from aerobat_pin.disturbances import PointForce, point_forces
from aerobat_pin.dynamics import BASE
from aerobat_pin.errors import SimulationError
from aerobat_pin.frames import frame_id
from aerobat_pin.hold import hold_about
from aerobat_pin.jit import check_views, motions, placements
from aerobat_pin.linkage import Closure
from aerobat_pin.plant_kernels import advance, evaluate_once, warm_up
from aerobat_pin.plant_layout import Constants, Tree, Unknown, pack, scratch
from aerobat_pin.robot import JOINTS, Aerobat
from aerobat_pin.scenario import Scenario
from aerobat_pin.wing import LINKS

AXES = ("link", "body", "world")


class Forces(NamedTuple):
    """What acts, averaged over each of n steps.

    `aerodynamic`, `thrusters`, `motor`, `unknown` are generalised forces (n, nv); `force_W` and `force_noise_free_W`
    (n, p, 3) [N] the unknown forces at their points in world axes; `motor_power` (n,) [W] is torque times joint rates.
    """

    aerodynamic: Array
    thrusters: Array
    motor: Array
    unknown: Array
    force_W: Array
    force_noise_free_W: Array
    motor_power: Array


@dataclass(frozen=True)
class State:
    """Base placement (7,), base twist (6,) in body axes, aerodynamic state (3N,)."""

    placement: Array
    twist: Array
    air: Array


@dataclass(frozen=True)
class Flown:
    """A flight on n equal intervals, as arrays: samples at its n + 1 edges, means over its n intervals.

    Attributes:
        q, v: (n + 1, nq), (n + 1, nv).
        air: (n + 1, 3N) aerodynamic state.
        forces: means over the intervals.
        loads: (n, 5, N) of the strips at the start of each interval: u, w, w_eff, force along x and along z.
    """

    q: Array
    v: Array
    air: Array
    forces: Forces
    loads: Array


class Plant:
    """The robot in its scenario, ready to fly.

    Raises:
        ScenarioError: a force acts at a frame that the robot does not have, or in no direction.
    """

    def __init__(self, robot: Aerobat, scenario: Scenario) -> None:
        """Build air, hold and unknown forces, and lay out the kernel's arrays."""
        self.robot, self.scenario = robot, scenario
        self.model = model = robot.model
        self.data = data = model.createData()
        self.air = RobotAir(robot.wing, strips=scenario.air.strips, air_density=scenario.air.density)
        self.crank_rate = 2.0 * np.pi * scenario.crank.frequency
        self.crank_start = np.radians(scenario.crank.start_deg)
        self.forces = point_forces(model, scenario)
        self.points = tuple(dict.fromkeys(force.frame for force in self.forces))
        liMi, twist = placements(data.liMi), motions(data.v)
        check_views(model, data, placements(data.oMi), liMi, twist)
        flight = scenario.flight
        rotation = pin.rpy.rpyToMatrix(*np.radians([flight.roll_deg, -flight.pitch_deg, flight.yaw_deg]))
        self.hold = hold_about(scenario, rotation)
        hold = np.zeros(0) if self.hold is None else self.hold.packed
        self.constants = Constants(self.air.arrays, _tree(model), _unknown(model, self.forces, self.points), hold)
        # What every kernel call begins with: constants, scratch, and Pinocchio's results as they are.
        self._fixed = (*pack(self.constants), scratch(self.air.line.strips), data.M, data.nle, liMi, twist)
        self.start = self._warmed_up(rotation)

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle and copy as a fresh plant: the views of Pinocchio's results cannot travel."""
        return type(self), (self.robot, self.scenario)

    @property
    def force_size(self) -> int:
        """Length of the kernel's row of forces: four generalised forces, two sets of point forces, the motor power."""
        return 4 * int(self.model.nv) + 6 * len(self.points) + 1

    def closure(self, time: Array) -> Closure:
        """Close the linkage at times (n,) [s] of the crank's steady turn."""
        return self.robot.linkage.solve(self.crank_start + self.crank_rate * time, self.crank_rate)

    def rates(self, q: Array, v: Array, joints: Array, air: Array, held: Array) -> tuple[Array, Array, Forces]:
        """Evaluate the equations of motion at one instant.

        Args:
            q: (nq,) configuration.
            v: (nv,) velocity.
            joints: (3, 2) angle, rate and acceleration of shoulder and elbow, those of q and v.
            air: (3N,) aerodynamic state.
            held: (2, n) noise and step of each unknown force [N].

        Returns:
            Base acceleration (6,) in body axes, rate of the air's state (3N,), forces with n = 1.

        Raises:
            ShapeError: an array does not fit.
        """
        q, v = shaped(q, (self.model.nq,), "q"), shaped(v, (self.model.nv,), "v")
        joints, air = shaped(joints, (3, 2), "joints"), shaped(air, (self.air.state_size,), "air")
        held = shaped(held, (2, len(self.forces)), "held")[:, :, None]
        state = np.concatenate([v[:BASE], air])
        rate, forces = np.empty_like(state), np.empty(self.force_size)
        self.evaluate(q, v, joints, held, state, rate, forces)
        return rate[:BASE], rate[BASE:], self.split(forces[None])

    def evaluate(
        self, q: Array, v: Array, joints: Array, held: Array, state: Array, rate: Array, forces: Array
    ) -> None:
        """Evaluate the equations of motion into the caller's arrays: the right-hand side, without allocating.

        Nothing is checked: contiguous arrays of doubles of the shapes below, or memory is overwritten. `rates` checks.

        Args:
            q: (nq,) configuration.
            v: (nv,) velocity.
            joints: (3, 2) angle, rate and acceleration of shoulder and elbow, those of q and v.
            held: (2, n, 1) noise and step of each unknown force [N].
            state: (6 + 3N,) base twist in body axes, that of v, then the air.
            rate: (6 + 3N,) written: base acceleration, then the rate of the air.
            forces: (`force_size`,) written; `split` names its parts.
        """
        pin.crba(self.model, self.data, q)
        pin.nonLinearEffects(self.model, self.data, q, v)
        evaluate_once(*self._fixed, joints, held, state, rate, forces)

    def fly(
        self,
        count: int,
        dt: float,
        held: Array,
        progress: Callable[[float], None] | None = None,
        start: State | None = None,
    ) -> Flown:
        """Fly.

        Args:
            count: number n of steps.
            dt: step [s].
            held: (2, forces, n) noise and step of each unknown force over each step [N].
            progress: called with the share done, 0..1, about a hundred times.
            start: where from; the scenario's start, air warmed up, when omitted.

        Raises:
            ShapeError: `held` or `start` does not fit.
            SimulationError: the flight diverged.
        """
        held = shaped(held, (2, len(self.forces), count), "held")
        start = self.start if start is None else start
        model, data = self.model, self.data
        motion = joint_table(self.closure(np.arange(2 * count + 1) * 0.5 * dt))
        size = BASE + self.air.state_size
        stages, tangent = np.zeros((6, size)), np.zeros((2, model.nv))
        stages[4] = stages[5] = shaped(np.concatenate([start.twist, start.air]), (size,), "start")
        q = self.robot.configuration(start.placement, *motion[0, 0])
        v = self.robot.velocity(start.twist, *motion[0, 1])
        forces, means = np.zeros(self.force_size), np.zeros((count, self.force_size))
        loads = np.zeros((count, 5, self.air.line.strips))
        placement, states = np.zeros((count + 1, 7)), np.zeros((count + 1, size))
        placement[0], states[0] = q[:7], stages[4]
        constants = (*self._fixed, motion, held, dt)
        written = (stages, tangent, v, forces, means, loads)
        crba, nle, integrate = pin.crba, pin.nonLinearEffects, pin.integrate
        way, rest = tangent
        every = max(1, count // 100)
        for k in range(count):
            crba(model, data, q)
            nle(model, data, q, v)
            advance(*constants, k, 0, *written)
            second = integrate(model, q, way)
            crba(model, data, second)
            nle(model, data, second, v)
            advance(*constants, k, 1, *written)
            third = integrate(model, q, way)
            crba(model, data, third)
            nle(model, data, third, v)
            advance(*constants, k, 2, *written)
            fourth = integrate(model, second, way)
            crba(model, data, fourth)
            nle(model, data, fourth, v)
            advance(*constants, k, 3, *written)
            q = integrate(model, integrate(model, q, way), rest)
            placement[k + 1], states[k + 1] = q[:7], stages[4]
            if k % every == 0:
                if not np.all(np.isfinite(stages[4])):
                    states[k + 1 :] = np.nan
                    break
                if progress is not None:
                    progress((k + 1) / count)
        _check_finite(self.scenario.name, states, dt)
        joints = motion[::2]
        return Flown(
            q=self.robot.configuration(placement, joints[:, 0, 0], joints[:, 0, 1]),
            v=self.robot.velocity(states[:, :BASE], joints[:, 1, 0], joints[:, 1, 1]),
            air=states[:, BASE:],
            forces=self.split(means),
            loads=loads,
        )

    def split(self, rows: Array) -> Forces:
        """Name the parts of the kernel's rows of forces (n, 4 nv + 6 p + 1)."""
        nv, points = self.model.nv, len(self.points)
        generalized = [rows[:, i * nv : (i + 1) * nv] for i in range(4)]
        at_points = rows[:, 4 * nv : 4 * nv + 6 * points].reshape(len(rows), 2, points, 3)
        aerodynamic, thrusters, motor, unknown = generalized
        return Forces(aerodynamic, thrusters, motor, unknown, at_points[:, 0], at_points[:, 1], rows[:, -1])

    def _warmed_up(self, rotation: Array) -> State:
        """Return the start, the air warmed up over whole cycles with the body held at its attitude and velocity."""
        flight, air = self.scenario.flight, self.scenario.air
        placement = np.concatenate([flight.position, pin.Quaternion(rotation).coeffs()])
        twist = np.concatenate([rotation.T @ np.array(flight.velocity), flight.angular_velocity])
        state: Array = np.zeros(self.air.state_size)
        if self.crank_rate == 0.0 or air.warm_up_cycles == 0:
            return State(placement, twist, state)
        period = 2.0 * np.pi / self.crank_rate
        count = int(np.ceil(air.warm_up_cycles * period / self.scenario.simulation.dt))
        dt = air.warm_up_cycles * period / count
        motion = joint_table(self.closure((np.arange(2 * count + 1) * 0.5 - count) * dt))
        table = np.empty((2 * count + 1, len(LINKS), 6))
        q = self.robot.configuration(placement, motion[0, 0, 0], motion[0, 0, 1])
        v = self.robot.velocity(twist, motion[0, 1, 0], motion[0, 1, 1])
        twists = motions(self.data.v)
        order = self.constants.tree.table[:, 0]
        for i in range(2 * count + 1):
            for row, (at_q, at_v) in enumerate(zip(self.robot.idx_q, self.robot.idx_v, strict=True)):
                q[at_q], v[at_v] = motion[i, 0, row % 2], motion[i, 1, row % 2]
            pin.forwardKinematics(self.model, self.data, q, v)
            table[i] = twists[order]
        warm_up(self.air.arrays, table, dt, state)
        return State(placement, twist, state)


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


def _tree(model: pin.Model) -> Tree:
    table: list[tuple[int, ...]] = []
    axis = [np.zeros(3)]
    for i, link in enumerate(LINKS):
        joint = model.frames[model.getFrameId(link)].parentJoint
        parents = [k for k, row in enumerate(table) if row[0] == model.parents[joint]]
        which = JOINTS.index(model.names[joint]) % 2 if i else 0
        table.append((joint, parents[0] if parents else -1, model.joints[joint].idx_v, which))
        if i:
            neutral = model.joints[joint].createData()
            model.joints[joint].calc(neutral, np.zeros(1))
            axis.append(np.ravel(neutral.S)[3:])
    return Tree(np.array(table), np.array(axis))


def _unknown(model: pin.Model, forces: tuple[PointForce, ...], points: tuple[str, ...]) -> Unknown:
    carriers = [model.frames[model.getFrameId(link)].parentJoint for link in LINKS]
    frames = [model.frames[frame_id(model, name)] for name in points]
    links = [carriers.index(frame.parentJoint) for frame in frames]
    table, numbers = [], []
    for force in forces:
        point = points.index(force.frame)
        turned = frames[point].placement.rotation if force.axes == "link" else np.eye(3)
        table.append((point, links[point], AXES.index(force.axes)))
        numbers.append([*(turned @ force.direction), force.signal.amplitude])
    places = [[link, *frame.placement.translation] for link, frame in zip(links, frames, strict=True)]
    return Unknown(
        np.array(table, dtype=np.intp).reshape(-1, 3),
        np.array(numbers, dtype=float).reshape(-1, 4),
        np.array(places, dtype=float).reshape(-1, 4),
    )


def _check_finite(name: str, states: Array, dt: float) -> None:
    bad = np.flatnonzero(~np.all(np.isfinite(states), axis=1))
    if bad.size:
        advice = "try a smaller simulation.dt, fewer air.strips, or gentler forces and speeds"
        raise SimulationError(f"scenario {name}: the flight diverged at t = {bad[0] * dt:.4f} s; {advice}")
