"""Draw the channels of a record, and what no force explains in any result."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from aerobat_pin.estimation import Result
from aerobat_pin.forces import END_SHARE, ONSET_SHARE, StoredEstimate
from aerobat_pin.numerics import Array
from aerobat_pin.observers import DOUBTFUL, SLOW_TIME, Estimate, Redundancy, slow_part, typical_step
from aerobat_pin.records import Channel, Record
from aerobat_pin.visualization import style
from aerobat_pin.visualization.figures.lines import Lines, broken, estimate_lines, thinned

CONTACTS_SHOWN = 5.0  # [s]
SHOWN_JOINTS = 8
DRAWN = {"base.position": "m", "base.velocity": "m/s", "joints.position": "rad, m", "joints.effort": "N m, N"}


def draw_motion(record: Record) -> Figure:
    """Draw position and velocity of the base, angles and efforts of the joints, whatever the record has."""
    keys = [key for key in DRAWN if key in record.channels] or list(record.channels)[:3]
    figure = Figure(figsize=(8.0, 1.9 * len(keys) + 0.8), layout="constrained")
    some = f", of the first {SHOWN_JOINTS} joints" if len(record.joints) > SHOWN_JOINTS else ""
    figure.suptitle(f"The motion and efforts as they were recorded{some}, SI units")
    for axis, key in zip(np.ravel(figure.subplots(len(keys), 1, sharex=True, squeeze=False)), keys, strict=True):
        channel = record.channels[key]
        names = channel.names
        if key.startswith("joints"):
            names = record.driven if key == "joints.effort" else record.joints

        def read(first: int, last: int, channel: Channel = channel) -> Lines:
            return channel.time[first:last] - record.start, channel.values[first:last]

        holes = [0.5 * (begin + end) - record.start for begin, end, _ in channel.holes]
        time, values = broken(*thinned(len(channel.time), read), holes)
        for k, name in enumerate(names[:SHOWN_JOINTS]):
            colour = (*style.AXIS_COLOURS, style.ORANGE)[k % 4]
            axis.plot(time, values[:, k], style.LINE_STYLES[k // 4], color=colour, label=name)
        axis.set_ylabel(f"{key}\n[{DRAWN.get(key, 'SI')}]")
        axis.legend(ncols=1, loc="center left", bbox_to_anchor=(1.0, 0.5))
        for first, last in record.parts:
            axis.axvspan(record.after_start(first), record.after_start(last), color=style.FAINT, alpha=0.25, zorder=0)
    figure.get_axes()[-1].set_xlabel("time [s]; grey: used")
    return figure


def draw_contacts(result: Result) -> Figure:
    """Draw which point touches the ground when, of the last `CONTACTS_SHOWN` seconds: a gait diagram."""
    name, stances = next(iter(result.stances.items()))
    last = result.stored[name].end - result.start
    figure = Figure(figsize=(8.0, 0.4 * len(stances) + 1.4), layout="constrained")
    axis = figure.add_subplot()
    for row, stance in enumerate(stances):
        ends = np.where(np.isnan(stance.end), last + result.start, stance.end)
        spans = np.column_stack([stance.onset - result.start, ends - stance.onset])
        axis.broken_barh([tuple(span) for span in spans], (row - 0.35, 0.7), color=style.ESTIMATES[0])
    axis.set_yticks(range(len(stances)), [f"{stance.point} ({stance.share:.0%})" for stance in stances])
    axis.invert_yaxis()
    axis.set(xlim=(max(0.0, last - CONTACTS_SHOWN), last), xlabel="time [s]")
    style.title_of(figure, f"Contacts by {name}: on above {ONSET_SHARE:.0%} of the weight, off below {END_SHARE:.0%}")
    return figure


def draw_unexplained(result: Result) -> Figure:
    """Draw the slow part of what no force explains, by which the belief is judged, and the limit of its rms."""
    figure = Figure(figsize=(8.0, 2.6), layout="constrained")
    axis = figure.add_subplot()
    for i, (name, estimate) in enumerate(result.stored.items()):
        check = estimate.redundancy

        def slow(part: Estimate, at: int, check: Redundancy = check, whole: StoredEstimate = estimate) -> Array:
            lead = min(at, round(10.0 * SLOW_TIME / typical_step(part.time)))  # in which the low-passes rise
            part = whole.between(at - lead, at + len(part.unexplained))
            size = np.linalg.norm(slow_part(part.time, part.unexplained)[lead:], axis=1)
            return np.asarray(size[:, None] / max(check.redundant, 1) ** 0.5)

        time, values = estimate_lines(estimate, slow)
        axis.plot(time - result.start, values[:, 0], color=style.ESTIMATES[i % 4], label=name, linewidth=0.8)
        limit = unexplained_limit(result, name)[0]
        if limit is not None:
            label = "limit of its rms, sensors' noise included" if i == 0 else None
            axis.axhline(np.hypot(limit, check.sensors), color=style.ESTIMATES[i % 4], linestyle="--", label=label)
    axis.set(xlabel="time [s]", ylabel="unexplained a row [N]")
    style.title_of(figure, "Slow part of what no force at the points explains")
    style.legend_on_top(axis, ncols=3)
    return figure


def unexplained_limit(result: Result, name: str) -> tuple[float | None, str]:
    """Return the limit of what no force explains [N per row] that the verdict on the belief has, and what it means.

    That is what a calibration expects, or the errors of the rows as stated, or a share of the weight. None where the
    rows say nothing.
    """
    check, scores, model = result.stored[name].redundancy, result.observers[name], result.model
    if model is not None and model.ratio is not None:
        return model.limit, "expected by the calibration, and as much more as may be: below it the model is unchanged"
    if not scores.states_seen:
        return check.allowed, "below it the belief is consistent"
    words = f"below it the squared errors of the rows are less than {DOUBTFUL:g} times as large as stated"
    return (check.belief * (DOUBTFUL / scores.k) ** 0.5 if scores.k else None), words
