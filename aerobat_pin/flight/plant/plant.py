"""The plant: the robot in its scenario, as one compiled call after Pinocchio's M and nle.

At each instant the air, the hold and the unknown forces push on the links; their generalised forces run up the tree,
and with the joints prescribed the base acceleration and the motor torque follow (see `dynamics`):

    H_bb a_b = F_b - h_b - H_bj theta''          u_m = H_jb a_b + H_jj theta'' + h_j - F_j

H and h are Pinocchio's M and nle with the wings' added mass (see `added_mass`).

The kernel `advance` is one stage of the integrator: it evaluates this, adds to the step's means, and prepares the
next stage by the tableau of `integrators`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin

from aerobat_pin.aerodynamics import LOADS
from aerobat_pin.errors import SimulationError
from aerobat_pin.flight.air_from_scenario import robot_air, wind_of
from aerobat_pin.flight.attitude_hold import hold_about
from aerobat_pin.flight.crank import CrankDrive, crank_drive, turned
from aerobat_pin.flight.plant.kernels import advance, evaluate
from aerobat_pin.flight.plant.memory import layout
from aerobat_pin.flight.plant.warm_up import warmed_up
from aerobat_pin.flight.point_forces import point_forces
from aerobat_pin.linkage import Closure
from aerobat_pin.numerics import Array, shaped
from aerobat_pin.robot import BASE, LINKS, Aerobat, joint_table
from aerobat_pin.scenario import Scenario


class Forces(NamedTuple):
    """What acts, averaged over each of n steps.

    `aerodynamic`, `added_mass`, `thrusters`, `motor`, `unknown` are generalised forces (n, nv); `force_W` and
    `force_noise_free_W` (n, p, 3) [N] the unknown forces at their points in world axes; `link_wrench` (n, 5, 6) what
    the air does to each link, at and in its frame, without added mass; `motor_power` (n,) [W] is torque times joint
    rates, and `air_power` (n,) [W] what the air does to the robot, added mass included.
    """

    aerodynamic: Array
    added_mass: Array
    thrusters: Array
    motor: Array
    unknown: Array
    force_W: Array
    force_noise_free_W: Array
    link_wrench: Array
    motor_power: Array
    air_power: Array


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
        crank_angle: (n + 1,) [rad].
        q, v: (n + 1, nq), (n + 1, nv).
        air: (n + 1, 3N) aerodynamic state.
        forces: means over the intervals.
        loads: (n, 9, N) of the strips at the start of each interval; `strips_of` names the rows.
    """

    crank_angle: Array
    q: Array
    v: Array
    air: Array
    forces: Forces
    loads: Array


