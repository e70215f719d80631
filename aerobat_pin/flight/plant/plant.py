"""The plant: the robot in its scenario; its equations of motion are one compiled call after Pinocchio's M and nle.

At each instant the air, the attitude hold and the unknown forces act on the links. Their wrenches are carried up the
kinematic tree and give the generalised force F. The crank's drive and the linkage prescribe the joint angles theta, so
the equations of motion, split into base rows (b) and joint rows (j), give the base acceleration a_b and the motor
torque u_m (see `prescribed_joints`):

    H_bb a_b = F_b - h_b - H_bj theta''          u_m = H_jb a_b + H_jj theta'' + h_j - F_j

H and h are Pinocchio's M and nle plus the contribution of the wings' added mass (see `added_mass`). If a motor turns
the crank, the crank's acceleration is one more unknown (see `aerobat_pin.flight.crank`), and theta'' follows. So is the
deflection of an elastic joint (see `aerobat_pin.flight.plant.elastic_joints`).

The kernel `advance_stage` is one stage of the integrator: it evaluates these equations, adds the forces to their means
over the step, and prepares the next stage.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pinocchio as pin

from aerobat_pin.aerobat import BASE_SIZE, LINK_COUNT, Aerobat, RobotInAir, joint_table, robot_air, wind_of
from aerobat_pin.errors import CrankError, SimulationError
from aerobat_pin.flight.attitude_hold import hold_about
from aerobat_pin.flight.crank import CrankDrive, RateControlledMotor, checked_motion, crank_drive
from aerobat_pin.flight.mujoco_robot import MujocoRobot
from aerobat_pin.flight.plant.elastic_joints import ElasticJoints, as_measured, loaded
from aerobat_pin.flight.plant.kernels import evaluate
from aerobat_pin.flight.plant.plant_state import Forces, PlantState, interval_means, point_forces, unknown_forces
from aerobat_pin.flight.plant.simulated_elsewhere import FlightElsewhere, Simulator
from aerobat_pin.flight.plant.stepping import SteppedFlight
from aerobat_pin.flight.plant.tables import State, Trajectory
from aerobat_pin.linkage import Closure, joint_series
from aerobat_pin.numerics import Array, fields_of, fill, guarded, new_state, number, shaped
from aerobat_pin.scenario import Scenario

START_ANGLES = 60  # crank angles in a turn at which the airspeeds of the start are computed
MODE_STEP_LIMIT = 2.0  # rate of the fastest mode times the step; the method is unstable from 2.785 on


class Plant:
    """The robot in its scenario, ready to be simulated.

    Args:
        robot: the robot.
        scenario: start, air, crank, attitude hold and unknown forces.
        drive: crank drive or motor that replaces the scenario's. A drive is also called with times before zero, while
            the aerodynamic state is warmed up.
        simulator: what integrates the motion in the plant's place, see `simulated_elsewhere`; what `plant.simulator`
            names when omitted.

    Raises:
        CrankError: the drive's angle, rate and acceleration do not agree.
        ScenarioError: a force acts at a frame that the robot does not have, or its direction is zero.
    """

    @guarded(simulator="free")
    def __init__(
        self,
        robot: Aerobat,
        scenario: Scenario,
        drive: CrankDrive | RateControlledMotor | None = None,
        simulator: Simulator | None = None,
    ) -> None:
        self._given, self.scenario, self.simulator = (robot, simulator), scenario, simulator
        if simulator is None and scenario.plant.simulator is not None:
            self.simulator = MujocoRobot(robot)
        self.robot = robot = loaded(robot, scenario.plant.payload)
        self.model = model = robot.model
        self.drive = crank_drive(scenario) if drive is None else drive
        self.forces = point_forces(model, scenario)
        self.points = tuple(dict.fromkeys(force.frame for force in self.forces))
        flight = scenario.flight
        rotation = pin.rpy.rpyToMatrix(*np.radians([flight.roll_deg, -flight.pitch_deg, flight.yaw_deg]))
        self.hold = hold_about(scenario, rotation) if scenario.control is None else None
        self.in_air = RobotInAir(robot, robot_air(robot.wing, scenario.flown_air))
        self.air, self.data = self.in_air.air, self.in_air.data
        motor = self.drive if isinstance(self.drive, RateControlledMotor) else None
        series = np.zeros((0, 4)) if motor is None else joint_series(robot.linkage)
        self.crank_start = np.zeros(0) if motor is None else motor.state
        self.elastic = ElasticJoints(robot, scenario.plant)
        states = self.air.state_size + len(self.crank_start) + 2 * self.elastic.count
        sizes = {"nv": model.nv, "states": BASE_SIZE + states, "harmonics": len(series), "link_count": LINK_COUNT}
        counts = {"e": self.elastic.count, "f": len(self.forces), "p": len(self.points)}
        self.memory = new_state(PlantState, robot=self.in_air.memory, **sizes, **counts)
        self.fields = fields_of(self.memory, PlantState)
        fill(self.fields.unknown, unknown_forces(model, self.forces, self.points))
        if self.hold is not None:
            fill(self.fields.hold, self.hold)
            self.fields.holds[...] = 1.0
        if motor is not None:
            fill(self.fields.motor, motor)
            self.fields.linkage[...] = series
        fields, elastic = self.fields, self.elastic
        fields.elastic[:], fields.stiffness[:], fields.damping[:] = elastic.links, elastic.stiffness, elastic.damping
        self.fastest_mode = 0.0  # [1/s] of the aerodynamic states at the start's largest airspeed
        self.initial = self._warmed_up(rotation)
        if self.elastic.count:
            self.initial = replace(self.initial, bent=self._settled())
        self.flight: SteppedFlight | None = None

    def __repr__(self) -> str:
        hold = "held" if self.hold is not None else "free"
        return (
            f"Plant({self.scenario.name!r}, {self.robot!r},\n"
            f"      {self.air!r},\n"
            f"      {type(self.drive).__name__}, {hold}, unknown forces at {list(self.points)})"
        )

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle and copy by building the plant anew, because views of Pinocchio's results cannot be pickled."""
        robot, simulator = self._given
        return type(self), (robot, self.scenario, self.drive, simulator)

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

    def evaluate(
        self, q: Array, v: Array, joints: Array, wind: Array, step_means: Array, state: Array, rate: Array
    ) -> None:
        """Evaluate the equations of motion without allocating; write the result to `rate` and `fields.forces`.

        The arguments are not checked, as `rates` does. Arrays must be contiguous, of doubles and of the shapes below;
        otherwise the kernel overwrites other memory.

        Args:
            q: (nq,) configuration.
            v: (nv,) velocity.
            joints: (3, 2) angle, rate and acceleration of shoulder and elbow; angle and rate as in q and v. With the
                crank's state, the acceleration is written.
            wind: (2, 3) wind velocity and its rate of change, world axes.
            step_means: (2, f, 1) mean noise and mean signal of each unknown force [N].
            state: (6 + 3N,) base twist in body axes, as in v, then the aerodynamic state; for a motor's flight four
                more with the state of its crank, for one on e elastic joints 2 e more, see `State`.
            rate: as `state`, written: base acceleration, and the rates of all other states.
        """
        pin.crba(self.model, self.data, q)
        pin.nonLinearEffects(self.model, self.data, q, v)
        evaluate(self.memory, joints, wind, step_means, 0, state, rate)

    @guarded(step_means=(2, "f", "n"), dt="positive")
    def start(
        self,
        step_means: Array | None = None,
        dt: float | None = None,
        start: State | None = None,
        *,
        endless: bool = False,
    ) -> tuple[Array, Array]:
        """Begin a flight of single steps; a plant flies one flight at a time.

        Args:
            step_means: (2, f, n) mean noise and mean signal of each unknown force over each of n intervals [N]; when
                omitted, those of the scenario.
            dt: length of an interval [s]; when omitted, the scenario's.
            start: initial state; when omitted, the scenario's start with its aerodynamic state warmed up.
            endless: whether the flight goes on after n intervals, in the same memory: the tables of the n intervals
                before are forgotten, and the noise of the unknown forces is drawn anew.

        Returns:
            Configuration q (nq,) and velocity v (nv,).

        Raises:
            ShapeError: `step_means` or `start` has the wrong shape.
        """
        settings = self.scenario.simulation
        dt = settings.dt if dt is None else dt
        if step_means is None:
            step_means = interval_means(self.forces, np.arange(settings.count + 1) * dt, settings.seed)
        step_means = shaped(step_means, (2, len(self.forces), step_means.shape[-1]), "step_means")
        begin = self.initial if start is None else start
        self.flight = (
            SteppedFlight(self, step_means, dt, begin, endless)
            if self.simulator is None
            else FlightElsewhere(self, step_means, dt, begin, endless, self.simulator)
        )
        return self.flight.q.copy(), self.flight.v

    def step(self, command: Array | None = None, crank_rate: float | None = None) -> tuple[Array, Array]:
        """Fly the next interval of the flight that `start` began.

        Args:
            command: (6,) wrench on the body over this interval, at its centre of mass and in body axes, force first
                [N, N m]; it replaces the attitude hold from here on. It is a known force of the log.
            crank_rate: rate [rad/s] that the crank's motor is to reach, from here on; needs `crank.drive = "motor"`.

        Returns:
            Configuration q (nq,) and velocity v (nv,) at the end of the interval.

        Raises:
            SimulationError: no flight has begun, or it has ended, or it diverged; then `kept` is the flight until then.
            CrankError: no motor turns the crank.
            ShapeError: `command` has the wrong shape.
        """
        flight = self.flight
        if flight is None:
            raise SimulationError("no flight has begun: start() must come before the first step()", 0.0)
        if command is not None:
            flight.push(command)
        if crank_rate is not None:
            if not isinstance(self.drive, RateControlledMotor):
                raise CrankError('crank_rate: no motor turns this crank; crank.drive = "motor" was expected')
            self.fields.motor.rate[...] = number(crank_rate, "crank_rate")
        return flight.step()

    @guarded(dt="positive")
    def fly(
        self,
        count: int,
        dt: float,
        step_means: Array,
        progress: Callable[[float], None] | None = None,
        start: State | None = None,
    ) -> Trajectory:
        """Integrate the equations of motion over n steps and return the flight.

        Args:
            count: number n of steps.
            dt: time step [s].
            step_means: (2, f, n) mean noise and mean signal of each unknown force over each step [N].
            progress: called about a hundred times with the completed share, 0..1.
            start: initial state; when omitted, the scenario's start with its aerodynamic state warmed up.

        Raises:
            ShapeError: `step_means` or `start` has the wrong shape.
            SimulationError: the flight diverged; its attribute `kept` is the flight before that.
        """
        self.start(shaped(step_means, (2, len(self.forces), count), "step_means"), dt, start)
        flight, every = self.flight, max(1, count // 100)
        assert flight is not None
        for k in range(count):
            flight.advance()
            if k % every == 0:
                if flight.is_hopeless:
                    break
                if progress is not None:
                    progress((k + 1) / count)
        return flight.trajectory()

    def as_measured(self) -> tuple[Array, Array, float]:
        """Return what exact sensors show now of q (nq,), v (nv,) and crank angle [rad], see `as_measured`."""
        flight = self.flight
        assert flight is not None
        angle, rate = np.array(flight.crank_angle), np.array(flight.crank_rate)
        q, v, shown = as_measured(self.scenario, self.robot, flight.q.copy(), flight.v, angle, rate)
        return q, v, float(shown)

    def substeps(self, dt: float) -> int:
        """Return the number of integration steps in an interval [s]: more where air or springs would be unstable."""
        return max(1, int(np.ceil(dt * self.fastest_mode / MODE_STEP_LIMIT - 1e-9)), self.elastic.substeps(dt))

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

    def _settled(self) -> Array:
        """Return deflections and their rates (2 e,) that the torques of rigid joints ask for at the start."""
        start, dt, means = self.initial, self.scenario.simulation.dt, np.zeros((2, len(self.forces)))
        deflections = []
        for joints in joint_table(self.closure(np.array([-dt, 0.0, dt]))):
            q, v = self.robot.configuration(start.placement, *joints[0]), self.robot.velocity(start.twist, *joints[1])
            torque = self.rates(q, v, joints, start.air, means)[2].motor[0, self.elastic.rows]
            deflections.append(-torque / self.elastic.stiffness)
        before, now, after = deflections
        return np.concatenate([now, (after - before) / (2.0 * dt)])
