"""From a scenario to a flight log: the plant's equations of motion, stepped through time."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import pinocchio as pin
import xarray as xr

from aerobat_pin.aerodynamics import RobotAir, StripLoads
from aerobat_pin.arrays import Array
from aerobat_pin.disturbances import PaperSignal, PointForce
from aerobat_pin.dynamics import BASE, prescribed_joint_dynamics
from aerobat_pin.errors import ScenarioError, SimulationError
from aerobat_pin.flight_log import KNOWN, FlightLog, channel
from aerobat_pin.frames import frame_id
from aerobat_pin.hold import AttitudeHold
from aerobat_pin.integrators import stage_mean, step
from aerobat_pin.linkage import Closure
from aerobat_pin.robot import JOINTS, Aerobat, load_aerobat
from aerobat_pin.scenario import Scenario
from aerobat_pin.wing import LINKS

Progress = Callable[[float], None]
Q_AXIS = ("x", "y", "z", "qx", "qy", "qz", "qw")
V_AXIS = ("vx", "vy", "vz", "wx", "wy", "wz")


class Forces(NamedTuple):
    """What acts at one instant; averaged over a step by the integrator's weights.

    `aerodynamic`, `thrusters`, `motor`, `unknown` are generalised forces (nv,); `force_W` and `force_noise_free_W`
    (n, 3) [N] the unknown forces at their points in world axes; `motor_power` [W] their motor torque times joint rates.
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


