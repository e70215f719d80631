"""Draw the paper's figures from a flight log and its estimates, without opening a window."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

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

Estimates = Mapping[str, Estimate]
LEAST_HEIGHT = 0.1  # [m]: smallest range of a position panel; a smaller one would magnify rounding noise
STICK_SPACING = 0.08  # [s] between two poses of the stick diagram; not a simple fraction of a flap
STICK_STRETCH = 2.5  # factor by which Y is enlarged in the stick diagram of a flight that is much longer than wide
STICK_ROOM = (8.2, 6.0)  # largest width and height of the stick diagram's axes [in]
SHORTEST_ENLARGED = 0.06  # [s]: shortest stretch of time shown in the last row of the estimation figure
ESTIMATE_LINES = ("-", ":", "--", "-.")


def draw_position(log: FlightLog) -> Figure:
    """Draw the position of the body's centre of mass over time (the paper's Fig. 5)."""
    figure, axes = _panels(3, "Position of the body's centre of mass, world axes")
    q = log.measured["q"].values
    for i, (axis, name) in enumerate(zip(axes, "XYZ", strict=True)):
        axis.plot(log.time, q[:, i], color=style.AXIS_COLOURS[i])
        axis.set_ylabel(f"{name} [m]")
        low, high = axis.get_ylim()
        if high - low < LEAST_HEIGHT:
            axis.set_ylim(0.5 * (low + high - LEAST_HEIGHT), 0.5 * (low + high + LEAST_HEIGHT))
    return figure


def draw_states(log: FlightLog) -> Figure:
    """Draw joint angles, Euler angles and world velocities over time (the paper's Fig. 6)."""
    figure, axes = _panels(3, "Joint angles, attitude and velocity", height=6.0)
    q, v = log.measured["q"], log.measured["v"].values
    for joint, colour, line in (("shoulder", style.LEFT, "-"), ("elbow", style.RIGHT, "--")):
        angle = np.degrees(q.sel(q_axis=f"left_{joint}").values)
        axes[0].plot(log.time, angle, line, color=colour, label=rf"{joint} $\theta_{joint[0]}$")
    axes[0].set_ylabel("joint angle [deg]")
    axes[1].set_ylabel("Euler angle [deg]")
    axes[2].set_ylabel("velocity, world [m/s]")
    for axis, values, labels in (
        (axes[1], np.degrees(euler_angles(q.values)), ("roll", "pitch (nose up)", "yaw")),
        (axes[2], world_velocity(q.values, v), "XYZ"),
    ):
        for i, label in enumerate(labels):
            axis.plot(log.time, values[:, i], style.LINE_STYLES[i], color=style.AXIS_COLOURS[i], label=label)
    for axis in axes:
        style.legend_on_top(axis, ncols=3)
    return figure


def draw_stick_diagram(robot: Aerobat, log: FlightLog) -> Figure:
    """Draw body and wings from above at fixed intervals of time (the paper's Fig. 7), as large as the figure allows."""
    q = log.measured["q"].values
    data = robot.model.createData()
    every = max(1, round(STICK_SPACING / float(np.median(np.diff(log.time)))))
    poses = [_sticks(robot, data, row) for row in q[::every]]
    along, across = np.ptp(np.concatenate([q[:, :2], *(line[:, :2] for pose in poses for line in pose)]), axis=0)
    stretch = STICK_STRETCH if across * STICK_STRETCH**2 < along else 1.0
    scale = min(STICK_ROOM[0] / along, STICK_ROOM[1] / (stretch * across))
    figure = Figure(figsize=(max(6.5, scale * along + 0.8), scale * stretch * across + 1.4), layout="constrained")
    axis = figure.add_subplot()
    axis.plot(q[:, 0], q[:, 1], color=style.MUTED, linewidth=0.8, label="path of the body")
    for k, (left, right, spine) in enumerate(poses):
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


def draw_estimation(log: FlightLog, estimates: Estimates) -> Figure:
    """Draw actual and estimated unknown forces (the paper's Fig. 8), one column for each frame.

    The last row enlarges a part of one axis; boxes mark this part and the events.
    """
    frames = next(iter(estimates.values())).frames
    figure = Figure(figsize=(9.0, 7.4), layout="constrained")
    kind = "wing" if set(frames) <= set(FORCE_POINTS) else "point"
    figure.suptitle(f"Unknown force at each {kind}, world axes: interval means")
    grid = figure.subplots(4, len(frames), sharex="row", squeeze=False)
    middle = 0.5 * (log.time[1:] + log.time[:-1])
    enlarged = _enlarged(log)
    for column, frame in enumerate(frames):
        for row, name in enumerate("xyz"):
            axis = grid[row][column]
            _force_lines(axis, middle, log, estimates, column, frame, row)
            axis.set_ylabel(f"$F_{name}$ [N]")
            axis.set_xlim(log.time[0], log.time[-1])
            _draw_event_boxes(axis, log)
            if row == enlarged.row:
                span = (enlarged.start, enlarged.end)
                _draw_box(axis, span, style.ENLARGED_ZONE, f"{enlarged.what}, enlarged in the last row")
        grid[0][column].set_title(f"{point_label(frame)} wing" if frame in FORCE_POINTS else frame)
        close = grid[3][column]
        _force_lines(close, middle, log, estimates, column, frame, enlarged.row)
        inside = (middle >= enlarged.start) & (middle <= enlarged.end)
        values = np.concatenate([line.get_ydata()[inside] for line in close.lines])
        pad = 0.15 * float(np.ptp(values)) + 1e-3
        close.set_ylim(float(values.min()) - pad, float(values.max()) + pad)
        close.set(xlim=(enlarged.start, enlarged.end), xlabel="time [s]")
        close.set_ylabel(f"$F_{'xyz'[enlarged.row]}$ [N], enlarged")
        _draw_event_boxes(close, log)
        for spine in close.spines.values():
            spine.set_visible(True)
            spine.set_color(style.ENLARGED_ZONE)
    handles, labels = grid[enlarged.row][0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=5)
    return figure


@dataclass(frozen=True)
class _Enlarged:
    """The part of the flight that the last row enlarges: start and end [s], axis of the force (0 to 2), and label."""

    start: float
    end: float
    row: int
    what: str


def _enlarged(log: FlightLog) -> _Enlarged:
    """Choose the part of the flight to enlarge.

    It is the first event; but if there is no event, or if the event is a step with noise as in the paper, a short part
    after about a quarter of the flight.
    """
    time = log.time
    for event in true_events(log)[:1]:
        force, noise_free = true_force(log, event.frames[0])
        if event.start >= time[-1] or (event.name == "step" and not np.array_equal(force, noise_free)):
            continue
        end = event.end if event.end <= time[-1] else event.start  # for an event without end, enlarge its onset
        margin = max(0.25 * (end - event.start), 0.5 * (SHORTEST_ENLARGED - (end - event.start)))
        start, end = _samples_around(time, event.start - margin, end + margin)
        strongest = np.abs(noise_free[(time[:-1] >= start) & (time[1:] <= end)]).max(axis=0)
        return _Enlarged(start, end, int(np.argmax(strongest)), str(event.name))
    start = time[0] + 0.27 * (time[-1] - time[0])
    points = () if log.truth is None else tuple(log.truth["point"].values)
    noisy = any(not np.array_equal(*true_force(log, str(point))) for point in points)
    return _Enlarged(*_samples_around(time, start, start + SHORTEST_ENLARGED), 1, "noise" if noisy else "detail")


def _samples_around(time: Array, start: float, end: float) -> tuple[float, float]:
    """Return the times [s] of the last sample before a stretch of time and of the first after it, within the log."""
    first = max(int(np.searchsorted(time, start + 1e-9, side="right")) - 1, 0)
    last = min(int(np.searchsorted(time, end - 1e-9)), len(time) - 1)
    return float(time[min(first, last - 1)]), float(time[last])


def _panels(rows: int, title: str, height: float = 5.0) -> tuple[Figure, list[Axes]]:
    figure = Figure(figsize=(7.0, height), layout="constrained")
    axes = list(figure.subplots(rows, 1, sharex=True))
    figure.suptitle(title)
    axes[-1].set_xlabel("time [s]")
    return figure, axes


def _force_lines(
    axis: Axes, time: Array, log: FlightLog, estimates: Estimates, column: int, frame: str, row: int
) -> None:
    if log.truth is not None:
        axis.plot(time, true_force(log, frame)[0][:, row], color=style.TRUTH, linewidth=2.0, label="actual")
    for (name, estimate), colour, line in zip(estimates.items(), style.ESTIMATES, ESTIMATE_LINES, strict=False):
        axis.plot(time, estimate.force[:, column, row], line, color=colour, linewidth=0.8, label=f"estimated: {name}")


def _draw_event_boxes(axis: Axes, log: FlightLog) -> None:
    """Draw a box around each event within the flight; events of the same name share one line in the legend."""
    labelled = set()
    for event in true_events(log):
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


def _sticks(robot: Aerobat, data: pin.Data, q: Array) -> tuple[Array, Array, Array]:
    """Return the world points (n, 3) [m] of left wing, right wing (each shoulder, elbow, tip) and body (rear, nose)."""
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
