"""The paper's figures from a flight log and its estimates. Drawn off screen; nothing here opens a window."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
import pinocchio as pin
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from aerobat_pin.estimation import point_label, true_events, true_force
from aerobat_pin.flight import FlightLog
from aerobat_pin.numerics import Array
from aerobat_pin.observers import Estimate
from aerobat_pin.robot import FORCE_POINTS, JOINTS, Aerobat, euler_angles, world_velocity
from aerobat_pin.visualization import style
from aerobat_pin.visualization.figures import air as air_figures
from aerobat_pin.visualization.figures import linkage as linkage_sheet

Estimates = Mapping[str, Estimate]
STICK_SPACING = 0.08  # [s], no simple fraction of a flap, between two snapshots of the stick diagram
STICK_STRETCH = 2.5  # of Y against X in the stick diagram of a flight that is so much longer than wide
STICK_ROOM = (8.2, 6.0)  # [in], at most, width and height of the stick diagram's axes
CLOSE_UP = 0.06  # [s], at least so long is the stretch that is looked at closely


def draw_all(robot: Aerobat, log: FlightLog, estimates: Estimates, note: str) -> dict[str, Figure]:
    """Draw every figure of a run: name -> figure. The note says on each picture of the flight what holds the robot."""
    with mpl.rc_context(style.RC):
        drawn = {
            "position": position(log),
            "states": states(log),
            "stick_diagram": stick_diagram(robot, log),
            "estimation": estimation(log, estimates),
        }
        if log.truth is not None:
            drawn |= {"aerodynamics": air_figures.aerodynamics(robot, log), "power": air_figures.power(log)}
        for figure in drawn.values():
            title = figure.get_suptitle()
            figure.suptitle(f"{title}\n{note}", fontsize=style.RC["axes.titlesize"])
        return {**drawn, "linkage": linkage_sheet.draw(robot.linkage)}


def save(figure: Figure, stem: Path) -> None:
    """Write `stem`.png and `stem`.pdf, without a date, so that the same run gives the same files."""
    for kind in ("png", "pdf"):
        stem.with_suffix(f".{kind}").write_bytes(style.rendered(figure, kind))


def position(log: FlightLog) -> Figure:
    """Position of the body's centre of mass over time (the paper's Fig. 5)."""
    figure, axes = _stack(3, "Position of the body's centre of mass, world axes")
    q = log.measured["q"].values
    for i, (axis, name) in enumerate(zip(axes, "XYZ", strict=True)):
        axis.plot(log.time, q[:, i], color=style.AXES[i])
        axis.set_ylabel(f"{name} [m]")
        _at_least(axis, 0.1)
    return figure


def states(log: FlightLog) -> Figure:
    """Joint angles, Euler angles and world velocities over time (the paper's Fig. 6)."""
    figure, axes = _stack(3, "Joint angles, attitude and velocity", height=6.0)
    q, v = log.measured["q"], log.measured["v"].values
    for joint, label, line in (("left_shoulder", "shoulder", "-"), ("left_elbow", "elbow", "--")):
        colour = style.LEFT if label == "shoulder" else style.RIGHT
        angle = np.degrees(q.sel(q_axis=joint).values)
        axes[0].plot(log.time, angle, line, color=colour, label=rf"{label} $\theta_{label[0]}$")
    axes[0].set_ylabel("joint angle [deg]")
    angles = np.degrees(euler_angles(q.values))
    for i, label in enumerate(("roll", "pitch (nose up)", "yaw")):
        axes[1].plot(log.time, angles[:, i], style.LINE_STYLES[i], color=style.AXES[i], label=label)
    axes[1].set_ylabel("Euler angle [deg]")
    velocity = world_velocity(q.values, v)
    for i, label in enumerate("XYZ"):
        axes[2].plot(log.time, velocity[:, i], style.LINE_STYLES[i], color=style.AXES[i], label=label)
    axes[2].set_ylabel("velocity, world [m/s]")
    for axis in axes:
        axis.legend(ncols=3, loc="upper right")
        low, high = axis.get_ylim()
        axis.set_ylim(low, high + 0.2 * (high - low))
    return figure


def stick_diagram(robot: Aerobat, log: FlightLog) -> Figure:
    """Top view of body and wings at fixed intervals along the flight (the paper's Fig. 7), as large as fits."""
    q = log.measured["q"].values
    data = robot.model.createData()
    every = max(1, round(STICK_SPACING / float(np.median(np.diff(log.time)))))
    sticks = [_sticks(robot, data, one) for one in q[::every]]
    along, across = np.ptp(np.concatenate([q[:, :2], *(one[:, :2] for three in sticks for one in three)]), axis=0)
    stretch = STICK_STRETCH if across * STICK_STRETCH**2 < along else 1.0
    scale = min(STICK_ROOM[0] / along, STICK_ROOM[1] / (stretch * across))
    figure = Figure(figsize=(max(6.5, scale * along + 0.8), scale * stretch * across + 1.4), layout="constrained")
    axis = figure.add_subplot()
    axis.plot(q[:, 0], q[:, 1], color=style.MUTED, linewidth=0.8, label="path of the body")
    for k, (left, right, spine) in enumerate(sticks):
        first = k == 0
        axis.plot(left[:, 0], left[:, 1], "o-", ms=2, color=style.LEFT, label="left wing" if first else None)
        axis.plot(right[:, 0], right[:, 1], "s--", ms=2, color=style.RIGHT, label="right wing" if first else None)
        axis.plot(spine[:, 0], spine[:, 1], color=style.INK, linewidth=2.5, label="body" if first else None)
    axis.set_aspect(stretch)
    axis.set_xlabel("X [m]")
    axis.set_ylabel("Y [m]")
    larger = f"; Y drawn {stretch:g} times larger than X" if stretch > 1.0 else ""
    figure.suptitle(f"Top view, a snapshot every {STICK_SPACING:g} s{larger}")
    figure.legend(ncols=4, loc="outside lower center")
    return figure


def estimation(log: FlightLog, estimates: Estimates) -> Figure:
    """Estimated against actual unknown forces, events and close-up boxed (the paper's Fig. 8)."""
    frames = next(iter(estimates.values())).frames
    figure = Figure(figsize=(9.0, 7.4), layout="constrained")
    where = "wing" if set(frames) <= set(FORCE_POINTS) else "point"
    figure.suptitle(f"Unknown force at each {where}, world axes: interval means")
    grid = figure.subplots(4, len(frames), sharex="row", squeeze=False)
    middle = 0.5 * (log.time[1:] + log.time[:-1])
    closely = _close_up(log)
    for column, frame in enumerate(frames):
        for row, name in enumerate("xyz"):
            axis = grid[row][column]
            _force_lines(axis, middle, log, estimates, column, frame, row)
            axis.set_ylabel(f"$F_{name}$ [N]")
            axis.set_xlim(log.time[0], log.time[-1])
            _event_zones(axis, log)
            if row == closely.row:
                _zone(axis, (closely.start, closely.end), style.NOISE_ZONE, f"{closely.what}, close in the last row")
        grid[0][column].set_title(f"{point_label(frame)} wing" if frame in FORCE_POINTS else frame)
        close = grid[3][column]
        _force_lines(close, middle, log, estimates, column, frame, closely.row)
        inside = (middle >= closely.start) & (middle <= closely.end)
        values = np.concatenate([line.get_ydata()[inside] for line in close.lines])
        pad = 0.15 * float(np.ptp(values)) + 1e-3
        close.set_ylim(float(values.min()) - pad, float(values.max()) + pad)
        close.set_xlim(closely.start, closely.end)
        close.set_ylabel(f"$F_{'xyz'[closely.row]}$ [N], close")
        close.set_xlabel("time [s]")
        _event_zones(close, log)
        for spine in close.spines.values():
            spine.set_visible(True)
            spine.set_color(style.NOISE_ZONE)
    handles, labels = grid[closely.row][0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=5)
    return figure


@dataclass(frozen=True)
class _CloseUp:
    """What is seen closely: from when to when [s], the axis of the force, and what there is."""

    start: float
    end: float
    row: int
    what: str


def _close_up(log: FlightLog) -> _CloseUp:
    """Choose the first event; of a step in noise, as the paper's, or where nothing happens, a stretch beside it."""
    time = log.time
    for event in true_events(log)[:1]:
        force, noise_free = true_force(log, event.frames[0])
        if event.start >= time[-1] or (event.name == "step" and not np.array_equal(force, noise_free)):
            continue
        end = event.end if event.end <= time[-1] else event.start  # what stays is seen coming
        margin = max(0.25 * (end - event.start), 0.5 * (CLOSE_UP - (end - event.start)))
        start, end = _samples_around(time, event.start - margin, end + margin)
        strongest = np.abs(noise_free[(time[:-1] >= start) & (time[1:] <= end)]).max(axis=0)
        return _CloseUp(start, end, int(np.argmax(strongest)), f"around the {event.name}")
    start = time[0] + 0.27 * (time[-1] - time[0])
    noisy = any(not np.array_equal(*true_force(log, str(frame))) for frame in _pushed(log))
    return _CloseUp(*_samples_around(time, start, start + CLOSE_UP), 1, "a stretch of noise" if noisy else "a stretch")


def _pushed(log: FlightLog) -> Array:
    return np.array([]) if log.truth is None else np.asarray(log.truth["point"].values)


def _samples_around(time: Array, start: float, end: float) -> tuple[float, float]:
    """Return the last sample before a stretch and the first after it [s], as far as there are."""
    first = max(int(np.searchsorted(time, start + 1e-9, side="right")) - 1, 0)
    last = min(int(np.searchsorted(time, end - 1e-9)), len(time) - 1)
    return float(time[min(first, last - 1)]), float(time[last])


def _stack(rows: int, title: str, height: float = 5.0) -> tuple[Figure, list[Axes]]:
    figure = Figure(figsize=(7.0, height), layout="constrained")
    axes = list(figure.subplots(rows, 1, sharex=True))
    figure.suptitle(title)
    axes[-1].set_xlabel("time [s]")
    return figure, axes


def _at_least(axis: Axes, height: float) -> None:
    """Keep rounding noise from filling a panel: show at least this range."""
    low, high = axis.get_ylim()
    if high - low < height:
        middle = 0.5 * (low + high)
        axis.set_ylim(middle - height / 2, middle + height / 2)


def _force_lines(
    axis: Axes, time: Array, log: FlightLog, estimates: Estimates, column: int, frame: str, row: int
) -> None:
    if log.truth is not None:
        axis.plot(time, true_force(log, frame)[0][:, row], color=style.TRUTH, linewidth=2.0, label="actual")
    for (name, estimate), colour, line in zip(estimates.items(), style.ESTIMATES, ("-", ":", "--", "-."), strict=False):
        axis.plot(time, estimate.force[:, column, row], line, color=colour, linewidth=0.8, label=f"estimated: {name}")


def _event_zones(axis: Axes, log: FlightLog) -> None:
    """Box what came and went, as far as the flight goes; each kind has one line of the legend."""
    named = set()
    for event in true_events(log):
        if event.start < log.time[-1]:
            span = (event.start, min(event.end, float(log.time[-1])))
            _zone(axis, span, style.STEP_ZONE, None if event.name in named else event.name)
            named.add(event.name)


def _zone(axis: Axes, span: tuple[float, float], colour: str, label: str | None) -> None:
    """Draw a box as high as the panel, behind the lines: a short event must not hide under its own box."""
    low, high = axis.get_ylim()
    box: dict[str, Any] = {"fill": False, "edgecolor": colour, "linewidth": 1.4, "zorder": 1, "label": label}
    axis.add_patch(Rectangle((span[0], low), span[1] - span[0], high - low, **box))
    axis.set_ylim(low, high)


def _sticks(robot: Aerobat, data: pin.Data, q: Array) -> tuple[Array, Array, Array]:
    """Return left wing, right wing (shoulder, elbow, tip) and body (tail end, nose) as world points (n, 3) [m]."""
    pin.forwardKinematics(robot.model, data, q)
    tip = robot.morphology.wing.distal_stations[-1]
    wings = []
    for (shoulder, elbow), sign in ((JOINTS[:2], 1.0), (JOINTS[2:], -1.0)):
        first, second = (data.oMi[robot.model.getJointId(joint)] for joint in (shoulder, elbow))
        end = second.act(np.array([0.0, sign * tip, 0.0]))
        wings.append(np.array([first.translation, second.translation, end]))
    half = robot.morphology.hull.length / 2
    base = data.oMi[1]
    spine = np.array([base.act(np.array([x, 0.0, 0.0])) for x in (-half, half)])
    return wings[0], wings[1], spine
