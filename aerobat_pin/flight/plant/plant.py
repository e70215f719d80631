"""The plant: the robot in its scenario; its equations of motion are one compiled call after Pinocchio's M and nle.

At each instant the air, the attitude hold and the unknown forces act on the links. Their wrenches are carried up the
kinematic tree and give the generalised force F. The linkage prescribes the joint angles theta, so the equations of
motion, split into base rows (b) and joint rows (j), give the base acceleration a_b and the motor torque u_m (see
`prescribed_joints`):

    H_bb a_b = F_b - h_b - H_bj theta''          u_m = H_jb a_b + H_jj theta'' + h_j - F_j

H and h are Pinocchio's M and nle plus the contribution of the wings' added mass (see `added_mass`).

The kernel `advance_stage` is one stage of the integrator: it evaluates these equations, adds the forces to their means
over the step, and prepares the next stage.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
import pinocchio as pin

from aerobat_pin.aerodynamics import LARGEST_AIRSPEED, STRIP_ROWS, RobotInAir, StripLoads, fill
from aerobat_pin.errors import SimulationError
from aerobat_pin.flight.air_from_scenario import robot_air, wind_of
from aerobat_pin.flight.attitude_hold import hold_about
from aerobat_pin.flight.crank import CrankDrive, checked_motion, crank_drive
from aerobat_pin.flight.plant.kernels import advance_stage, evaluate
from aerobat_pin.flight.plant.memory import Forces, plant_in, split_forces, unknown_forces
from aerobat_pin.flight.point_forces import point_forces
from aerobat_pin.linkage import Closure
from aerobat_pin.numerics import Array, fields_of, guarded, lie_step, new_memory, shaped
from aerobat_pin.robot import BASE_SIZE, Aerobat, joint_table
from aerobat_pin.scenario import Scenario

# Beyond these limits a flight has diverged.
LIMITS = {
    "velocity": (1e3, "m/s"),
    "angular velocity": (1e4, "rad/s"),
    "aerodynamic state": (1e3, "m or m2/s"),
    "airspeed of a strip": (LARGEST_AIRSPEED, "m/s"),
}


@dataclass(frozen=True)
class State:
    """A state of the plant: base placement (7,), base twist (6,) in body axes, aerodynamic state (3N,)."""

    placement: Array
    twist: Array
    air: Array


@dataclass(frozen=True)
class Flown:
    """A simulated flight of n equal intervals, as arrays: samples at the n + 1 edges, means over the n intervals.

    Attributes:
        crank_angle: (n + 1,) absolute crank angle t1 [rad].
        q, v: configuration (n + 1, nq) and velocity (n + 1, nv).
        air: (n + 1, 3N) aerodynamic state.
        forces: means of all forces over the intervals.
        loads: (n, 9, N) strip loads at the start of each interval; `strips_of` names the rows.
    """

    crank_angle: Array
    q: Array
    v: Array
    air: Array
    forces: Forces
    loads: Array


class Plant:
    """The robot in its scenario, ready to be simulated.

    Args:
        robot: the robot.
        scenario: start, air, crank, attitude hold and unknown forces.
        drive: crank drive that replaces the scenario's. It is also called with times before zero, while the
            aerodynamic state is warmed up.

    Raises:
        CrankError: the drive's angle, rate and acceleration do not agree.
        ScenarioError: a force acts at a frame that the robot does not have, or its direction is zero.
    """

    @guarded()
    def __init__(self, robot: Aerobat, scenario: Scenario, drive: CrankDrive | None = None) -> None:
        """Build air, attitude hold and unknown forces, and lay out the kernel's memory."""
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
        """Name scenario, robot, aerodynamic model, crank drive and unknown forces."""
        held = "held" if self.hold is not None else "free"
        return (
            f"Plant({self.scenario.name!r}, {self.robot!r},\n"
            f"      {self.air!r},\n"
            f"      {type(self.drive).__name__}, {held}, unknown forces at {list(self.points)})"
        )

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle and copy by building the plant anew, because views of Pinocchio's results cannot be pickled."""
        return type(self), (self.robot, self.scenario, self.drive)

    @guarded(time=("n",))
    def closure(self, time: Array) -> Closure:
        """Close the linkage at the crank angles that the drive gives for times (n,) [s]."""
        return self.robot.linkage.solve(*checked_motion(self.drive, time))

    @guarded()
    def rates(
        self, q: Array, v: Array, joints: Array, air: Array, held: Array, time: float = 0.0
    ) -> tuple[Array, Array, Forces]:
        """Evaluate the equations of motion at one instant.

        Args:
            q: (nq,) configuration.
            v: (nv,) velocity.
            joints: (3, 2) angle, rate and acceleration of shoulder and elbow; angle and rate as in q and v.
            air: (3N,) aerodynamic state.
            held: (2, f) mean noise and mean signal of each unknown force [N].
            time: time at which the wind is evaluated [s].

        Returns:
            Base acceleration (6,) in body axes, rate of the aerodynamic state (3N,), and the forces with n = 1.

        Raises:
            ShapeError: an array has the wrong shape.
        """
        q, v = shaped(q, (self.model.nq,), "q"), shaped(v, (self.model.nv,), "v")
        joints, air = shaped(joints, (3, 2), "joints"), shaped(air, (self.air.state_size,), "air")
        held = shaped(held, (2, len(self.forces)), "held")[:, :, None]
        state = np.concatenate([v[:BASE_SIZE], air])
        rate = np.empty_like(state)
        self.evaluate(q, v, joints, self.wind(np.array([time]))[0], held, state, rate)
        return rate[:BASE_SIZE], rate[BASE_SIZE:], Forces(*(part[None].copy() for part in self.fields.forces))

    def evaluate(self, q: Array, v: Array, joints: Array, wind: Array, held: Array, state: Array, rate: Array) -> None:
        """Evaluate the equations of motion without allocating; write the result to `rate` and `fields.forces`.

        The arguments are not checked, as `rates` does. Arrays must be contiguous, of doubles and of the shapes below;
        otherwise the kernel overwrites other memory.

        Args:
            q: (nq,) configuration.
            v: (nv,) velocity.
            joints: (3, 2) angle, rate and acceleration of shoulder and elbow; angle and rate as in q and v.
            wind: (2, 3) wind velocity and its rate of change, world axes.
            held: (2, f, 1) mean noise and mean signal of each unknown force [N].
            state: (6 + 3N,) base twist in body axes, as in v, then the aerodynamic state.
            rate: (6 + 3N,) written: base acceleration, then the rate of the aerodynamic state.
        """
        pin.crba(self.model, self.data, q)
        pin.nonLinearEffects(self.model, self.data, q, v)
        evaluate(self.memory, joints, wind, held, 0, state, rate)

    @guarded(dt="positive")
    def fly(
        self,
        count: int,
        dt: float,
        held: Array,
        progress: Callable[[float], None] | None = None,
        start: State | None = None,
    ) -> Flown:
        """Integrate the equations of motion and return the flight.

        Args:
            count: number n of steps.
            dt: time step [s].
            held: (2, f, n) mean noise and mean signal of each unknown force over each step [N].
            progress: called about a hundred times with the completed share, 0..1.
            start: initial state; when omitted, the scenario's start with its aerodynamic state warmed up.

        Raises:
            ShapeError: `held` or `start` has the wrong shape.
            SimulationError: the flight diverged; its attribute `kept` is the flight before that.
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
        hopeless = max(limit for limit, _ in LIMITS.values())

        def evaluate_stage(number: int, here: Array) -> tuple[Array, Array]:
            crba(model, data, here)
            nle(model, data, here, v)
            advance_stage(memory, motion, wind, held, dt, k, number, means, loads)
            return tangents

        for k in range(count):
            q = lie_step(evaluate_stage, retract, q)
            placement[k + 1], states[k + 1] = q[:7], fields.start
            if k % every == 0:
                if not np.all(np.abs(fields.start) <= hopeless):
                    break
                if progress is not None:
                    progress((k + 1) / count)
        sizes = [np.abs(part).max(axis=1, initial=0.0) for part in (states[:, :3], states[:, 3:6], states[:, 6:])]
        strips = StripLoads(*loads.swapaxes(0, 1))  # unlike `strips_of`, takes what is not finite
        sizes.append(np.append(strips.airspeed.max(axis=1, initial=0.0), 0.0))
        inside = [size <= limit for size, (limit, _) in zip(sizes, LIMITS.values(), strict=True)]
        outside = ~np.all(inside, axis=0)
        kept = int(np.argmax(outside)) if outside.any() else count + 1  # samples
        joints = motion[: 2 * kept : 2]
        flown = Flown(
            crank_angle=closed.crank_angle[: 2 * kept : 2],
            q=self.robot.configuration(placement[:kept], joints[:, 0, 0], joints[:, 0, 1]),
            v=self.robot.velocity(states[:kept, :BASE_SIZE], joints[:, 1, 0], joints[:, 1, 1]),
            air=states[:kept, BASE_SIZE:],
            forces=split_forces(fields.forces, means[: max(kept - 1, 0)]),
            loads=loads[: max(kept - 1, 0)],
        )
        if kept <= count:
            name = next(name for name, fine in zip(LIMITS, inside, strict=True) if not fine[kept])
            value = dict(zip(LIMITS, sizes, strict=True))[name][kept]
            before = max(kept - 1, 0)
            message = _divergence(kept * dt, name, value, placement[before], states[before])
            raise SimulationError(f"scenario {self.scenario.name}: {message}", kept * dt, flown if kept > 1 else None)
        return flown

    @guarded(time=("n",))
    def wind(self, time: Array) -> Array:
        """Return wind velocity and its rate of change (n, 2, 3), world axes [m/s, m/s2], at times (n,) [s]."""
        return wind_of(self.scenario.air).field(time)

    def _warmed_up(self, rotation: Array) -> State:
        """Return the initial state, its aerodynamic part warmed up over whole flaps at constant attitude and velocity.

        During this warm-up the crank follows its drive at times before zero. If the drive rests there, the aerodynamic
        state settles with the wings at rest.
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


def _divergence(time: float, name: str, value: float, placement: Array, state: Array) -> str:
    """Say when a flight diverged, which limit it passed, and the placement and state one step before."""
    limit, unit = LIMITS[name]
    x, v, w = (", ".join(f"{number:.3g}" for number in row[:3]) for row in (placement, state, state[3:]))
    return (
        f"the flight diverged at t = {time:.4f} s: {name} {value:.3g} {unit} is beyond the limit of {limit:g} {unit}; "
        f"before, the body was at {x} m, with {v} m/s and {w} rad/s in its axes; try a smaller simulation.dt, fewer "
        "air.strips, or gentler forces and speeds"
    )
