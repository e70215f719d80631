"""Draw actual and estimated unknown forces, their errors and a close-up of the first event (the paper's Fig. 8)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from aerobat_pin.aerobat import FlightLog, TrueEvent, true_events, true_force
from aerobat_pin.estimation import point_label
from aerobat_pin.numerics import Array
from aerobat_pin.observers import Estimate
from aerobat_pin.robot import FORCE_POINTS
from aerobat_pin.visualization import style

Estimates = Mapping[str, Estimate]
SHORTEST_ENLARGED = 0.06  # [s]: shortest stretch of time shown in the last row
ESTIMATE_LINES = ("-", ":", "--", "-.")
ROUGHER = 1.5  # an estimate whose steps are larger than the truth's by this factor is drawn behind it
DEVIATIONS = 2.0  # half the height of a band of uncertainty, in standard deviations


def draw_estimation(log: FlightLog, estimates: Estimates, events: Sequence[TrueEvent] = ()) -> Figure:
    """Draw actual and estimated unknown forces, one column for each frame.

    Below each force is its error, on one scale for all of them, if the truth is known. The last row enlarges a part of
    one axis; boxes mark this part and the events. Panels of a row share their axes.

    Args:
        log: the flight log.
        estimates: observer -> estimate, all of the same frames.
        events: events beside those of the true force, such as a gust.
    """
    frames = next(iter(estimates.values())).frames
    events = sorted([*true_events(log), *events], key=lambda event: event.start)
    known = log.truth is not None
    heights = [*((1.0, 0.45) if known else (1.0,)) * 3, 1.15]
    figure = Figure(figsize=(max(6.5, 4.5 * len(frames)), 10.2 if known else 7.4), layout="constrained")
    kind = "wing" if set(frames) <= set(FORCE_POINTS) else "point"
    style.title_of(figure, f"Unknown force at each {kind}, world axes: interval means")
    grid = figure.subplots(len(heights), len(frames), sharex="row", squeeze=False, height_ratios=heights)
    middle = 0.5 * (log.time[1:] + log.time[:-1])
    enlarged = _enlarged(log, estimates, events)
    step = 2 if known else 1
    for column, frame in enumerate(frames):
        grid[0][column].set_title(f"{point_label(frame)} wing" if frame in FORCE_POINTS else frame)
        for row, name in enumerate("xyz"):
            axis = grid[step * row][column]
            _force_lines(axis, middle, log, estimates, column, frame, row)
            axis.set_ylabel(f"$F_{name}$ [N]")
            axis.set_xlim(log.time[0], log.time[-1])
            if known:
                _error_lines(grid[step * row + 1][column], middle, log, estimates, column, frame, row)
        close = grid[-1][column]
        _force_lines(close, middle, log, estimates, column, frame, enlarged.row)
        close.set(xlim=(enlarged.start, enlarged.end), xlabel="time [s]")
        close.set_ylabel(f"$F_{'xyz'[enlarged.row]}$ [N], enlarged")
    for row in range(3):
        style.share_limits(grid[step * row])
    if known:
        style.share_limits(axis for row in range(3) for axis in grid[2 * row + 1])
    _fit_close_ups(grid[-1], middle, enlarged)
    for column in range(len(frames)):
        for row in range(3):
            _draw_event_boxes(grid[step * row][column], log, events)
        span = (enlarged.start, enlarged.end)
        what = f"{enlarged.what}, enlarged in the last row"
        _draw_box(grid[step * enlarged.row][column], span, style.ENLARGED_ZONE, what)
        _draw_event_boxes(grid[-1][column], log, events)
        for spine in grid[-1][column].spines.values():
            spine.set_visible(True)
            spine.set_color(style.ENLARGED_ZONE)
    handles, labels = grid[step * enlarged.row][0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=3 if len(frames) > 1 else 2)
    return figure


@dataclass(frozen=True)
class _Enlarged:
    """The part of the flight that the last row enlarges: start and end [s], axis of the force (0 to 2), and label."""

    start: float
    end: float
    row: int
    what: str


def _enlarged(log: FlightLog, estimates: Estimates, events: Sequence[TrueEvent]) -> _Enlarged:
    """Choose the part of the flight to enlarge: the first event, of a step its onset.

    If there is no event within the flight, it is the part with the fastest change of the first estimate.
    """
    time = log.time
    for event in events:
        if event.start >= time[-1]:
            continue
        lasts = event.end <= time[-1] and event.name != "step"
        end = event.end if lasts else event.start
        margin = max(0.25 * (end - event.start), 0.5 * (SHORTEST_ENLARGED - (end - event.start)))
        start, end = _samples_around(time, event.start - margin, end + margin)
        inside = (time[:-1] >= start) & (time[1:] <= end)
        force = next(iter(estimates.values())).force[:, 0] if not event.frames else true_force(log, event.frames[0])[1]
        size = np.ptp(force[inside], axis=0) if event.name == "step" else np.abs(force[inside]).max(axis=0)
        return _Enlarged(start, end, int(np.argmax(size)), str(event.name))
    middle, row = _fastest_change(time, next(iter(estimates.values())).force)
    half = 0.5 * SHORTEST_ENLARGED
    return _Enlarged(*_samples_around(time, middle - half, middle + half), row, "fastest change")


def _fastest_change(time: Array, force: Array) -> tuple[float, int]:
    """Return when (time [s], axis) the means of a force (m, points, 3) before and after differ most."""
    width = max(int(0.25 * SHORTEST_ENLARGED * len(force) / (time[-1] - time[0])), 1)
    sums = np.concatenate([np.zeros((1, *force.shape[1:])), np.cumsum(force, axis=0)])
    if len(sums) <= 2 * width:
        return float(time[len(time) // 2]), 1
    change = np.abs(sums[2 * width :] - 2.0 * sums[width:-width] + sums[: -2 * width]).max(axis=1)
    first, row = np.unravel_index(int(np.argmax(change)), change.shape)
    return float(time[first + width]), int(row)


def _samples_around(time: Array, start: float, end: float) -> tuple[float, float]:
    """Return the times [s] of the last sample before a stretch of time and of the first after it, within the log."""
    first = max(int(np.searchsorted(time, start + 1e-9, side="right")) - 1, 0)
    last = min(int(np.searchsorted(time, end - 1e-9)), len(time) - 1)
    return float(time[min(first, last - 1)]), float(time[last])


def _force_lines(
    axis: Axes, time: Array, log: FlightLog, estimates: Estimates, column: int, frame: str, row: int
) -> None:
    """Draw the truth, and the estimates over it; one that is much rougher goes behind, where it hides no truth."""
    smooth = np.inf
    if log.truth is not None:
        truth = true_force(log, frame)[0][:, row]
        smooth = ROUGHER * max(float(np.std(np.diff(truth))), 1e-6)
        axis.plot(time, truth, color=style.TRUTH, linewidth=2.0, label="actual", zorder=2.2)
    for (name, estimate), colour, line in zip(estimates.items(), style.ESTIMATES, ESTIMATE_LINES, strict=False):
        force = estimate.force[:, column, row]
        rough = float(np.std(np.diff(force))) > smooth
        order = 2.1 if rough else 2.3
        axis.plot(time, force, line, color=colour, linewidth=0.8, label=f"estimated: {name}", zorder=order)
        if rough:
            axis.lines[0].set_linewidth(1.2)
        if estimate.standard_deviation is not None and estimate.are_world_forces:
            half = DEVIATIONS * estimate.standard_deviation[:, 3 * column + row]
            half = np.where(np.isfinite(half), half, np.nan)
            label = f"{name}: {DEVIATIONS:g} standard deviations"
            axis.fill_between(time, force - half, force + half, color=colour, alpha=0.25, lw=0, zorder=2.0, label=label)


def _error_lines(
    axis: Axes, time: Array, log: FlightLog, estimates: Estimates, column: int, frame: str, row: int
) -> None:
    truth = true_force(log, frame)[0][:, row]
    for estimate, colour, line in zip(estimates.values(), style.ESTIMATES, ESTIMATE_LINES, strict=False):
        axis.plot(time, 1e3 * (estimate.force[:, column, row] - truth), line, color=colour, linewidth=0.6)
    axis.set_ylabel("error [mN]")
    axis.set_xlim(log.time[0], log.time[-1])


def _fit_close_ups(axes: Sequence[Axes], time: Array, enlarged: _Enlarged) -> None:
    """Fit the close-ups to their lines, all with the same scale."""
    inside = (time >= enlarged.start) & (time <= enlarged.end)
    ends = []
    for axis in axes:
        values = np.concatenate([np.asarray(line.get_ydata())[inside] for line in axis.lines])
        ends.append((float(values.min()), float(values.max())))
    half = 0.65 * max(high - low for low, high in ends) + 1e-3
    for axis, (low, high) in zip(axes, ends, strict=True):
        axis.set_ylim(0.5 * (low + high) - half, 0.5 * (low + high) + half)


def _draw_event_boxes(axis: Axes, log: FlightLog, events: Sequence[TrueEvent]) -> None:
    """Draw a box around each event within the flight; events of the same name share one line in the legend."""
    labelled = set()
    for event in events:
        if event.start < log.time[-1]:
            span = (event.start, min(event.end, float(log.time[-1])))
            _draw_box(axis, span, style.EVENT_ZONE, None if event.name in labelled else event.name)
            labelled.add(event.name)


def _draw_box(axis: Axes, span: tuple[float, float], colour: str, label: str | None) -> None:
    """Draw a box as high as the panel, behind the lines so that it does not cover a short event."""
    low, high = axis.get_ylim()
    size = (span[1] - span[0], high - low)
    axis.add_patch(Rectangle((span[0], low), *size, fill=False, edgecolor=colour, linewidth=1.4, zorder=1, label=label))
    axis.set_ylim(low, high)
