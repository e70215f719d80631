"""Checks of clocks and samples: rates, holes, repeated stamps, held values, recorder's clock, duplicates."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from aerobat_pin.estimation.recordings.columns import Columns
from aerobat_pin.estimation.recordings.findings import LogFinding
from aerobat_pin.estimation.recordings.record import Record
from aerobat_pin.estimation.recordings.resample import holes

HELD_SHARE = 0.3  # of samples that repeat the one before, from which a channel counts as held
STUCK = 0.5  # [s] without change, of a channel that otherwise changes
CLOCK_DELAY = 0.5e-3  # [s] between sensor's and recorder's stamps, or their scatter, that is worth a warning
LARGEST_COMPARED = 500_000_000  # bytes of files that are compared
MOST_COMPARED = 50


def stamp_findings(record: Record, columns: Columns) -> Iterator[LogFinding]:
    """Yield what the stamps and the sequence of samples show."""
    yield from _clocks(columns)
    found: dict[tuple[float, float], list[str]] = {}
    for key, channel in record.channels.items():
        rate = 1.0 / float(np.median(np.diff(channel.time)))
        gaps = [hole for hole in holes(channel.time, record.map.log.longest_gap) if hole[1] > record.start]
        same = np.all(np.diff(channel.values, axis=0) == 0.0, axis=1)
        moving = bool(np.any(np.diff(channel.values, axis=0) != 0.0))
        share = float(np.mean(same)) if moving else 0.0
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
        elif moving and not key.startswith("known"):
            yield from _stuck(record, key, channel.time[1:], same)
    for (begin, end), keys in found.items():
        whose = keys[0] if len(keys) == 1 else f"{keys[0]} and {len(keys) - 1} other channels"
        what = f"no sample of {whose} for {end - begin:.2f} s, from {begin - record.start:.2f} s on: left out"
        yield LogFinding("gap", "warning", what, end - begin, "s")
    yield from _duplicates(columns.path)


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
        if not len(clock.late):
            continue
        middle, scatter = float(np.median(clock.late)), float(np.std(clock.late))
        text = f"{name}: the recorder's stamps are {1e3 * middle:.1f} ms late and scatter by {1e3 * scatter:.1f} ms"
        if columns.stamps == "recorder" and max(abs(middle), scatter) > CLOCK_DELAY:
            yield LogFinding("recorder clock", "warning", f'{text}; log.clock = "header" avoids it', middle, "s")
        else:
            yield LogFinding("recorder clock", "note", f"{text}; the headers' are used", middle, "s")


def _stuck(record: Record, key: str, time: np.ndarray, same: np.ndarray) -> Iterator[LogFinding]:
    """Yield stretches in which a channel does not change although it does elsewhere, inside the used parts."""
    if float(np.mean(same)) > 0.9:
        return
    for first, last in record.parts:
        low, high = record.start + first * record.dt, record.start + last * record.dt
        inside = (time >= low) & (time <= high)
        at, runs = time[inside], np.flatnonzero(~same[inside])
        if len(runs) < 2:
            continue
        edges = np.concatenate([[0], runs, [len(at) - 1]])
        lengths = at[edges[1:]] - at[edges[:-1]]
        longest = int(np.argmax(lengths))
        if lengths[longest] > STUCK:
            begin = float(at[edges[longest]] - record.start)
            what = f"{key} does not change for {lengths[longest]:.2f} s, from {begin:.2f} s on"
            yield LogFinding("held channel", "warning", what, float(lengths[longest]), "s")


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
