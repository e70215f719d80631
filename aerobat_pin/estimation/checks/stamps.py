"""Checks of clocks and samples: rates, holes, repeated stamps, held values, recorder's clock, duplicates."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from aerobat_pin.estimation.findings import LogFinding
from aerobat_pin.numerics import Array
from aerobat_pin.records import EXTENT, Columns, LogChannel, Record, holes, mcap_is_sealed, typical_spacing

HELD_SHARE = 0.3  # of samples that repeat the one before, from which a channel counts as held
MOSTLY_HELD = 0.9  # share of repeats beyond which a channel counts as slow, not as stuck
STUCK = 0.5  # [s] without change, of a channel that otherwise changes
CLOCK_DELAY = 0.5e-3  # [s] between sensor's and recorder's stamps, or their scatter, that is worth a warning
LARGEST_COMPARED = 500_000_000  # bytes of files that are compared
MOST_COMPARED = 50


def stamp_findings(record: Record) -> Iterator[LogFinding]:
    """Yield what the stamps and the sequence of samples show."""
    if record.log is not None:
        yield from _clocks(record.log)
    found: dict[tuple[float, float], list[str]] = {}
    for key, channel in record.channels.items():
        rate = 1.0 / typical_spacing(channel.time)
        gaps = [hole for hole in holes(channel.time, record.map.log.longest_gap) if hole[1] > record.start]
        repeats = sum(int(np.sum(same)) for _, same in _repeats(channel, 0, len(channel.time)))
        moving = repeats < len(channel.time) - 1
        share = repeats / (len(channel.time) - 1) if moving else 0.0
        text = f"{rate:.4g} Hz, {len(gaps)} gaps, {100.0 * share:.0f} % of samples repeat the one before"
        yield LogFinding(f"rate of {key}", "note", text, rate, "Hz")
        for gap in gaps:
            found.setdefault(gap, []).append(key)
        if share > HELD_SHARE and not key.endswith(".supply"):
            own = rate * (1.0 - share)
            what = (
                f"{key} repeats its last value in {100.0 * share:.0f} % of its samples: it comes at "
                f"{own:.3g} Hz, not {rate:.3g}"
            )
            yield LogFinding("held channel", "warning", what, share, "1")
        elif moving and share <= MOSTLY_HELD and not key.startswith("known"):
            yield from _stuck(record, key, channel)
    for (begin, end), keys in found.items():
        whose = keys[0] if len(keys) == 1 else f"{keys[0]} and {len(keys) - 1} other channels"
        what = f"no sample of {whose} for {end - begin:.2f} s, from {begin - record.start:.2f} s on: left out"
        yield LogFinding("gap", "warning", what, end - begin, "s")
    if record.log is not None:
        yield from _duplicates(record.log.path)
        yield from _unsealed(record.log.path)


def _clocks(columns: Columns) -> Iterator[LogFinding]:
    """Yield what was dropped because of its stamp, and how the clocks of a bag differ."""
    for name, clock in columns.clocks.items():
        count = len(clock.time) + clock.repeated + clock.backward
        if clock.repeated:
            what = f"{name}: {clock.repeated} of {count} samples have the stamp of the one before: dropped"
            yield LogFinding("repeated stamps", "warning", what, clock.repeated / count, "1")
        if clock.backward:
            what = f"{name}: {clock.backward} of {count} samples go back in time (a file appended to itself?): dropped"
            yield LogFinding("time goes back", "warning", what, clock.backward / count, "1")
        if clock.late is None or not len(clock.late):
            continue
        late = np.concatenate(clock.late.spread())
        middle, scatter = float(np.median(late)), float(np.std(late))
        text = f"{name}: the recorder's stamps are {1e3 * middle:.1f} ms late and scatter by {1e3 * scatter:.1f} ms"
        if columns.stamps == "recorder" and max(abs(middle), scatter) > CLOCK_DELAY:
            yield LogFinding("recorder clock", "warning", f'{text}; log.clock = "header" avoids it', middle, "s")
        else:
            yield LogFinding("recorder clock", "note", f"{text}; the headers' are used", middle, "s")


def _repeats(channel: LogChannel, first: int, last: int) -> Iterator[tuple[Array, NDArray[np.bool_]]]:
    """Yield stamps [s] of samples `first` + 1 to `last` (exclusive), and whether they repeat the one before.

    A force of exactly zero is no repeat: a sensor that nothing touches may show it for long.
    """
    of_force = channel.key == "check.wrench" or channel.key.startswith("known.")
    for begin in range(first, last - 1, EXTENT):
        rows = slice(begin, min(begin + EXTENT + 1, last))
        values = channel.values[rows]
        same = np.all(np.diff(values, axis=0) == 0.0, axis=1)
        yield channel.time[rows][1:], same & np.any(values[1:] != 0.0, axis=1) if of_force else same


def _stuck(record: Record, key: str, channel: LogChannel) -> Iterator[LogFinding]:
    """Yield stretches in which a channel does not change although it does elsewhere, inside the used parts."""
    for part in record.parts:
        low, high = (record.start + index * record.dt for index in part)
        first, last = channel.time.index(low), channel.time.index(high, "right")
        changes, since, longest, begin = 0, None, 0.0, 0.0
        for time, same in _repeats(channel, max(first - 1, 0), last):
            ends = time[~same]
            changes += len(ends)
            edges = np.concatenate([[time[0] if since is None else since], ends, time[-1:]])
            lengths = np.diff(edges)
            if float(lengths.max()) > longest:
                longest, begin = float(lengths.max()), float(edges[int(np.argmax(lengths))] - record.start)
            since = float(edges[-2])
        if changes > 1 and longest > STUCK:
            what = f"{key} does not change for {longest:.2f} s, from {begin:.2f} s on"
            yield LogFinding("held channel", "warning", what, longest, "s")


def _unsealed(path: Path) -> Iterator[LogFinding]:
    """Yield that a bag has no checksums, by which damaged numbers would be noticed."""
    files = sorted(path.glob("*.mcap")) if os.path.isdir(path) else [path] if path.suffix.lower() == ".mcap" else []
    bare = [file.name for file in files if not mcap_is_sealed(file)]
    if bare:
        yield LogFinding("checksums", "note", f"{', '.join(bare)} has none: damaged numbers would not be noticed")


def _duplicates(path: Path) -> Iterator[LogFinding]:
    """Yield files beside the log that hold the same bytes under another name."""
    if not os.path.isfile(path) or path.stat().st_size > LARGEST_COMPARED:
        return
    size = path.stat().st_size
    others = [
        other
        for other in sorted(path.parent.glob(f"*{path.suffix}"))
        if other != path and other.is_file() and other.stat().st_size == size
    ][:MOST_COMPARED]
    if not others:
        return
    own = _digest(path)
    for other in others:
        if _digest(other) == own:
            what = f"{other.name} beside it holds the same bytes: one recording under two names, not two"
            yield LogFinding("duplicate file", "warning", what, float(size), "bytes")


def _digest(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
