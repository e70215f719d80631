"""Draw what was estimated from a recording: forces, the sensor beside them, the motion, and what no force explains."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from aerobat_pin.estimation import Compared, RecordingEstimate, StoredEstimate
from aerobat_pin.numerics import Array
from aerobat_pin.observers import Estimate, Redundancy, slow_part
from aerobat_pin.records import LogChannel
from aerobat_pin.visualization import style

MOST_DRAWN = 4000  # of a line; a longer one is drawn by the extremes of each of its stretches
MOST_COLUMNS = 4
READ = 50_000  # samples that are read at once
LIVELY = 0.12  # share of the record that the figure of the sensor enlarges
CROSS_POINTS = 5000  # of one series against the other
Lines = tuple[Array, Array]


def draw_recording(found: RecordingEstimate) -> dict[str, Figure]:
    """Return the figures of a recording: name -> figure."""
    with mpl.rc_context(style.RC):
        figures = {"forces": _forces(found)}
        if found.compared:
            figures["sensor"] = _draw_sensor(found)
        figures["motion"] = _motion(found)
        if any(estimate.redundancy.redundant > 0 for estimate in found.stored.values()):
            figures["unexplained"] = _unexplained(found)
        return figures


def thinned(count: int, read: Callable[[int, int], Lines]) -> Lines:
    """Return a long series by the extremes of each of its stretches, so that no peak is lost, or a short one as it is.

    Args:
        count: number of samples.
        read: function that returns times (n,) and values (n, k) of the samples from one index to another (exclusive).

    Returns:
        Times (m,) and values (m, k).
    """
    if count <= MOST_DRAWN:
        return read(0, count)
    size = -(-count // (MOST_DRAWN // 2))
    times, values = [], []
    for first in range(0, count, size * max(1, READ // size)):
        time, found = read(first, min(first + size * max(1, READ // size), count))
        starts = np.arange(0, len(time), size)
        low, high = np.minimum.reduceat(found, starts), np.maximum.reduceat(found, starts)
        times.append(np.repeat(time[np.minimum(starts + size // 2, len(time) - 1)], 2))
        values.append(np.stack([low, high], axis=1).reshape(2 * len(starts), -1))
    return np.concatenate(times), np.concatenate(values)


def _estimate_lines(estimate: StoredEstimate, start: float, values_of: Callable[[Estimate], Array]) -> Lines:
    """Return values (n, k) of the intervals of an estimate over the time after the start of the record."""

    def read(first: int, last: int) -> Lines:
        part = estimate.between(first, last)
        return part.time[:-1] - start, values_of(part)

    return thinned(len(estimate), read)


def _sensor_lines(side: Compared, start: float, first: int, last: int) -> tuple[Array, Array, Array]:
    """Return times, estimate and sensor, as they are scored, of the intervals from one to another (exclusive)."""
    width = len(side.labels)

    def read(low: int, high: int) -> Lines:
        rows = slice(first + low, first + high)
        return side.start[rows] - start, np.concatenate([side.estimate[rows], side.sensor[rows]], axis=1)

    time, values = thinned(last - first, read)
    return time, values[:, :width], values[:, width:]


def _forces(found: RecordingEstimate) -> Figure:
    """Draw every estimated component over time, a column for each point."""
    first = next(iter(found.stored.values())).head
    labels = first.identifiability.components
    points = list(dict.fromkeys(label.rpartition(".")[0] for label in labels))[:MOST_COLUMNS]
    rows = max(sum(label.startswith(f"{point}.") for label in labels) for point in points)
    figure = Figure(figsize=(max(6.5, 3.2 * len(points)), 1.9 * rows + 1.0), layout="constrained")
    figure.suptitle(f"Unknown forces in {found.record.title}, interval means")
    grid = figure.subplots(rows, len(points), sharex=True, squeeze=False)
    start, free = found.record.start, found.record.map.use.free
    side = next(iter(found.compared.values()), None)
    measured = None if side is None else _sensor_lines(side, start, 0, len(side.start))
    lines = {
        observer: _estimate_lines(estimate, start, lambda part: part.components)
        for observer, estimate in found.stored.items()
    }
    for column, point in enumerate(points):
        grid[0][column].set_title(point)
        own = [label for label in labels if label.startswith(f"{point}.")]
        for row, label in enumerate(own):
            axis, k = grid[row][column], labels.index(label)
            name = label.rpartition(".")[2]
            if side is not None and measured is not None and side.point == point and name in side.labels:
                values = measured[2][:, side.labels.index(name)]
                axis.plot(measured[0], values, color=style.TRUTH, label="force sensor")
            for i, (observer, (time, values)) in enumerate(lines.items()):
                axis.plot(time, values[:, k], color=style.ESTIMATES[i % 4], label=observer, linewidth=0.9)
            axis.set_ylabel(f"{name} [{first.units[k]}]")
            if free is not None:
                axis.axvspan(free[0], free[1], color=style.FAINT, alpha=0.4, zorder=0)
        grid[rows - 1][column].set_xlabel("time [s]")
    handles, names = grid[0][0].get_legend_handles_labels()
    figure.legend(handles, names, loc="outside lower center", ncols=5)
    return figure


def _draw_sensor(found: RecordingEstimate) -> Figure:
    """Draw estimate and sensor as they are scored: a stretch enlarged, and one against the other."""
    name, side = next(iter(found.compared.items()))
    scores = side.scores(found.record.dt)
    count = len(side.labels)
    figure = Figure(figsize=(9.0, 2.4 * count), layout="constrained")
    smooth = found.record.map.check.wrench.filter if found.record.map.check.wrench is not None else None
    behind = f", both behind a zero-phase low-pass of {smooth:g} Hz" if smooth else ""
    figure.suptitle(f"{name} and force sensor at {side.point}{behind}")
    grid = figure.subplots(count, 2, squeeze=False, width_ratios=(2.4, 1.0))
    time, estimate, sensor = _sensor_lines(side, found.record.start, *_liveliest_stretch(side))
    points, true_points = _cross_points(side)
    for row, label in enumerate(side.labels):
        axis, cross = grid[row]
        axis.plot(time, sensor[:, row], color=style.TRUTH, label="force sensor")
        axis.plot(time, estimate[:, row], "--", color=style.ESTIMATES[0], label=name)
        axis.set_ylabel(f"{label} [{'N' if label[0] == 'F' else 'N m'}]")
        cross.plot(
            true_points[:, row], points[:, row], ".", ms=1.5, color=style.ESTIMATES[0], alpha=0.4, rasterized=True
        )
        low, high = cross.get_xlim()
        cross.plot([low, high], [low, high], color=style.TRUTH, linewidth=0.8)
        r2 = scores[label].r2
        cross.set_title(
            "hardly any signal" if r2 is None else f"R2 {r2:.3f}, rms of the difference {scores[label].rmse:.3g}",
            fontsize=8,
        )
        cross.set_ylabel("estimate")
    grid[-1][0].set_xlabel("time [s]")
    grid[-1][1].set_xlabel("sensor")
    style.legend_on_top(grid[0][0], ncols=2)
    return figure


def _liveliest_stretch(side: Compared) -> tuple[int, int]:
    """Return (first, last), exclusive, of an eighth of the record in which the sensor swings most."""
    count, mean = len(side.start), side.sample(MOST_DRAWN)[1].mean(axis=0)
    size = max(1, count // MOST_DRAWN)
    swings = []
    for first in range(0, count, size * 1000):
        swing = np.abs(side.sensor[first : first + size * 1000] - mean).sum(axis=1)
        swings.append(np.add.reduceat(swing, np.arange(0, len(swing), size)))
    bins = np.concatenate(swings)
    length = max(200 // size, round(LIVELY * len(bins)))
    if len(bins) <= length:
        return 0, count
    first = size * int(np.argmax(np.convolve(bins, np.ones(length), "valid")))
    return first, min(first + size * length, count)


def _cross_points(side: Compared) -> Lines:
    """Return estimate and sensor (n, k) of intervals that are scored, some thousands spread over the record."""
    every = max(1, len(side.start) // CROSS_POINTS)
    found, truth = [], []
    for start, one, other in side.pieces():
        rows = np.flatnonzero(side.scored(start))[::every]
        found.append(one[rows])
        truth.append(other[rows])
    return np.concatenate(found), np.concatenate(truth)


def _motion(found: RecordingEstimate) -> Figure:
    """Draw position, attitude's vector part or joint angles, whatever the recording has."""
    record = found.record
    keys: list[str] = [
        key for key in ("base.position", "base.velocity", "joints.position", "joints.effort") if key in record.channels
    ]
    keys = keys or list(record.channels)[:3]
    units = {"base.position": "m", "base.velocity": "m/s", "joints.position": "rad, m", "joints.effort": "N m, N"}
    figure = Figure(figsize=(8.0, 1.9 * len(keys) + 0.8), layout="constrained")
    figure.suptitle("The motion and efforts as they were recorded, SI units")
    for axis, key in zip(np.ravel(figure.subplots(len(keys), 1, sharex=True, squeeze=False)), keys, strict=True):
        channel = record.channels[key]
        names = channel.names
        if key.startswith("joints"):
            names = record.driven if key == "joints.effort" else record.joints

        def read(first: int, last: int, channel: LogChannel = channel) -> Lines:
            return channel.time[first:last] - record.start, channel.values[first:last]

        time, values = thinned(len(channel.time), read)
        for k, name in enumerate(names[:8]):
            axis.plot(
                time,
                values[:, k],
                style.LINE_STYLES[k // 4],
                color=(*style.AXIS_COLOURS, style.ORANGE)[k % 4],
                label=name,
            )
        axis.set_ylabel(f"{key}\n[{units.get(key, 'SI')}]")
        axis.legend(ncols=1, loc="center left", bbox_to_anchor=(1.0, 0.5))
        for first, last in record.parts:
            axis.axvspan(first * record.dt, last * record.dt, color=style.FAINT, alpha=0.25, zorder=0)
    figure.get_axes()[-1].set_xlabel("time [s]; grey: used")
    return figure


def _unexplained(found: RecordingEstimate) -> Figure:
    """Draw the slow part of what no force explains, by which the belief is judged, and the limit of its rms."""
    figure = Figure(figsize=(8.0, 2.6), layout="constrained")
    axis = figure.add_subplot()
    for i, (name, estimate) in enumerate(found.stored.items()):
        check = estimate.redundancy
        time, values = _estimate_lines(estimate, found.record.start, partial(_slow_unexplained, check=check))
        axis.plot(time, values[:, 0], color=style.ESTIMATES[i % 4], label=name, linewidth=0.8)
        axis.axhline(
            np.hypot(check.allowed, check.sensors),
            color=style.MUTED,
            linestyle="--",
            label="limit of its rms, sensors' noise included" if i == 0 else None,
        )
    axis.set(
        xlabel="time [s]", ylabel="unexplained a row [N]", title="Slow part of what no force at the points explains"
    )
    style.legend_on_top(axis, ncols=3)
    return figure


def _slow_unexplained(part: Estimate, check: Redundancy) -> Array:
    """Return the slow part (n, 1) of what no force explains, a row [N]."""
    slow = slow_part(part.time, part.unexplained)
    return np.asarray(np.linalg.norm(slow, axis=1)[:, None] / max(check.redundant, 1) ** 0.5)
