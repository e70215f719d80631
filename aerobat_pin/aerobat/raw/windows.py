"""Windows of a long record, which the joint smoother takes one after the other."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from aerobat_pin.aerobat.raw.channels import RawRecord
from aerobat_pin.numerics import Array

LONGEST_STRETCH = 5.0  # [s]: records that are longer are smoothed in parts
LATE_PART, EARLY_PART = 0.6, 0.3  # [s] at the end of a part that are given up, and at its start for warming up


@dataclass(frozen=True)
class RecordPart:
    """Knots `start` to `stop` of a part; those from `first` to `last` are kept; the next window starts at `next`."""

    start: int
    stop: int
    first: int
    last: int
    next: int | None


def stretches(time: Array) -> Iterator[RecordPart]:
    """Yield the windows of a record with knots at `time` (m + 1,)."""
    start = first = 0
    end = len(time) - 1
    while True:
        stop = int(np.searchsorted(time, time[start] + LONGEST_STRETCH))
        if stop >= end or time[end] - time[stop] < LATE_PART:
            yield RecordPart(start, end, first, end, None)
            return
        last = int(np.searchsorted(time, time[stop] - LATE_PART))
        following = int(np.searchsorted(time, time[last] - EARLY_PART))
        yield RecordPart(start, stop, first, last, following)
        start, first = following, last


def part_of(record: RawRecord, start: int, stop: int) -> RawRecord:
    """Return the knots `start` to `stop` of a record; samples at the first knot stay out if it is not the record's."""
    if start == 0 and stop == len(record.time) - 1:
        return record
    low = -np.inf if start == 0 else record.time[start] + 1e-9
    high = np.inf if stop == len(record.time) - 1 else record.time[stop] + 1e-9
    channels = {}
    for name, channel in record.channels.items():
        use = (channel.time > low) & (channel.time <= high)
        channels[name] = replace(channel, time=channel.time[use], values=channel.values[use])
    return replace(record, time=record.time[start : stop + 1], channels=channels, known=record.known[start:stop])
