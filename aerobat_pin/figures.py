"""The paper's figures from a flight log and its estimates. Drawn off screen; nothing here opens a window."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
import pinocchio as pin
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from aerobat_pin import air_figures, linkage_sheet, style
from aerobat_pin.arrays import Array
from aerobat_pin.evaluation import euler_angles, point_label, true_events, true_force, world_velocity
from aerobat_pin.flight_log import FlightLog
from aerobat_pin.observers import Estimate
from aerobat_pin.robot import FORCE_POINTS, JOINTS, Aerobat

Estimates = Mapping[str, Estimate]
STICK_SPACING = 0.08  # [s], no simple fraction of a flap, between two snapshots of the stick diagram
STICK_STRETCH = 2.5  # of Y against X in the stick diagram
CLOSE_UP = 0.06  # [s], the stretch in which the noise is looked at closely


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
    """Top view of body and wings at fixed intervals along the flight (the paper's Fig. 7)."""
    figure = Figure(figsize=(9.0, 2.7), layout="constrained")
    axis = figure.add_subplot()
    q = log.measured["q"].values
    axis.plot(q[:, 0], q[:, 1], color=style.MUTED, linewidth=0.8, label="path of the body")
    data = robot.model.createData()
    every = max(1, round(STICK_SPACING / float(np.median(np.diff(log.time)))))
    for k in range(0, len(q), every):
        left, right, spine = _sticks(robot, data, q[k])
        first = k == 0
        axis.plot(left[:, 0], left[:, 1], "o-", ms=2, color=style.LEFT, label="left wing" if first else None)
        axis.plot(right[:, 0], right[:, 1], "s--", ms=2, color=style.RIGHT, label="right wing" if first else None)
        axis.plot(spine[:, 0], spine[:, 1], color=style.INK, linewidth=2.5, label="body" if first else None)
    axis.set_aspect(STICK_STRETCH)
    axis.set_xlabel("X [m]")
    axis.set_ylabel("Y [m]")
    figure.suptitle(f"Top view, a snapshot every {STICK_SPACING:g} s; Y drawn {STICK_STRETCH:g} times larger than X")
    figure.legend(ncols=4, loc="outside lower center")
    return figure


def estimation(log: FlightLog, estimates: Estimates) -> Figure:
    """Estimated against actual unknown forces, noise and events boxed (the paper's Fig. 8)."""
    frames = next(iter(estimates.values())).frames
    figure = Figure(figsize=(9.0, 7.4), layout="constrained")
    where = "wing" if set(frames) <= set(FORCE_POINTS) else "point"
    figure.suptitle(f"Unknown force at each {where}, world axes: interval means")
    grid = figure.subplots(4, len(frames), sharex="row", squeeze=False)
    middle = 0.5 * (log.time[1:] + log.time[:-1])
    close_up = _close_up(log)
    for column, frame in enumerate(frames):
        for row, name in enumerate("xyz"):
            axis = grid[row][column]
            _force_lines(axis, middle, log, estimates, column, frame, row)
            axis.set_ylabel(f"$F_{name}$ [N]")
            axis.set_xlim(log.time[0], log.time[-1])
            for event in true_events(log):
                if event.start < log.time[-1]:
                    _zone(axis, (event.start, min(event.end, float(log.time[-1]))), style.STEP_ZONE)
            if name == "y":
                _zone(axis, close_up, style.NOISE_ZONE)
        grid[0][column].set_title(f"{point_label(frame)} wing" if frame in FORCE_POINTS else frame)
        close = grid[3][column]
        _force_lines(close, middle, log, estimates, column, frame, 1)
        values = next(iter(estimates.values())).force[(middle >= close_up[0]) & (middle <= close_up[1]), column, 1]
        pad = 0.15 * float(np.ptp(values)) + 1e-3
        close.set_ylim(float(values.min()) - pad, float(values.max()) + pad)
        close.set_xlim(*close_up)
        close.set_ylabel("$F_y$ [N], close")
        close.set_xlabel("time [s]")
        for spine in close.spines.values():
            spine.set_visible(True)
            spine.set_color(style.NOISE_ZONE)
    handles, labels = grid[0][0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=len(labels))
    return figure


def _close_up(log: FlightLog) -> tuple[float, float]:
    """Choose a stretch in the first half of the flight, at least two samples long [s]."""
    start = log.time[0] + 0.27 * (log.time[-1] - log.time[0])
    after = log.time[log.time >= start + CLOSE_UP]
    return float(start), float(after[0] if len(after) else log.time[-1])


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


def _zone(axis: Axes, span: tuple[float, float], colour: str) -> None:
    low, high = axis.get_ylim()
    box: dict[str, Any] = {"fill": False, "edgecolor": colour, "linewidth": 1.4, "zorder": 4}
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
