"""Open a recording: read what the map names, find the common times, and leave out what cannot be used."""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from aerobat_pin.errors import LogError, MapError
from aerobat_pin.numerics import guarded, runs_of_true
from aerobat_pin.records.block import Channel
from aerobat_pin.records.channels import base_requests, channel_of, check_same_rows, further_requests, named_columns
from aerobat_pin.records.columns import Columns
from aerobat_pin.records.joint_channels import requests_of, with_efforts_there, without_failed_readings
from aerobat_pin.records.joint_names import as_names, listed_joints, nearest_joints, renamed_joints
from aerobat_pin.records.map_file import load_map, without_absent
from aerobat_pin.records.map_tables import Map
from aerobat_pin.records.read import read_columns
from aerobat_pin.records.record import Record
from aerobat_pin.records.resample import longest_holes, rate_beside_holes
from aerobat_pin.records.robot_files import robot_of_map
from aerobat_pin.records.robots import PlainRobot
from aerobat_pin.records.spool import EXTENT, Series, typical_spacing

STEP_ERROR = 0.05  # share by which usual steps may be longer than `log.longest_gap`: stamps scatter
LEAST_SAMPLES = 10  # of a part; a shorter one is dropped
LEAST_OWN = 3  # of a part at times of its own: fewer samples do not give rates
FASTEST = 20_000.0  # [Hz] of the common times
MOST_TIMES = 1 << 45  # common times from the first to the last, holes included; beyond they are no longer evenly spaced


@guarded()
def open_by_map(
    path: Path | str, chosen: Map | Path | str, folder: Path | str | None = None, robot: PlainRobot | None = None
) -> Record:
    """Read a recording by its map.

    Args:
        path: the log.
        chosen: the map, or its file.
        folder: where relative paths of the map begin; at its file, or here, when omitted.
        robot: a robot that knows more than the map says; the map's own when omitted.

    Raises:
        LogError, MapError: the log or the map lacks something, or they do not fit together.
    """
    path, folder = Path(path), None if folder is None else Path(folder)
    if not isinstance(chosen, Map):
        folder, chosen = folder or Path(chosen).parent, load_map(Path(chosen))
    folder = folder or Path()
    robot = (robot or robot_of_map(chosen.robot, folder)).carrying(chosen.payload)
    chosen = with_held_joints(chosen, robot)
    asked = [*base_requests(chosen), *further_requests(chosen)]
    wanted = {name for request in asked for name in request.names} | named_columns(chosen)
    columns = read_columns(path, chosen.log, wanted)
    chosen = without_absent(chosen, columns)
    joints, notes = _sensed_joints(chosen, robot, columns)
    chosen, asked, unsensed = with_efforts_there(chosen, requests_of(chosen, robot, joints), columns.values)
    columns = without_failed_readings(asked, columns)
    if chosen.log.times == "own":
        for request in asked:
            check_same_rows(request, columns)
    read = ((request.key, channel_of(request, columns, chosen.log.longest_gap)) for request in asked)
    channels = {key: channel for key, channel in read if channel is not None}
    _check_complete(chosen, robot, channels)
    if (fault := robot.fault(channels)) is not None:
        raise LogError(f"log {path}: {fault}")
    times = _common_times(path, chosen, channels, columns)
    _check_stretches(chosen, times.end - times.start)
    start, (parts, dropped) = times.start, _parts(chosen, columns, channels, times)
    if times.knots is not None and robot.smooths(channels):
        start, parts, dropped = times[0], ((0, len(times) - 1),), ()
    if not parts:
        raise LogError(f"log {path}: no part is left to use: {'; '.join(dropped) or 'it is too short'}")
    driven = next((each.joints for each in asked if each.key == "joints.effort" and each.key in channels), ())
    turned = (item for channel in channels.values() for item in channel.turns.items())
    taken = [f"{joint}: jumps by a full turn are taken out ({count})" for joint, count in turned]
    lacked = [each.names for each in asked if each.key not in channels and columns.values.keys() >= {*each.names}]
    taken += [f"{', '.join(names)} are 0 in every message: found from the positions" for names in lacked]
    log, notes = replace(columns, values={}), (*columns.notes, *notes, *unsensed, *taken, *dropped)
    return Record(chosen, robot, channels, joints, driven, start, times.rate, parts, notes, times.knots, log, folder)


