"""Check clocks and samples: rates, holes, stamps, held and interpolated values, recorder's clock, duplicates."""

from __future__ import annotations

import filecmp
import os
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from aerobat_pin.estimation.findings import LOST_SAMPLES, Finding, FindingVerdict
from aerobat_pin.numerics import LATEST_SHIFT, Array
from aerobat_pin.records import EXTENT, Channel, Clock, Columns, Record, longest_holes, typical_spacing

FEWEST_CHANGES = 4  # of a channel that can be told to be held
FREQUENT = 0.75  # share of samples that change in a channel that is not held
MOSTLY_HELD = 0.9  # share of repeats beyond which a channel counts as slow, not as stuck
RUN = 16  # changes whose distances are even in a channel that is held; those of a rounded slow signal are not
REGULAR = 0.5  # share of runs that must be even: one lost sample spoils a run
STUCK, FROZEN = 0.5, 0.1  # [s] without change, of a channel that otherwise changes; of a pose that jumps afterwards
OVER_USUAL, MOVES = 10.0, 0.1  # times as long as an effort else stays as it is; of its joint's range, meanwhile
MOVED_ON, STEPS_AFTER = 10.0, 10  # times the largest of so many steps afterwards, or one count: it moved on unseen
CUT_OFF, OFTEN_CUT_OFF = 10.0, 0.01  # times as many samples as at the next value, and of all: more than a coarse peak
FEWEST_LEVELS, MOVES_IN = 50, 10  # values of an effort that varies; samples within which an angle changes in motion
STRAIGHT = 0.5  # share of triples of neighbours on a straight line, from which a channel is interpolated
STRAIGHT_ERROR = 1e-7  # of the channel's range: how straight
FEWEST_STRAIGHT = 20  # samples that can be told to be interpolated
MOST_OFF = 0.5  # share of samples whose stamps do not fit, beyond which the others are no record
MOST_LOST = 0.6  # share of samples that another one with their stamp replaces, beyond which forces may be missed
CLOCK_DELAY = 0.5e-3  # [s] between sensor's and recorder's stamps, or their scatter, that is worth a warning
LARGEST_COMPARED = 500_000_000  # bytes of files that are compared
DRIFT, OVER_SCATTER = 5e-3, 5.0  # [s] by which a clock leaves the others over a log, and over its scatter at both ends
EMPTY = "leave its cells empty where there is no sample, or interpolate"
CHANNEL_WORDS = {  # keys of channels -> what messages call them
    "base.position": "position",
    "base.quaternion": "attitude",
    "base.velocity": "velocity",
    "base.rate": "gyro",
    "joints.position": "joint positions",
    "joints.velocity": "joint velocities",
    "joints.effort": "joint efforts",
    "check.specific_force": "accelerometer",
    "check.wrench": "force sensor",
}


def sample_findings(record: Record) -> Iterator[Finding]:
    """Yield what the stamps and the sequence of samples show."""
    if record.log is not None:
        yield from _clocks(record.log)
    gaps: dict[tuple[float, float], list[str]] = {}
    parts = [tuple(record.times(edge, edge)[0] for edge in part) for part in record.parts]
    clocks = {(len(channel.time), channel.time[0], channel.time[-1]) for channel in record.channels.values()}
    for channel in record.channels.values():
        angles = record.channels.get("joints.position") if channel.key == "joints.effort" else None
        yield from channel_findings(channel, parts, alone=len(clocks) > 1, angles=angles, start=record.start)
        for begin, end, whose in channel.holes:
            if end > record.start and record.knots is None:
                gaps.setdefault((begin, end), []).append(whose)
    efforts, positions = (record.channels.get(f"joints.{part}") for part in ("effort", "position"))
    if efforts is not None and positions is not None:
        for finds in (_dead_efforts, _stuck_efforts, _cut_off_efforts):
            yield from finds(record, efforts, positions)
    told, more = longest_holes(gaps)
    for begin, end in told:
        whose, *others = gaps[begin, end]
        whose += f" (and {len(others)} more)" * bool(others)
        what = f"no sample of {whose} for {end - begin:.2f} s, from {begin - record.start:.2f} s on: left out"
        yield Finding("gap", "warning", what, end - begin, "s")
    if more:
        yield Finding("gap", "warning", f"{more} shorter holes are left out, too", more, "1")
    if record.log is not None:
        yield from _duplicates(record.log.path)
        yield from _unsealed(record.log.path)


