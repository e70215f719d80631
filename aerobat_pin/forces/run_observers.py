"""Run observers over a record in blocks: an hour needs the memory of a block."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import replace
from functools import cache
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from aerobat_description.reading import did_you_mean
from aerobat_pin.errors import MapError
from aerobat_pin.forces.deviations import (
    NOISE_STRETCH,
    rows_as_components,
    tilt_of,
    with_belief_error,
    with_expected,
    with_tilt,
)
from aerobat_pin.forces.inputs import KnownInputs, inputs_of, with_zeroed_velocity
from aerobat_pin.forces.known_forces import KnownForces
from aerobat_pin.forces.stored_estimate import ROWS_READ, TIME_CONSTANTS_TO_SETTLE, StoredEstimate, some_intervals
from aerobat_pin.numerics import Array, frame_id
from aerobat_pin.observers import (
    MEMORY_OF_K,
    OBSERVERS,
    AllBut,
    Application,
    Estimate,
    Expected,
    KalmanObserver,
    Observer,
    Rows,
    Sampled,
    scale_of_forces,
)
from aerobat_pin.records import Map, PlainRobot, Record, Spool

BLOCK = 30_000  # intervals that are estimated at once
REMEMBERED = 4.0  # times `MEMORY_OF_K`, by which it begins yet earlier: errors of the rows last
LEAD = 15.0  # time constants 1/K by which a block begins before its first result: what is left of its start is e^-15
LEAST_EXPECTED = 5.0e-4  # of the robot's weight, per spare row: no belief, and no step of a record, is more exact
ADDED_MISFIT = 2.0e-4  # the same that a filter assumes of its model beside errors that a calibration states
BeliefErrors = Callable[[Observer, KnownInputs], Array | None]  # None if they are unknown


class Watch(Protocol):
    """What follows a record on its way to the observers; it needs `settling` seconds before what counts."""

    settling: float

    def take(self, record: Record, inputs: KnownInputs, kept: slice, *, ends: bool) -> None:
        """Take the inputs of a block, of which the intervals `kept` count; with them a part may end."""


def observers_of(
    record: Record, names: Sequence[str] = (), expected: Expected | None = None, *, errors_known: bool = False
) -> tuple[list[Observer], tuple[str, ...]]:
    """Return observers of a record, and which rows they do not believe and why, in words.

    Args:
        record: the record.
        names: of the observers; those that the map names when empty.
        expected: what is expected of forces and rows; None for forces of any size.
        errors_known: whether a calibration states the errors of the belief, so that filters need not assume any.

    Raises:
        MapError: there is no observer of a name.
        ObserverError: an observer cannot be built for this robot.
    """
    rows, notes = rows_of(record.map, record.robot, record.joints, record.channels)
    return built_observers(record.map, record.robot, rows, names, expected, errors_known=errors_known), notes


def points_of(chosen: Map) -> list[str | Application]:
    """Return where a map seeks forces and wrenches."""
    return [*chosen.robot.points, *(Application(frame, "wrench") for frame in chosen.robot.wrenches)]


def built_observers(
    chosen: Map,
    robot: PlainRobot,
    rows: Rows,
    names: Sequence[str] = (),
    expected: Expected | None = None,
    *,
    errors_known: bool = False,
) -> list[Observer]:
    """Return observers of a map's points, those that it names when `names` is empty; the rest as in `observers_of`."""
    points = points_of(chosen)
    names = (tuple(names) or chosen.observer.names) if points else ("momentum",)  # all others need a point
    if wrong := [name for name in names if name not in OBSERVERS] or [""] * (not names):
        raise MapError(f"map: observer.names = {list(names)}: {did_you_mean(wrong[0], OBSERVERS, 'choose from')}")
    section, observers, sizes = chosen.observer, [], {} if expected is None else {"expected": expected}
    for name in names:
        observers.append(OBSERVERS[name](robot.model, points, section.gain, rows, **section.settings(name), **sizes))
        if errors_known and isinstance(observers[-1], KalmanObserver):
            observers[-1].trust_model(ADDED_MISFIT * scale_of_forces(robot.model))
    return observers


def believed_rows(record: Record) -> Rows:
    """Return the rows of a record's robot that are believed."""
    return rows_of(record.map, record.robot, record.joints, record.channels)[0]


def ignored_rows(record: Record) -> tuple[str, ...]:
    """Return the joints, and parts of the base, whose rows are not believed."""
    rows = believed_rows(record)
    return rows.names if isinstance(rows, AllBut) else () if rows == "all" else record.robot.joints


def rows_of(
    chosen: Map, robot: PlainRobot, joints: Sequence[str], channels: Collection[str]
) -> tuple[Rows, tuple[str, ...]]:
    """Return the rows that are believed, and the reasons in words.

    The robot may know better than the map. `joints` are those that have channels, `channels` the keys that are there.
    """
    rows = robot.rows()
    if rows is not None:
        return rows, ()
    ignored = list(chosen.robot.rows.ignore)
    notes = []
    ignored += [joint for joint in chosen.joints.held if joint not in ignored]
    unsensed = [joint for joint in joints if joint not in (*ignored, *chosen.joints.passive)]
    if "joints.effort" not in channels and unsensed:
        ignored += unsensed
        notes.append(f"no effort is recorded: rows of {', '.join(unsensed)} are not believed")
    if robot.free and not chosen.base.held and chosen.base.from_ == "joints" and "base" not in ignored:
        ignored.append("base")
        notes.append("the base's motion is not measured, its velocity counts as 0: its six rows are not believed")
    if robot.free and chosen.base.held and not any(f"{row}.".startswith("base.") for row in ignored):
        plate = any(not known.powers for known in chosen.known.values())
        model, frames = robot.model, (*chosen.robot.points, *chosen.robot.wrenches)
        if not plate and not any(model.frames[frame_id(model, frame)].parentJoint == 1 for frame in frames):
            ignored.append("base")
            notes.append("what holds the base is not measured: its six rows are not believed")
    return AllBut(*ignored) if ignored else "all", tuple(notes)


