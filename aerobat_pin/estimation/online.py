"""Estimate while messages arrive: an object that takes samples of all channels in time order, as a ROS 2 node does.

The rule is that of records: estimates come at the times of one leading channel, the other channels are interpolated
linearly, and joint torques are means over the interval. So an estimate waits until every channel has a sample at or
after its time; that is its latency, beside the observer's 1/K.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

from aerobat_pin.errors import LogError, MapError
from aerobat_pin.estimation.calibration.calibration import Calibration, belief_of
from aerobat_pin.estimation.expected import expected_from, row_scale
from aerobat_pin.estimation.known_forces import FittedValues
from aerobat_pin.estimation.run_observers import built_observers, points_of, rows_of
from aerobat_pin.numerics import Array, guarded
from aerobat_pin.observers import Expected, Observer
from aerobat_pin.records import (
    FREE_NQ,
    FREE_NV,
    Map,
    PlainRobot,
    as_attitude,
    base_requests,
    body_turn,
    entries,
    joint_requests,
    line_means,
    listed_joints,
    robot_of_map,
    rotation_matrices,
    sampled,
    sampled_turns,
    stamp,
    world_turn,
)

KEPT = 2.0  # [s] of samples; a channel that is later than the others by more is missing
LEADING = ("joints.position", "base.position")


class OnlineSample:
    """The estimate of one interval.

    Attributes:
        start: start of the interval [s].
        end: its end [s].
        components: label -> estimate [N or N m], such as `FL_FOOT.Fz`; world axes.
        deviation: label -> its standard deviation; that of an expected force where the pose does not show it.
    """

    __slots__ = ("components", "deviation", "end", "start")

    def __init__(self, start: float, end: float, components: dict[str, float], deviation: dict[str, float]) -> None:
        self.start, self.end, self.components, self.deviation = start, end, components, deviation

    def __repr__(self) -> str:
        values = ", ".join(f"{label} {value:.4g}" for label, value in self.components.items())
        return f"OnlineSample({self.start:.4f} to {self.end:.4f} s: {values})"


class OnlineEstimator:
    """Estimates unknown forces from samples in time order, by a map.

    Args:
        chosen: the map; its check tables, fits, parts and known forces of commands are not used online.
        folder: where relative paths of the map begin.
        heard: called with each estimate, in place of collecting what `push` and `message` return.
        calibration: friction, factors of efforts and mass from a recording (`calibrate`).

    Raises:
        CalibrationError: the calibration belongs to another robot, or to a map that means something else.
        MapError, LogError: the map does not fit the robot, or asks for what only a whole record has: a velocity that is
            differentiated, a fit.
    """

    @guarded()
    def __init__(
        self,
        chosen: Map,
        folder: Path,
        heard: Callable[[OnlineSample], None] | None = None,
        calibration: Calibration | None = None,
    ) -> None:
        self.robot: PlainRobot = robot_of_map(chosen.robot, folder)
        self._map, self._heard = chosen, heard
        self._values = FittedValues()
        if calibration is not None:
            self._values = replace(calibration.fitted, row_noise=calibration.row_noise)
        every = tuple(name for name in self.robot.joints if name not in chosen.joints.held)
        names = listed_joints(chosen.joints.names) or every
        self.joints = names
        if calibration is not None:
            calibration.belief.refuse_other(belief_of(chosen, self.robot, names))
            if calibration.series is not None:
                raise MapError("online: a calibration with a series over a phase needs a whole record")
            self.robot = calibration.believed(self.robot)
        self.robot = self.robot.carrying(chosen.payload)
        asked = (*base_requests(chosen), *joint_requests(chosen, self.robot, names))
        self._requests = {request.key: request for request in asked}
        self._check()
        self._columns: dict[str, list[tuple[str, int]]] = {}
        for key, request in self._requests.items():
            for k, name in enumerate(request.names):
                self._columns.setdefault(name, []).append((key, k))
        self._samples: dict[str, list[tuple[float, Array]]] = {key: [] for key in self._requests}
        lead = [key for key in LEADING if key in self._requests]
        self._leading = lead[0] if lead else next(iter(self._requests))
        self._last: float | None = None
        self._v = np.zeros(self.robot.model.nv)
        self._squares, self._count = np.zeros(self.robot.model.nv), 0
        self._observer: Observer | None = None

    def message(self, topic: str, message: object) -> list[OnlineSample]:
        """Take a ROS message of any client library; return the estimates that it completes."""
        found = entries(message)
        time = stamp(message)
        if found is None or time <= 0.0:
            return []
        return self.push(time, {f"{topic}.{name}": value for name, value in found.items()})

    def push(self, time: float, values: dict[str, float]) -> list[OnlineSample]:
        """Take samples of some columns, named as in the map, at one time [s]; return the estimates they complete.

        Raises:
            LogError: the time of a channel decreased.
        """
        for key, request in self._requests.items():
            if not all(name in values for name in request.names):
                continue
            at, kept = time - request.delay, self._samples[key]
            if kept and at <= kept[-1][0]:
                if at == kept[-1][0]:
                    continue
                raise LogError(f"{key}: time went from {kept[-1][0]} s to {at} s: messages in time order were expected")
            kept.append((at, request.converted(np.array([values[name] for name in request.names]))))
        return self._advance()

    def _check(self) -> None:
        """Raise MapError for a map that needs a whole record."""
        joints, base = self._map.joints, self._map.base
        sought = self._map.payload is not None and self.robot.payload is None
        if self._map.known or sought or (joints.friction is not None and self._values.friction is None):
            raise MapError(
                "online: known forces and fits need a whole record; leave them out of the map; friction can come "
                "from a calibration"
            )
        if self.joints and "joints.velocity" not in self._requests:
            raise MapError("online: joints.velocity must be measured: a window that differentiates needs the future")
        if self.robot.free and not base.held and not {"base.velocity", "base.rate"} <= set(self._requests):
            raise MapError("online: base.velocity and base.rate must be measured")

    def _advance(self) -> list[OnlineSample]:
        """Estimate at all leading samples for which every channel has a sample at or after."""
        found: list[OnlineSample] = []
        if not all(len(kept) > 1 for kept in self._samples.values()):
            return found
        ready = min(kept[-1][0] for kept in self._samples.values())
        begin = max(kept[0][0] for kept in self._samples.values())
        for time, _ in list(self._samples[self._leading]):
            if time > ready or time < begin or (self._last is not None and time <= self._last):
                continue
            q, v = self._state(time)
            if self._observer is None or self._last is None:
                self._observer = self._new_observer()
                self._observer.reset(q, v, time)
            else:
                effort = self._torque(self._last, time)
                self._learn_size(self._observer, effort)
                tau = effort + self._friction(v, time - self._last)
                sample = self._observer.update(time, q, v, tau)
                labels = self._observer.applications.components
                values = (sample.components, sample.standard_deviation)
                named = [{} if one is None else dict(zip(labels, one.tolist(), strict=True)) for one in values]
                one = OnlineSample(self._last, time, *named)
                found.append(one)
                if self._heard is not None:
                    self._heard(one)
            self._last, self._v = time, v
        self._forget(ready)
        return found

    def _new_observer(self) -> Observer:
        rows, _ = rows_of(self._map, self.robot, self.joints, self._requests)
        return built_observers(self._map, self.robot, rows, (), self._expected(np.zeros_like(self._v)))[0]

    def _expected(self, effort: Array) -> Expected | None:
        """Return what is expected, from the rms (nv,) of the efforts so far; other rows carry the weight."""
        if not self.robot.limits_forces:
            return None
        carried = self.robot.weight * row_scale(self.robot.model)
        return expected_from(self.robot, self._values, points_of(self._map), effort, carried)

    def _learn_size(self, observer: Observer, effort: Array) -> None:
        """Expect errors in proportion to the efforts: anew whenever twice as many intervals have shown their size."""
        self._squares, self._count = self._squares + effort**2, self._count + 1
        if observer.expected is not None and self._count & (self._count - 1) == 0:
            expected = self._expected(np.sqrt(self._squares / self._count))
            assert expected is not None
            observer.expect(expected)

    def _forget(self, ready: float) -> None:
        """Drop samples that no further estimate needs."""
        oldest = ready - KEPT if self._last is None else self._last
        for kept in self._samples.values():
            while len(kept) > 2 and kept[1][0] < oldest:
                kept.pop(0)

    def _series(self, key: str) -> tuple[Array, Array]:
        kept = self._samples[key]
        return np.array([time for time, _ in kept]), np.stack([values for _, values in kept])

    def _torque(self, first: float, last: float) -> Array:
        tau = np.zeros(self.robot.model.nv)
        if "joints.effort" in self._requests:
            means = line_means(*self._series("joints.effort"), np.array([first, last]))[0]
            for joint, value in zip(self._requests["joints.effort"].joints, means, strict=True):
                tau[self.robot.v_index(joint)] = value
            for joint, factor in zip(self._values.joints, self._values.scale, strict=True):
                tau[self.robot.v_index(joint)] *= factor
        return tau

    def _friction(self, v: Array, dt: float) -> Array:
        """Return the torque (nv,) of the joints' friction in the interval that ends with velocity `v`."""
        found = np.zeros_like(v)
        if self._values.friction is not None:
            rows = [self.robot.v_index(joint) for joint in self._values.joints]
            found[rows] = self._values.friction.torque((0.5 * (v + self._v))[rows], ((v - self._v) / dt)[rows])
        return found

    def _state(self, time: float) -> tuple[Array, Array]:
        """Return configuration and velocity at a time."""
        robot, at = self.robot, np.array([time])
        q, v = robot.neutral(), np.zeros(robot.model.nv)
        for joint, place in self._map.joints.held.items():
            q[robot.q_index(joint)] = place
        for key, vector, index in (("position", q, robot.q_index), ("velocity", v, robot.v_index)):
            if f"joints.{key}" in self._requests:
                values = sampled(*self._series(f"joints.{key}"), at)[0]
                vector[[index(joint) for joint in self.joints]] = values
        if robot.free and not self._map.base.held:
            q[:FREE_NQ], v[:FREE_NV] = self._base(at)
        return q, v

    def _base(self, at: Array) -> tuple[Array, Array]:
        chosen, base = self._map, self._map.base
        stamps, turns = self._series("base.quaternion")
        attitude = as_attitude(chosen, sampled_turns(stamps, turns / np.linalg.norm(turns, axis=1)[:, None], at))
        R = rotation_matrices(attitude)[0]
        place = world_turn(chosen) @ sampled(*self._series("base.position"), at)[0]
        velocity = sampled(*self._series("base.velocity"), at)[0]
        of_topic = self._requests["base.velocity"].names[0].startswith(f"{base.topic}.linear")
        if base.velocity is not None and base.velocity.axes == "world" and not of_topic:
            linear = R.T @ world_turn(chosen) @ velocity
        else:
            linear = body_turn(chosen) @ velocity
        rate = sampled(*self._series("base.rate"), at)[0]
        if base.rate is not None and base.rate.columns and base.rate.axes == "world":
            angular = R.T @ world_turn(chosen) @ rate
        else:
            angular = body_turn(chosen) @ rate
        return np.concatenate([place, attitude[0]]), np.concatenate([linear, angular])