@guarded()
def with_held_joints(chosen: Map, robot: PlainRobot) -> Map:
    """Return a map in which `held = {"*" = 0.0}` stands for every joint that `joints.names` does not name."""
    fixed = chosen.joints.held
    if "*" not in fixed:
        return chosen
    names = {*listed_joints(chosen.joints.names), *renamed_joints(chosen.joints.names).values()}
    unnamed = {name: fixed["*"] for name in robot.joints if name not in names}
    places = {**unnamed, **{name: place for name, place in fixed.items() if name != "*"}}
    return chosen.model_copy(update={"joints": chosen.joints.model_copy(update={"held": places})})


def _sensed_joints(chosen: Map, robot: PlainRobot, columns: Columns) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Return the joints that have channels, and notes. Raises MapError unless every joint is known or held."""
    table = chosen.joints
    listed, renamed = listed_joints(table.names), renamed_joints(table.names)
    unknown = [name for name in (*listed, *renamed.values(), *table.held, *table.passive) if name not in robot.joints]
    if unknown:
        raise MapError(f"map: joints: no joint '{unknown[0]}' in the robot; there are {', '.join(robot.joints)}")
    notes, strangers = [], list[str]()
    if robot.unread:
        notes.append(f"not read from the robot's file: {', '.join(robot.unread)}")
    if nobody := robot.impossible:
        notes.append(f"no body has the moments of inertia of {', '.join(nobody)}")
    names = listed or tuple(name for name in robot.joints if name not in table.held)
    if table.topic is not None:
        start = f"{table.topic}.position."
        heard = [name.removeprefix(start) for name in columns.names if name.startswith(start)]
        if not heard:
            raise columns.missing(table.topic, "joints.topic")
        joints = [renamed.get(name, name) for name in heard]
        strangers = [name for name in joints if name not in robot.joints]
        if strangers:
            notes.append(f"joints of {table.topic} that the robot does not have are left out: {', '.join(strangers)}")
        names = listed or tuple(name for name in joints if name in robot.joints and name not in table.held)
    elif renamed:
        raise MapError("map: joints.names is a table, which renames joints of joints.topic: a list was expected")
    elif table.position is None and (table.velocity is None or not table.velocity.columns):
        names = ()
    missing = [name for name in robot.joints if name not in names and name not in table.held]
    if missing and not robot.moves_joints:
        hint = "name their columns"
        following = [f"{name} mimics {robot.mimics[name].leader}" for name in missing if name in robot.mimics]
        hint += f" ({', '.join(following)}, and moves with it)" * bool(following)
        topics = [name for name, kind in columns.kinds.items() if "JointState" in kind and name != table.topic]
        hint = f"does {topics[0]} have them? Columns can be of several topics" if topics and not following else hint
        if strangers:
            alike = as_names(nearest_joints(strangers, missing) or {"NAME": missing[0]})
            hint = f"{table.topic} has {', '.join(strangers)}: if one of them is meant, write {alike}"
        raise MapError(
            f"map: joints: {', '.join(missing)} have no channel; {hint}, or write joints.held = "
            f"{{{missing[0]} = 0.0}} for a joint that stands still (its row is then not believed)"
        )
    if driven := [name for name in table.held if name in robot.mimics and robot.mimics[name].leader in names]:
        leader = robot.mimics[driven[0]].leader
        raise MapError(
            f"map: joints: {driven[0]} is in held, but the robot's file says that it mimics {leader}, which moves: its "
            f"share of the effort would be taken for a force. Name its columns: position and velocity follow those of "
            f"{leader}, and its effort is what it takes of the motor's"
        )
    if still := [name for name in table.passive if name in table.held]:
        raise MapError(f"map: joints: {still[0]} is in held, which drives it by an unknown effort, and in passive: one")
    if table.passive:
        notes.append(f"without a motor, efforts known to be 0: {', '.join(table.passive)}")
    if table.held:
        fixed = ", ".join(f"{name} at {place:g}" for name, place in table.held.items())
        notes.append(f"held still, rows not believed: {fixed}")
    return names, tuple(notes)


def _check_complete(chosen: Map, robot: PlainRobot, channels: dict[str, Channel]) -> None:
    """Raise MapError if a free base lacks what its motion is found from, or that does not tell what the robot needs."""
    source = chosen.base.from_
    if not robot.free and source != "measured":
        raise MapError(f'map: base.from = "{source}", but the base is fixed: robot.root = "free_flyer" was expected')
    if not robot.free or chosen.base.held:
        return
    if source == "measured":
        if missing := [part for part in ("position", "quaternion") if f"base.{part}" not in channels]:
            raise MapError(
                f"map: the robot's base is free, but base.{missing[0]} has no columns and no topic; a base that stands "
                'still is base.held = true, and one that is screwed down robot.root = "fixed"'
            )
        return
    if robot.knows_forces:
        raise MapError(
            f'map: base.from = "{source}" tells the base\'s velocity but for a constant, and not its place; the '
            f"forces that {robot.title} knows itself, such as its air, depend on them: base.position and "
            "base.velocity must be measured"
        )
    if source == "joints" and not robot.joints:
        raise MapError(
            'map: base.from = "joints" believes the rows of joints alone, and the robot has none: "imu" or '
            '"measured" was expected'
        )
    for part in ("quaternion", "acceleration") if source == "imu" else ("quaternion",):
        if f"base.{part}" not in channels:
            why = "gravity is known in its axes alone" if part == "quaternion" else "it gives the velocity"
            raise MapError(f'map: base.from = "{source}", but base.{part} has no columns and no topic: {why}')
    if source == "imu" and chosen.log.times == "own":
        raise MapError('map: base.from = "imu" needs even times: log.times = "even" was expected')


def _check_stretches(chosen: Map, length: float) -> None:
    """Raise MapError if a stretch of a map [s] is outside a record of some length [s]."""
    friction, wrench, payload = chosen.joints.friction, chosen.check.wrench, chosen.payload
    stretches = {
        "use.free": chosen.use.free,
        "joints.friction.fit": None if friction is None else friction.fit,
        "payload.fit": None if payload is None else payload.fit,
        "check.wrench.tare": None if wrench is None else wrench.tare,
        "check.wrench.part": None if wrench is None else wrench.part,
        **{f"known.{name}.tare": section.tare for name, section in chosen.known.items()},
    }
    for key, stretch in stretches.items():
        if stretch is not None and not (stretch[0] < length and stretch[1] > 0.0):
            raise MapError(f"map: {key} = {list(stretch)}: a stretch within the record's {length:.3g} s was expected")


@dataclass(frozen=True)
class _CommonTimes(Sequence[float]):
    """The times [s] that all channels share: evenly spaced, or a record's own, some of which may lie outside."""

    start: float  # the first one [s]
    rate: float  # [Hz]
    end: float  # the last one, at most [s]
    knots: Series | None  # a record's own

    def __len__(self) -> int:
        return int(np.floor((self.end - self.start) * self.rate + 1e-6)) + 1 if self.knots is None else len(self.knots)

    def __getitem__(self, index: Any) -> Any:
        if self.knots is not None:
            return self.knots[index] if isinstance(index, slice) else float(self.knots[index])
        at = np.arange(index.start, index.stop) if isinstance(index, slice) else index
        return self.start + at / self.rate