def run_observers(
    record: Record,
    inputs_at: Callable[[int, int], KnownInputs],
    observers: Sequence[Observer],
    progress: Callable[[float], None] | None = None,
    watch: Watch | None = None,
    expected: Expected | None = None,
    errors: BeliefErrors | None = None,
) -> dict[str, StoredEstimate]:
    """Return the estimate of the unknown forces on all parts of a record by each observer, by its name.

    Args:
        record: the record.
        inputs_at: gives the observers' inputs between two indices, as `inputs_between` does.
        observers: the observers.
        progress: called with the share that is done.
        watch: is given what the observers are given.
        expected: what is expected of the forces, by which a filter that states deviations is judged, too.
        errors: by how much (m, c) errors of the belief may spoil each component, as far as a calibration knows, which
            every observer then states.
    """
    wait = max(LEAD / float(record.map.observer.gain), 0.0 if watch is None else watch.settling)
    wait = max(wait, LEAD * NOISE_STRETCH / record.rate)
    lead, spool = int(np.ceil(wait * record.rate)) + 1, Spool()
    estimates = {observer.name: StoredEstimate(spool) for observer in observers}
    memory = min(round(REMEMBERED * MEMORY_OF_K * record.rate), BLOCK)
    total, done = len(observers) * sum(last - first for first, last in record.parts), 0
    for first, last in record.parts:
        for begin, end in blocks_of(first, last) if not record.robot.remembers else [(first, last)]:
            early, late = max(first, begin - lead - memory), min(last, end + lead)
            inputs, kept = inputs_at(early, late), slice(begin - early, end - early)
            if watch is not None:
                watch.take(record, inputs, kept, ends=end == last)
            inputs, sampled = with_zeroed_velocity(record, inputs, early), list[Sampled]()
            for observer in observers:
                if progress is not None:
                    progress(done / total)
                estimate = _estimate_of(observer, record, inputs, sampled, expected, errors)
                estimates[observer.name].append(some_intervals(estimate, kept))
                done += end - begin
    if progress is not None:
        progress(1.0)
    return estimates


def _estimate_of(
    observer: Observer,
    record: Record,
    inputs: KnownInputs,
    sampled: list[Sampled],
    expected: Expected | None,
    errors: BeliefErrors | None,
) -> Estimate:
    """Return the estimate of an observer, with its deviations as far as they are known."""
    estimate = observer.run(inputs.time, inputs.q, inputs.v, inputs.tau, inputs.known, sampled)
    if not estimate.frames:
        estimate = rows_as_components(estimate, observer, inputs.v, expected)
    elif expected is not None:
        estimate = with_expected(estimate, observer, expected)
    elif errors is not None:
        estimate = with_belief_error(estimate, errors(observer, inputs))
    tilt, deviation = tilt_of(record.map), estimate.standard_deviation
    if tilt == 0.0 or deviation is None or not estimate.are_world_forces:
        return estimate
    return replace(estimate, standard_deviation=with_tilt(estimate.components, deviation, tilt))


def inputs_between(record: Record, forces: KnownForces) -> Callable[[int, int], KnownInputs]:
    """Return the function of first and last index, in one part of a record, that gives an observer's inputs there."""
    rows = believed_rows(record)
    if not record.robot.remembers:
        return lambda first, last: inputs_of(record, first, last, forces, rows)

    @cache
    def whole(begin: int, end: int) -> KnownInputs:
        return inputs_of(record, begin, end, forces, rows)

    def between(first: int, last: int) -> KnownInputs:
        begin, end = next(part for part in record.parts if part[0] <= first and last <= part[1])
        return whole(begin, end).between(first - begin, last - begin)

    return between


def blocks_of(first: int, last: int) -> Iterator[tuple[int, int]]:
    """Yield (begin, end) of blocks of `BLOCK` intervals that make up a part; the last one may be a tenth longer."""
    while first < last:
        end = last if last - first < 1.1 * BLOCK else first + BLOCK
        yield first, end
        first = end


def settled(record: Record, time: Array) -> NDArray[np.bool_]:
    """Return which intervals, by their starts (m,) [s], are not at the start of a part, where filters still rise."""
    wait = TIME_CONSTANTS_TO_SETTLE / float(record.map.observer.gain)
    good = np.ones(len(time), bool)
    for first, _ in record.parts:
        begin = record.start + record.after_start(first)
        good &= ~((time >= begin - 1e-9) & (time < begin + wait))
    return good


def rms_in(record: Record, estimate: StoredEstimate, stretch: tuple[float, float]) -> Array | None:
    """Return the rms (c,) of each component between two times after the start [s], where it is seen, else NaN.

    None if nothing is settled and seen there.
    """
    squares, count = np.zeros((2, len(estimate.head.units)))
    first, last = (estimate.index(record.start + time) for time in stretch)
    for begin in range(first, last + 1, ROWS_READ):
        block = estimate.between(begin, min(begin + ROWS_READ, last + 1))
        when = block.time[:-1] - record.start
        inside = settled(record, block.time[:-1]) & (when >= stretch[0]) & (when <= stretch[1])
        shown = block.shown & inside[:, None]
        squares += np.sum(np.where(shown, block.components, 0.0) ** 2, axis=0)
        count += shown.sum(axis=0)
    means = np.divide(squares, count, out=np.full_like(squares, np.nan), where=count > 0.0)
    return np.sqrt(means) if count.any() else None
