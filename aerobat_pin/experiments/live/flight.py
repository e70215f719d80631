"""Aerobat flies as long as one watches: the closed loop of a scenario keeps it up while somebody pushes it."""

from __future__ import annotations

from copy import deepcopy
from dataclasses import replace
from typing import ClassVar

import numpy as np

from aerobat_pin.aerobat import (
    BASE_SIZE,
    AirStream,
    FlightLog,
    believed_robot,
    check_names,
    flown_robot,
    robot_of_belief,
)
from aerobat_pin.control import Controller
from aerobat_pin.errors import AerobatError, ScenarioError, SimulationError
from aerobat_pin.experiments.experiment import Experiment, Progress, run_recorded
from aerobat_pin.experiments.flight_summary import flight_summary
from aerobat_pin.experiments.live.source import KEPT, LIVE_OBSERVERS, PUSH_SHARE, LiveRow, LiveSource
from aerobat_pin.flight import ClosedLoop, LoopRecord, Plant, Sensing, Trajectory, flight_log_of
from aerobat_pin.numerics import Array, guarded
from aerobat_pin.observers import OBSERVERS
from aerobat_pin.scenario import Scenario, SineForce

ERRORS_DRAWN = 1.0  # [s]: the sensors' errors are drawn anew so often
LEAST_SAVED = 2.0  # [s]


class _Watched(Controller):
    """A controller that remembers what the sensors showed: q, v and crank angle (n, nq + nv + 1) of a window."""

    samples: Array
    last: tuple[Array, Array, float]

    def command(self, time: float, q: Array, v: Array, crank_angle: float) -> Array:
        """Return the commanded thrusts (m,) [N]."""
        self.last = q.copy(), v.copy(), crank_angle
        self.samples[round(time / self._step) % len(self.samples)] = np.concatenate([q, v, [crank_angle]])
        return super().command(time, q, v, crank_angle)


