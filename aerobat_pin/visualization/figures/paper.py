"""Draw the paper's figures of a flight (position, states, top view) without opening a window."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from aerobat_pin.aerobat import FlightLog
from aerobat_pin.numerics import Array
from aerobat_pin.robot import JOINTS, Aerobat, euler_angles, world_velocity
from aerobat_pin.visualization import style

LEAST_HEIGHT = 0.1  # [m]: smallest range of a position panel; a smaller one would magnify rounding noise
POSES_PER_FLAP = 8  # of the stick diagram
STICK_SPACING = 0.08  # [s] between two poses where no flap is known
STICK_STRETCH = 2.5  # factor by which Y is enlarged in the stick diagram of a flight that is much longer than wide
STICK_ROOM = (8.2, 6.0)  # largest width and height of the stick diagram's axes [in]


def draw_position(log: FlightLog) -> Figure:
    """Draw the position of the body's centre of mass over time (the paper's Fig. 5)."""
    figure, axes = _panels("Position of the body's centre of mass, world axes")
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
    figure, axes = _panels("Joint angles, attitude and velocity", height=6.0)
    q, v = log.measured["q"], log.measured["v"].values
    for joint, sign, colour, line in (("shoulder", "θₛ", style.LEFT, "-"), ("elbow", "θₑ", style.RIGHT, "--")):
        angle = np.degrees(q.sel(q_axis=f"left_{joint}").values)
        axes[0].plot(log.time, angle, line, color=colour, label=f"{joint} {sign}")
    axes[0].set_ylabel("joint angle [deg]")
    axes[1].set_ylabel("Euler angle [deg]")
    axes[2].set_ylabel("velocity, world [m/s]")
    for axis, values, labels in (
        (axes[1], _without_jumps(np.degrees(euler_angles(q.values))), ("roll", "pitch (nose up)", "yaw")),
        (axes[2], world_velocity(q.values, v), "XYZ"),
    ):
        for i, label in enumerate(labels):
            axis.plot(log.time, values[:, i], style.LINE_STYLES[i], color=style.AXIS_COLOURS[i], label=label)
    for axis in axes:
        style.legend_on_top(axis, ncols=3)
    return figure


def draw_stick_diagram(robot: Aerobat, log: FlightLog) -> Figure:
    """Draw body and wings from above, several poses a flap, and the ways of the wing tips (the paper's Fig. 7)."""
    q = log.measured["q"].values
    data = robot.model.createData()
    step = float(np.median(np.diff(log.time)))
    period = _flap_period(log)
    every = max(1, round((STICK_SPACING if period is None else period / POSES_PER_FLAP) / step))
    track = [_sticks(robot, data, row) for row in q[:: max(1, every // 4)]]
    poses = track[:: every // max(1, every // 4)]
    along, across = np.ptp(np.concatenate([q[:, :2], *(line[:, :2] for pose in track for line in pose)]), axis=0)
    stretch = STICK_STRETCH if across * STICK_STRETCH**2 < along else 1.0
    scale = min(STICK_ROOM[0] / along, STICK_ROOM[1] / (stretch * across))
    figure = Figure(figsize=(max(6.5, scale * along + 0.8), scale * stretch * across + 1.6), layout="constrained")
    axis = figure.add_subplot()
    axis.plot(q[:, 0], q[:, 1], color=style.MUTED, linewidth=0.8, label="path of the body")
    for side, name, colour, line in ((0, "left wing", style.LEFT, "-"), (1, "right wing", style.RIGHT, "--")):
        tips = np.array([pose[side][-1] for pose in track])
        axis.plot(tips[:, 0], tips[:, 1], line, color=colour, linewidth=1.2, label=f"tip of the {name}")
        sticks = np.concatenate([[*pose[side][:, :2], (np.nan, np.nan)] for pose in poses])
        axis.plot(*sticks.T, "-", color=colour, linewidth=0.5, alpha=0.7, label=f"{name}: shoulder, elbow, tip")
    for k, (_, _, spine) in enumerate(poses[::POSES_PER_FLAP]):
        axis.plot(spine[:, 0], spine[:, 1], color=style.INK, linewidth=2.5, label="body" if k == 0 else None)
    axis.set_aspect(stretch)
    axis.set_xlabel("X [m]")
    axis.set_ylabel("Y [m]")
    larger = f"; Y drawn {stretch:g} times larger than X" if stretch > 1.0 else ""
    shown = f"a pose every {STICK_SPACING:g} s" if period is None else f"{POSES_PER_FLAP} poses a flap, the body once"
    style.title_of(figure, f"Top view, {shown}{larger}")
    figure.legend(ncols=3, loc="outside lower center")
    return figure


def _flap_period(log: FlightLog) -> float | None:
    """Return the mean period of a flap [s]; None without a crank angle, or if the crank hardly turns."""
    if "crank_angle" not in log.measured:
        return None
    turns = abs(np.ptp(np.unwrap(log.measured["crank_angle"].values))) / (2.0 * np.pi)
    return float((log.time[-1] - log.time[0]) / turns) if turns > 1.0 else None


def _without_jumps(angles: Array) -> Array:
    """Return angles (n, k) [deg] with NaN where they wrap, so that no vertical line joins -180 and 180."""
    angles = angles.copy()
    angles[1:][np.abs(np.diff(angles, axis=0)) > 180.0] = np.nan
    return angles


def _panels(title: str, height: float = 5.0) -> tuple[Figure, list[Axes]]:
    figure = Figure(figsize=(7.0, height), layout="constrained")
    axes = list(figure.subplots(3, 1, sharex=True))
    figure.suptitle(title)
    axes[-1].set_xlabel("time [s]")
    return figure, axes


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
