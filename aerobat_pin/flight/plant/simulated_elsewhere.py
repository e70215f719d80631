"""A flight whose motion another simulator integrates, under the air, thrusters and unknown forces of this package.

A step of the plant is cut into `EXCHANGES` equal parts. At the start of each, all forces are evaluated at the
simulator's motion, and given to it for the whole part:

    force = thrusters + unknown + (3 air_k - air_k-1) / 2         air = F + (M - H) a + (nle - h), see `plant`

The extrapolation to the part's middle makes the exchange of second order, for the state of the air likewise. The last
two terms are the wings' added mass. Its accelerations a are those that the equations of motion give at the simulator's
motion: ones that were measured would be a part old, and ring where added mass is large. So the simulator's inertia
moves the robot, and the plant's is asked for added mass alone. The log has the forces that were given, and the
simulator's torques.
"""

from __future__ import annotations

from typing import NamedTuple, Protocol

import numpy as np
import pinocchio as pin

from aerobat_pin.aerobat import BASE_SIZE
from aerobat_pin.errors import ScenarioError, SimulationError
from aerobat_pin.flight.plant.kernels import evaluate
from aerobat_pin.flight.plant.stepping import SteppedFlight
from aerobat_pin.flight.plant.tables import SimulatedPlant, State
from aerobat_pin.numerics import Array, shaped

EXCHANGES = 4  # an even number


class SimulatedMotion(NamedTuple):
    """Where a simulator's robot is at the end of a step.

    Attributes:
        q: (nq,) configuration as in `Aerobat.model`: position in world [m], quaternion xyzw, joints [rad].
        v: (nv,) velocity: of the body's centre of mass and of the body, in its axes [m/s, rad/s], of joints [rad/s].
        crank_angle: absolute crank angle t1 [rad].
        crank_rate: its rate [rad/s].
        torque: (4,) mean torque of the linkage on the joints over the step, in the order of `JOINTS` [N m].
    """

    q: Array
    v: Array
    crank_angle: float
    crank_rate: float
    torque: Array


class Simulator(Protocol):
    """What integrates the motion of the robot in the plant's place; gravity and the crank's motor are its own."""

    def start(self, q: Array, v: Array, crank_angle: float, crank_rate: float) -> None:
        """Begin a flight at a configuration (nq,), a velocity (nv,), and a crank angle [rad] with its rate [rad/s]."""

    def step(self, force: Array, crank_angle: float, crank_rate: float, dt: float) -> SimulatedMotion:
        """Fly on for a time.

        Args:
            force: (nv,) generalised force of all but gravity and motor: force and moment on the body at its centre of
                mass, body axes [N, N m], then torques at the joints [N m].
            crank_angle: what the motor should have turned the crank to at the end of this time [rad].
            crank_rate: its rate then [rad/s].
            dt: the time [s].
        """
        ...


class FlightElsewhere(SteppedFlight):
    """A flight of a plant whose motion a simulator integrates; other arguments as of `SteppedFlight`.

    Raises:
        ScenarioError: the scenario has a motor, elastic joints or a payload, of which the simulator knows nothing.
    """

    def __init__(
        self, plant: SimulatedPlant, step_means: Array, dt: float, start: State, endless: bool, simulator: Simulator
    ) -> None:
        if len(plant.crank_start) or plant.elastic.count or plant.scenario.plant.payload is not None or endless:
            raise ScenarioError(
                f"scenario {plant.scenario.name}: a simulator flies it: no crank.motor, plant.elbow, plant.shoulder, "
                "plant.payload or endless flight were expected"
            )
        super().__init__(plant, step_means, dt, start, endless)
        self.simulator, tables = simulator, self.tables
        tables.crank_angle, tables.crank_rate = tables.crank_angle.copy(), tables.crank_rate.copy()
        self._moved = SimulatedMotion(self.q, self.v, self.crank_angle, self.crank_rate, np.zeros(4))
        self._last: tuple[Array, Array] | None = None  # forces of the air and rate of its state, one part before
        self._crank_acceleration = 0.0
        simulator.start(self.q, self.v, self.crank_angle, self.crank_rate)

    def advance(self) -> None:
        """Fly the next interval."""
        tables, k = self.tables, self.done
        if k == tables.intervals:
            raise SimulationError(f"the flight has ended after {k} steps", self.time)
        for part in range(EXCHANGES * tables.parts):
            self._advance_part(k, part)
        q, v, angle, rate, _ = self._moved
        at, robot = 2 * tables.parts * (k + 1), self.plant.robot
        tables.motion[at, 0], tables.motion[at, 1] = _of_both_wings(q[list(robot.idx_q)], v[list(robot.idx_v)])
        tables.crank_angle[at], tables.crank_rate[at] = angle, rate
        self.q, self.plant.fields.v[:], self.done = q, v, k + 1
        tables.placement[k + 1], tables.states[k + 1] = q[:7], self.plant.fields.start

    def _advance_part(self, k: int, part: int) -> None:
        plant, tables, now = self.plant, self.tables, self._moved
        fields, robot, rows = plant.fields, plant.robot, list(plant.robot.idx_v)
        forces, state, air = fields.forces, fields.start, slice(BASE_SIZE, len(fields.start))
        parts, rate, joints = EXCHANGES * tables.parts, np.empty(len(fields.start)), np.empty((3, 2))
        dt, half = tables.dt / parts, 2 * (k * parts + part) // EXCHANGES
        joints[:2] = _of_both_wings(now.q[list(robot.idx_q)], now.v[rows])
        closed = robot.linkage.solve(now.crank_angle, now.crank_rate, self._crank_acceleration)
        joints[2] = closed.theta_s_ddot, closed.theta_e_ddot
        pin.crba(plant.model, plant.data, now.q)
        pin.nonLinearEffects(plant.model, plant.data, now.q, now.v)
        evaluate(plant.memory, joints, tables.wind[half], tables.step_means, k, state, rate)
        if part == 0:
            tables.loads[k] = fields.robot.loads
        blown = np.array([forces.aerodynamic, forces.added_mass])
        last, last_rate = self._last or (blown, rate[air])
        self._last = blown, rate[air]
        forces.aerodynamic[:], forces.added_mass[:] = given = 1.5 * blown - 0.5 * last
        driven = plant.closure(np.array([k * tables.dt + (part + 1) * dt]))
        crank = float(driven.crank_angle[0]), float(driven.crank_velocity[0])
        moved = self.simulator.step(given.sum(axis=0) + forces.thrusters + forces.unknown, *crank, dt)
        q, v = shaped(moved.q, now.q.shape, "SimulatedMotion.q"), shaped(moved.v, now.v.shape, "SimulatedMotion.v")
        self._moved = moved = SimulatedMotion(q, v, float(moved.crank_angle), float(moved.crank_rate), moved.torque)
        self._crank_acceleration = (moved.crank_rate - now.crank_rate) / dt
        forces.motor[:] = 0.0
        forces.motor[rows] = shaped(moved.torque, (len(rows),), "SimulatedMotion.torque")
        forces.motor_power[...] = forces.motor @ now.v
        forces.air_power[...] = given.sum(axis=0) @ now.v
        tables.means[k] += np.concatenate([force.ravel() for force in forces]) / EXCHANGES
        state[:BASE_SIZE] = moved.v[:BASE_SIZE]
        state[air] += dt * (1.5 * rate[air] - 0.5 * last_rate)


def _of_both_wings(*rows: Array) -> Array:
    """Return shoulder and elbow as means of both wings (n, 2), of rows (4,) in the order of `JOINTS`."""
    return np.asarray(np.array(rows).reshape(-1, 2, 2).mean(axis=1))