def _common_times(path: Path, chosen: Map, channels: dict[str, Channel], columns: Columns) -> _CommonTimes:
    """Return the times that all channels share. Raises MapError without channels, LogError for rates and spans."""
    if not channels:
        raise MapError(
            "map: no channel is named: base.held = true and no joints and no known force leave nothing to see"
        )
    leading = next(channels[key] for key in ("joints.position", "base.position", *channels) if key in channels)
    knots, least = None, float(LEAST_SAMPLES)
    if chosen.log.times == "own":
        leading = max(channels.values(), key=lambda channel: len(channel.time))
        knots, least = leading.time, LEAST_OWN - 1.5
    if (spacing := typical_spacing(leading.time)) > chosen.log.longest_gap * (1.0 + STEP_ERROR):
        clock = columns.clocks[columns.clock_of[leading.names[0]]]
        raise LogError(
            f"log {path}: time rises by {spacing:g} s from sample to sample of {leading.key} (log.time.unit = "
            f"'{chosen.log.time.unit or 's'}'): at most log.longest_gap = {chosen.log.longest_gap:g} s was expected"
            f"{clock.not_used}"
        )
    rate = chosen.log.rate or 1.0 / spacing
    if knots is not None:
        rate = rate_beside_holes(knots, chosen.log.longest_gap)
    if not 0.0 < rate <= FASTEST:
        unit = f" (log.time.unit = '{chosen.log.time.unit or 's'}')" if not columns.kinds else ""
        mean = (len(leading.time) - 1) / float(leading.time[-1] - leading.time[0])
        most = f"{FASTEST:g} were expected"
        most += f"; stamped in bursts? log.rate = {mean:.4g} is the mean" if mean <= FASTEST else ""
        raise LogError(f"log {path}: {leading.key} has {rate:.3g} samples a second{unit}: at most {most}")
    start = max(channel.time[0] for channel in channels.values())
    end = min(channel.time[-1] for channel in channels.values())
    low, high = chosen.use.part or (0.0, np.inf)
    start, end = max(start, start + low), min(end, start + high)
    if (end - start) * rate < least:
        spans = ", ".join(f"{key} {each.time[0]:.3f} to {each.time[-1]:.3f} s" for key, each in channels.items())
        count = LEAST_SAMPLES if knots is None else LEAST_OWN
        raise LogError(f"log {path}: its channels have less than {count} samples in common: {spans}")
    if (end - start) * rate > MOST_TIMES:
        raise LogError(
            f"log {path}: its stamps go from {start:.6g} to {end:.6g} s at {rate:.4g} samples a second: at most "
            f"{MOST_TIMES / rate:.3g} s were expected; is one of them wrong?"
        )
    return _CommonTimes(float(start), float(rate), float(end), knots)


