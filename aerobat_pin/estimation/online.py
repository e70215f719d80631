"""Estimate while messages arrive: an object that takes samples of all channels, as a ROS 2 node does.

The rule is that of records: estimates come at the times of one leading channel, or evenly spaced at `log.rate`, the
other channels are interpolated linearly, and joint torques are means over the interval. So an estimate waits until
every channel has a sample at or after its time; that is its latency, beside the observer's 1/K. What goes wrong with
samples is counted (`OnlineEstimator.health`) and ends nothing.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from operator import itemgetter
from pathlib import Path
from typing import Any

import numpy as np

from aerobat_pin.errors import AerobatError, MapError
from aerobat_pin.estimation import stream_rings as ring_kernels
from aerobat_pin.estimation.calibration.calibration import Calibration, belief_of
from aerobat_pin.estimation.online_sample import OnlineSample, StreamHealth, stream_health
from aerobat_pin.estimation.stream_kernels import build_interval
from aerobat_pin.estimation.stream_samples import put
from aerobat_pin.estimation.stream_sizes import StreamSizes
from aerobat_pin.forces import (
    LAGS,
    RECENT,
    TIME_CONSTANTS_TO_SETTLE,
    FittedValues,
    add_lag_of_filter,
    built_observers,
    change_of_axes,
    filters_at_start,
    raise_to_noise,
    rows_of,
    tilt_of,
    walks_on,
    with_tilt,
)
from aerobat_pin.numerics import Array, fields_of, guarded
from aerobat_pin.observers import Expected, KalmanObserver, Observer, ObserversTogether, SmootherObserver
from aerobat_pin.records import (
    Map,
    PlainRobot,
    base_requests,
    entries,
    joint_requests,
    listed_joints,
    robot_of_map,
    stamp,
    with_held_joints,
)

PARTED = 10  # messages in a row that lack a column of a channel, after which that is an obstacle
K_EVERY = 50  # estimates: after so many filters expect errors of the size that others see
LEADING = ("joints.position", "base.position")


class OnlineEstimator:
    """Estimates unknown forces from samples as they arrive, by a map.

    Args:
        chosen: the map; its check tables and parts are not used online.
        folder: where relative paths of the map begin.
        heard: called with each estimate, in place of collecting what `push` and `message` return.
        calibration: friction, factors of efforts and mass from a recording (`calibrate`).
        wait: by how much samples may arrive late [s]; every estimate waits for it.
        expected: what is expected of forces and rows; learnt from the efforts as they come when omitted.
        values: friction, factors of efforts and links, without a calibration.

    Raises:
        CalibrationError: the calibration belongs to another robot, or to a map that means something else.
        MapError, LogError: the map does not fit the robot, or asks for what only a whole record has: a velocity that is
            differentiated, a known force, a fit, a smoother, no point at all.
    """

    @guarded()
    def __init__(
        self,
        chosen: Map,
        folder: Path,
        heard: Callable[[OnlineSample], None] | None = None,
        calibration: Calibration | None = None,
        *,
        wait: float = 0.0,
        expected: Expected | None = None,
        values: FittedValues | None = None,
    ) -> None:
        self.robot: PlainRobot = robot_of_map(chosen.robot, folder)
        self._map = chosen = with_held_joints(chosen, self.robot)
        self._heard, self._folder, self._calibration = heard, folder, calibration
        self._further: dict[str, Any] = {"wait": wait, "expected": expected, "values": values}
        self._values = values or FittedValues()
        if calibration is not None:
            self._values = replace(calibration.fitted, row_noise=calibration.row_noise)
        moving = tuple(name for name in self.robot.joints if name not in chosen.joints.held)
        self.joints = names = listed_joints(chosen.joints.names) or moving
        if calibration is not None:
            calibration.belief.refuse_other(belief_of(chosen, self.robot, names))
            if calibration.series is not None:
                raise MapError("online: a calibration with a series over a phase needs a whole record")
            self.robot = calibration.believed(self.robot)
        elif len(self._values.links):
            self.robot = self.robot.with_links(self._values.links)
        self.robot = self.robot.carrying(chosen.payload)
        requests = (*base_requests(chosen), *joint_requests(chosen, self.robot, names))
        self._requests = {request.key: request for request in requests}
        self._check()
        self._columns = [request.names for request in requests]
        readers = ((c, itemgetter(*names), np.zeros(len(names))) for c, names in enumerate(self._columns))
        self._readers: list[tuple[int, Any, Array]] = [*readers]
        lead = [key for key in LEADING if key in self._requests]
        self._leading = [*self._requests].index(lead[0] if lead else next(iter(self._requests)))
        self._memory = ring_kernels.new_rings(chosen, self.robot, names, requests, self._values, wait)
        self._rings = fields_of(self._memory, ring_kernels.Rings)
        self._epoch: float | None = None
        self._unstamped = set[str]()  # topics
        self._parted: dict[int, list[str]] = {}  # channel -> column that each message lacked since the last whole one
        self._estimates = self._starts = self._failed = 0
        self._rows, _ = rows_of(chosen, self.robot, names, self._requests)
        self._learnt = StreamSizes(chosen, self.robot, self._rows, self._values)
        sizes = self._learnt.expected(np.zeros(self.robot.model.nv)) if expected is None else expected
        self._learns = expected is None and sizes is not None
        self._tilt = 0.0 if chosen.robot.wrenches else tilt_of(chosen)
        self._sizes, self._observers = sizes, list[Observer]()
        self._build()
        put(self._memory, 0, np.nan, self._readers[0][2])  # these four compile
        build_interval(self._memory, self._leading)
        raise_to_noise(np.zeros(0), np.zeros((RECENT, 0)), np.zeros(0))
        add_lag_of_filter(np.zeros(0), 0.0, np.zeros((LAGS + 2, 0)), np.zeros(0))
        self.reset()
        self._rings.tally[:] = 0

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle and copy as a stream without samples: views of its rings cannot be copied with them."""
        return partial(type(self), self._map, self._folder, self._heard, self._calibration, **self._further), ()

    @property
    def columns(self) -> tuple[str, ...]:
        """What the map reads: columns, such as `/imu.angular_velocity.x` of a topic `/imu`."""
        return tuple(name for request in self._requests.values() for name in request.names)

    @property
    def observers(self) -> tuple[str, ...]:
        """Their names."""
        return tuple(observer.name for observer in self._observers)

    @property
    def walks(self) -> bool:
        """Whether the robot has legs to stand on, so that its points can be in contact with the ground."""
        return walks_on(self.robot, self._map)

    @property
    def health(self) -> StreamHealth:
        """What became of the samples so far."""
        keys, counts = tuple(self._requests), (self._estimates, self._starts, self._failed)
        obstacles = [f"{topic}: its messages have no stamp" for topic in sorted(self._unstamped)]
        if parted := {keys[c]: lacked[0] for c, lacked in self._parted.items() if len(lacked) == PARTED}:
            obstacles.append(
                f"no message of late has all of {', '.join(parted)}: {', '.join(parted.values())} missing where others "
                "are; one publisher for all joints (joint_state_publisher with source_list joins several), "
                "joints.held, or robot.rows.ignore of a joint without effort, was expected"
            )
        return stream_health(self._rings, keys, counts, self._wait, self._together.recent_k, obstacles)

    def reset(self) -> None:
        """Forget all samples and start again with the next ones; what is counted stays."""
        rings = self._rings
        rings.head[:], rings.filled[:], rings.usual[:], rings.pending[:] = 0, 0, 0.0, 0.0
        rings.shown[:] = rings.changed[:] = rings.now[: ring_kernels.COUNT] = np.nan
        rings.jumped[:], rings.stuck[:] = 0.0, 0
        rings.now[ring_kernels.BROKEN] = 0.0
        self._epoch = None
        self._parted.clear()

    @guarded()
    def tune(self, observer: str, gain: float) -> None:
        """Go on with one observer, anew, and its gain K [1/s]. Raises MapError if there is none, or no such gain."""
        section = {**self._map.observer.model_dump(exclude_none=True), "names": [observer], "gain": gain}
        chosen, before = self._map, list(self._observers)
        self._map = chosen.model_copy(update={"observer": type(chosen.observer).model_validate(section)})
        try:
            self._build()
        except AerobatError:
            self._map, self._observers = chosen, before
            raise
        self._rings.now[ring_kernels.LAST] = np.nan

    @property
    def configuration(self) -> Array:
        """The robot's q (nq,) at the end of the last interval."""
        return self._rings.q.copy()

    def message(self, topic: str, message: object) -> list[OnlineSample]:
        """Take a ROS message of any client library; return the estimates that it completes."""
        fields, time = entries(message), stamp(message)
        if fields is None or time <= 0.0:
            self._unstamped |= {topic} if fields else set()
            return []
        self._unstamped.discard(topic)
        return self.push(time, {f"{topic}.{name}": value for name, value in fields.items()})

    def push(self, time: float, values: Mapping[str, float]) -> list[OnlineSample]:
        """Take samples of some columns, named as in the map, at one time [s]; return the estimates they complete.

        Nothing of a sample raises: `health` counts those that cannot be used, and why.
        """
        since, memory = self._since_epoch(time), self._memory
        for c, reader, buffer in self._readers:
            try:
                buffer[:] = reader(values)
            except KeyError as missing:
                if not values.keys().isdisjoint(self._columns[c]):
                    self._parted[c] = [str(missing.args[0]), *self._parted.get(c, [])][:PARTED]
                continue
            except (TypeError, ValueError):  # not a number
                buffer[:] = np.nan
            self._parted.pop(c, None)
            put(memory, c, since, buffer)
        return self._advance()

    def _since_epoch(self, time: float) -> float:
        """Return a time [s] since the whole second of the first one: Unix time has only 2.4e-7 s in a double."""
        try:
            if self._epoch is None and math.isfinite(time):
                self._epoch = self._rings.setting[3] = float(math.floor(time))
            return time - (self._epoch or 0.0)
        except TypeError:
            return math.nan

    def _check(self) -> None:
        """Raise MapError for a map that needs a whole record."""
        if not self._requests:
            raise MapError("online: the map names no channel")
        if not (self._map.robot.points or self._map.robot.wrenches):
            raise MapError("online: robot.points = []: a point at which a force is sought was expected")
        joints, base = self._map.joints, self._map.base
        sought = self._map.sought_payload is not None
        if self._map.known or sought or (joints.friction is not None and self._values.friction is None):
            raise MapError(
                "online: known forces and fits need a whole record; leave them out of the map; friction can come "
                "from a calibration"
            )
        if self.joints and "joints.velocity" not in self._requests:
            raise MapError("online: joints.velocity must be measured: a window that differentiates needs the future")
        needed = {"base.rate"} if base.from_ != "measured" else {"base.velocity", "base.rate"}
        if self.robot.free and not base.held and not needed <= set(self._requests):
            raise MapError(f"online: {' and '.join(sorted(needed, reverse=True))} must be measured")

    def _build(self) -> None:
        """Make the map's observers, and let all read one `pin.Data`, in groups by what they need computed."""
        self._observers = built_observers(self._map, self.robot, self._rows, (), self._sizes)
        for observer in self._observers:
            if isinstance(observer, SmootherObserver):
                raise MapError(
                    "online: observer smoother corrects every estimate by what comes later, so it needs a whole "
                    "record; observer.names = ['kalman'] is its half that runs forward"
                )
            if isinstance(observer, KalmanObserver) and observer.doubted_forces:
                raise MapError("online: observer.kalman.known_error: a stream knows the sum of known forces alone")
        filters = self._sizes is not None and all(isinstance(each, KalmanObserver) for each in self._observers)
        judge = built_observers(self._map, self.robot, self._rows, ("force_level",), self._sizes) if filters else []
        self._together = ObserversTogether([*self._observers, *judge])  # a filter does not say its k
        self._wait = TIME_CONSTANTS_TO_SETTLE / float(self._map.observer.gain)
        self._behind: list[tuple[Array, Array]] = []  # of each observer: filters behind its components, recent noise

    def _advance(self) -> list[OnlineSample]:
        """Estimate at all times for which every channel has a sample at or after."""
        estimates: list[OnlineSample] = []
        while code := build_interval(self._memory, self._leading):
            if code == ring_kernels.STREAM_START:
                self._starts += 1
                self._together.start(self._rings.q, self._rings.v)
                self._behind = [filters_at_start(observer) for observer in self._observers]
            else:
                estimates += self._estimates_of_interval(rezeroed=code == ring_kernels.REZEROED)
        return estimates

    def _estimates_of_interval(self, *, rezeroed: bool) -> list[OnlineSample]:
        """Return what the observers find in the interval that the kernels have built, and say it to who listens."""
        rings, now, together = self._rings, self._rings.now, self._together
        q, v, tau, dt, end = rings.q, rings.v, rings.tau, float(now[ring_kernels.DT]), float(now[ring_kernels.LAST])
        if self._learns:
            self._learn_sizes()
        if rezeroed:
            tau = tau + change_of_axes(together.model, together.data, q, rings.before, v, dt)
        samples = together.take(q, v, tau, dt)
        if None in samples:
            self._failed += 1
            now[ring_kernels.LAST] = np.nan
        else:
            self._estimates += 1
            if self._learns:
                self._learnt.take(together, samples, q, tau, dt)
        settled, epoch = bool(end - now[ring_kernels.BEGAN] >= self._wait), self._epoch or 0.0
        kept, estimates = math.exp(-dt * float(self._map.observer.gain)), list[OnlineSample]()
        for observer, sample, (behind, recent) in zip(self._observers, samples, self._behind, strict=False):
            if sample is None:
                continue
            components = sample.components
            deviation = of_rows = sample.standard_deviation
            if deviation is not None and observer.expected is not None:
                deviation = deviation.copy()
                raise_to_noise(components, recent, deviation)
                add_lag_of_filter(components, kept, behind, deviation)
                deviation = np.hypot(deviation, observer.expected.shared)
            if deviation is not None and self._tilt > 0.0:
                deviation = with_tilt(components, deviation, self._tilt)
            times = epoch + end - dt, epoch + end
            estimates.append(OnlineSample(observer, *times, settled, components, deviation, of_rows, together.recent_k))
            if self._heard is not None:
                self._heard(estimates[-1])
        return estimates

    def _learn_sizes(self) -> None:
        """Expect errors anew whenever twice as many intervals have shown them; tell filters k, which others see."""
        count = int(self._rings.now[ring_kernels.COUNT])
        learns = count & (count - 1) == 0
        if learns:
            self._sizes = self._learnt.expected(np.sqrt(self._rings.squares / count))
        if self._sizes is not None and (learns or count % K_EVERY == 0):
            doubted = replace(self._sizes, doubt=max(1.0, self._together.recent_k))  # 1 while k is not known
            for observer in self._together.observers:
                if isinstance(observer, KalmanObserver):
                    observer.expect(doubted)
                elif learns:
                    observer.expect(self._sizes)
