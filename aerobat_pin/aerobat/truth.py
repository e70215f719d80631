"""The true unknown forces of a simulated flight, as interval means, and their events such as steps and pushes."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from aerobat_pin.aerobat.flight_log import FlightLog
from aerobat_pin.numerics import Array, guarded
from aerobat_pin.records import Reference, TrueEvent

SUM = "sum"  # instead of a frame: the sum of the forces at all points


@guarded()
def true_force(log: FlightLog, frame: str) -> tuple[Array, Array]:
    """Return the true unknown force at a frame and its noise-free part, (m, 3) each, in world axes [N].

    Both are zero if no unknown force acts at the frame. The frame `sum` stands for all points together.
    """
    assert log.truth is not None
    points = [str(name) for name in log.truth["point"].values]
    if frame == SUM:
        return log.truth["force_W"].values.sum(axis=1), log.truth["force_noise_free_W"].values.sum(axis=1)
    if frame not in points:
        zero = np.zeros((log.truth.sizes["interval"], 3))
        return zero, zero
    at = points.index(frame)
    return log.truth["force_W"].values[:, at], log.truth["force_noise_free_W"].values[:, at]


@guarded()
def truth_of(log: FlightLog, frames: Sequence[str]) -> tuple[Reference, ...]:
    """Return the true forces at frames as references of estimates; none if the log has no truth."""
    if log.truth is None:
        return ()
    return tuple(Reference(frame, "truth", ("Fx", "Fy", "Fz"), *true_force(log, frame)) for frame in frames)


@guarded()
def true_events(log: FlightLog) -> list[TrueEvent]:
    """Return the events of the true forces, sorted by time; an event at several frames is listed once."""
    if log.truth is None or "event" not in log.truth.dims:
        return []
    names, frames, starts, ends = (
        log.truth[name].values for name in ("event", "event_point", "event_start", "event_end")
    )
    found: dict[tuple[float, float, str], list[str]] = {}
    for name, frame, start, end in zip(names, frames, starts, ends, strict=True):
        found.setdefault((float(start), float(end), str(name)), []).append(str(frame))
    return [TrueEvent(name, tuple(there), start, end) for (start, end, name), there in sorted(found.items())]
