"""The plant: the robot in its scenario; its equations of motion are one compiled call after Pinocchio's M and nle.

At each instant the air, the attitude hold and the unknown forces act on the links. Their wrenches are carried up the
kinematic tree and give the generalised force F. The crank's drive and the linkage prescribe the joint angles theta, so
the equations of motion, split into base rows (b) and joint rows (j), give the base acceleration a_b and the motor
torque u_m (see `prescribed_joints`):

    H_bb a_b = F_b - h_b - H_bj theta''          u_m = H_jb a_b + H_jj theta'' + h_j - F_j

H and h are Pinocchio's M and nle plus the contribution of the wings' added mass (see `added_mass`). If a motor turns
the crank, the crank's acceleration is one more unknown (see `aerobat_pin.flight.crank.motor`), and theta'' follows.

The kernel `advance_stage` is one stage of the integrator: it evaluates these equations, adds the forces to their means
over the step, and prepares the next stage.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import numpy as np
import pinocchio as pin

from aerobat_pin.aerodynamics import LARGEST_AIRSPEED, STRIP_ROWS, RobotInAir, StripLoads, fill
from aerobat_pin.errors import SimulationError
from aerobat_pin.flight.air_from_scenario import robot_air, wind_of
from aerobat_pin.flight.attitude_hold import hold_about
from aerobat_pin.flight.crank import CrankDrive, RateControlledMotor, checked_motion, crank_drive
from aerobat_pin.flight.plant.kernels import advance_stage, evaluate
from aerobat_pin.flight.plant.memory import Forces, plant_in, split_forces, unknown_forces
from aerobat_pin.flight.point_forces import point_forces
from aerobat_pin.linkage import Closure, joint_series
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
START_ANGLES = 60  # crank angles in a turn at which the airspeeds of the start are computed
MODE_STEP_LIMIT = 2.0  # rate of the fastest mode times the step; the method is unstable from 2.785 on


@dataclass(frozen=True)
class State:
    """A state of the plant: base placement (7,), base twist (6,) in body axes, aerodynamic state (3N,), and the crank.

    `crank` (4,) is the state of a crank that a motor turns: angle, rate, motor torque, integral; (0,) for other drives.
    """

    placement: Array
    twist: Array
    air: Array
    crank: Array = field(default_factory=lambda: np.zeros(0))


@dataclass(frozen=True)
class Flown:
    """A simulated flight of n equal intervals, as arrays: samples at the n + 1 edges, means over the n intervals.

    Attributes:
        crank_angle, crank_rate: (n + 1,) absolute crank angle t1 [rad] and its rate [rad/s].
        q, v: configuration (n + 1, nq) and velocity (n + 1, nv).
        air: (n + 1, 3N) aerodynamic state.
        forces: means of all forces over the intervals.
        loads: (n, 9, N) strip loads at the start of each interval; `strips_of` names the rows.
    """

    crank_angle: Array
    crank_rate: Array
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
        drive: crank drive or motor that replaces the scenario's. A drive is also called with times before zero, while
            the aerodynamic state is warmed up.

    Raises:
        CrankError: the drive's angle, rate and acceleration do not agree.
        ScenarioError: a force acts at a frame that the robot does not have, or its direction is zero.
    """

    @guarded()
    def __init__(
        self, robot: Aerobat, scenario: Scenario, drive: CrankDrive | RateControlledMotor | None = None
    ) -> None:
        """Build air, attitude hold and unknown forces, and lay out the kernel's memory."""
        self.robot, self.scenario = robot, scenario
        self.model = model = robot.model
        self.drive = crank_drive(scenario) if drive is None else drive
        self.forces = point_forces(model, scenario)
        self.points = tuple(dict.fromkeys(force.frame for force in self.forces))
        flight = scenario.flight
        rotation = pin.rpy.rpyToMatrix(*np.radians([flight.roll_deg, -flight.pitch_deg, flight.yaw_deg]))
        self.hold = hold_about(scenario, rotation)
        self.in_air = RobotInAir(robot, robot_air(robot.wing, scenario.air))
        self.air, self.data = self.in_air.air, self.in_air.data
        motor = self.drive if isinstance(self.drive, RateControlledMotor) else None
        series = np.zeros((0, 4)) if motor is None else joint_series(robot.linkage)
        self.crank_start = np.zeros(0) if motor is None else motor.state
        states = self.air.state_size + len(self.crank_start)
        sizes = (model.nv, states, len(series), len(self.forces), len(self.points))
        self.memory = new_memory(plant_in, self.in_air.memory.ctypes.data, *sizes)
        self.fields = fields_of(plant_in, self.memory)
        fill(self.fields.unknown, unknown_forces(model, self.forces, self.points))
        if self.hold is not None:
            fill(self.fields.hold, self.hold)
            self.fields.holds[...] = 1.0
        if motor is not None:
            fill(self.fields.motor, motor)
            self.fields.linkage[...] = series
        self.fastest_mode = 0.0  # [1/s] of the aerodynamic states at the start's largest airspeed
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
        """Close the linkage at the crank angles that the drive gives for times (n,) [s]; with a motor, up to 0 s."""
        drive = self.drive.before if isinstance(self.drive, RateControlledMotor) else self.drive
        return self.robot.linkage.solve(*checked_motion(drive, time))

    @guarded()
    def rates(
        self, q: Array, v: Array, joints: Array, air: Array, held: Array, time: float = 0.0
    ) -> tuple[Array, Array, Forces]:
        """Evaluate the equations of motion at one instant, with joints that accelerate as given.

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
            joints: (3, 2) angle, rate and acceleration of shoulder and elbow; angle and rate as in q and v. With the
                crank's state, the acceleration is written.
            wind: (2, 3) wind velocity and its rate of change, world axes.
            held: (2, f, 1) mean noise and mean signal of each unknown force [N].
            state: (6 + 3N,) base twist in body axes, as in v, then the aerodynamic state; for a motor's flight
                (6 + 3N + 4,) with the state of its crank.
            rate: as `state`, written: base acceleration, rate of the aerodynamic state, rate of the crank's state.
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
        intervals, parts = count, self.substeps(dt)
        count, dt = count * parts, dt / parts
        model, data, memory, fields = self.model, self.data, self.memory, self.fields
        halves = np.arange(2 * count + 1) * 0.5 * dt
        wind, size, free = self.wind(halves), len(fields.start), len(self.crank_start) > 0
        begin = np.concatenate([start.twist, start.air, start.crank])
        fields.start[:] = fields.state[:] = shaped(begin, (size,), "start")
        # A free crank's flight writes its own motion after the first row.
        closed = (
            self.robot.linkage.solve(*np.tile(start.crank[:2, None], len(halves))) if free else self.closure(halves)
        )
        motion = joint_table(closed)
        q, v = self.robot.configuration(start.placement, *motion[0, 0]), fields.v
        v[:] = self.robot.velocity(start.twist, *motion[0, 1])
        means = np.zeros((intervals, sum(part.size for part in fields.forces)))
        loads = np.zeros((intervals, STRIP_ROWS, self.air.line.strips))
        placement, states = np.zeros((intervals + 1, 7)), np.zeros((intervals + 1, size))
        placement[0], states[0] = q[:7], fields.start
        crba, nle, retract = pin.crba, pin.nonLinearEffects, partial(pin.integrate, model)
        tangents, every = (fields.tangent[0], fields.tangent[1]), max(1, count // 100)
        hopeless = max(limit for limit, _ in LIMITS.values())

        def evaluate_stage(number: int, here: Array) -> tuple[Array, Array]:
            crba(model, data, here)
            nle(model, data, here, v)
            advance_stage(memory, motion, wind, held, dt, k, number, parts, means, loads)
            return tangents

        for k in range(count):
            q = lie_step(evaluate_stage, retract, q)
            at = k // parts + 1
            placement[at], states[at] = q[:7], fields.start
            if k % every == 0:
                if not np.all(np.abs(fields.start) <= hopeless):
                    break
                if progress is not None:
                    progress((k + 1) / count)
        air = BASE_SIZE + self.air.state_size
        sizes = [np.abs(part).max(axis=1, initial=0.0) for part in np.split(states[:, :air], [3, 6], axis=1)]
        strips = StripLoads(*loads.swapaxes(0, 1))  # unlike `strips_of`, takes what is not finite
        sizes.append(np.append(strips.airspeed.max(axis=1, initial=0.0), 0.0))
        inside = [size <= limit for size, (limit, _) in zip(sizes, LIMITS.values(), strict=True)]
        outside = ~np.all(inside, axis=0)
        kept = int(np.argmax(outside)) if outside.any() else intervals + 1  # samples
        samples, whole = slice(None, 2 * parts * kept, 2 * parts), slice(max(kept - 1, 0))
        joints, crank = motion[samples], (closed.crank_angle[samples], closed.crank_velocity[samples])
        if free:
            crank = (states[:kept, air], states[:kept, air + 1])
        flown = Flown(
            crank_angle=crank[0],
            crank_rate=crank[1],
            q=self.robot.configuration(placement[:kept], joints[:, 0, 0], joints[:, 0, 1]),
            v=self.robot.velocity(states[:kept, :BASE_SIZE], joints[:, 1, 0], joints[:, 1, 1]),
            air=states[:kept, BASE_SIZE:air],
            forces=split_forces(fields.forces, means[whole] / parts),
            loads=loads[whole],
        )
        if kept <= intervals:
            name = next(name for name, fine in zip(LIMITS, inside, strict=True) if not fine[kept])
            value, when = dict(zip(LIMITS, sizes, strict=True))[name][kept], kept * dt * parts
            told = _divergence(when, name, value, placement[whole.stop], states[whole.stop])
            raise SimulationError(f"scenario {self.scenario.name}: {told}", when, flown if kept > 1 else None)
        return flown

    def substeps(self, dt: float) -> int:
        """Return the number of integration steps in an interval [s]: more than one where the air would be unstable."""
        return max(1, int(np.ceil(dt * self.fastest_mode / MODE_STEP_LIMIT - 1e-9)))

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
        against = twist - np.concatenate([wind, np.zeros(3)])
        if self.air.state_size:
            turn = joint_table(self.robot.linkage.solve(np.linspace(0.0, 2.0 * np.pi, START_ANGLES), rate))
            airspeed = np.max(self.air.airspeed(self.in_air.flapping_twists(placement, against, turn)))
            self.fastest_mode = float(airspeed) * self.air.line.fastest_mode
        if rate == 0.0 or air.warm_up_cycles == 0 or not self.air.state_size:
            return State(placement, twist, np.zeros(self.air.state_size), self.crank_start)
        period = 2.0 * np.pi / rate
        step = self.scenario.simulation.dt
        count = int(np.ceil(air.warm_up_cycles * period / step * self.substeps(step)))
        dt = air.warm_up_cycles * period / count
        motion = joint_table(self.closure((np.arange(2 * count + 1) * 0.5 - count) * dt))
        return State(placement, twist, self.in_air.warmed_up(placement, against, motion, dt), self.crank_start)


def _divergence(time: float, name: str, value: float, placement: Array, state: Array) -> str:
    """Say when a flight diverged, which limit it passed, and the placement and state one step before."""
    limit, unit = LIMITS[name]
    x, v, w = (", ".join(f"{number:.3g}" for number in row[:3]) for row in (placement, state, state[3:]))
    return (
        f"the flight diverged at t = {time:.4f} s: {name} {value:.3g} {unit} is beyond the limit of {limit:g} {unit}; "
        f"before, the body was at {x} m, with {v} m/s and {w} rad/s in its axes; try a smaller simulation.dt, fewer "
        "air.strips, or gentler forces and speeds"
    )
