"""A robot that is heard: its recording, in the time that it took, or the topics of a ROS 2 node."""

from __future__ import annotations

import heapq
from collections.abc import Callable, Iterator
from pathlib import Path
from time import monotonic

import numpy as np

from aerobat_pin.errors import LogError
from aerobat_pin.estimation import OnlineEstimator, OnlineSample, Result, estimate, stream_of
from aerobat_pin.experiments.experiment import Progress
from aerobat_pin.experiments.live.ros_node import ForceNode
from aerobat_pin.experiments.live.source import LiveRow, LiveSource
from aerobat_pin.numerics import Array, guarded
from aerobat_pin.records import Columns, Map, open_by_map, read_columns, urdf_of

Stamped = tuple[float, int, dict[str, float]]  # time [s], number of its clock, columns


class LiveStream(LiveSource):
    """A robot whose forces a stream estimates by a map; the first observer alone goes on."""

    def __init__(self, title: str, stream: OnlineEstimator, chosen: Map, folder: Path) -> None:
        points, section = (*chosen.robot.points, *chosen.robot.wrenches), chosen.observer
        super().__init__(title, stream.robot.model, points, stream.observers[0], section.gain)
        self.stream, self.map, self.folder, self.urdf = stream, chosen, folder, urdf_of(chosen.robot, folder)
        stream.tune(self.observer, self.gain)

    def changed(self, *, tuned: bool) -> None:
        """Let another observer go on."""
        if tuned:
            self.stream.tune(self.observer, self.gain)

    def rows(self, samples: list[OnlineSample], true: Array) -> list[LiveRow]:
        """Return estimates beside the true force (p, 3)."""
        rows = []
        for sample in samples:
            values = sample.components
            force = np.array([[values[f"{point}.{axis}"] for axis in ("Fx", "Fy", "Fz")] for point in self.points])
            rows.append(LiveRow(sample.end, true, force))
        return rows

    def estimated(self, log: Path, show: Progress) -> Result:
        """Return what `aerobat estimate` finds in a recording by the chosen observer."""
        section = self.map.observer.model_copy(update={"names": (self.observer,), "gain": self.gain})
        record = open_by_map(log, self.map.model_copy(update={"observer": section}), self.folder)
        return estimate(record, progress=lambda share: show("estimating", share), trust=True)


class LiveRecording(LiveStream):
    """A recording, sample by sample.

    It is a table, a bag, or an MCAP file; relative paths of its map begin at the folder.

    Raises:
        LogError, MapError: they cannot be read, or need a whole record.
    """

    unseen = False

    @guarded()
    def __init__(self, log: Path, chosen: Map, folder: Path) -> None:
        record = open_by_map(log, chosen, folder)
        super().__init__(log.name, stream_of(record), record.map, folder)
        columns = read_columns(log, record.map.log, self.stream.columns)
        if lacking := [name for name in self.stream.columns if name not in columns.values]:
            raise LogError(f"log {log}: no {lacking[0]}, which a stream waits for; `aerobat estimate` does without it")
        self._samples = heapq.merge(
            *(_samples(columns, n, clock) for n, clock in enumerate(columns.clocks)), key=lambda sample: sample[:2]
        )
        self._log, self._next = log, next(self._samples, None)
        if self._next is None:
            raise LogError(f"log {log}: no sample of what the map names")
        self.time = self._next[0]

    def step(self) -> list[LiveRow]:
        """Hear the next sample."""
        if self._next is None:
            self.ended, self.said = True, "the recording has ended"
            return []
        self.time = self._next[0]
        samples = self.stream.push(self.time, self._next[2])
        self._next = next(self._samples, None)
        if samples:
            self.q = self.stream.configuration
        return self.rows(samples, self.unknown)

    def result(self, show: Progress) -> Result:
        """Return what `aerobat estimate` finds in the whole recording."""
        return self.estimated(self._log, show)


class LiveTopics(LiveStream):
    """The topics that a map names, heard by a ROS 2 node, which publishes the forces as well.

    Args:
        chosen: the map.
        folder: where relative paths of the map begin.
        say: called with a line for each topic that is heard.

    Raises:
        ExtraError: there is no ROS 2.
        LogError, MapError: see `OnlineEstimator`.
    """

    def __init__(self, chosen: Map, folder: Path, say: Callable[[str], None]) -> None:
        self._heard: list[OnlineSample] = []
        self.node = ForceNode(chosen, folder, say, heard=self._heard.append)
        super().__init__("topics of ROS 2", self.node.estimator, chosen, folder)

    def advance(self, seconds: float, budget: float) -> list[LiveRow]:
        """Hear what arrives within the budget [s]."""
        deadline = monotonic() + budget
        while (remaining := deadline - monotonic()) > 0.0:
            self.node.turn(remaining)
        samples = self._heard.copy()
        self._heard.clear()
        if samples:
            self.time, self.q = samples[-1].end, self.stream.configuration
        return self.rows(samples, self.unknown)

    def close(self) -> None:
        """Leave the network."""
        self.node.close()

    def result(self, show: Progress) -> Result:
        """Refuse: a bag records topics."""
        raise LogError("topics are not kept here: `ros2 bag record`, then `aerobat estimate BAG --map MAP`")


def _samples(columns: Columns, number: int, clock: str) -> Iterator[Stamped]:
    """Yield the samples of one clock, without empty cells."""
    names = [name for name, its in columns.clock_of.items() if its == clock]
    pieces = [columns.clocks[clock].time[:], *(columns.values[name][:] for name in names)]
    for row in zip(*(piece.tolist() for piece in pieces), strict=True):
        yield row[0], number, {name: value for name, value in zip(names, row[1:], strict=True) if np.isfinite(value)}