class Plant:
    """The robot in its scenario: the right-hand side of its equations of motion.

    Raises:
        ScenarioError: a force acts at a frame that the robot does not have, or in no direction.
    """

    def __init__(self, robot: Aerobat, scenario: Scenario) -> None:
        """Build air, hold and unknown forces."""
        self.robot, self.scenario = robot, scenario
        self.model = robot.model.copy()
        self.model.gravity.linear = np.array([0.0, 0.0, -scenario.flight.gravity])
        self.data = self.model.createData()
        self.air = RobotAir(robot.wing, strips=scenario.air.strips, air_density=scenario.air.density)
        self.crank_rate = 2.0 * np.pi * scenario.crank.frequency
        self.crank_start = np.radians(scenario.crank.start_deg)
        self.forces = _point_forces(self.model, scenario)
        self.points = tuple(dict.fromkeys(force.frame for force in self.forces))
        self._joints = [self.model.frames[self.model.getFrameId(link)].parentJoint for link in LINKS]
        self._frames = {name: self.model.frames[frame_id(self.model, name)] for name in self.points}
        self.start = self._start()
        self.hold = _hold(scenario, self.start)

    def closure(self, time: Array) -> Closure:
        """Close the linkage at times (n,) [s] of the crank's steady turn."""
        return self.robot.linkage.solve(self.crank_start + self.crank_rate * time, self.crank_rate)

    def rates(self, joints: Array, state: State, noise: Array, steps: Array) -> tuple[Array, Array, Forces, StripLoads]:
        """Evaluate the equations of motion.

        Args:
            joints: (3, 2) angle, rate and acceleration of shoulder and elbow [rad, rad/s, rad/s2].
            state: base and air.
            noise: (n,) held noise of every unknown force [N].
            steps: (n,) their held steps [N].

        Returns:
            Base acceleration (6,) in body axes, rate of the air's state, forces, strip loads.
        """
        robot, model, data = self.robot, self.model, self.data
        q = robot.configuration(state.placement, *joints[0])
        v = robot.velocity(state.twist, *joints[1])
        M = pin.crba(model, data, q)
        nle = pin.nonLinearEffects(model, data, q, v)
        pin.computeJointJacobians(model, data, q)
        jacobians = [pin.getJointJacobian(model, data, j, pin.ReferenceFrame.LOCAL) for j in self._joints]
        wrenches, air_rate, strips = self.air.evaluate(np.array([data.v[j].vector for j in self._joints]), state.air)
        aerodynamic = np.concatenate(jacobians).T @ wrenches.ravel()
        thrusters = np.zeros(model.nv)
        if self.hold is not None:
            body = data.oMi[1]
            thrusters[:BASE] = self.hold.wrench(body.translation, body.rotation, state.twist)
        unknown, force_W, clean_W = self._unknown(float(joints[0, 1]), noise, steps)
        acceleration, motor = prescribed_joint_dynamics(
            M, nle, aerodynamic + thrusters + unknown, robot.velocity(np.zeros(6), *joints[2])[BASE:]
        )
        power = np.array(motor[BASE:] @ v[BASE:])
        return (
            acceleration[:BASE],
            air_rate,
            Forces(aerodynamic, thrusters, motor, unknown, force_W, clean_W, power),
            strips,
        )

    def _unknown(self, elbow_angle: float, noise: Array, steps: Array) -> tuple[Array, Array, Array]:
        """Return the generalised force (nv,), and force and noise-free force (n, 3) at the points in world axes."""
        model, data = self.model, self.data
        force_W = np.zeros((len(self.points), 3))
        clean_W = np.zeros_like(force_W)
        for i, force in enumerate(self.forces):
            frame = self._frames[force.frame]
            rotation = data.oMi[frame.parentJoint].rotation @ frame.placement.rotation
            direction = force.direction_W(rotation, data.oMi[1].rotation)
            clean = force.signal.smooth(elbow_angle) + steps[i]
            point = self.points.index(force.frame)
            clean_W[point] += clean * direction
            force_W[point] += (clean + noise[i]) * direction
        generalized = np.zeros(model.nv)
        for point, name in enumerate(self.points):
            frame = self._frames[name]
            joint = frame.parentJoint
            local = pin.Force(data.oMi[joint].rotation.T @ force_W[point], np.zeros(3))
            wrench = pin.SE3(np.eye(3), frame.placement.translation).act(local)
            jacobian = pin.getJointJacobian(model, data, joint, pin.ReferenceFrame.LOCAL)
            generalized += jacobian.T @ wrench.vector
        return generalized, force_W, clean_W

    def _start(self) -> State:
        """Return the start, the air warmed up over whole cycles with the body held at its attitude and velocity."""
        flight, air = self.scenario.flight, self.scenario.air
        angles = np.radians([flight.roll_deg, -flight.pitch_deg, flight.yaw_deg])
        rotation = pin.rpy.rpyToMatrix(*angles)
        placement = np.concatenate([flight.position, pin.Quaternion(rotation).coeffs()])
        twist = np.concatenate([rotation.T @ np.array(flight.velocity), np.zeros(3)])
        state: Array = np.zeros(self.air.state_size)
        if self.crank_rate == 0.0 or air.warm_up_cycles == 0:
            return State(placement, twist, state)
        period = 2.0 * np.pi / self.crank_rate
        count = int(np.ceil(air.warm_up_cycles * period / self.scenario.simulation.dt))
        dt = air.warm_up_cycles * period / count
        motion = joint_table(self.closure((np.arange(2 * count + 1) * 0.5 - count) * dt))

        def held(time: float, _: Array, y: Array) -> tuple[Array, Array, None]:
            joints = motion[round(2.0 * time / dt)]
            q = self.robot.configuration(placement, *joints[0])
            pin.forwardKinematics(self.model, self.data, q, self.robot.velocity(twist, *joints[1]))
            twists = np.array([self.data.v[j].vector for j in self._joints])
            return np.zeros(0), self.air.evaluate(twists, y)[1], None

        for k in range(count):
            _, state, _ = step(held, lambda q, _: q, k * dt, np.zeros(0), state, dt)
        return State(placement, twist, state)