def _clocks(columns: Columns) -> Iterator[Finding]:
    """Yield what was dropped because of its stamp, and how the clocks of a bag differ."""
    delays = {name: np.concatenate(clock.late.spread()) for name, clock in columns.clocks.items() if clock.late}
    usual = min((float(np.median(late)) for late in delays.values()), key=abs, default=0.0)
    drifts = {name: _drift(late) for name, late in delays.items()}
    steady = min(drifts.values(), key=abs, default=0.0)
    for name, clock in columns.clocks.items():
        count = len(clock.time) + clock.repeated + clock.off + clock.backward
        if clock.repeated:
            yield _repeated(name, clock, count)
        if clock.off:
            what = f"{name}: {clock.off} of {count} samples have no stamp, or one that does not fit between its"
            verdict: FindingVerdict = "refused" if clock.off > MOST_OFF * count else "warning"
            yield Finding("time goes back", verdict, f"{what} neighbours': left out", clock.off / count, "1")
        if clock.backward:
            what = f"{name}: {clock.backward} of {count} samples go back in time (a file appended to itself?): dropped"
            yield Finding("time goes back", "warning", what, clock.backward / count, "1")
        if clock.set_back:
            what = f"{name}: the clock was set back {clock.set_back} x; samples stand where their stamps say"
            yield Finding("time goes back", "warning", what, clock.set_back, "1")
        if clock.reordered:
            what = f"{name}: {clock.reordered} of {count} rows stood behind later ones, and were sorted"
            yield Finding("order of rows", "note", what, clock.reordered / count, "1")
        if name in delays:
            drift = drifts[name] - steady if drifts[name] else 0.0
            yield _delay_finding(name, delays[name], usual, drift, recorder_used=columns.stamps == "recorder")


def _delay_finding(name: str, late: Array, usual_delay: float, drift: float, *, recorder_used: bool) -> Finding:
    """Return by how much (n,) [s] the recorder's stamps are later than the headers', and whether that is doubtful."""
    middle, scatter = float(np.median(late)), float(np.std(late))
    drifts = not recorder_used and abs(drift) > DRIFT
    text = f"{name}: the recorder's stamps are {1e3 * middle:.1f} ms late and scatter by {1e3 * scatter:.1f} ms"
    if recorder_used and max(abs(middle), scatter) > CLOCK_DELAY:
        text += '; log.clock = "header" avoids it'
    elif drifts:
        text += (
            f"; from the first tenth to the last they drift by {1e3 * drift:.0f} ms against those of other topics: its "
            'headers seem to have a clock of another rate (in a map: log.clock = "recorder")'
        )
    elif not recorder_used and abs(middle - usual_delay) > LATEST_SHIFT:
        text += (
            f", those of other topics {1e3 * usual_delay:.1f} ms: its headers seem to have another clock (in a map: "
            f'log.clock = "recorder", or delay = {usual_delay - middle:.3f} of what is read from it)'
        )
    else:
        text += "; these are used" if recorder_used else "; the headers' are used"
        return Finding("recorder clock", "note", text, middle, "s")
    return Finding("recorder clock", "warning", text, drift if drifts else middle, "s")


