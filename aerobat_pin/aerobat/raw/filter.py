"""The causal filter of the joint smoother's model: one set of samples in, motion and forces out.

Each update linearises one interval about the latest estimate and takes the samples of that interval: an extended Kalman
filter. It starts when the first poses have come, from the smoother's result on them. What it loses against the smoother
is what later samples would have said; see docs/raw_sensors.md. A pose that comes late, as those of motion capture do,
is carried along the filter's own motion since its stamp, and then taken as one of the latest update.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from aerobat_pin.aerobat.motion import Torque
from aerobat_pin.aerobat.raw.air import AirAboutNominal
from aerobat_pin.aerobat.raw.channels import RawRecord, SensorSamples
from aerobat_pin.aerobat.raw.dynamics import LinearDynamics
from aerobat_pin.aerobat.raw.layout import MOTION, first_prior
from aerobat_pin.aerobat.raw.linear import added_variances
from aerobat_pin.aerobat.raw.nominal_motion import NominalMotion, first_guess
from aerobat_pin.aerobat.raw.recursion import advance, take_samples
from aerobat_pin.aerobat.raw.rows import ROWS_BY_SENSOR, Sensed
from aerobat_pin.aerobat.raw.smoother import JointSmoother
from aerobat_pin.aerobat.raw.tuning import JUMP, LEAST_JUMP_GAIN, Tuning
from aerobat_pin.errors import ObserverError
from aerobat_pin.numerics import Array

Given: TypeAlias = "ArrayLike | tuple[float, ArrayLike]"  # a sample, or stamp [s] and sample
FIRST_POSES = 8  # with which the filter starts, and as many samples of the crank
POSES, MOST_LATE = ("position", "orientation"), 0.05  # what may come late, and by how much [s]
SURPRISING = 6.0  # standard deviations of a chi-square above its mean: the forces may have jumped
OVER_INTERVAL = ("accelerometer", "torque")  # sensors that average over an interval: their stamp is its middle


@dataclass(frozen=True)
class JointSample:
    """The filter's estimate at the time of an update.

    Attributes:
        time: [s].
        placement: (7,) of the body in the world, position and quaternion xyzw.
        twist: (6,) of the body, body axes.
        crank: (3,) angle, rate and acceleration.
        force: (points, 3) in world axes, over the latest interval [N].
        covariance: (3 points, 3 points) of the forces [N2].
        deviation: (15,) standard deviations of pose (body axes), twist and crank.
        innovation: sum of the latest samples' innovations squared over their variance, and their number.
    """

    time: float
    placement: Array
    twist: Array
    crank: Array
    force: Array
    covariance: Array
    deviation: Array
    innovation: tuple[float, int]


class JointFilter:
    """Take samples one interval after the other.

    Args:
        smoother: robot, air, frames and settings; also used to start.
        tuning: of forces and crank, as a smoother has found it or as the settings state it.
        sensors: the sensors; of each channel, noise, place and turn are used.
        torque: which torque the samples have.
    """

    def __init__(
        self, smoother: JointSmoother, tuning: Tuning, sensors: Mapping[str, SensorSamples], torque: Torque
    ) -> None:
        self.smoother, self.tuning, self.sensors, self.torque = smoother, tuning, dict(sensors), torque
        self.layout, self._nv = smoother.layout, smoother.robot.model.nv
        self._air = AirAboutNominal(smoother.robot, smoother.air.along.section)
        self._waiting: list[tuple[float, dict[str, tuple[float, Array]], Array]] = []
        self._nominal: NominalMotion | None = None
        self._way: deque[tuple[float, float, pin.SE3]] = deque()  # start, end [s], motion of each latest interval
        self._latest: dict[str, float] = {}  # stamp of each sensor's last sample [s]
        self._x: Array = np.zeros(0)
        self._P: Array = np.zeros((0, 0))
        self._rate = np.zeros(6)
        white = self.layout.white
        self._fresh = np.array([white.start, white.stop], dtype=np.intp)
        self._noise_of, self._noise = -1.0, np.zeros(self.layout.size)

    @property
    def started(self) -> bool:
        """Whether enough poses have come."""
        return self._nominal is not None

    def update(self, time: float, samples: Mapping[str, Given], known: ArrayLike | None = None) -> JointSample | None:
        """Take the samples that have come since the last update.

        Args:
            time: now [s]; later than at the last update.
            samples: sensor (`position`, `orientation` as a quaternion xyzw, `gyro`, `accelerometer`, `crank`, `torque`)
                -> its sample, or stamp and sample. Without a stamp, accelerometer and torque belong to the middle of
                the time since the last update, the others to now. A pose may be stamped up to 50 ms before the last
                update; one stamped before the first update is left out.
            known: (nv,) known generalised force since the last update; zero when omitted.

        Returns:
            The estimate, or None until the filter has started.

        Raises:
            ObserverError: an unknown sensor, a sample or known forces of the wrong size, or not finite, one stamped
                outside the time since the last update, or not after the sensor's sample before; nothing of that update
                is taken.
        """
        last = self._nominal.time[0] if self._nominal is not None else self._waiting[-1][0] if self._waiting else None
        if last is not None and not time > last:
            raise ObserverError(f"joint filter: time = {time:g} s after {last:g} s: a later one was expected")
        taken = {name: self._checked(name, sample, time, last) for name, sample in samples.items()}
        force = np.zeros(self._nv) if known is None else np.array(known, float)
        if force.shape != (self._nv,) or not np.all(np.isfinite(force)):
            raise ObserverError(f"joint filter: known: {self._nv} finite numbers were expected")
        self._latest |= {name: stamp for name, (stamp, _) in taken.items()}
        begin = (self._waiting[0][0] if self._waiting else time) - 1e-9
        taken = {name: self._carried(name, *sample, last) for name, sample in taken.items() if sample[0] >= begin}
        if self._nominal is not None:
            return self._step(self._nominal, time, taken, force)
        self._waiting.append((time, taken, force))
        counts = [sum(name in samples_of for _, samples_of, _ in self._waiting) for name in (*POSES, "crank")]
        if min(counts) >= FIRST_POSES and "position" in taken:
            return self._start()
        return None

    def run(self, record: RawRecord) -> list[JointSample | None]:
        """Filter a record as a stream; return what the update at each of its knots returned."""
        places = {
            name: np.searchsorted(channel.time, record.time + 1e-9, side="right")
            for name, channel in record.channels.items()
        }
        estimates: list[JointSample | None] = []
        for k, time in enumerate(record.time.tolist()):
            known = record.known[max(k - 1, 0)]
            samples: dict[str, Given] = {}
            for name, channel in record.channels.items():
                at = int(places[name][k])
                if at > (int(places[name][k - 1]) if k else 0):  # of several, the latest
                    samples[name] = float(channel.time[at - 1]), channel.values[at - 1]
            estimates.append(self.update(time, samples, known))
        return estimates

    def _checked(self, name: str, sample: Given, time: float, last: float | None) -> tuple[float, Array]:
        if name not in self.sensors:
            raise ObserverError(f"joint filter: no sensor '{name}': {', '.join(self.sensors)} were expected")
        now = time if name not in OVER_INTERVAL or last is None else 0.5 * (time + last)
        stamp, values = sample if isinstance(sample, tuple) and len(sample) == 2 else (now, sample)
        array, size = np.array(values, float, ndmin=1), self.sensors[name].values.shape[1]
        if array.shape != (size,) or not all(map(math.isfinite, array.tolist())):
            raise ObserverError(f"joint filter: sample of {name}: {size} finite numbers were expected")
        earliest = last if last is not None else -math.inf
        if last is not None and name in POSES:
            earliest = (self._way[0][0] if self._way else last - MOST_LATE) - 1e-9
        earliest = max(earliest, self._latest.get(name, -math.inf))
        if not earliest < stamp <= time + 1e-9:
            raise ObserverError(
                f"joint filter: {name} is stamped {stamp:.13g} s: "
                f"a stamp after {earliest:.13g} s, up to {time:.13g} s, was expected"
            )
        return float(stamp), array

    def _carried(self, name: str, stamp: float, values: Array, last: float | None) -> tuple[float, Array]:
        """Return a sample; a late pose as it would have been at the last update, once the filter has started."""
        if last is None or stamp > last or not self._way:
            return stamp, values
        for start, end, step in self._way:
            if end > stamp:
                part = min((end - stamp) / (end - start), 1.0)
                if name == "position":
                    values = values + part * step.translation
                else:
                    turned = pin.Quaternion(values / np.linalg.norm(values)).matrix()
                    mark = self.sensors[name].turn
                    body = turned @ mark.T @ pin.exp3(part * pin.log3(step.rotation))
                    values = pin.Quaternion(body @ mark).coeffs()
        return last, values

    def _remember(self, start: NominalMotion, end: NominalMotion) -> None:
        """Remember an interval's motion, without the corrections at its end: way of the markers in world axes, turn."""
        lever = (end.rotation[0] - start.rotation[0]) @ self.sensors["position"].place
        step = pin.SE3(start.rotation[0].T @ end.rotation[0], end.position[0] - start.position[0] + lever)
        self._way.append((float(start.time[0]), float(end.time[0]), step))
        while self._way[0][1] < end.time[0] - MOST_LATE:
            self._way.popleft()

    def _record(self, times: list[float], each: list[dict[str, tuple[float, Array]]], known: Array) -> RawRecord:
        channels = {}
        for name, sensor in self.sensors.items():
            taken = [samples[name] for samples in each if name in samples]
            if taken:
                stamps, values = np.array([s for s, _ in taken]), np.array([v for _, v in taken])
                channels[name] = replace(sensor, time=stamps, values=values)
        return RawRecord(np.array(times), channels, known, self.torque)

    def _start(self) -> JointSample:
        times, each, known = (list(part) for part in zip(*self._waiting, strict=True))
        record = self._record(times, each, np.array(known[1:]))
        guess = first_guess(record)
        smoother = self.smoother
        prior = first_prior(self.layout, guess, smoother.weight, smoother.settings)
        solved = smoother.solve(record, guess, prior, self.tuning)
        self._air.begin(solved.motion)
        count = len(times) - 1
        for k in range(count):
            self._remember(solved.motion.part(k, k), solved.motion.part(k + 1, k + 1))
        self._nominal = solved.motion.part(count, count)
        self._x, self._P = solved.smoothed.states[-1].copy(), solved.smoothed.filtered.P.copy()
        self._x[:MOTION] = 0.0
        self._rate = (solved.motion.twist[-1] - solved.motion.twist[-2]) / (times[-1] - times[-2])
        return self._sample(self._nominal, self.layout.forces(self._x[None]), self._block(), (0.0, 0))

    def _step(
        self, nominal: NominalMotion, time: float, taken: dict[str, tuple[float, Array]], known: Array
    ) -> JointSample:
        dt = time - float(nominal.time[0])
        x, layout, smoother = self._x, self.layout, self.smoother
        motion = nominal.extended(dt, self._rate)
        air, force = self._air.go_on(motion), layout.forces(x[None])
        d = smoother.dynamics(motion, air, known[None], force)
        if dt != self._noise_of:
            self._noise_of, self._noise = dt, added_variances(layout, self.tuning, np.array([dt]))[0]
        self._P[layout.white, layout.white] = np.diag(self._noise[layout.white])
        ratio, count = self._take(motion, d, taken, 0)
        force_now, block = layout.forces(x[None]), self._block()
        self._rate = self._rate + d.push[0] + d.acceleration[0] @ x
        advance(x, self._P, d.transition[0], d.shift[0], self._noise, self._fresh)
        more, others = self._take(motion, d, taken, 1)
        after = motion.part(1, 1)
        self._remember(nominal, after)
        self._nominal = after.moved(x[None, :MOTION])
        x[:MOTION] = 0.0
        return self._sample(self._nominal, force_now, block, (ratio + more, count + others))

    def _take(
        self, motion: NominalMotion, d: LinearDynamics, taken: dict[str, tuple[float, Array]], knot: int
    ) -> tuple[float, int]:
        """Take the samples of a knot; return the sum of innovations squared over variance, and their number.

        Where they are far from what was expected, and the forces may have jumped, they have.
        """
        parts = []
        for name, (stamp, values) in taken.items():
            if (stamp + 1e-9 >= motion.time[1]) == bool(knot):
                sensor = self.sensors[name]
                at, k = np.array([stamp]), np.array([knot])
                sensed = Sensed(sensor, self.layout, motion, d, self.torque, k, at, values[None])
                h, e, _ = ROWS_BY_SENSOR[name](sensed)
                parts.append((h[0], e[0], np.full(e.size, sensor.noise**2)))
        if not parts:
            return 0.0, 0
        h, e, R = (np.concatenate(each) for each in zip(*parts, strict=True))
        count, x, P = len(e), self._x.copy(), self._P.copy()
        gains, innovations = np.empty((count, len(x))), np.empty((count, 2))
        take_samples(self._x, self._P, h, e, R, gains, innovations)
        ratio = float(innovations[:, 0] @ (innovations[:, 0] / innovations[:, 1]))
        if ratio > count + SURPRISING * np.sqrt(2.0 * count):
            self._let_jump(x, P, h, e, R)
            take_samples(x, P, h, e, R, gains, innovations)
            self._x[:], self._P[:] = x, P
        return ratio, count

    def _let_jump(self, x: Array, P: Array, h: Array, e: Array, R: Array) -> None:
        """Add to P the variances of jumps of the slow states that make samples likelier, one after the other.

        State `x` (n,) and covariance `P` (n, n) are those before the samples, which are given as in `SampleRows`.
        """
        variance, walk = (JUMP * self.smoother.weight) ** 2, self.layout.walk
        shown, jumped = h[:, walk], np.zeros(walk.stop - walk.start, bool)
        while not np.all(jumped):
            answer = np.linalg.solve(h @ P @ h.T + np.diag(R), np.column_stack([e - h @ x, shown]))
            pull, information = shown.T @ answer[:, 0], np.sum(shown * answer[:, 1:], axis=0)
            gains = 0.5 * (pull**2 / (information + 1.0 / variance) - np.log1p(variance * information))
            best = int(np.argmax(np.where(jumped, -np.inf, gains)))
            if gains[best] < LEAST_JUMP_GAIN:
                return
            jumped[best] = True
            P[walk.start + best, walk.start + best] += variance

    def _block(self) -> Array:
        by_mode, walk = self.layout.by_mode, self.layout.walk
        return np.asarray(by_mode @ self._P[walk, walk] @ by_mode.T)

    def _sample(self, nominal: NominalMotion, force: Array, block: Array, innovation: tuple[float, int]) -> JointSample:
        deviation = np.sqrt(np.maximum(np.diag(self._P)[:MOTION], 0.0))
        return JointSample(
            float(nominal.time[0]),
            pin.SE3ToXYZQUAT(nominal.body(0)),
            nominal.twist[0].copy(),
            nominal.crank[0].copy(),
            force.reshape(-1, 3).copy(),
            block,
            deviation,
            innovation,
        )
