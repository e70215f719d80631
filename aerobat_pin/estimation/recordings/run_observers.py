"""Run observers over a record in blocks, and join the blocks' estimates: an hour needs the memory of a block."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from aerobat_pin.errors import MapError
from aerobat_pin.estimation.recordings.known_forces import KnownForces
from aerobat_pin.estimation.recordings.record import Record
from aerobat_pin.numerics import Array
from aerobat_pin.observers import OBSERVERS, AllBut, Application, Estimate, Observer, Rows

BLOCK = 60_000  # intervals that are estimated at once
LEAD = 15.0  # time constants 1/K by which a block begins before its first result: what is left of its start is e^-15
TIME_CONSTANTS_TO_SETTLE = 5.0  # time constants after which an estimate counts as settled


def observers_of(record: Record) -> tuple[list[Observer], tuple[str, ...]]:
    """Return the observers that the map names, and which rows they do not believe and why, in words.

    Raises:
        MapError: there is no observer of a name.
        ObserverError: an observer cannot be built for this robot.
    """
    chosen = record.map
    wrong = [name for name in chosen.observer.names if name not in OBSERVERS]
    if wrong or not chosen.observer.names:
        raise MapError(f"map: observer.names = {list(chosen.observer.names)}: choose from {', '.join(OBSERVERS)}")
    ignored, notes = believed_rows(record)
    points: list[str | Application] = [
        *chosen.robot.points,
        *(Application(frame, "wrench") for frame in chosen.robot.wrenches),
    ]
    rows: Rows = AllBut(*ignored) if ignored else "all"
    made = [OBSERVERS[name](record.robot.model, points, chosen.observer.gain, rows) for name in chosen.observer.names]
    return made, notes


def believed_rows(record: Record) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Return the rows that are not believed, and the reasons in words."""
    chosen, robot = record.map, record.robot
    ignored = list(chosen.robot.rows.ignore)
    notes = []
    held = [joint for joint in chosen.joints.held if joint not in ignored]
    ignored += held
    unsensed = [joint for joint in record.joints if joint not in ignored]
    if "joints.effort" not in record.channels and unsensed:
        ignored += unsensed
        notes.append(f"no effort is recorded: rows of {', '.join(unsensed)} are not believed")
    if robot.free and chosen.base.held and not any(row.startswith("base") for row in ignored):
        plate = any(not known.powers for known in chosen.known.values())
        frames = (*chosen.robot.points, *chosen.robot.wrenches)
        model = robot.model
        if not plate and not any(model.frames[model.getFrameId(frame)].parentJoint == 1 for frame in frames):
            ignored.append("base")
            notes.append("what holds the base is not measured: its six rows are not believed")
    return tuple(ignored), tuple(notes)


def run_observers(
    record: Record, forces: KnownForces, observers: Sequence[Observer], progress: Callable[[float], None] | None = None
) -> dict[str, Estimate]:
    """Estimate the unknown forces on all parts of a record: name of the observer -> estimate."""
    gain = float(record.map.observer.gain)
    lead = int(np.ceil(LEAD / gain * record.rate)) + 1
    found: dict[str, list[Estimate]] = {observer.name: [] for observer in observers}
    total, done = sum(last - first for first, last in record.parts), 0
    for first, last in record.parts:
        for begin in range(first, last, BLOCK):
            end = min(begin + BLOCK, last)
            if last - end < BLOCK // 10:
                end = last
            early, late = max(first, begin - lead), min(last, end + lead)
            block = record.block(early, late)
            tau, known = forces.torque(block), forces.known(block)
            for observer in observers:
                whole = observer.run(block.time, block.q, block.v, tau, known)
                found[observer.name].append(_some_intervals(whole, begin - early, end - early))
            done += end - begin
            if progress is not None:
                progress(done / total)
            if end == last:
                break
    return {name: _joined(parts) for name, parts in found.items()}


def settled(record: Record, time: Array) -> NDArray[np.bool_]:
    """Return which intervals, by their starts (m,) [s], are not at the start of a part, where filters still rise."""
    wait = TIME_CONSTANTS_TO_SETTLE / float(record.map.observer.gain)
    good = np.ones(len(time), bool)
    for first, _ in record.parts:
        begin = record.start + first * record.dt
        good &= ~((time >= begin - 1e-9) & (time < begin + wait))
    return good


def _some_intervals(estimate: Estimate, first: int, last: int) -> Estimate:
    """Return the intervals from `first` to `last` (exclusive) of an estimate."""
    inside = slice(first, last)
    deviation, innovation = estimate.standard_deviation, estimate.innovation
    return replace(
        estimate,
        time=estimate.time[first : last + 1],
        components=estimate.components[inside].copy(),
        residual=estimate.residual[inside].copy(),
        unexplained=estimate.unexplained[inside].copy(),
        standard_deviation=None if deviation is None else deviation[inside].copy(),
        innovation=None if innovation is None else replace(innovation, nis=innovation.nis[inside].copy()),
    )


def _joined(parts: list[Estimate]) -> Estimate:
    """Join the estimates of blocks; of the judgements on the whole record, the worst block's counts.

    The time of an interval's end is that of the next interval's start, also across a hole between two parts.
    """
    if len(parts) == 1:
        return parts[0]
    worst = min(parts, key=lambda part: (part.identifiability.rank, -part.identifiability.condition))
    deviations = [part.standard_deviation for part in parts if part.standard_deviation is not None]
    innovations = [part.innovation for part in parts if part.innovation is not None]
    innovation = None
    if innovations:
        innovation = replace(innovations[0], nis=np.concatenate([one.nis for one in innovations]))
    return replace(
        parts[0],
        time=np.concatenate([*(part.time[:-1] for part in parts), parts[-1].time[-1:]]),
        components=np.concatenate([part.components for part in parts]),
        residual=np.concatenate([part.residual for part in parts]),
        identifiability=worst.identifiability,
        unexplained=np.concatenate([part.unexplained for part in parts]),
        standard_deviation=np.concatenate(deviations) if deviations else None,
        innovation=innovation,
    )