def _parts(
    chosen: Map, columns: Columns, channels: dict[str, Channel], times: _CommonTimes
) -> tuple[tuple[tuple[int, int], ...], tuple[str, ...]]:
    """Return the parts of the common times that are used, and what was dropped and why."""
    start, end, own, longest_gap = times.start, times.end, times.knots is not None, chosen.log.longest_gap
    notes, missing = list[str](), {(-np.inf, start), (end, np.inf)} if own else set[tuple[float, float]]()
    for where, side, row in (("first", 1.0, 0), ("last", -1.0, -1)):
        edges = [(side * float(channel.time[row]), key) for key, channel in channels.items()]
        if (cut := max(edges)[0] - min(edges)[0]) > longest_gap:
            notes.append(f"the {where} {cut:.3g} s are left out: not all columns of {max(edges)[1]} have samples there")
    for key, channel in channels.items():
        if (usual := typical_spacing(channel.time)) > longest_gap * (1.0 + STEP_ERROR):
            notes.append(f"{key}: a sample every {usual:.3g} s, beyond log.longest_gap: interpolated all the same")
        gaps = [hole for hole in channel.holes if hole[1] > start and hole[0] < end]
        missing |= {hole[:2] for hole in gaps}
        told, more = longest_holes(gaps)
        for begin, finish, whose in told:
            lasts = finish - begin
            notes.append(f"{whose}: no sample from {begin - start:.3f} to {finish - start:.3f} s ({lasts:.2f} s)")
        notes += [f"{key}: no sample in {more} shorter holes"] * bool(more)
    runs, covered, used, begins = list[tuple[int, int]](), 0, 0, sorted(begin for begin, _ in missing)
    if (when := chosen.use.when) is not None:
        level = Channel("use.when", (when.column,), *columns.series(when.column, "use.when.column"))
        least, most = (-np.inf if when.above is None else when.above), (np.inf if when.below is None else when.below)
    for low, high in _outside(missing, times):
        time = times[low:high]
        good = np.ones(len(time), bool)
        if when is not None:
            height = np.interp(time, *level.between(time[0], time[-1], extra=2))
            good = (height >= least) & (height <= most)
        covered, used = covered + len(good), used + int(np.sum(good))
        for first, last in runs_of_true(good):
            follows = runs and runs[-1][1] == low + first - 1
            if follows and (not own or bisect_left(begins, time[0]) == bisect_left(begins, times[low - 1])):
                runs[-1] = (runs[-1][0], low + last - 1)
            else:
                runs.append((low + first, low + last - 1))
    trim, parts, short = (0, 0), list[tuple[int, int]](), list[int]()
    if when is not None:
        trim = round(when.trim[0] * times.rate), round(when.trim[1] * times.rate)
        share = 1.0 - used / max(covered, 1)
        notes.append(f"use.when {when.column}: {100.0 * share:.0f} % of the record is left out")
    for first, last in ((first + trim[0], last - trim[1]) for first, last in runs):
        if last - first + 1 >= (LEAST_OWN if own else LEAST_SAMPLES):
            parts.append((first, last))
        elif last > first:
            short.append(last - first + 1)
    notes += [f"parts of {', '.join(map(str, sorted({*short})))} samples are left out"] * bool(short)
    return tuple(parts), tuple(notes)


def _outside(missing: Iterable[tuple[float, float]], times: _CommonTimes) -> Iterator[tuple[int, int]]:
    """Yield (first, last), exclusive, of the common times that are in no hole, in pieces of at most `EXTENT`.

    A hole costs the same however long it is: one wrong stamp can make it a year.
    """
    first = 0
    for begin, finish in (*sorted(missing), (np.inf, np.inf)):
        last = bisect_right(times, begin)
        for low in range(first, last, EXTENT):
            yield low, min(low + EXTENT, last)
        first = max(first, bisect_left(times, finish))
