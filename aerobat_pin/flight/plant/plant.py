"""The plant: the robot in its scenario, as one compiled call after Pinocchio's M and nle.

At each instant the air, the hold and the unknown forces push on the links; their generalised forces run up the tree,
and with the joints prescribed the base acceleration and the motor torque follow (see `prescribed_joints`):

    H_bb a_b = F_b - h_b - H_bj theta''          u_m = H_jb a_b + H_jj theta'' + h_j - F_j

H and h are Pinocchio's M and nle with the wings' added mass (see `added_mass`).

The kernel `advance_stage` is one stage of the integrator: it evaluates this, adds to the step's means, and leads on to
the next stage.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
import pinocchio as pin

from aerobat_pin.aerodynamics import STRIP_ROWS, RobotInAir, fill
from aerobat_pin.errors import SimulationError
from aerobat_pin.flight.air_from_scenario import robot_air, wind_of
from aerobat_pin.flight.attitude_hold import hold_about
from aerobat_pin.flight.crank import CrankDrive, checked_motion, crank_drive
from aerobat_pin.flight.plant.kernels import advance_stage, evaluate
from aerobat_pin.flight.plant.memory import Forces, plant_in, split_forces, unknown_forces
from aerobat_pin.flight.point_forces import point_forces
from aerobat_pin.linkage import Closure
from aerobat_pin.numerics import Array, fields_of, lie_step, new_memory, shaped
from aerobat_pin.robot import BASE_SIZE, Aerobat, joint_table
from aerobat_pin.scenario import Scenario


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
        self.drive = crank_drive(robot, scenario) if drive is None else drive
        self.forces = point_forces(model, scenario)
        self.points = tuple(dict.fromkeys(force.frame for force in self.forces))
        flight = scenario.flight
        rotation = pin.rpy.rpyToMatrix(*np.radians([flight.roll_deg, -flight.pitch_deg, flight.yaw_deg]))
        self.hold = hold_about(scenario, rotation)
        self.in_air = RobotInAir(robot, robot_air(robot.wing, scenario.air))
        self.air, self.data = self.in_air.air, self.in_air.data
        sizes = (model.nv, self.air.state_size, len(self.forces), len(self.points))
        self.memory = new_memory(plant_in, self.in_air.memory.ctypes.data, *sizes)
        self.fields = fields_of(plant_in, self.memory)
        fill(self.fields.unknown, unknown_forces(model, self.forces, self.points))
        if self.hold is not None:
            fill(self.fields.hold, self.hold)
            self.fields.holds[...] = 1.0
        self.start = self._warmed_up(rotation)

    def __repr__(self) -> str:
        """Say who flies what."""
        held = "held" if self.hold is not None else "free"
        return (
            f"Plant({self.scenario.name!r}, {self.robot!r},\n"
            f"      {self.air!r},\n"
            f"      {type(self.drive).__name__}, {held}, unknown forces at {list(self.points)})"
        )

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle and copy as a fresh plant: the views of Pinocchio's results cannot travel."""
        return type(self), (self.robot, self.scenario, self.drive)

    def closure(self, time: Array) -> Closure:
        """Close the linkage at times (n,) [s] of the crank's drive."""
        return self.robot.linkage.solve(*checked_motion(self.drive, time))

    def rates(
        self, q: Array, v: Array, joints: Array, air: Array, held: Array, time: float = 0.0
    ) -> tuple[Array, Array, Forces]:
        """Evaluate the equations of motion at one instant.

        Args:
            q: (nq,) configuration.
            v: (nv,) velocity.
            joints: (3, 2) angle, rate and acceleration of shoulder and elbow, those of q and v.
            air: (3N,) aerodynamic state.
            held: (2, f) mean noise and mean signal of each unknown force [N].
            time: of the wind [s].

        Returns:
            Base acceleration (6,) in body axes, rate of the air's state (3N,), forces with n = 1.

        Raises:
            ShapeError: an array does not fit.
        """
        q, v = shaped(q, (self.model.nq,), "q"), shaped(v, (self.model.nv,), "v")
        joints, air = shaped(joints, (3, 2), "joints"), shaped(air, (self.air.state_size,), "air")
        held = shaped(held, (2, len(self.forces)), "held")[:, :, None]
        state = np.concatenate([v[:BASE_SIZE], air])
        rate = np.empty_like(state)
        self.evaluate(q, v, joints, self.wind(np.array([time]))[0], held, state, rate)
        return rate[:BASE_SIZE], rate[BASE_SIZE:], Forces(*(part[None].copy() for part in self.fields.forces))

    def evaluate(self, q: Array, v: Array, joints: Array, wind: Array, held: Array, state: Array, rate: Array) -> None:
        """Evaluate the equations of motion into the caller's array and `fields.forces`, without allocating.

        Nothing is checked: contiguous arrays of doubles of the shapes below, or memory is overwritten. `rates` checks.

        Args:
            q: (nq,) configuration.
            v: (nv,) velocity.
            joints: (3, 2) angle, rate and acceleration of shoulder and elbow, those of q and v.
            wind: (2, 3) velocity of the air and its rate, world axes.
            held: (2, f, 1) mean noise and mean signal of each unknown force [N].
            state: (6 + 3N,) base twist in body axes, that of v, then the air.
            rate: (6 + 3N,) written: base acceleration, then the rate of the air.
        """
        pin.crba(self.model, self.data, q)
        pin.nonLinearEffects(self.model, self.data, q, v)
        evaluate(self.memory, joints, wind, held, 0, state, rate)

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
            held: (2, f, n) mean noise and mean signal of each unknown force over each step [N].
            progress: called with the share done, 0..1, about a hundred times.
            start: where from; the scenario's start, air warmed up, when omitted.

        Raises:
            ShapeError: `held` or `start` does not fit.
            SimulationError: the flight diverged.
        """
        held = shaped(held, (2, len(self.forces), count), "held")
        start = self.start if start is None else start
        model, data, memory, fields = self.model, self.data, self.memory, self.fields
        halves = np.arange(2 * count + 1) * 0.5 * dt
        closed = self.closure(halves)
        motion, wind, size = joint_table(closed), self.wind(halves), BASE_SIZE + self.air.state_size
        fields.start[:] = fields.state[:] = shaped(np.concatenate([start.twist, start.air]), (size,), "start")
        q, v = self.robot.configuration(start.placement, *motion[0, 0]), fields.v
        v[:] = self.robot.velocity(start.twist, *motion[0, 1])
        means = np.zeros((count, sum(part.size for part in fields.forces)))
        loads = np.zeros((count, STRIP_ROWS, self.air.line.strips))
        placement, states = np.zeros((count + 1, 7)), np.zeros((count + 1, size))
        placement[0], states[0] = q[:7], fields.start
        crba, nle, retract = pin.crba, pin.nonLinearEffects, partial(pin.integrate, model)
        tangents, every = (fields.tangent[0], fields.tangent[1]), max(1, count // 100)

        def evaluate_stage(number: int, here: Array) -> tuple[Array, Array]:
            crba(model, data, here)
            nle(model, data, here, v)
            advance_stage(memory, motion, wind, held, dt, k, number, means, loads)
            return tangents

        for k in range(count):
            q = lie_step(evaluate_stage, retract, q)
            placement[k + 1], states[k + 1] = q[:7], fields.start
            if k % every == 0:
                if not np.all(np.isfinite(fields.start)):
                    states[k + 1 :] = np.nan
                    break
                if progress is not None:
                    progress((k + 1) / count)
        _check_finite(self.scenario.name, states, dt)
        joints = motion[::2]
        return Flown(
            crank_angle=closed.crank_angle[::2],
            q=self.robot.configuration(placement, joints[:, 0, 0], joints[:, 0, 1]),
            v=self.robot.velocity(states[:, :BASE_SIZE], joints[:, 1, 0], joints[:, 1, 1]),
            air=states[:, BASE_SIZE:],
            forces=split_forces(fields.forces, means),
            loads=loads,
        )

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
        rate = 2.0 * np.pi * self.scenario.crank.frequency
        if rate == 0.0 or air.warm_up_cycles == 0 or not self.air.state_size:
            return State(placement, twist, np.zeros(self.air.state_size))
        period = 2.0 * np.pi / rate
        count = int(np.ceil(air.warm_up_cycles * period / self.scenario.simulation.dt))
        dt = air.warm_up_cycles * period / count
        motion = joint_table(self.closure((np.arange(2 * count + 1) * 0.5 - count) * dt))
        against = twist - np.concatenate([wind, np.zeros(3)])
        return State(placement, twist, self.in_air.warmed_up(placement, against, motion, dt))


def _check_finite(name: str, states: Array, dt: float) -> None:
    bad = np.flatnonzero(~np.all(np.isfinite(states), axis=1))
    if bad.size:
        advice = "try a smaller simulation.dt, fewer air.strips, or gentler forces and speeds"
        raise SimulationError(f"scenario {name}: the flight diverged at t = {bad[0] * dt:.4f} s; {advice}")
