"""Draw actual and estimated unknown forces, their errors and a close-up of the first event (the paper's Fig. 8)."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from aerobat_pin.aerobat import FORCE_POINTS
from aerobat_pin.estimation import Result
from aerobat_pin.forces import PairedEstimate, StoredEstimate, point_label
from aerobat_pin.numerics import Array
from aerobat_pin.observers import Estimate
from aerobat_pin.records import Reference, TrueEvent
from aerobat_pin.visualization import style
from aerobat_pin.visualization.figures.lines import estimate_lines, fit_errors, fit_to_drawn

SHORTEST_ENLARGED = 0.06  # [s]: shortest stretch of time shown in the last row
ENLARGED_SHARE = 0.03  # of the record that it shows, if that is longer
MOST_COLUMNS, MOST_ROWS = 8, 18  # of points side by side, of joints below each other
ESTIMATE_LINES = ("-", ":", "--", "-.")
ROUGHER = 1.5  # an estimate whose steps are larger than the truth's by this factor is drawn behind it
DEVIATIONS = 2.0  # half the height of a band of uncertainty, in standard deviations
EVERYWHERE = (-np.inf, np.inf)
ACTUAL = {"truth": "actual", "sensor": "force sensor"}
HATCHED: Any = {"color": style.FAINT, "hatch": "////", "alpha": 0.5, "lw": 0, "zorder": 0.5, "step": "mid"}


def draw_estimation(result: Result, events: Sequence[TrueEvent] = ()) -> Figure:
    """Draw estimated and actual unknown forces, one column for each point.

    Below each force is its error, if there is a reference, on one scale for all of them, unless that hides some. The
    last row enlarges a part of one component; boxes mark this part and the events; a stretch that a map calls free of
    contact is grey. Panels of a row share their axes, which fit what is drawn once the estimates have risen.

    Args:
        result: the estimates, with their references and events.
        events: events beside those of the true force, such as a gust.
    """
    panels = _Panels(result)
    frames, known = panels.frames, bool(result.references) and bool(panels.frames[0])
    begin, events = result.start, sorted([*result.events, *events], key=lambda event: event.start)
    events = [replace(event, start=event.start - begin, end=event.end - begin) for event in events]
    heights = [*((1.0, 0.45) if known else (1.0,)) * len(panels.labels), 1.15]
    height = 0.45 + sum(heights) * (1.77 if known else 1.67)
    figure = Figure(figsize=(max(6.5, 4.5 * len(frames)), height), layout="constrained")
    kind = "wing" if set(frames) <= set(FORCE_POINTS) else "point"
    what = f"Unknown force at each {kind}, world axes" if frames[0] else "Residual of each joint"
    style.title_of(figure, f"{what}{panels.some}: interval means")
    grid = figure.subplots(len(heights), len(frames), sharex="row", squeeze=False, height_ratios=heights)
    forces, errors, close_ups = grid[: -1 : 2 if known else 1], list(grid[1:-1:2]), grid[-1]
    enlarged = _enlarged(result, panels, events)
    for column, frame in enumerate(frames):
        forces[0][column].set_title(f"{point_label(frame)} wing" if frame in FORCE_POINTS else frame)
        for row, label in enumerate(panels.labels):
            panels.draw_forces(forces[row][column], frame, label)
            forces[row][column].set_xlim(*panels.span)
            if known:
                panels.draw_errors(errors[row][column], frame, label)
        close = close_ups[column]
        panels.draw_forces(close, frame, enlarged.label, (enlarged.start, enlarged.end))
        close.set(xlim=(enlarged.start, enlarged.end), xlabel="time [s]")
        close.set_ylabel(f"{close.get_ylabel()}, enlarged")
        close.spines[:].set(visible=True, color=style.ENLARGED_ZONE)
    risen = max(result.risen.values()) - result.start
    for axes in forces:
        fit_to_drawn(axes, risen)
    if known:
        fit_errors(errors, risen)
    _fit_close_ups(close_ups)
    for axis in (*forces.flat, *close_ups):
        _draw_event_boxes(axis, panels.span[1], events)
    chosen = forces[panels.labels.index(enlarged.label)]
    for axis in chosen:
        span = (enlarged.start, enlarged.end)
        _draw_box(axis, span, style.ENLARGED_ZONE, f"{enlarged.what}, enlarged in the last row")
    if result.record is not None and result.record.map.use.free is not None:
        for axis in forces.flat:
            axis.axvspan(*result.record.map.use.free, color=style.FAINT, alpha=0.4, zorder=0)
    shown: dict[str, Artist] = {}
    for axis in chosen[::-1]:
        handles, labels = axis.get_legend_handles_labels()
        shown = dict(zip(labels, handles, strict=True)) | {k: v for k, v in shown.items() if k not in labels}
    figure.legend(shown.values(), shown.keys(), loc="outside lower center", ncols=3 if len(frames) > 1 else 2)
    return figure


class _Panels:
    """What the panels show: points, labels of components, and begin and end [s] of the record."""

    def __init__(self, result: Result) -> None:
        self.result, self.first = result, next(iter(result.stored.values()))
        components = self.first.head.identifiability.components
        named = any(estimate.head.frames for estimate in result.stored.values())
        self.places = [tuple(name.rsplit(".", 1)) if named else ("", name) for name in components]
        frames, labels = ([*dict.fromkeys(part)] for part in zip(*self.places, strict=True))
        self.units = dict(zip(self.places, self.first.head.units, strict=True))
        self.frames, self.labels = frames[:MOST_COLUMNS], labels[:MOST_ROWS]
        of, shown = (len(frames), MOST_COLUMNS) if named else (len(labels), MOST_ROWS)
        self.some = f", the first {shown} of {of}" if of > shown else ""
        self.span = self.first.start[0] - result.start, self.first.end - result.start

    @property
    def factor(self) -> float:
        """Of errors [N, N m]: they are drawn in thousandths, unless one of them has an rms of 1 or more."""
        scores = (score for observer in self.result.observers.values() for score in observer.scored.values())
        return 1e3 if max((score.rmse for score in scores), default=0.0) < 1.0 else 1.0

    def reference(self, frame: str, label: str) -> tuple[Reference, int] | None:
        """Return the reference of a component and its column there; None without one."""
        for reference in self.result.references:
            if reference.frame == frame and label in reference.labels:
                return reference, reference.labels.index(label)
        return None

    def draw_forces(self, axis: Axes, frame: str, label: str, span: tuple[float, float] = EVERYWHERE) -> None:
        """Draw the truth, and the estimates over it; one that is much rougher goes behind, where it hides no truth."""
        smooth, known = np.inf, self.reference(frame, label)
        if known is not None:
            actual = partial(_actual, reference=known[0], k=known[1])
            time, force = self._lines(self.first, actual, span)
            smooth = ROUGHER * max(_roughness(force), 1e-6)
            axis.plot(time, force, color=style.TRUTH, linewidth=2.0, label=ACTUAL[known[0].kind], zorder=2.2)
        for name, estimate, colour, line in self._estimates():
            labels = estimate.head.identifiability.components
            if (name_of := f"{frame}.{label}".lstrip(".")) not in labels:
                continue
            k = labels.index(name_of)
            time, force, low, high = self._lines(estimate, partial(_band, k=k), span)
            rough = _roughness(force) > smooth
            order = 2.1 if rough else 2.3
            axis.plot(time, force, line, color=colour, linewidth=0.8, label=f"estimated: {name}", zorder=order)
            if rough:
                axis.lines[0].set_linewidth(1.2)
            if estimate.head.standard_deviation is not None:
                words = f"{name}: {DEVIATIONS:g} standard deviations"
                axis.fill_between(time, low, high, color=colour, alpha=0.25, lw=0, zorder=2.0, label=words)
            if estimate is self.first and np.any(unseen := np.isnan(force) & np.isfinite(time)):
                words, whole_height = "not seen: the pose does not show it", axis.get_xaxis_transform()
                axis.fill_between(time, 0, 1, where=unseen, transform=whole_height, label=words, **HATCHED)
        letter = f"${label[0]}_{label[1]}$" if frame else label
        axis.set_ylabel(f"{letter} [{self.units.get((frame, label), '')}]", parse_math=bool(frame))
        axis.set_visible((frame, label) in self.units)

    def draw_errors(self, axis: Axes, frame: str, label: str) -> None:
        """Draw estimates minus reference, where this is scored, both behind its filter; nothing without a reference."""
        known = self.reference(frame, label)
        axis.set(
            xlim=self.span,
            visible=known is not None,
            ylabel=f"error [{'' if self.factor == 1.0 else 'm'}{self.units.get((frame, label), '')}]",
        )
        for name, estimate, colour, line in self._estimates():
            for side in self.result.compared[name]:
                if known is not None and side.reference is known[0]:
                    time, error = self._lines(
                        estimate, partial(_error, side=side, k=known[1], factor=self.factor), EVERYWHERE
                    )
                    axis.plot(time, error, line, color=colour, linewidth=0.6)

    def _estimates(self) -> Iterator[tuple[str, StoredEstimate, str, str]]:
        """Yield name, estimate, colour and line of each observer."""
        stored = self.result.stored
        n = len(ESTIMATE_LINES)
        for i, (name, estimate) in enumerate(stored.items()):  # behind the fourth, each colour has another line
            yield name, estimate, style.ESTIMATES[i % n], ESTIMATE_LINES[(i + i // n) % n]

    def _lines(
        self, estimate: StoredEstimate, values_of: Callable[[Estimate, int], Array], span: tuple[float, float]
    ) -> tuple[Array, ...]:
        """Return times from the start (n,) [s] and one series (n,) for each column of `values_of`, within a span."""
        begin, end = (time + self.result.start for time in span)
        time, values = estimate_lines(estimate, values_of, begin, end)
        return time - self.result.start, *values.T


def _roughness(force: Array) -> float:
    """Return the standard deviation of the steps of a series, as far as it is known; 0 if nowhere."""
    steps = np.diff(force)
    return float(np.nanstd(steps)) if np.any(np.isfinite(steps)) else 0.0


def _actual(part: Estimate, at: int, reference: Reference, k: int) -> Array:
    return np.asarray(reference.values[at : at + len(part.components)][:, [k]])


def _band(part: Estimate, _: int, k: int) -> Array:
    """Return a component (n, 3): estimate, lower and upper end of its band; NaN where not seen, or infinite."""
    force, sure = np.where(part.shown[:, k], part.components[:, k], np.nan), part.standard_deviation
    half = np.zeros(len(force)) if sure is None else np.where(np.isfinite(sure[:, k]), DEVIATIONS * sure[:, k], np.nan)
    return np.column_stack([force, force - half, force + half])


def _error(part: Estimate, at: int, side: PairedEstimate, k: int, factor: float) -> Array:
    rows = slice(at, at + len(part.components))
    difference = factor * (side.estimate[rows][:, k] - side.reference.values[rows][:, k])
    return np.where(side.reference.scored(part.time[:-1]), difference, np.nan)[:, None]


class _Enlarged(NamedTuple):
    """The part of the record that the last row enlarges: start and end [s], component, and what it is."""

    start: float
    end: float
    label: str
    what: str


def _enlarged(result: Result, panels: _Panels, events: Sequence[TrueEvent]) -> _Enlarged:
    """Choose the part of the record to enlarge: the first event, of a step its onset.

    If there is no event within the record, it is the part with the fastest change of the first estimate.
    """
    first, end_of_all = panels.first, panels.span[1]
    for event in events:
        if event.start >= end_of_all:
            continue
        lasts = event.end <= end_of_all and event.name != "step"
        end = event.end if lasts else event.start
        margin = max(0.25 * (end - event.start), 0.5 * (SHORTEST_ENLARGED - (end - event.start)))
        start, end = _samples_around(first, result.start + event.start - margin, result.start + end + margin)
        rows = slice(first.index(start), first.index(end))
        known = panels.reference(event.frames[0], "Fx") if event.frames else None
        clean = None if known is None else known[0].noise_free
        force = first.between(rows.start, rows.stop).components[:, :3] if clean is None else clean[rows]
        size = np.ptp(force, axis=0) if event.name == "step" else np.abs(force).max(axis=0)
        axis = ("Fx", "Fy", "Fz")[int(np.argmax(size))]  # of a point, or of the base among the rows
        label = next((label for label in panels.labels if label.endswith(axis)), panels.labels[0])
        return _Enlarged(start - result.start, end - result.start, label, event.name)
    length = max(SHORTEST_ENLARGED, ENLARGED_SHARE * (panels.span[1] - panels.span[0]))
    begin = first.start[0] + length  # until then filters rise
    begin = begin if begin < first.start[-1] else -np.inf
    drawn = [k for k, (frame, label) in enumerate(panels.places) if frame in panels.frames and label in panels.labels]
    time, force = estimate_lines(first, lambda part, _: np.where(part.shown, part.components, np.nan)[:, drawn], begin)
    middle, column = _fastest_change(time[finite := np.isfinite(time)], force[finite], length)  # parts may be short
    label = panels.places[drawn[column]][1]
    start, end = _samples_around(first, middle - 0.5 * length, middle + 0.5 * length)
    return _Enlarged(start - result.start, end - result.start, label, "fastest change")


def _fastest_change(time: Array, force: Array, length: float) -> tuple[float, int]:
    """Return when (time [s], column) the means of components (m, c) over half a length before and after differ most.

    Of those that are seen, NaN where not, all that time.
    """
    width = max(int(0.25 * length * len(force) / (time[-1] - time[0])), 1) if len(time) > 1 else 1
    if len(force) < 2 * width:
        return float(time[len(time) // 2]), min(1, force.shape[1] - 1)
    none, unseen = np.zeros((1, force.shape[1])), np.isnan(force)
    sums, missing = (np.cumsum(np.concatenate([none, part]), axis=0) for part in (np.nan_to_num(force), unseen))
    change = np.abs(sums[2 * width :] - 2.0 * sums[width:-width] + sums[: -2 * width])
    change[missing[2 * width :] > missing[: -2 * width]] = 0.0
    at, column = np.unravel_index(int(np.argmax(change)), change.shape)
    return float(time[at + width]), int(column)


def _samples_around(estimate: StoredEstimate, start: float, end: float) -> tuple[float, float]:
    """Return the times [s] of the last sample before a stretch of time and of the first after it, within the record."""
    last = estimate.start.index(end - 1e-9)
    first = max(min(estimate.start.index(start + 1e-9, "right") - 1, last - 1), 0)
    return float(estimate.start[first]), estimate.end if last >= len(estimate) else float(estimate.start[last])


def _fit_close_ups(axes: Sequence[Axes]) -> None:
    """Fit the close-ups to their lines, all with the same scale."""
    ends = []
    for axis in axes:
        values = np.concatenate([np.asarray(line.get_ydata(), float) for line in axis.lines] or [np.zeros(1)])
        values = values[np.isfinite(values)] if np.any(np.isfinite(values)) else np.zeros(1)
        ends.append((float(values.min()), float(values.max())))
    half = 0.65 * max(high - low for low, high in ends) + 1e-3
    for axis, (low, high) in zip(axes, ends, strict=True):
        axis.set_ylim(0.5 * (low + high) - half, 0.5 * (low + high) + half)


def _draw_event_boxes(axis: Axes, end: float, events: Sequence[TrueEvent]) -> None:
    """Draw a box around each event before the end [s]; events of the same name share one line in the legend."""
    labelled = set()
    for event in events:
        if event.start < end:
            span = (event.start, min(event.end, end))
            _draw_box(axis, span, style.EVENT_ZONE, None if event.name in labelled else event.name)
            labelled.add(event.name)


def _draw_box(axis: Axes, span: tuple[float, float], colour: str, label: str | None) -> None:
    """Draw a box as high as the panel, behind the lines so that it does not cover a short event."""
    low, high = axis.get_ylim()
    size = (span[1] - span[0], high - low)
    axis.add_patch(Rectangle((span[0], low), *size, fill=False, edgecolor=colour, linewidth=1.4, zorder=1, label=label))
    axis.set_ylim(low, high)
