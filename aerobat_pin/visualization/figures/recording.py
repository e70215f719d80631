"""Draw what was estimated from a recording: forces, the sensor beside them, the motion, and what no force explains."""

from __future__ import annotations

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from aerobat_pin.estimation import RecordingEstimate
from aerobat_pin.numerics import Array
from aerobat_pin.visualization import style

MOST_DRAWN = 4000  # of a line; a longer one is drawn by the extremes of each of its stretches
MOST_COLUMNS = 4
Lines = tuple[Array, Array]


def draw_recording(found: RecordingEstimate) -> dict[str, Figure]:
    """Return the figures of a recording: name -> figure."""
    with mpl.rc_context(style.RC):
        figures = {"forces": _forces(found)}
        if found.compared:
            figures["sensor"] = _draw_sensor(found)
        figures["motion"] = _motion(found)
        if any(estimate.redundancy.redundant > 0 for estimate in found.estimates.values()):
            figures["unexplained"] = _unexplained(found)
        return figures


def thinned(time: Array, values: Array) -> Lines:
    """Return the extremes (n,) of a long series in each of its stretches, so that no peak is lost."""
    if len(time) <= MOST_DRAWN:
        return time, values
    size = -(-len(time) // (MOST_DRAWN // 2))
    starts = np.arange(0, len(time), size)
    low, high = np.minimum.reduceat(values, starts), np.maximum.reduceat(values, starts)
    middle = np.minimum(starts + size // 2, len(time) - 1)
    return np.repeat(time[middle], 2), np.stack([low, high], axis=1).ravel()


def _forces(found: RecordingEstimate) -> Figure:
    """Draw every estimated component over time, a column for each point."""
    first = next(iter(found.estimates.values()))
    labels = first.identifiability.components
    points = list(dict.fromkeys(label.rpartition(".")[0] for label in labels))[:MOST_COLUMNS]
    rows = max(sum(label.startswith(f"{point}.") for label in labels) for point in points)
    figure = Figure(figsize=(max(6.5, 3.2 * len(points)), 1.9 * rows + 1.0), layout="constrained")
    figure.suptitle(f"Unknown forces in {found.log.name}, interval means")
    grid = figure.subplots(rows, len(points), sharex=True, squeeze=False)
    start = found.record.start
    for column, point in enumerate(points):
        grid[0][column].set_title(point)
        own = [label for label in labels if label.startswith(f"{point}.")]
        for row, label in enumerate(own):
            axis, k = grid[row][column], labels.index(label)
            side = next(iter(found.compared.values()), None)
            name = label.rpartition(".")[2]
            if side is not None and side.point == point and name in side.labels:
                values = side.sensor[:, side.labels.index(name)]
                axis.plot(*thinned(side.start - start, values), color=style.TRUTH, label="force sensor")
            for i, (observer, estimate) in enumerate(found.estimates.items()):
                values = estimate.components[:, k]
                line = thinned(estimate.time[:-1] - start, values)
                axis.plot(*line, color=style.ESTIMATES[i % 4], label=observer, linewidth=0.9)
            axis.set_ylabel(f"{name} [{first.units[k]}]")
            _shade(axis, found)
        grid[rows - 1][column].set_xlabel("time [s]")
    handles, names = grid[0][0].get_legend_handles_labels()
    figure.legend(handles, names, loc="outside lower center", ncols=5)
    return figure


def _shade(axis: object, found: RecordingEstimate) -> None:
    """Mark the stretch that the map calls free of contact."""
    free = found.record.map.use.free
    if free is not None:
        axis.axvspan(free[0], free[1], color=style.FAINT, alpha=0.4, zorder=0)  # type: ignore[attr-defined]


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
    time = side.start - found.record.start
    swing = np.abs(side.sensor - side.sensor.mean(axis=0)).sum(axis=1)
    length = max(200, round(0.12 * len(time)))
    sums = np.convolve(swing, np.ones(length), "valid") if len(swing) > length else np.ones(1)
    first = int(np.argmax(sums))
    shown = slice(first, first + length)
    every = max(1, len(time) // 5000)
    for row, label in enumerate(side.labels):
        axis, cross = grid[row]
        axis.plot(*thinned(time[shown], side.sensor[shown, row]), color=style.TRUTH, label="force sensor")
        axis.plot(*thinned(time[shown], side.estimate[shown, row]), "--", color=style.ESTIMATES[0], label=name)
        axis.set_ylabel(f"{label} [{'N' if label[0] == 'F' else 'N m'}]")
        cross.plot(
            side.sensor[side.scored, row][::every],
            side.estimate[side.scored, row][::every],
            ".",
            ms=1.5,
            color=style.ESTIMATES[0],
            alpha=0.4,
            rasterized=True,
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
        names = record.joints if key.startswith("joints") else channel.names
        for k, name in enumerate(names[:8]):
            line = thinned(channel.time - record.start, channel.values[:, k])
            axis.plot(*line, style.LINE_STYLES[k // 4], color=(*style.AXIS_COLOURS, style.ORANGE)[k % 4], label=name)
        axis.set_ylabel(f"{key}\n[{units.get(key, 'SI')}]")
        axis.legend(ncols=1, loc="center left", bbox_to_anchor=(1.0, 0.5))
        for first, last in record.parts:
            axis.axvspan(first * record.dt, last * record.dt, color=style.FAINT, alpha=0.25, zorder=0)
    figure.get_axes()[-1].set_xlabel("time [s]; grey: used")
    return figure


def _unexplained(found: RecordingEstimate) -> Figure:
    """Draw what no force explains, and what is allowed."""
    figure = Figure(figsize=(8.0, 2.6), layout="constrained")
    axis = figure.add_subplot()
    for i, (name, estimate) in enumerate(found.estimates.items()):
        check = estimate.redundancy
        line = thinned(estimate.time[:-1] - found.record.start, estimate.redundancy_series)
        axis.plot(*line, color=style.ESTIMATES[i % 4], label=name, linewidth=0.8)
        axis.axhline(
            check.allowed, color=style.MUTED, linestyle="--", label="allowed of the slow part" if i == 0 else None
        )
    axis.set(xlabel="time [s]", ylabel="unexplained a row [N]", title="What no force at the points explains")
    style.legend_on_top(axis, ncols=3)
    return figure