class LiveFlight(LiveSource):
    """The flight of a scenario under forces of the user, in place of its own.

    Observers and controller know nothing of the forces that are set, and nothing of the wind.

    Args:
        scenario: it has a table `control`.

    Raises:
        ScenarioError: it has none, or an observer that there is not, or that needs the future, or a torque that does.
    """

    knobs: ClassVar[tuple[str, ...]] = ("noise", "wind")

    @guarded()
    def __init__(self, scenario: Scenario) -> None:
        if scenario.control is None:
            raise ScenarioError(
                f"scenario {scenario.name} has no table control, so nothing keeps its robot up: one with it was "
                "expected, such as hover_closed_loop"
            )
        section = scenario.observers
        check_names(section.names)
        if section.names[-1] not in LIVE_OBSERVERS:
            raise ScenarioError(
                f"scenario {scenario.name}: observer {section.names[-1]} corrects every estimate by what comes later, "
                "so it cannot live; observers.names = ['kalman'] is its half that runs forward"
            )
        if section.torque == "modelled":
            raise ScenarioError(
                f"scenario {scenario.name}: observers.torque = 'modelled' takes a whole flight, so it cannot live; "
                "'measured', 'motor_only' or 'none' was expected"
            )
        axes = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
        forces = tuple(
            SineForce(signal="sine", frame=frame, direction=axis, axes="world", amplitude=0.0)
            for frame in section.frames
            for axis in axes
        )
        settings = scenario.simulation.model_copy(update={"duration": KEPT})
        self.scenario = scenario.model_copy(update={"unknown_force": forces, "simulation": settings})
        self.plant = Plant(flown_robot(scenario), self.scenario)
        self.robot, self._believed = self.plant.robot, believed_robot(scenario)
        super().__init__(scenario.name, self.robot.model, section.frames, section.names[-1], section.gain)
        self.limit = PUSH_SHARE * self.robot.mass * scenario.flight.gravity
        self.dt, self._count, self._before = settings.dt, settings.count, 0.0
        self._drawn = 1.0
        self._begin()

    def _begin(self) -> None:
        """Begin the flight, or begin it again."""
        self._pilot = _Watched(self.scenario, self._believed)
        self._loop = ClosedLoop(self.plant, self._pilot, endless=True)
        self._air = AirStream(self._believed, self.scenario.believed_air, self.dt)
        self._pilot.samples = np.zeros((self._count, len(self.q) + self.model.nv + 1))
        self._past: tuple[Array, Trajectory, LoopRecord, Array] | None = None
        self._before, self._true, self._started = self.time, None, False
        self.changed(tuned=True)

    def changed(self, *, tuned: bool) -> None:
        """Push, blow, draw the sensors' errors anew, and begin with another observer."""
        self._loop.flight.disturb(self.force.ravel(), self.wind)
        if tuned:
            settings = self.scenario.observers.settings(self.observer)
            kind = OBSERVERS[self.observer]
            rows = robot_of_belief(self.scenario, self._believed).rows() or "all"
            self._observer = kind(self._believed.model, self.points, self.gain, rows=rows, **settings)
            self._started = False
        fitted = self.scenario.sensors.fitted
        if fitted and (tuned or self.noise != self._drawn):
            self._drawn = self.noise
            scaled = {
                name: parameter.model_copy(update={"noise": (self.noise * np.array(parameter.noise)).tolist()})
                for name, parameter in fitted.items()
            }
            sensors = self.scenario.sensors.model_copy(update=scaled)
            time = np.arange(round(ERRORS_DRAWN / self.dt) + 1) * self.dt
            seed, first = self.scenario.simulation.seed, self._loop.done
            self._loop.sensing = Sensing(self.robot, sensors, time, seed + first, first)

    def step(self) -> list[LiveRow]:
        """Fly one interval; the estimate is that of the interval before, whose end the sensors show now."""
        try:
            rows = self._step()
        except AerobatError:  # numbers beyond all limits
            return self._lost()
        if self._loop.done % self._count == 0:
            self._past = deepcopy(self._window(self._count))
        if self._loop.done % 100 == 0 and self._pilot.state.word == "LOST":
            return self._lost()
        return rows

    def _window(self, samples: int) -> tuple[Array, Trajectory, LoopRecord, Array]:
        """Return the window's samples up to now: times, flight, what happened in the loop, what the sensors showed."""
        loop = self._loop
        time = (loop.done - samples + np.arange(samples)) * self.dt  # since the flight began, as the wind has it
        return time, loop.flight.trajectory(samples), loop.record(samples - 1), self._pilot.samples[:samples]

    def _step(self) -> list[LiveRow]:
        loop, pilot = self._loop, self._pilot
        loop.step()
        (q, v, crank), at = pilot.last, (loop.done - 1) * self.dt
        rows = list[LiveRow]()
        if self._true is None:
            self._air.reset(at, q, v, crank, loop.flight.crank_rate)
        else:
            air, added = self._air.update(at, q, v)
            if self._started:
                known = {"aerodynamic": air, "added_mass": added, "thrusters": self._pushed}
                sample = self._observer.update(at, q, v, self._motor, known)
                rows = [LiveRow(self._before + at, self._true, sample.components.reshape(-1, 3))]
        if not self._started:
            self._observer.reset(q, v, at)
            self._started = True
        forces = loop.flight.last_forces()
        self._true, self._motor = forces.force_W[0].copy(), forces.motor[0].copy()
        self._pushed = np.pad(pilot.modelled, (0, self.model.nv - BASE_SIZE))
        self.q, self.time = loop.q, self._before + loop.done * self.dt
        return rows

    @property
    def crank(self) -> float:
        """Absolute crank angle t1 [rad]."""
        return self._loop.flight.crank_angle

    def _lost(self) -> list[LiveRow]:
        self.said = f"lost: {self._pilot.state.line}; it begins again"
        self.force[:] = 0.0
        self._begin()
        return []

    def result(self, show: Progress) -> Experiment:
        """Return the last seconds as a run: what the sensors showed, and what only the simulation knows."""
        count = self._loop.done % self._count  # the end of the last interval is yet to be shown
        if count * self.dt >= LEAST_SAVED or self._past is None:
            if count < 10:
                raise SimulationError("nothing has been flown yet that could be saved", self.time)
            time, trajectory, record, shown = self._window(count)
        else:
            time, trajectory, record, shown = self._past
        exact = flight_log_of(self.plant, time, trajectory, record)
        assert exact.truth is not None
        measured, truth = exact.measured.copy(deep=True), exact.truth.copy()
        nq, nv = self.model.nq, self.model.nv
        for name, values in (("q", shown[:, :nq]), ("v", shown[:, nq : nq + nv]), ("crank_angle", shown[:, -1])):
            truth[name] = truth.get(name, exact.measured[name])
            measured[name].values[:] = values
        section = self.scenario.observers.model_copy(update={"names": (self.observer,), "gain": self.gain})
        settings = self.scenario.simulation.model_copy(update={"duration": (len(time) - 1) * self.dt})
        belief = self.scenario.model_copy(update={"observers": section, "simulation": settings})
        log = FlightLog(measured, truth)
        experiment, summary = run_recorded(log, belief, show), flight_summary(log, self.robot.mass)
        more = {**experiment.scores.more, "log": None, "flight": summary.to_json()}
        return replace(experiment, robot=self.robot, scores=replace(experiment.scores, more=more), flight=summary)
