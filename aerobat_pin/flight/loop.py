"""The closed loop, sample by sample: sensors, controller, thrusters, plant.

The controller is any object with the methods of `Pilot`; this room does not know which law it obeys. A command that
follows from sample k acts from `thrusters.delay` later on, through the lag of the thrusters.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from time import thread_time
from typing import Protocol

import numpy as np

from aerobat_pin.errors import AerobatError, SimulationError
from aerobat_pin.flight.plant.plant import Plant
from aerobat_pin.flight.plant.tables import Trajectory
from aerobat_pin.flight.sensors import Sensing
from aerobat_pin.flight.thrusters import LaggedThrust, ThrusterSet, thrusters_of
from aerobat_pin.numerics import Array


class Pilot(Protocol):
    """What flies a plant by its thrusters.

    Attributes:
        trim: (m,) thrusts that the thrusters have at the start [N].
        modelled: (6,) mean wrench of the thrusters over the interval after the last command, as the pilot believes.
        unrealised: (6,) what the limits left of the wrench that the last command was to make.
        disturbance: (6,) unknown wrench on the body that the pilot saw last.
        loop_times: (n,) written by the loop: processor time from each sample to its command [s], that is of sensors
            and pilot, without the plant.
    """

    trim: Array
    modelled: Array
    unrealised: Array
    disturbance: Array
    loop_times: Array

    def board(self, plant: Plant) -> None:
        """Learn which plant is to be flown, before the flight; only a comparison with the truth needs it."""

    def begin(self, time: float, q: Array, v: Array, crank_angle: float) -> None:
        """Start at the first sample of a flight."""

    def command(self, time: float, q: Array, v: Array, crank_angle: float) -> Array:
        """Return the commanded thrusts (m,) [N] for a sample and a crank angle [rad]."""
        ...


@dataclass(frozen=True)
class LoopRecord:
    """What happened in a closed loop, per interval.

    Attributes:
        thrusters: the thrusters.
        command: (n, m) commands that were given at the start of the interval [N].
        thrust: (n, m) mean thrusts that were realised [N].
        modelled, unrealised, disturbance: (n, 6) as the attributes of `Pilot`.
    """

    thrusters: ThrusterSet
    command: Array
    thrust: Array
    modelled: Array
    unrealised: Array
    disturbance: Array


class ClosedLoop:
    """A plant that is flown by a pilot.

    Args:
        plant: the plant; its robot has thrusters.
        pilot: the controller.
        step_means: (2, f, n) mean noise and mean signal of each unknown force [N]; when omitted, the scenario's.
        endless: whether the flight goes on after n intervals, see `Plant.start`; the record begins anew with them.

    Attributes:
        q, v: true configuration and velocity.
        done: number of intervals flown.
    """

    def __init__(self, plant: Plant, pilot: Pilot, step_means: Array | None = None, *, endless: bool = False) -> None:
        scenario, robot = plant.scenario, plant.robot
        self.plant, self.pilot = plant, pilot
        pilot.board(plant)
        self.thrusters = thrusters_of(robot.morphology)
        self.dt = scenario.simulation.dt
        self.thrust = LaggedThrust(self.thrusters, scenario.thrusters, self.dt, pilot.trim)
        self.q, self.v = plant.start(step_means, endless=endless)
        assert plant.flight is not None
        self.flight = plant.flight
        count = self.flight.tables.intervals
        self.sensing = Sensing(robot, scenario.sensors, np.arange(count + 1) * self.dt, scenario.simulation.seed)
        self.done = 0
        m = len(self.thrusters.limit)
        pilot.loop_times = self._times = np.zeros(count)
        self._rows = [np.zeros((count, size)) for size in (m, m, 6, 6, 6)]

    def step(self) -> None:
        """Fly one interval."""
        k, pilot = self.done, self.pilot
        time = k * self.dt
        self.sensing.draw(k)
        q, v, crank_angle = self.plant.as_measured()
        begun = thread_time()
        q, v = self.sensing.read(k, q, v)
        crank_angle = self.sensing.crank(k, crank_angle)
        if k == 0:
            pilot.begin(time, q, v, crank_angle)
            begun = thread_time()
        command = pilot.command(time, q, v, crank_angle)
        self._times[k % len(self._times)] = thread_time() - begun
        self.q, self.v = self.plant.step(self.thrust.advance(command))
        at = k % len(self._rows[0])
        entry = (command, self.thrust.mean, pilot.modelled, pilot.unrealised, pilot.disturbance)
        for rows, values in zip(self._rows, entry, strict=True):
            rows[at] = values
        self.done = k + 1

    def fly(self, count: int, progress: Callable[[float], None] | None = None) -> Trajectory:
        """Fly n intervals and return the flight, as `Plant.fly` does.

        Raises SimulationError also where the pilot fails in flight; its `kept` is the flight until then.
        """
        every = max(1, count // 100)
        for k in range(count):
            try:
                self.step()
            except SimulationError:
                raise
            except AerobatError as error:
                if k == 0:  # nothing has flown: the pilot does not fit
                    raise
                title = f"scenario {self.plant.scenario.name}: the controller failed at t = {self.done * self.dt:.4f} s"
                flown = self.flight.trajectory()  # raises if the flight had diverged before
                raise SimulationError(f"{title}: {error}", self.done * self.dt, flown) from error
            if progress is not None and k % every == 0:
                progress((k + 1) / count)
        return self.flight.trajectory()

    def record(self, intervals: int | None = None) -> LoopRecord:
        """Return what happened so far, or in the first intervals."""
        return LoopRecord(self.thrusters, *(rows[: self.done][:intervals] for rows in self._rows))