def _drift(late: Array) -> float:
    """Return how much later the recorder's stamps (n,) [s] are in their last tenth; 0 if they scatter as much."""
    n = max(len(late) // 10, 1)
    first, last = np.median(late[:n]), np.median(late[-n:])
    scatter = max(np.median(np.abs(late[:n] - first)), np.median(np.abs(late[-n:] - last)))
    return float(last - first) if abs(last - first) > OVER_SCATTER * scatter else 0.0


def _repeated(name: str, clock: Clock, count: int) -> Finding:
    """Return how many of a clock's samples have the stamp of the one before: most of those that differ are lost."""
    share = clock.repeated / count
    rounded = f" seem to be rounded to {clock.rounded_to:.2g} s: write them with more digits" * bool(clock.rounded_to)
    if clock.differing > MOST_LOST * count:
        what = f"{name}: {clock.differing} of {count} samples are not used, as earlier ones have their stamps"
        what += f", which{rounded or ' should tell samples apart'}"
        return Finding(LOST_SAMPLES, "warning", what, share, "1")
    what = f"{name}: {clock.repeated} of {count} samples have the stamp of the one before, and are merged with it"
    if not clock.differing:
        return Finding("repeated stamps", "note", what, share, "1")
    what += f"; {clock.differing} of them differ: the first value stays{rounded and f'; stamps{rounded}'}"
    return Finding("repeated stamps", "warning", what, share, "1")


def channel_findings(
    channel: Channel, parts: list[tuple[float, float]], *, alone: bool, start: float, angles: Channel | None = None
) -> Iterator[Finding]:
    """Yield a channel's rate, and that its samples are held, interpolated, or do not change for long.

    In the used `parts` [s] it may rest as long as joint positions, `angles`, do. `alone` says whether it has a clock of
    its own: in a table with one clock, slower channels are interpolated. Times are told after a `start` [s].
    """
    key, count, (differs, rests) = channel.key, len(channel.values), _changes(channel)
    changed = differs | rests
    if count < 2:
        return
    rate, share = 1.0 / typical_spacing(channel.time), float(np.mean(~changed))
    text = f"{rate:.4g} samples a second, {100.0 * share:.0f} % of them repeat the one before"
    yield Finding(f"rate of {key}", "note", text, rate, "Hz")
    if key.endswith(".supply") or key.startswith("extra.known") or not changed.any():
        return  # a controller holds its commands
    title = CHANNEL_WORDS.get(key, key.removeprefix("extra.").replace("_", " "))
    if _held(differs[~rests]):
        changes = f"{title} change{'' if title[-1] == 's' else 's'}"
        what = f"{changes} only {rate * (1.0 - share):.3g} times a second among {rate:.4g} samples a second; {EMPTY}"
        yield Finding("held channel", "warning", what, share, "1")
    elif share <= MOSTLY_HELD and not key.startswith("known"):
        yield from _stuck(channel, changed, parts, channel if key == "joints.position" else angles, start)
        if (straight := _straight(channel)) > STRAIGHT:
            what = f"{100.0 * straight:.0f} % of the neighbours in {title} lie on straight lines"
            yield Finding("interpolated channel", "warning" if alone else "note", f"{what}; {EMPTY}", straight, "1")


def _changes(channel: Channel) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Return whether samples (n - 1,) differ from the one before, and whether they are zero where this may last."""
    may_rest, differs, rests = rests_at_zero(channel.key), [np.zeros(0, bool)], [np.zeros(0, bool)]
    for values in channel.values.pieces(beyond=1):
        differs.append(np.any(np.diff(values, axis=0) != 0.0, axis=1))
        rests.append(np.all(values[1:] == 0.0, axis=1) & may_rest)
    return np.concatenate(differs), np.concatenate(rests)


def rests_at_zero(key: str) -> bool:
    """Return whether a channel may be zero for long: the rate of what stands, or a force where nothing touches."""
    return key == "check.wrench" or key.startswith("known.") or key.endswith((".velocity", ".rate"))


def _dead_efforts(record: Record, efforts: Channel, positions: Channel) -> Iterator[Finding]:
    """Yield efforts that never change although their joints move: a driver may fill in zeros for what it lacks."""
    moves = {joint for joint, rests in zip(record.joints, _constant(positions), strict=True) if not rests}
    moves -= {*record.map.robot.rows.ignore}
    dead = [joint for joint, rests in zip(record.driven, _constant(efforts), strict=True) if rests and joint in moves]
    if dead:
        whose = "joint efforts" if len(dead) == len(record.driven) else f"efforts of {', '.join(dead)}"
        what = f"{whose} never change although the joints move: are they measured at all? joints.passive names joints"
        text = f"{what} without a motor, robot.rows.ignore those whose efforts nobody knows"
        yield Finding("held channel", "warning", text, len(dead) / len(record.driven), "1")


def _stuck_efforts(record: Record, efforts: Channel, positions: Channel) -> Iterator[Finding]:
    """Yield efforts that do not change for long in a used part while their joints move, and other efforts change."""
    ranges = np.ptp(np.concatenate(positions.values.spread()), axis=0)
    differs = np.concatenate([np.diff(values, axis=0) != 0.0 for values in efforts.values.pieces(beyond=1)])
    for part in record.parts:
        low, high = (record.times(edge, edge)[0] for edge in part)
        begin, stop = efforts.time.index(low), efforts.time.index(high, "right")
        time, changed = efforts.time[begin:stop], differs[begin : stop - 1]
        for joint, changes in zip(record.driven, changed.T, strict=True):
            edges = np.concatenate([[0], np.flatnonzero(changes) + 1, [len(changes)]])
            at = int(np.argmax(np.diff(edges)))
            (first, last), others = edges[at : at + 2].tolist(), np.delete(np.diff(edges), at)
            usual = (others @ others) / max(others.sum(), 1)
            if len(others) <= FEWEST_CHANGES or last - first <= OVER_USUAL * usual or time[last] - time[first] <= STUCK:
                continue
            k, since, end = record.joints.index(joint), float(time[first]), float(time[last])
            angle = positions.between(since, end)[1][:, k]
            moves = len(angle) and np.ptp(angle) > MOVES * ranges[k] > 0.0
            if moves and changed[first + 1 : last - 1].any() and joint not in record.map.robot.rows.ignore:
                what = f"the effort of {joint} does not change for {end - since:.2f} s, from {since - record.start:.2f}"
                text = f"{what} s on, although it moves: a motor at its limit, or {EMPTY}"
                yield Finding("held channel", "warning", text, end - since, "s")


def _cut_off_efforts(record: Record, efforts: Channel, positions: Channel) -> Iterator[Finding]:
    """Yield efforts that stay at exactly their largest or least value while their joint moves, and else vary."""
    values, cut = efforts.values[:EXTENT], dict[str, float]()
    angles = dict(zip(record.joints, positions.values[:EXTENT].T, strict=True))
    for joint, effort in zip(record.driven, values.T, strict=True):
        angle = np.interp(efforts.time[: len(values)], positions.time[: len(angles[joint])], angles[joint])
        moves = np.abs(angle[MOVES_IN:] - angle[:-MOVES_IN]) > 0.0
        levels, counts = np.unique(effort[:-MOVES_IN][moves], return_counts=True)
        if len(levels) < FEWEST_LEVELS:
            continue  # as of steps that are commanded
        for end, beside in ((0, 1), (-1, -2)):
            share = float(counts[end] / len(values))
            if levels[end] != 0.0 and counts[end] > CUT_OFF * counts[beside] and share > OFTEN_CUT_OFF:
                cut[joint] = cut.get(joint, 0.0) + share
    if cut:
        whose = ", ".join(f"{joint} ({100.0 * share:.0f} % of the time)" for joint, share in cut.items())
        what = f"efforts stay at exactly their largest or least value in motion: {whose}; are they cut off there, or"
        yield Finding("effort at its limit", "warning", f"{what} are motors at their limits?", max(cut.values()), "1")


def _constant(channel: Channel) -> NDArray[np.bool_]:
    """Return whether each column never changes."""
    first = channel.values[0]
    return np.asarray(np.all([np.all(values == first, axis=0) for values in channel.values.pieces()], axis=0))


def _held(changed: NDArray[np.bool_]) -> bool:
    """Return whether samples repeat at even intervals, as those of a slower sensor do, also while they change."""
    at = np.flatnonzero(changed)
    if not FEWEST_CHANGES < len(at) < FREQUENT * len(changed):
        return False
    run = min(RUN, len(at) // 2)
    lengths = at[run:] - at[:-run]
    usual = float(np.median(lengths))
    return run < FREQUENT * usual and float(np.mean(np.abs(lengths - usual) <= 1.0)) >= REGULAR


def _stuck(
    channel: Channel, changed: NDArray[np.bool_], parts: list[tuple[float, float]], angles: Channel | None, start: float
) -> Iterator[Finding]:
    """Yield stretches of the used parts in which a channel does not change although it does elsewhere.

    A robot that stands is no fault: velocities say if it moves nevertheless.
    """
    for low, high in parts:
        first, last = channel.time.index(low), channel.time.index(high, "right") - 1
        changes = first + 1 + np.flatnonzero(changed[first:last])
        edges = np.concatenate([[first], changes, [last]])
        k = int(np.argmax(np.diff(edges)))
        begin, end = float(channel.time[int(edges[k])]), float(channel.time[int(edges[k + 1])])
        others = np.delete(np.diff(edges), k)
        jumps = np.diff(edges)[k] * others.sum() > OVER_USUAL * (others @ others) and end - begin > FROZEN
        jumps = jumps and channel.key in ("base.position", "base.quaternion") and _moved(channel, begin, end)
        if len(changes) > 1 and (jumps or end - begin > STUCK):
            what = f"{channel.key} does not change for {end - begin:.2f} s, from {begin - start:.2f} s on"
            at_rest = angles is not None and not _moved(angles, begin, end)
            what += f"; {EMPTY}" * bool(jumps and not at_rest)
            yield Finding("held channel", "note" if at_rest else "warning", what, end - begin, "s")


def _moved(angles: Channel, begin: float, end: float) -> bool:
    """Return whether joint positions change between two times [s], or jump at the second."""
    first, last = angles.time.index(begin), angles.time.index(end)
    seen, after = angles.values[first:last], np.abs(np.diff(angles.values[last - 1 : last + STEPS_AFTER], axis=0))
    steps = np.abs(np.diff(angles.values[:EXTENT], axis=0))
    least = np.maximum(np.min(steps, axis=0, initial=np.inf, where=steps > 0.0), after[1:].max(axis=0, initial=0.0))
    return bool(np.any(seen != seen[:1]) or (len(after) > 1 and np.any(after[0] > MOVED_ON * least)))


def _straight(channel: Channel) -> float:
    """Return the share of neighbours on straight lines; of joints and cranks none, which are driven steadily."""
    values = channel.values[:EXTENT]
    if channel.key.startswith(("joints.position", "extra.")) or len(values) < FEWEST_STRAIGHT:
        return 0.0
    step = np.diff(channel.time[: len(values)])
    share = (step[1:] / (step[1:] + step[:-1]))[:, None]
    bend = np.abs(values[1:-1] - (values[:-2] * share + values[2:] * (1.0 - share)))
    rounding = 4.0 * np.finfo(float).eps * np.max(np.abs(values), axis=0) + 1e-19
    moving = np.any(values[2:] != values[:-2], axis=1)
    return float(np.mean(np.all(bend < STRAIGHT_ERROR * np.ptp(values, axis=0) + rounding, axis=1) & moving))


def _unsealed(path: Path) -> Iterator[Finding]:
    """Yield that a bag has no checksums, by which damaged numbers would be noticed."""
    from aerobat_pin.records import mcap_is_sealed  # its module reads bags, and a flight needs none

    files = sorted(path.glob("*.mcap")) if os.path.isdir(path) else [path] if path.suffix.lower() == ".mcap" else []
    if bare := [file.name for file in files if not mcap_is_sealed(file)]:
        yield Finding("checksums", "note", f"{', '.join(bare)} has none: damaged numbers would not be noticed")


def _duplicates(path: Path) -> Iterator[Finding]:
    """Yield files beside the log that hold the same bytes under another name."""
    if not os.path.isfile(path) or path.stat().st_size > LARGEST_COMPARED:
        return
    for other in sorted(path.parent.glob(f"*{path.suffix}")):
        if other != path and other.is_file() and filecmp.cmp(path, other, shallow=False):
            what = os.fsencode(other.name).decode(errors="replace") + " beside it holds the same bytes: one log twice"
            yield Finding("duplicate file", "warning", what, float(path.stat().st_size), "bytes")
