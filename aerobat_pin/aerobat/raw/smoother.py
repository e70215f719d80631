"""The joint smoother: all raw samples of a record at once, linearised anew about its own result until that stays.

A long record is smoothed in windows that overlap, so that memory stays bounded: the next window starts from what the
filter knew before the overlap, and each window gives up its end, where later samples are still missing.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np

from aerobat_pin.aerobat.aerobat import Aerobat
from aerobat_pin.aerobat.raw.air import AirAboutNominal, AirForces
from aerobat_pin.aerobat.raw.channels import RawRecord, RecordPart, part_of, stretches
from aerobat_pin.aerobat.raw.dynamics import LinearDynamics, linear_dynamics
from aerobat_pin.aerobat.raw.layout import MOTION, TWIST_ERROR, Layout, Prior, first_prior, prior_at
from aerobat_pin.aerobat.raw.linear import TIMED, ClockOffset, LinearRecord, clock_offsets, corrected
from aerobat_pin.aerobat.raw.nominal_motion import NominalMotion, first_guess
from aerobat_pin.aerobat.raw.recursion import Flags, Smoothed
from aerobat_pin.aerobat.raw.rows import sample_rows
from aerobat_pin.aerobat.raw.tuning import (
    Tuning,
    first_tuning,
    free_logs,
    likelier_tuning,
    more_jumps,
    simpler_tuning,
)
from aerobat_pin.linkage import SeriesSculpture
from aerobat_pin.numerics import Array
from aerobat_pin.scenario import AirSection, RawSection

SETTLED = 4.0e-4  # [m/s], and ten times as many rad/s: rms change of the twist at which the iteration ends
NEARLY = 20.0  # times this: the tuning is chosen
CORRECTIONS = 2  # times that a clock offset is applied, for a better one, where one is found
FIRST_ROUNDS, MORE_ROUNDS = 12, 4  # of walks and jumps: in the first search, and after it about each new motion
LEAST_GAIN_OF_ROUND = 1.0  # of the log-likelihood: smaller gains end the rounds
STALE = 0.1  # [m/s]: rms change of the twist after which the air's derivative is flown anew


@dataclass(frozen=True)
class JointEstimate:
    """Motion and forces of a record, with what was found about sensors and model.

    Attributes:
        nominal: motion at the knots.
        force: (m, points, 3) slowly changing forces in world axes, of each interval [N].
        force_covariance: (m, 3 points, 3 points) their covariance.
        jumps: times [s] at which the forces jump.
        bias: (6,) of gyro and accelerometer at the end, as are mount and factors.
        mount: (6,) error of the accelerometer's place [m] and turn [rad], and their covariance; None if not sought.
        factors: name (`mass`, `air`) -> factor and its standard deviation.
        tuning: the walk in use; `chosen` says whether it was chosen by likelihood.
        offsets: clock offsets that the samples ask for.
        applied: sensor -> clock offset [s] that was taken off.
        nis: sensor -> mean of innovation squared over its variance, in the first window that has its samples.
        innovation: (m, 2) sum over each interval of innovations squared over their variance, and their number.
        iterations: linearisations of the first window; `settled` says whether the last one changed nothing.
    """

    nominal: NominalMotion
    force: Array
    force_covariance: Array
    jumps: tuple[float, ...]
    bias: Array
    mount: tuple[Array, Array] | None
    factors: dict[str, tuple[float, float]]
    tuning: Tuning
    nis: dict[str, float]
    innovation: Array
    iterations: int
    settled: bool
    chosen: bool = False
    offsets: tuple[ClockOffset, ...] = ()
    applied: Mapping[str, float] = field(default_factory=dict)


class JointSmoother:
    """The joint smoother of a believed robot in its believed air.

    Args:
        robot: the believed robot.
        air: the believed air.
        frames: frames at whose origins unknown forces act.
        settings: the table `observers.raw`.
        mount: whether place and turn of the accelerometer are estimated too.
    """

    def __init__(
        self, robot: Aerobat, air: AirSection, frames: tuple[str, ...], settings: RawSection, *, mount: bool = False
    ) -> None:
        linkage = SeriesSculpture(robot.linkage)
        self.robot = robot = replace(robot, linkage=linkage)
        self.series = linkage.series
        self.frames, self.settings, self._data = frames, settings, robot.model.createData()
        self.air = AirAboutNominal(robot, air)
        self.weight = robot.mass * (float(np.linalg.norm(robot.model.gravity.linear)) or 9.81)
        self.layout = Layout(len(frames), settings.mass_error > 0.0, settings.air_error > 0.0, mount)

    def run(self, record: RawRecord, progress: Callable[[float], None] | None = None) -> JointEstimate:
        """Smooth a record."""
        guess = first_guess(record)
        prior = first_prior(self.layout, guess, self.weight, self.settings)
        tuning, shifts, offsets = None, dict[str, float](), tuple[ClockOffset, ...]()
        parts = list[JointEstimate]()
        for window in stretches(record.time):
            stretch, motion = part_of(record, window.start, window.stop), guess.part(window.start, window.stop)
            solved = self.solve(stretch, motion, prior, tuning)
            if tuning is None and self.settings.offset_error > 0.0:
                offsets = self._offsets(stretch, solved)
                if self.settings.apply_offsets and (
                    shifts := {offset.sensor: offset.seconds for offset in offsets if offset.sure}
                ):
                    record = record.shifted(shifts)
                    solved = self.solve(part_of(record, window.start, window.stop), solved.motion, prior, None)
            tuning = solved.tuning
            parts.append(solved.kept(window))
            if window.next is not None:
                k = window.next - window.start
                filtered = solved.smoothed.filtered
                prior = prior_at(solved.linear.nominal, k, filtered.states[k], filtered.covariances[k])
            if progress is not None:
                progress(window.stop / (len(record.time) - 1))
        first, chosen = parts[0], bool(np.any(free_logs(self.settings, len(self.frames))))
        return replace(
            parts[-1],
            nominal=NominalMotion.joined([part.nominal for part in parts]),
            force=np.concatenate([part.force for part in parts]),
            force_covariance=np.concatenate([part.force_covariance for part in parts]),
            jumps=tuple(time for part in parts for time in part.jumps),
            chosen=chosen,
            offsets=offsets,
            applied=shifts,
            nis={name: ratio for part in reversed(parts) for name, ratio in part.nis.items()},
            innovation=np.concatenate([part.innovation for part in parts]),
            iterations=first.iterations,
            settled=all(part.settled for part in parts),
        )

    def dynamics(
        self, motion: NominalMotion, air: AirForces, known: Array, force: Array, layout: Layout | None = None
    ) -> LinearDynamics:
        """Linearise the dynamics about a motion."""
        layout = layout or self.layout
        return linear_dynamics(self.robot, self.series, self.frames, layout, motion, air, known, force, self._data)

    def linear(
        self,
        record: RawRecord,
        motion: NominalMotion,
        air: AirForces,
        force: Array,
        layout: Layout,
        jumps: Array,
    ) -> LinearRecord:
        """Linearise a record about a motion."""
        dynamics = self.dynamics(motion, air, record.known, force, layout)
        rows = sample_rows(record, layout, motion, dynamics)
        return LinearRecord(layout, motion, dynamics, tuple(record.channels), rows, jumps)

    def solve(self, record: RawRecord, motion: NominalMotion, prior: Prior, tuning: Tuning | None) -> Solved:
        """Iterate to the smoothed motion of one window; a tuning that is None is chosen on the way."""
        use = first_tuning(self.settings, self.weight) if tuning is None else tuning
        free = free_logs(self.settings, len(self.frames))
        if tuning is not None:
            free[:] = False
        rounds = [FIRST_ROUNDS, MORE_ROUNDS] if np.any(free) else [MORE_ROUNDS]
        force: Array = np.zeros((len(record.time) - 1, len(self.frames), 3))
        jumps: Array = np.zeros(len(force))
        by_twist: Array | None = None
        flown_at, last, size = motion, self.settings.iterations - 1, np.inf
        for iteration in range(self.settings.iterations):
            if _change_of_twist(motion.twist - flown_at.twist) > STALE:
                by_twist = None
            if by_twist is None:
                flown_at = motion
            air = self.air.fly(motion, by_twist)
            by_twist = air.by_twist
            linear = self.linear(record, motion, air, force, self.layout, jumps)
            if rounds and (iteration == last or (iteration > 0 and size < NEARLY * SETTLED)):
                use, linear = self._likelier(replace(linear, jumps=np.zeros(len(force))), prior, use, free, rounds[0])
                if rounds.pop(0) == FIRST_ROUNDS:
                    use = simpler_tuning(partial(linear.score, prior=prior), use, free, self.weight)
                jumps = linear.jumps
            smoothed = linear.smooth(use, prior)
            size = _change_of_twist(smoothed.states[:, TWIST_ERROR])
            motion = motion.moved(smoothed.states[:, :MOTION])
            force = self.layout.forces(smoothed.states[:-1])
            if size < SETTLED and not rounds:
                break
        smoothed = linear.smooth(use, prior, blocks=True)
        return Solved(linear, smoothed, motion, use, prior, air, iteration + 1, size < SETTLED)

    def _likelier(
        self, linear: LinearRecord, prior: Prior, tuning: Tuning, free: Flags, rounds: int
    ) -> tuple[Tuning, LinearRecord]:
        """Return a tuning under which the samples are likelier, and the record with the jumps that they ask for.

        In a search from the start, jumps wait until the walks are of the right size; else all that moves is one.
        """
        wait = rounds // 3 if rounds == FIRST_ROUNDS else 0
        for i in range(rounds):
            smoothed, jumps = linear.smooth(tuning, prior, scores=True), linear.jumps
            if i >= wait:
                jumps = more_jumps(smoothed, self.layout.walk, linear.nominal.time, jumps, self.weight)
            tuning, gain = likelier_tuning(
                tuning, free, smoothed, np.diff(linear.nominal.time), self.layout, self.weight
            )
            if i >= wait and gain < LEAST_GAIN_OF_ROUND and np.array_equal(jumps, linear.jumps):
                break
            linear = replace(linear, jumps=jumps)
        return tuning, linear

    def _offsets(self, record: RawRecord, solved: Solved) -> tuple[ClockOffset, ...]:
        """Return the clock offsets that the samples of a smoothed window ask for."""
        layout = replace(self.layout, offsets=tuple(name for name in TIMED if name in record.channels))
        error = self.settings.offset_error

        def linear(solved: Solved, record: RawRecord) -> LinearRecord:
            force = self.layout.forces(solved.smoothed.states[:-1])
            return self.linear(record, solved.motion, solved.air, force, layout, solved.linear.jumps)

        offsets = clock_offsets(linear(solved, record), solved.prior, solved.tuning, error)
        if not offsets:
            return offsets
        for _ in range(CORRECTIONS):
            shifted = record.shifted({offset.sensor: offset.seconds for offset in offsets})
            solved = self.solve(shifted, solved.motion, solved.prior, solved.tuning)
            offsets = corrected(offsets, linear(solved, shifted), solved.prior, solved.tuning, error)
        return offsets


@dataclass(frozen=True)
class Solved:
    """One window: its last linearisation, the smoothed states about it, and the motion with these errors added."""

    linear: LinearRecord
    smoothed: Smoothed
    motion: NominalMotion
    tuning: Tuning
    prior: Prior
    air: AirForces
    iterations: int
    settled: bool

    def kept(self, window: RecordPart) -> JointEstimate:
        """Return what is kept of the window, as copies: all else is ten times as large."""
        layout, smoothed, rows = self.linear.layout, self.smoothed, self.linear.rows
        a, b = window.first - window.start, window.last - window.start
        final, x, P = b if window.next is not None else b + 1, smoothed.states[-1], smoothed.filtered.P
        innovation, variance = smoothed.filtered.innovations.T
        ratio = innovation**2 / variance  # of each sample
        total = np.concatenate([[0.0], np.cumsum(ratio)])[rows.start]
        return JointEstimate(
            nominal=self.motion.part(a, final - 1),
            force=layout.forces(smoothed.states[a:b]),
            force_covariance=layout.by_mode @ smoothed.blocks[a:b] @ layout.by_mode.T,
            jumps=tuple(self.linear.nominal.time[a + 1 : b + 1][self.linear.jumps[a:b] > 0.0].tolist()),
            bias=np.concatenate([x[layout.gyro_bias], x[layout.accelerometer_bias]]),
            mount=(x[layout.mount_at].copy(), P[layout.mount_at, layout.mount_at].copy()) if layout.mount else None,
            factors={
                name: (1.0 + x[at].item(), np.sqrt(P[at, at]).item())
                for name, at, sought in (("mass", layout.mass_at, layout.mass), ("air", layout.air_at, layout.air))
                if sought
            },
            tuning=self.tuning,
            nis={self.linear.sensors[i]: float(np.mean(ratio[rows.sensor == i])) for i in np.unique(rows.sensor)},
            innovation=np.stack([np.diff(total)[:-1], np.diff(rows.start)[:-1]], axis=1)[a:b].copy(),
            iterations=self.iterations,
            settled=self.settled,
        )


def _change_of_twist(twist: Array) -> float:
    """Return the rms of changes of the twist (k, 6) [m/s], 10 rad/s counted as 1 m/s."""
    return float(np.sqrt(np.mean(twist[:, :3] ** 2) + 0.01 * np.mean(twist[:, 3:] ** 2)))
