"""The tables of a flight, which the integrator reads and writes at every step, and the flight that they make.

A flight has diverged where it passes one of `LIMITS`.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np
import pinocchio as pin

from aerobat_pin.aerobat import BASE_SIZE, Aerobat, RobotAir, joint_table
from aerobat_pin.aerodynamics import LARGEST_AIRSPEED, STRIP_ROWS, StripLoads
from aerobat_pin.errors import SimulationError
from aerobat_pin.flight.attitude_hold import AttitudeHold
from aerobat_pin.flight.crank import CrankDrive, RateControlledMotor
from aerobat_pin.flight.plant.elastic_joints import ElasticJoints
from aerobat_pin.flight.plant.plant_state import Forces, PointForce, split_forces
from aerobat_pin.linkage import Closure
from aerobat_pin.numerics import Array
from aerobat_pin.scenario import Scenario

# Beyond these limits a flight has diverged.
LIMITS = {
    "velocity": (1e3, "m/s"),
    "angular velocity": (1e4, "rad/s"),
    "aerodynamic state": (1e3, "m or m2/s"),
    "deflection of an elastic joint": (np.pi, "rad"),
    "airspeed of a strip": (LARGEST_AIRSPEED, "m/s"),
}
HOPELESS = max(limit for limit, _ in LIMITS.values())  # nothing that has a limit is larger within it


class SimulatedPlant(Protocol):
    """What a flight needs of the plant that flies: see `aerobat_pin.flight.plant.plant.Plant`."""

    robot: Aerobat
    scenario: Scenario
    model: pin.Model
    data: pin.Data
    air: RobotAir
    drive: CrankDrive | RateControlledMotor
    forces: tuple[PointForce, ...]
    hold: AttitudeHold | None
    crank_start: Array
    elastic: ElasticJoints
    memory: Array
    fields: Any

    def substeps(self, dt: float) -> int:
        """Return the number of integration steps in an interval [s]."""
        ...

    def wind(self, time: Array) -> Array:
        """Return wind velocity and its rate of change (n, 2, 3), world axes."""
        ...

    def closure(self, time: Array) -> Closure:
        """Close the linkage at the crank angles of times (n,) [s]."""
        ...


@dataclass(frozen=True)
class State:
    """A state of the plant: base placement (7,), base twist (6,) in body axes, aerodynamic state (3N,), and what moves.

    `crank` (4,) is the state of a crank that a motor turns: angle, rate, motor torque, integral; (0,) for other drives.
    `bent` (2 e,) are the deflections of e elastic joints [rad] and their rates [rad/s].
    """

    placement: Array
    twist: Array
    air: Array
    crank: Array = field(default_factory=lambda: np.zeros(0))
    bent: Array = field(default_factory=lambda: np.zeros(0))


@dataclass(frozen=True)
class Trajectory:
    """A simulated flight of n equal intervals, as arrays: samples at the n + 1 edges, means over the n intervals.

    Attributes:
        crank_angle, crank_rate: (n + 1,) absolute crank angle t1 [rad] and its rate [rad/s].
        q, v: configuration (n + 1, nq) and velocity (n + 1, nv).
        deflection: (n + 1, 4) angles by which elastic joints differ from the linkage, in the order of `JOINTS` [rad].
        air: (n + 1, 3N) aerodynamic state.
        forces: means of all forces over the intervals.
        loads: (n, 9, N) strip loads at the start of each interval; `strips_of` names the rows.
    """

    crank_angle: Array
    crank_rate: Array
    q: Array
    v: Array
    deflection: Array
    air: Array
    forces: Forces
    loads: Array


class FlightTables:
    """The tables of n intervals, each integrated in equal steps; "half" marks tables with a row at every half step.

    Args:
        plant: the plant that flies.
        step_means: (2, f, n) mean noise and mean signal of each unknown force [N].
        dt: length of an interval [s].
        start: state at the beginning.
        before: intervals flown before; the drive and the wind are tabulated for the time after them.

    Attributes:
        motion: (half, 3, 2) angle, rate and acceleration of shoulder and elbow. A free crank's flight writes its own
            motion after the first row.
        crank_angle, crank_rate: (half,) of a crank that a drive turns [rad, rad/s].
        wind: (half, 2, 3) velocity of the air and its rate of change, world axes [m/s, m/s2].
        means: (n, size) sums of the forces' means over the steps of an interval, see `split_forces`.
        loads: (n, 9, N) strip loads at the start of each interval.
        placement, states: (n + 1, 7) and (n + 1, 6 + S) at the intervals' edges.
        bent: columns of the elastic joints' deflections in `states`.
    """

    def __init__(self, plant: SimulatedPlant, step_means: Array, dt: float, start: State, before: int = 0) -> None:
        self.plant, self.step_means, self.dt = plant, step_means, dt
        self.intervals, self.parts = step_means.shape[2], plant.substeps(dt)
        steps, self.step = self.intervals * self.parts, dt / self.parts
        first = 2 * before * self.parts
        halves = np.arange(first, first + 2 * steps + 1) * 0.5 * self.step
        self.free = len(plant.crank_start) > 0
        self.wind = plant.wind(halves)
        closed = (
            plant.robot.linkage.solve(*np.tile(start.crank[:2, None], len(halves)))
            if self.free
            else plant.closure(halves)
        )
        self.crank_angle, self.crank_rate = closed.crank_angle, closed.crank_velocity
        self.motion = joint_table(closed)
        size = len(plant.fields.start)
        self.means = np.zeros((self.intervals, sum(part.size for part in plant.fields.forces)))
        self.loads = np.zeros((self.intervals, STRIP_ROWS, plant.air.line.strips))
        self.placement, self.states = np.zeros((self.intervals + 1, 7)), np.zeros((self.intervals + 1, size))
        self.bent = slice(size - 2 * plant.elastic.count, size - plant.elastic.count)

    def trajectory(self, kept: int) -> Trajectory:
        """Return the first samples of the flight, of which there are `kept`."""
        robot, free = self.plant.robot, self.free
        placement, states, air = self.placement[:kept], self.states[:kept], BASE_SIZE + self.plant.air.state_size
        samples, whole = slice(None, 2 * self.parts * kept, 2 * self.parts), slice(max(kept - 1, 0))
        joints, elastic = self.motion[samples], self.plant.elastic
        q = robot.configuration(placement, joints[:, 0, 0], joints[:, 0, 1])
        v = robot.velocity(states[:, :BASE_SIZE], joints[:, 1, 0], joints[:, 1, 1])
        deflection = elastic.spread(states[:, self.bent])
        q[:, list(robot.idx_q)] += deflection
        v[:, list(robot.idx_v)] += elastic.spread(states[:, self.bent.stop :])
        return Trajectory(
            crank_angle=states[:, air] if free else self.crank_angle[samples],
            crank_rate=states[:, air + 1] if free else self.crank_rate[samples],
            q=q,
            v=v,
            deflection=deflection,
            air=states[:, BASE_SIZE:air],
            forces=split_forces(self.plant.fields.forces, self.means[whole] / self.parts),
            loads=self.loads[whole],
        )


def checked_flight(tables: FlightTables, samples: int) -> Trajectory:
    """Return the first `samples` of a flight. Raises SimulationError, whose `kept` is what came before it diverged."""
    air = BASE_SIZE + tables.plant.air.state_size
    states, loads = tables.states[:samples, :air], tables.loads[: samples - 1]
    parts = *np.split(states, [3, 6], axis=1), tables.states[:samples, tables.bent]
    sizes = [np.abs(part).max(axis=1, initial=0.0) for part in parts]
    strips = StripLoads(*loads.swapaxes(0, 1))  # unlike `strips_of`, takes what is not finite
    sizes.append(np.append(strips.airspeed.max(axis=1, initial=0.0), 0.0))
    inside = [size <= limit for size, (limit, _) in zip(sizes, LIMITS.values(), strict=True)]
    outside = ~np.all(inside, axis=0)
    kept = int(np.argmax(outside)) if outside.any() else samples
    trajectory = tables.trajectory(kept)
    if kept < samples:
        name = next(name for name, fine in zip(LIMITS, inside, strict=True) if not fine[kept])
        value, when, last = dict(zip(LIMITS, sizes, strict=True))[name][kept], kept * tables.dt, max(kept - 1, 0)
        message = _divergence(when, name, value, tables.placement[last], tables.states[last])
        title = f"scenario {tables.plant.scenario.name}: {message}"
        raise SimulationError(title, when, trajectory if kept > 1 else None)
    return trajectory


def _divergence(time: float, name: str, value: float, placement: Array, state: Array) -> str:
    """Say when a flight diverged, which limit it passed, and the placement and state one step before."""
    limit, unit = LIMITS[name]
    x, v, w = (", ".join(f"{number:.3g}" for number in row[:3]) for row in (placement, state, state[3:]))
    return (
        f"the flight diverged at t = {time:.4f} s: {name} {value:.3g} {unit} is beyond the limit of {limit:g} {unit}; "
        f"before, the body was at {x} m, with {v} m/s and {w} rad/s in its axes; try a smaller simulation.dt, fewer "
        "air.strips, or gentler forces and speeds"
    )