def simulate(scenario: Scenario, progress: Progress | None = None) -> FlightLog:
    """Fly a scenario.

    Args:
        scenario: what happens.
        progress: called with the share done, 0..1, about a hundred times.

    Raises:
        ScenarioError, MorphologyFileError, LinkageError: the scenario asks for what the robot cannot do.
        SimulationError: the flight diverged.
    """
    settings = scenario.simulation
    robot = load_aerobat(scenario.robot.morphology, scenario.robot.changes)
    plant = Plant(robot, scenario)
    count = max(1, round(settings.duration / settings.dt))
    dt = settings.duration / count
    edges = np.arange(count + 1) * dt
    motion = joint_table(plant.closure(np.arange(2 * count + 1) * 0.5 * dt))
    noise, steps = _held_parts(plant.forces, edges, settings.seed)
    retract = pin.liegroups.SE3().integrate

    placement, y = plant.start.placement, np.concatenate([plant.start.twist, plant.start.air])
    placements, states = [placement], [y]
    means: list[Forces] = []
    strips: list[StripLoads] = []
    for k in range(count):

        def rates(time: float, q: Array, y: Array, k: int = k) -> tuple[Array, Array, tuple[Forces, StripLoads]]:
            joints = motion[round(2.0 * time / dt)]
            state = State(q, y[:BASE], y[BASE:])
            acceleration, air_rate, forces, loads = plant.rates(joints, state, noise[:, k], steps[:, k])
            return state.twist, np.concatenate([acceleration, air_rate]), (forces, loads)

        placement, y, outputs = step(rates, retract, k * dt, placement, y, dt)
        if not np.all(np.isfinite(y)):
            raise SimulationError(f"scenario {scenario.name}: the flight diverged at t = {(k + 1) * dt:.4f} s")
        placements.append(placement)
        states.append(y)
        means.append(Forces(*(stage_mean(values) for values in zip(*(forces for forces, _ in outputs), strict=True))))
        strips.append(outputs[0][1])
        if progress is not None and k % max(1, count // 100) == 0:
            progress((k + 1) / count)
    return _flight_log(plant, edges, motion[::2], np.array(placements), np.array(states), means, strips)


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


def _point_forces(model: pin.Model, scenario: Scenario) -> tuple[PointForce, ...]:
    forces = []
    for i, section in enumerate(scenario.unknown_force):
        if not model.existFrame(section.frame):
            known = ", ".join(frame.name for frame in model.frames if frame.name != "universe")
            raise ScenarioError(f"unknown_force.{i}.frame = '{section.frame}': the robot's frames are {known}")
        size = float(np.linalg.norm(section.direction))
        if size == 0.0:
            raise ScenarioError(f"unknown_force.{i}.direction = {section.direction}: a direction is not zero")
        signal = PaperSignal(
            section.amplitude, section.noise, section.step, section.step_start, section.step_end, section.tick
        )
        forces.append(PointForce(section.frame, np.array(section.direction) / size, section.axes, signal))
    return tuple(forces)


def _held_parts(forces: tuple[PointForce, ...], edges: Array, seed: int) -> tuple[Array, Array]:
    """Draw noise and step of every force (n, intervals), each from a stream of its own, by its place in the list."""
    drawn = [force.signal.held(edges, np.random.default_rng([seed, i])) for i, force in enumerate(forces)]
    empty = np.zeros((0, len(edges) - 1))
    if not drawn:
        return empty, empty
    return np.array([noise for noise, _ in drawn]), np.array([steps for _, steps in drawn])


def _hold(scenario: Scenario, start: State) -> AttitudeHold | None:
    if scenario.hold is None:
        return None
    gains = scenario.hold
    return AttitudeHold(
        rotation=pin.Quaternion(start.placement[3:]).matrix(),
        forward_speed=scenario.flight.velocity[0],
        height=scenario.flight.position[2],
        attitude_stiffness=np.array(gains.attitude_stiffness),
        attitude_damping=np.array(gains.attitude_damping),
        torque_limit=np.array(gains.torque_limit),
        speed_gain=gains.speed_gain,
        thrust_limit=gains.thrust_limit,
        lift=gains.lift,
        height_stiffness=gains.height_stiffness,
        height_damping=gains.height_damping,
        lift_limit=gains.lift_limit,
    )


def _flight_log(
    plant: Plant,
    time: Array,
    joints: Array,
    placements: Array,
    states: Array,
    means: list[Forces],
    strips: list[StripLoads],
) -> FlightLog:
    robot, scenario = plant.robot, plant.scenario
    q = robot.configuration(placements, joints[:, 0, 0], joints[:, 0, 1])
    v = robot.velocity(states[:, :BASE], joints[:, 1, 0], joints[:, 1, 1])
    names = [robot.model.names[robot.model.getJointId(name)] for name in JOINTS]
    order = [name for _, name in sorted(zip(robot.idx_v, names, strict=True))]
    mean = {field: np.array([getattr(forces, field) for forces in means]) for field in Forces._fields}
    per_sample, per_interval = ("time",), ("interval",)
    generalized = (*per_interval, "v_axis")
    coords = {
        "time": channel(time, per_sample, "s", "sample time"),
        "interval": channel(time[:-1], per_interval, "s", "start of the interval"),
    }
    measured = xr.Dataset(
        {
            "q": channel(q, ("time", "q_axis"), "m, -, rad", "configuration: position in world, quaternion, joints"),
            "v": channel(v, ("time", "v_axis"), "m/s, rad/s", "velocity: body twist in body axes, joint rates"),
            "crank_angle": channel(
                plant.crank_start + plant.crank_rate * time, per_sample, "rad", "absolute crank angle t1"
            ),
            "motor_torque": channel(mean["motor"], generalized, "N m", "motor torque at the joints, interval mean"),
            f"{KNOWN}aerodynamic": channel(
                mean["aerodynamic"], generalized, "N, N m", "aerodynamic generalised force, interval mean"
            ),
            f"{KNOWN}thrusters": channel(
                mean["thrusters"], generalized, "N, N m", "attitude hold's generalised force, interval mean"
            ),
        },
        coords={**coords, "q_axis": [*Q_AXIS, *order], "v_axis": [*V_AXIS, *order]},
        attrs={
            "scenario": scenario.name,
            "morphology": scenario.robot.morphology,
            "morphology_changes": json.dumps(scenario.robot.changes),
            "gravity": scenario.flight.gravity,
            "torque": "measured",
        },
    )
    at_point = (*per_interval, "point", "axis")
    strip = (*per_interval, "strip")
    truth = xr.Dataset(
        {
            "force_W": channel(mean["force_W"], at_point, "N", "unknown force in world axes, interval mean"),
            "force_noise_free_W": channel(
                mean["force_noise_free_W"], at_point, "N", "unknown force without its noise, interval mean"
            ),
            "unknown": channel(mean["unknown"], generalized, "N, N m", "unknown generalised force, interval mean"),
            "motor_power": channel(mean["motor_power"], per_interval, "W", "motor power, interval mean"),
            "air_state": channel(states[:, BASE:], ("time", "air_axis"), "m, m, m2/s", "zeta_1, zeta_2, circulation"),
            "incidence": channel([s.incidence for s in strips], strip, "rad", "incidence at the 3/4 chord, at start"),
            "strip_force_z": channel([s.force_z for s in strips], strip, "N", "force along the link's z, at start"),
            "strip_force_x": channel([s.force_x for s in strips], strip, "N", "force along the link's x, at start"),
        },
        coords={
            **coords,
            "v_axis": [*V_AXIS, *order],
            "point": list(plant.points),
            "axis": ["x", "y", "z"],
            "strip": channel(plant.air.line.y, ("strip",), "m", "arc coordinate, left wing positive"),
        },
    )
    stepped = [force.signal for force in plant.forces if force.signal.step != 0.0]
    if stepped:
        truth.attrs["step_zone"] = [stepped[0].step_start, stepped[0].step_end]
    return FlightLog(measured, truth)
