"""A flight under way: one interval after the other, with a wrench on the body that may change between them."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
import pinocchio as pin

from aerobat_pin.aerobat import BASE_SIZE
from aerobat_pin.errors import SimulationError
from aerobat_pin.flight.crank import RateControlledMotor
from aerobat_pin.flight.plant.kernels import advance_stage
from aerobat_pin.flight.plant.plant_state import Forces, interval_means, split_forces
from aerobat_pin.flight.plant.tables import HOPELESS, FlightTables, SimulatedPlant, State, Trajectory, checked_flight
from aerobat_pin.numerics import Array, checked, lie_step, shaped


class SteppedFlight:
    """A flight of a plant, interval by interval; `endless` as of `Plant.start`, other arguments as of `FlightTables`.

    Attributes:
        q: (nq,) configuration after the last interval.
        done: number of intervals flown.
        tables: the tables of the last n intervals, or of all of them.
    """

    def __init__(self, plant: SimulatedPlant, step_means: Array, dt: float, start: State, endless: bool) -> None:
        self.plant, self.endless, self.done, self._window = plant, endless, 0, 0
        self._force: Array = np.zeros(step_means.shape[1])
        self._wind: Array = np.zeros(3)
        fields = plant.fields
        begin = np.concatenate([start.twist, start.air, start.crank, start.bent])
        fields.start[:] = fields.state[:] = shaped(begin, (len(fields.start),), "start")
        fields.command[:], fields.holds[...] = 0.0, plant.hold is not None
        if isinstance(plant.drive, RateControlledMotor):
            fields.motor.rate[...] = plant.drive.rate  # a flight before may have changed it
        self.tables = FlightTables(plant, step_means, dt, start)
        self.q = plant.robot.configuration(start.placement, *self.tables.motion[0, 0])
        fields.v[:] = plant.robot.velocity(start.twist, *self.tables.motion[0, 1])
        deflection, rate = plant.elastic.spread(start.bent.reshape(2, -1))
        self.q[list(plant.robot.idx_q)] += deflection
        fields.v[list(plant.robot.idx_v)] += rate
        self._lay_out()

    @property
    def v(self) -> Array:
        """Velocity (nv,) after the last interval."""
        return np.array(self.plant.fields.v)

    @property
    def time(self) -> float:
        """Time flown [s]."""
        return self.done * self.tables.dt

    @property
    def crank_angle(self) -> float:
        """Absolute crank angle t1 [rad] after the last interval."""
        return self._crank(0, self.tables.crank_angle)

    @property
    def crank_rate(self) -> float:
        """Rate of the crank [rad/s] after the last interval."""
        return self._crank(1, self.tables.crank_rate)

    def _crank(self, column: int, driven: Array) -> float:
        tables, at = self.tables, self.done - self._window
        free = tables.states[at, BASE_SIZE + self.plant.air.state_size :]
        return float(free[column] if tables.free else driven[2 * tables.parts * at])

    @property
    def is_hopeless(self) -> bool:
        """Whether the state has left all limits; the flight can end; `trajectory` says where it left the first one.

        A crank may turn as far as it likes.
        """
        state, air = self.plant.fields.start, BASE_SIZE + self.plant.air.state_size
        parts = state[:air], state[self.tables.bent]
        return not all(np.all(np.abs(part) <= HOPELESS) for part in parts)

    def push(self, wrench: Array) -> None:
        """Replace the attitude hold by a wrench (6,) on the body, at its centre of mass and in body axes."""
        fields = self.plant.fields
        ready = isinstance(wrench, np.ndarray) and wrench.shape == (BASE_SIZE,) and wrench.dtype == float
        fields.command[:] = wrench if ready else checked(wrench, BASE_SIZE, "command")
        fields.holds[...] = 0.0

    def disturb(self, force: Array, wind: Array) -> None:
        """From here on, add to the unknown forces (f,) [N] and to the wind (3,) [m/s]; no pilot knows of either."""
        self._add(force - self._force, wind - self._wind)
        self._force, self._wind = force.copy(), wind.copy()

    def _add(self, force: Array, wind: Array) -> None:
        tables, at = self.tables, self.done - self._window
        tables.step_means[1, :, at:] += force[:, None]
        tables.wind[2 * tables.parts * at :, 0] += wind

    def advance(self) -> None:
        """Fly the next interval."""
        tables, at = self.tables, self.done - self._window
        if at == tables.intervals:
            self._next_window()
            tables, at = self.tables, 0
        q, first = self.q, at * tables.parts
        for k in range(first, first + tables.parts):
            q = lie_step(self._stages(k), self._retract, q)
        self.q, self.done = q, self.done + 1
        tables.placement[at + 1], tables.states[at + 1] = q[:7], self.plant.fields.start

    def step(self) -> tuple[Array, Array]:
        """Fly the next interval and return q (nq,) and v (nv,). Raises SimulationError where the flight diverged."""
        self.advance()
        v = self.v
        if not v @ v < HOPELESS * HOPELESS:
            self.trajectory(self.done - self._window + 1)
        return self.q.copy(), v

    def trajectory(self, samples: int | None = None) -> Trajectory:
        """Return the flight so far, or its first samples. Raises SimulationError if it diverged."""
        return checked_flight(self.tables, self.done - self._window + 1 if samples is None else samples)

    def last_forces(self) -> Forces:
        """Return the means of all forces over the last interval, with n = 1."""
        tables, at = self.tables, self.done - self._window
        return split_forces(self.plant.fields.forces, tables.means[at - 1 : at] / tables.parts)

    def _lay_out(self) -> None:
        """Bind what every stage needs to a function of the step."""
        plant, tables = self.plant, self.tables
        model, data, memory, fields, v = plant.model, plant.data, plant.memory, plant.fields, plant.fields.v
        crba, nle, tangents = pin.crba, pin.nonLinearEffects, (fields.tangent[0], fields.tangent[1])
        motion, wind, step_means = tables.motion, tables.wind, tables.step_means
        means, loads = tables.means, tables.loads
        dt, parts, k = tables.step, tables.parts, 0

        def evaluate_stage(number: int, q: Array) -> tuple[Array, Array]:
            crba(model, data, q)
            nle(model, data, q, v)
            advance_stage(memory, motion, wind, step_means, dt, k, number, parts, means, loads)
            return tangents

        def stages(step: int) -> Callable[[int, Array], tuple[Array, Array]]:
            nonlocal k
            k = step
            return evaluate_stage

        self._stages: Any = stages
        self._retract = partial(pin.integrate, model)
        tables.placement[0], tables.states[0] = self.q[:7], fields.start

    def _next_window(self) -> None:
        """Begin the tables anew after their last interval."""
        if not self.endless:
            raise SimulationError(f"the flight has ended after {self.done} steps: endless=True goes on", self.time)
        plant, tables = self.plant, self.tables
        edges = (self.done + np.arange(tables.intervals + 1)) * tables.dt
        settings = plant.scenario.simulation
        step_means = interval_means(plant.forces, edges, settings.seed + self.done)
        air = BASE_SIZE + plant.air.state_size
        crank, bent = np.split(np.array(plant.fields.start[air:]), [len(plant.crank_start)])
        state = State(self.q[:7], plant.fields.start[:BASE_SIZE], np.zeros(0), crank, bent)
        self.tables, self._window = FlightTables(plant, step_means, tables.dt, state, self.done), self.done
        self._add(self._force, self._wind)
        self._lay_out()
