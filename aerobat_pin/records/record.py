"""A recording at common times: what the observers are given, block by block, so that an hour fits into memory."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from aerobat_pin.numerics import Array
from aerobat_pin.observers import rotation_matrices
from aerobat_pin.records.axes import as_attitude, axes_of, has_world_axes
from aerobat_pin.records.block import Block, Channel
from aerobat_pin.records.channels import EXTRA
from aerobat_pin.records.columns import Columns
from aerobat_pin.records.map_tables import JointVelocitySection, Map, RateSection, VelocitySection
from aerobat_pin.records.reference import Reference
from aerobat_pin.records.resample import line_means, neighbour_rates, sampled, sampled_turns, slopes, turn_rates
from aerobat_pin.records.robots import FREE_NQ, FREE_NV, PlainRobot
from aerobat_pin.records.spool import Series, spread_stretches

BLOCK_MARGIN = 0.5  # [s] around a block, half of the longest window that differentiates
ZEROED = 0.4999  # [s] after which a velocity that an IMU gives begins at zero again
FAR_AWAY = 1e4  # [m]: of places beyond, as on a grid of the Earth, Coriolis forces and pages lose the digits
ROUNDED = 1e-3  # of a step, by which a sample is beside a common time at most where they coincide


@dataclass(frozen=True)
class Record:
    """A recording with its map and robot.

    Attributes:
        map: the map.
        robot: the robot.
        channels: key -> channel.
        joints: joints that have channels, in the order of the columns.
        driven: those of them that have efforts, in the order of their columns.
        start: first common time [s].
        rate: of the common times [Hz]; where they are uneven the mean, holes left out.
        parts: (first, last) index of the common times of each part that is used.
        notes: what was dropped or assumed, in words.
        knots: (n + 1,) common times of a record that has its own, which can be uneven; None where they are even.
        log: the columns that it was read from, without their samples; None if it was not read from a file.
        folder: where relative paths of the map begin.
        label: what messages and pages call a record that was not read from a file.
        references: what a simulation knows of the forces: estimates are compared with it, and never see it.
    """

    map: Map
    robot: PlainRobot
    channels: dict[str, Channel]
    joints: tuple[str, ...]
    driven: tuple[str, ...]
    start: float
    rate: float
    parts: tuple[tuple[int, int], ...]
    notes: tuple[str, ...] = ()
    knots: Series | None = None
    log: Columns | None = None
    folder: Path = Path()
    label: str = "flight"
    references: tuple[Reference, ...] = ()

    @property
    def title(self) -> str:
        """What messages and pages call the record: the name of its file, or its label."""
        return self.label if self.log is None else self.log.path.name

    def __repr__(self) -> str:
        parts = "one part" if len(self.parts) == 1 else f"{len(self.parts)} parts"
        used = f"{self.duration:.4g} s in {parts} at {self.rate:.4g} Hz"
        return f"{self.title}: {self.robot.title}, {self.robot.mass:.4g} kg; {used}"

    @property
    def dt(self) -> float:
        """Time between two common times [s]; the mean where they are uneven, holes left out."""
        return 1.0 / self.rate

    @property
    def duration(self) -> float:
        """Length of all used parts together [s]."""
        if self.knots is not None:
            return sum(self.after_start(last) - self.after_start(first) for first, last in self.parts)
        return float(sum(last - first for first, last in self.parts)) * self.dt

    def after_start(self, index: float) -> float:
        """Return how long after the start [s] a common time is, by its index, which can lie between two."""
        if self.knots is None:
            return index * self.dt
        first = int(index)
        near = self.times(first, first + 1)
        return float(np.interp(index - first, np.arange(len(near)), near)) - self.start

    def index_after(self, time: float) -> float:
        """Return the index of the common time so long after the start [s], which can lie between two."""
        if self.knots is None:
            return time * self.rate
        first = max(self.knots.index(self.start + time, "right") - 1, 0)
        near = self.times(first, first + 1)
        return first + float(np.interp(self.start + time, near, np.arange(len(near))))

    def times(self, first: int, last: int) -> Array:
        """Return the common times from index `first` to `last` inclusive [s]."""
        if self.knots is not None:
            return np.asarray(self.knots[first : last + 1])
        return np.asarray(self.start + np.arange(first, last + 1) * self.dt)

    @property
    def windows(self) -> tuple[float, float, float]:
        """Windows [s] of the slopes that are the base's velocity and rate, and the joints'; 0 where they are none."""
        base, joints, even = self.map.base, self.map.joints, self.knots is None
        linear, angular = base.velocity or VelocitySection(), base.rate or RateSection()
        turning = joints.velocity or JointVelocitySection()
        each = (("base.velocity", linear.window), ("base.rate", angular.window), ("joints.velocity", turning.window))
        some = [window if even and key not in self.channels else 0.0 for key, window in each]
        return some[0] if base.from_ == "measured" else 0.0, some[1], some[2]

    def block(self, first: int, last: int) -> Block:
        """Return the samples from index `first` to `last` inclusive, completed by the robot."""
        robot, count = self.robot, last - first + 1
        time = self.times(first, last)
        q = np.tile(robot.neutral(), (count, 1))
        v = np.zeros((count, robot.model.nv))
        tau = np.zeros((count - 1, robot.model.nv))
        rows_q, rows_v = ([index(joint) for joint in self.joints] for index in (robot.q_index, robot.v_index))
        for joint, place in self.map.joints.held.items():
            q[:, robot.q_index(joint)] = place
        if "joints.position" in self.channels:
            q[:, rows_q] = self.at("joints.position", time)
        if "joints.velocity" in self.channels:
            v[:, rows_v] = self.at("joints.velocity", time)
        elif self.joints and self.knots is None:
            wide, inside = self._wide(first, last)
            v[:, rows_v] = slopes(self.at("joints.position", wide), self.dt, self.windows[2])[inside]
        if "joints.effort" in self.channels:
            tau[:, [robot.v_index(joint) for joint in self.driven]] = self.means("joints.effort", time)
        if robot.free and not self.map.base.held:
            q[:, :FREE_NQ], v[:, :FREE_NV] = self._base(first, last)
        if self.knots is not None:
            self._differentiate(time, q, v)
        measured = frozenset(self.channels)
        extra = {
            key.removeprefix(EXTRA): self.means(key, time) if self._is_force(key) else self.at(key, time)
            for key in self.channels
            if key.startswith(EXTRA)
        }
        velocities = {"base.velocity" if robot.free else "joints.velocity"}
        source = {"q": "measured", "v": "measured" if velocities <= measured else "reconstructed"}
        return robot.complete(Block(time, q, v, tau, extra, measured, source))

    def _is_force(self, key: str) -> bool:
        """Return whether an extra channel is given out as means over intervals."""
        section = self.map.extra.get(key.removeprefix(EXTRA))
        return self.channels[key].means or (section is not None and section.kind in ("force", "torque"))

    def _differentiate(self, time: Array, q: Array, v: Array) -> None:
        """Write the velocities that are not measured, of a record at its own times, into v (m, nv)."""
        places = {"base.velocity": [0, 1, 2], "base.rate": [3, 4, 5]} if self.robot.free else {}
        places["joints.velocity"] = [self.robot.v_index(joint) for joint in self.joints]
        rows = [row for key, indices in places.items() if key not in self.channels for row in indices]
        if rows:
            v[:, rows] = neighbour_rates(self.robot.model, time, q)[:, rows]

    def at(self, key: str, time: Array) -> Array:
        """Return a channel (m, k) at times (m,) [s]."""
        channel = self.channels[key]
        if channel.time is self.knots and self._are_knots(time):
            return self._own_rows(channel, time)
        return sampled(*self.cut(key, time), time)

    def means(self, key: str, time: Array) -> Array:
        """Return interval means (m, k) of a channel between times (m + 1,) [s]."""
        channel = self.channels[key]
        if channel.means:
            return self._own_rows(channel, time[:-1])
        if self.knots is not None:  # which are as fast as any channel
            rows = self.at(key, time)
            return 0.5 * (rows[1:] + rows[:-1])
        return line_means(*self.cut(key, time), time)

    def _are_knots(self, time: Array) -> bool:
        """Return whether times (m,) [s] are common times that follow each other, of a record that has its own."""
        assert self.knots is not None
        first = self.knots.index(float(time[0]))
        return np.array_equal(self.times(first, first + len(time) - 1), time)

    def _own_rows(self, channel: Channel, time: Array) -> Array:
        """Return the rows (m, k) of a channel whose stamps are the common times (m,) themselves."""
        assert self.knots is not None
        first = self.knots.index(float(time[0]))
        return np.asarray(channel.values[first : first + len(time)])

    def spread(
        self, most: int, begin: float = -np.inf, end: float = np.inf, *, least: int = 0
    ) -> Iterator[tuple[int, int]]:
        """Yield (first, last) of pieces of all parts, or of a long record `SPREAD` stretches at even distances.

        Args:
            most: intervals of all pieces together.
            begin: time after the start [s] before which there is no piece.
            end: time after the start [s] after which there is none.
            least: intervals of a stretch, however many they are together.
        """
        low, high = (float(np.clip(self.index_after(time), 0.0, self.parts[-1][1])) for time in (begin, end))
        parts = [(max(first, int(np.floor(low))), min(last, int(np.ceil(high)))) for first, last in self.parts]
        parts = [(first, last) for first, last in parts if first < last]
        for begin_at, end_at in spread_stretches(sum(last - first for first, last in parts), most, least):
            done = 0
            for first, last in parts:
                inside = max(first, first + begin_at - done), min(last, first + end_at - done)
                if inside[0] < inside[1]:
                    yield inside
                done += last - first

    def cut(self, key: str, time: Array) -> tuple[Array, Array]:
        """Return the stamps and samples of a channel around times (m,) [s]."""
        return self.channels[key].between(float(time[0]), float(time[-1]), extra=2)

    def _wide(self, first: int, last: int) -> tuple[Array, slice]:
        """Return the common times of a stretch with margins, which end at holes, and where the stretch is in them."""
        extra = round(BLOCK_MARGIN * self.rate)
        low, high = max(self.parts[0][0], first - extra), min(self.parts[-1][1], last + extra)
        for begin, end, _ in (hole for channel in self.channels.values() for hole in channel.holes):
            before = math.floor((begin - self.start) * self.rate + ROUNDED)
            after = math.ceil((end - self.start) * self.rate - ROUNDED)
            low, high = (after if low < after <= first else low), (before if last <= before < high else high)
        return self.times(low, high), slice(first - low, last - low + 1)

    def turns(self, time: Array) -> Array:
        """Return the attitude (m, 4) at times (m,) [s]: body to world, z up, x, y, z, w."""
        if self.channels["base.quaternion"].time is self.knots:
            return as_attitude(self.map, self.at("base.quaternion", time))
        return as_attitude(self.map, sampled_turns(*self.cut("base.quaternion", time), time))

    def _in_axes(self, key: str, time: Array) -> Array:
        """Return a channel of the base (m, 3) in this package's axes at times (m,) [s]."""
        values, turn = self.at(key, time), axes_of(self.map, key, self.channels[key].names)
        return values if turn is None else np.asarray(values @ turn.T)

    def _in_body(self, key: str, time: Array, R: Array) -> Array:
        """Return a measured velocity or rate (m, 3) in body axes at times (m,) [s] with attitudes (m, 3, 3)."""
        values = self._in_axes(key, time)
        in_world = has_world_axes(self.map, key, self.channels[key].names)
        return np.asarray(np.einsum("nji,nj->ni", R, values)) if in_world else values

    @cached_property
    def _origin(self) -> Array:
        """Where the base's place counts from (3,) [m]: zero, or where the record begins, if that is `FAR_AWAY` away."""
        place = self._in_axes("base.position", self.times(self.parts[0][0], self.parts[0][0]))[0]
        return np.asarray(place if np.linalg.norm(place) > FAR_AWAY else np.zeros(3))

    def _base(self, first: int, last: int) -> tuple[Array, Array]:
        """Return placement (m, 7) and twist in body axes (m, 6) of the base."""
        base = self.map.base
        time, inside = (self.times(first, last), slice(None)) if self.knots is not None else self._wide(first, last)
        attitude = self.turns(time)
        R = rotation_matrices(attitude)
        place: Array = np.zeros((len(time), 3))
        linear = angular = place
        if "base.position" in self.channels:
            place = self._in_axes("base.position", time) - self._origin
        if "base.velocity" in self.channels:
            linear = self._in_body("base.velocity", time, R)
        elif self.knots is None and base.from_ == "measured":
            linear = np.einsum("nji,nj->ni", R, slopes(place, self.dt, self.windows[0]))
        if "base.rate" in self.channels:
            angular = self._in_body("base.rate", time, R)
        elif self.knots is None:
            angular = turn_rates(attitude, self.dt, self.windows[1])
        if base.from_ == "imu":
            linear = np.zeros_like(angular)
            linear[inside] = self._integrated(first, last, R[inside]) - np.cross(angular[inside], base.imu.place)
        return np.concatenate([place, attitude], axis=1)[inside], np.concatenate([linear, angular], axis=1)[inside]

    def zeroed_at(self, index: int) -> int:
        """Return the common time at or before an index at which the velocity found by an IMU last began at zero."""
        count = math.ceil(ZEROED * self.rate)
        first = max((first for first, _ in self.parts if first <= index), default=0)
        return first + (index - first) // count * count

    def _integrated(self, first: int, last: int, R: Array) -> Array:
        """Return the accelerometer's velocity (m, 3) in body axes but for a constant in world axes: u' = R f + g.

        It is zero at `zeroed_at(first)`. R (m, 3, 3) are the attitudes at the common times from `first` to `last`.
        """
        begin = self.zeroed_at(first)
        time = self.times(begin, last)
        stamps = self.cut("base.acceleration", time)[0]
        nodes = np.union1d(time, stamps[(stamps > time[0]) & (stamps < time[-1])])
        felt = self._in_axes("base.acceleration", nodes)
        a = np.einsum("nij,nj->ni", rotation_matrices(self.turns(nodes)), felt) + self.robot.model.gravity.linear
        steps = 0.5 * np.diff(nodes)[:, None] * (a[1:] + a[:-1])
        u = np.concatenate([np.zeros((1, 3)), np.cumsum(steps, axis=0)])[np.searchsorted(nodes, time)][first - begin :]
        return np.asarray(np.einsum("nji,nj->ni", R, u))