class Plant:
    """The robot in its scenario, ready to fly.

    Args:
        robot: the robot.
        scenario: what happens.
        drive: how the crank turns, in place of the scenario's drive. While the air warms up it is asked for times
            before zero.

    Raises:
        CrankError: the drive is not a motion.
        ScenarioError: a force acts at a frame that the robot does not have, or in no direction.
    """

    def __init__(self, robot: Aerobat, scenario: Scenario, drive: CrankDrive | None = None) -> None:
        """Build air, hold and unknown forces, and lay out the kernel's arrays."""
        self.robot, self.scenario = robot, scenario
        self.model = model = robot.model
        self.data = model.createData()
        self.air = robot_air(robot.wing, scenario.air)
        self.drive = crank_drive(robot, scenario) if drive is None else drive
        self.forces = point_forces(model, scenario)
        self.points = tuple(dict.fromkeys(force.frame for force in self.forces))
        flight = scenario.flight
        rotation = pin.rpy.rpyToMatrix(*np.radians([flight.roll_deg, -flight.pitch_deg, flight.yaw_deg]))
        self.hold = hold_about(scenario, rotation)
        self.constants, self._places, self._arrays = layout(
            model, self.data, self.air, self.forces, self.points, self.hold
        )
        self.start = self._warmed_up(rotation)

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle and copy as a fresh plant: the views of Pinocchio's results cannot travel."""
        return type(self), (self.robot, self.scenario, self.drive)

    @property
    def force_size(self) -> int:
        """Length of the kernel's row of forces: five generalised, two sets at points, link wrenches, two powers."""
        return 5 * int(self.model.nv) + 6 * len(self.points) + 6 * len(LINKS) + 2

    def closure(self, time: Array) -> Closure:
        """Close the linkage at times (n,) [s] of the crank's drive."""
        return self.robot.linkage.solve(*turned(self.drive, time))

    def rates(
        self, q: Array, v: Array, joints: Array, air: Array, held: Array, time: float = 0.0
    ) -> tuple[Array, Array, Forces]:
        """Evaluate the equations of motion at one instant.

        Args:
            q: (nq,) configuration.
            v: (nv,) velocity.
            joints: (3, 2) angle, rate and acceleration of shoulder and elbow, those of q and v.
            air: (3N,) aerodynamic state.
            held: (2, n) noise and signal of each unknown force [N].
            time: of the wind [s].

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
        self.evaluate(q, v, joints, self.wind(np.array([time]))[0], held, state, rate, forces)
        return rate[:BASE], rate[BASE:], self.split(forces[None])

    def evaluate(
        self, q: Array, v: Array, joints: Array, wind: Array, held: Array, state: Array, rate: Array, forces: Array
    ) -> None:
        """Evaluate the equations of motion into the caller's arrays: the right-hand side, without allocating.

        Nothing is checked: contiguous arrays of doubles of the shapes below, or memory is overwritten. `rates` checks.

        Args:
            q: (nq,) configuration.
            v: (nv,) velocity.
            joints: (3, 2) angle, rate and acceleration of shoulder and elbow, those of q and v.
            wind: (2, 3) velocity of the air and its rate, world axes.
            held: (2, n, 1) noise and signal of each unknown force [N].
            state: (6 + 3N,) base twist in body axes, that of v, then the air.
            rate: (6 + 3N,) written: base acceleration, then the rate of the air.
            forces: (`force_size`,) written; `split` names its parts.
        """
        pin.crba(self.model, self.data, q)
        pin.nonLinearEffects(self.model, self.data, q, v)
        evaluate(self._places, self.air.steady, joints, wind, held, 0, state, rate, forces)

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
            held: (2, forces, n) noise and signal of each unknown force over each step [N].
            progress: called with the share done, 0..1, about a hundred times.
            start: where from; the scenario's start, air warmed up, when omitted.

        Raises:
            ShapeError: `held` or `start` does not fit.
            SimulationError: the flight diverged.
        """
        held = shaped(held, (2, len(self.forces), count), "held")
        start = self.start if start is None else start
        model, data = self.model, self.data
        halves = np.arange(2 * count + 1) * 0.5 * dt
        closed = self.closure(halves)
        motion = joint_table(closed)
        size = BASE + self.air.state_size
        stages, tangent = np.zeros((6, size)), np.zeros((2, model.nv))
        stages[4] = stages[5] = shaped(np.concatenate([start.twist, start.air]), (size,), "start")
        q = self.robot.configuration(start.placement, *motion[0, 0])
        v = self.robot.velocity(start.twist, *motion[0, 1])
        forces, means = np.zeros(self.force_size), np.zeros((count, self.force_size))
        loads = np.zeros((count, LOADS, self.air.line.strips))
        placement, states = np.zeros((count + 1, 7)), np.zeros((count + 1, size))
        placement[0], states[0] = q[:7], stages[4]
        constants = (self._places, self.air.steady, motion, self.wind(halves), held, dt)
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
            crank_angle=closed.crank_angle[::2],
            q=self.robot.configuration(placement, joints[:, 0, 0], joints[:, 0, 1]),
            v=self.robot.velocity(states[:, :BASE], joints[:, 1, 0], joints[:, 1, 1]),
            air=states[:, BASE:],
            forces=self.split(means),
            loads=loads,
        )

    def split(self, rows: Array) -> Forces:
        """Name the parts of the kernel's rows of forces (n, `force_size`)."""
        nv, points, links = self.model.nv, len(self.points), len(LINKS)
        parts = np.split(rows, np.cumsum([nv] * 5 + [3 * points] * 2 + [6 * links]), axis=1)
        at_points = [part.reshape(len(rows), points, 3) for part in parts[5:7]]
        aerodynamic, added_mass, thrusters, motor, unknown = parts[:5]
        link_wrench, (motor_power, air_power) = parts[7].reshape(len(rows), links, 6), parts[8].T
        generalized = (aerodynamic, added_mass, thrusters, motor, unknown)
        return Forces(*generalized, at_points[0], at_points[1], link_wrench, motor_power, air_power)

    def wind(self, time: Array) -> Array:
        """Return velocity of the air and its rate (n, 2, 3), world axes [m/s, m/s2], at times (n,) [s]."""
        return wind_of(self.scenario.air).field(time)

    def _warmed_up(self, rotation: Array) -> State:
        """Return the start, the air warmed up over whole cycles with the body held at its attitude and velocity.

        The crank does what its drive says for the times before zero: where it rests, the air settles about still wings.
        """
        flight, air = self.scenario.flight, self.scenario.air
        placement = np.concatenate([flight.position, pin.Quaternion(rotation).coeffs()])
        twist = np.concatenate([rotation.T @ np.array(flight.velocity), flight.angular_velocity])
        wind = rotation.T @ self.wind(np.zeros(1))[0, 0]
        state: Array = np.zeros(self.air.state_size)
        rate = 2.0 * np.pi * self.scenario.crank.frequency
        if rate == 0.0 or air.warm_up_cycles == 0 or not state.size:
            return State(placement, twist, state)
        period = 2.0 * np.pi / rate
        count = int(np.ceil(air.warm_up_cycles * period / self.scenario.simulation.dt))
        dt = air.warm_up_cycles * period / count
        motion = joint_table(self.closure((np.arange(2 * count + 1) * 0.5 - count) * dt))
        against = twist - np.concatenate([wind, np.zeros(3)])
        warmed_up(self.robot, self.data, (self._places, self.constants.tree), placement, against, motion, dt, state)
        return State(placement, twist, state)


def _check_finite(name: str, states: Array, dt: float) -> None:
    bad = np.flatnonzero(~np.all(np.isfinite(states), axis=1))
    if bad.size:
        advice = "try a smaller simulation.dt, fewer air.strips, or gentler forces and speeds"
        raise SimulationError(f"scenario {name}: the flight diverged at t = {bad[0] * dt:.4f} s; {advice}")
