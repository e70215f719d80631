"""Draw a flight, without a window: the paper's figures (position, states, top view), and what a simulation knows.

That is force and power of the air; of a closed loop course, thrusters, and what was seen.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pinocchio as pin
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from aerobat_pin.aerobat import JOINTS, Aerobat, FlightLog
from aerobat_pin.aerodynamics import LiftingLine
from aerobat_pin.numerics import Array
from aerobat_pin.observers import euler_angles, rotation_matrices, world_velocity
from aerobat_pin.scenario import Scenario
from aerobat_pin.visualization import style

LEAST_HEIGHT = 0.1  # [m]: smallest range of a position panel; a smaller one would magnify rounding noise
POSES_PER_FLAP = 8  # of the stick diagram
STICK_SPACING = 0.08  # [s] between two poses where no flap is known
STICK_STRETCH = 2.5  # factor by which Y is enlarged in the stick diagram of a flight that is much longer than wide
STICK_ROOM = (8.2, 6.0)  # largest width and height of the stick diagram's axes [in]
COLOURED = 98.0  # percentile of the strips' forces at which the colour scale ends
SEEN = ((1, "sideways force [mN]"), (2, "upward force [mN]"), (3, "rolling moment [mN m]"))


def draw_flight(robot: Aerobat, scenario: Scenario, log: FlightLog) -> dict[str, Figure]:
    """Draw all figures of a flight, of which the log knows what they show: name -> figure."""
    figures = {
        "position": draw_position(log),
        "states": draw_states(log),
        "stick_diagram": draw_stick_diagram(robot, log),
    }
    if log.truth is not None:
        figures |= {"aerodynamics": draw_aerodynamics(robot, log), "power": draw_power(log)}
        if "thrust" in log.truth:
            figures["control"] = draw_control(robot, scenario, log)
    return figures


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
    _curves(axes[1], log.time, _without_jumps(np.degrees(euler_angles(q.values))), ("roll", "pitch (nose up)", "yaw"))
    _curves(axes[2], log.time, world_velocity(q.values, v), "XYZ")
    for axis, label in zip(axes, ("joint angle [deg]", "Euler angle [deg]", "velocity, world [m/s]"), strict=True):
        axis.set_ylabel(label)
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


def _curves(axis: Axes, time: Array, values: Array, labels: Sequence[str]) -> None:
    """Draw values (n, 3) over times (n,) [s]."""
    for i, label in enumerate(labels):
        axis.plot(time, values[:, i], style.LINE_STYLES[i], color=style.AXIS_COLOURS[i], label=label)


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


def draw_aerodynamics(robot: Aerobat, log: FlightLog) -> Figure:
    """Draw aerodynamic lift and thrust over time, and the normal force of each strip over time and span."""
    assert log.truth is not None
    figure = Figure(figsize=(7.0, 6.6), layout="constrained")
    figure.suptitle("Force of the air on the robot, added mass included: interval means")
    lift, thrust, strips = figure.subplots(3, 1, sharex=True, height_ratios=(1.0, 1.0, 1.2))
    middle = 0.5 * (log.time[1:] + log.time[:-1])
    generalised = log.truth["aerodynamic"].values + log.truth["added_mass"].values
    force = 1e3 * world_velocity(_true_motion(log)[:-1], generalised)  # base rows in world axes
    weight = 1e3 * robot.mass * float(log.measured.attrs["gravity"])
    for axis, values, name in ((lift, force[:, 2], "lift, Z"), (thrust, force[:, 0], "thrust, X")):
        axis.plot(middle, values, color=style.BLUE)
        mean = float(np.mean(values))
        axis.axhline(mean, color=style.VERMILLION, linestyle="--", label=f"mean {mean:.0f} mN")
        axis.set_ylabel(f"{name} [mN]")
    lift.axhline(weight, color=style.INK, linestyle=":", label=f"weight {weight:.0f} mN")
    for axis in (lift, thrust):
        style.legend_on_top(axis, ncols=2)
    span = log.truth["strip"].values
    line = LiftingLine(robot.wing.span, robot.wing.chord, strips=len(span))
    loading = log.truth["strip_force_z"].values / line.width
    end = max(float(np.percentile(np.abs(loading), COLOURED)), 1e-9)
    drawn = strips.pcolormesh(
        middle, 1e3 * span, loading.T, cmap=style.FIELD_COLOURS, vmin=-end, vmax=end, shading="nearest", rasterized=True
    )
    strips.grid(visible=False)
    strips.set_ylabel("along the span, left positive [mm]")
    strips.set_xlabel("time [s]")
    figure.colorbar(drawn, ax=strips, label="force per length,\nalong the wing's normal [N/m]", extend="both")
    return figure


def draw_power(log: FlightLog) -> Figure:
    """Draw the power that the motor and the air give to the robot, over time."""
    assert log.truth is not None
    figure = Figure(figsize=(7.0, 2.8), layout="constrained")
    figure.suptitle("Power given to the robot: interval means")
    axis = figure.subplots()
    middle = 0.5 * (log.time[1:] + log.time[:-1])
    for name, colour, line in (("motor", style.BLUE, "-"), ("air", style.ORANGE, "--")):
        values = log.truth[f"{name}_power"].values
        axis.plot(middle, values, line, color=colour, label=f"{name}, mean {np.mean(values):.2f} W")
    axis.set_ylabel("power [W]")
    axis.set_xlabel("time [s]")
    style.legend_on_top(axis, ncols=2)
    return figure


def draw_control(robot: Aerobat, scenario: Scenario, log: FlightLog) -> Figure:
    """Draw a flight that a controller flew: four rows over time."""
    assert log.truth is not None
    figure = Figure(figsize=(7.4, 9.0), layout="constrained")
    figure.suptitle("Closed loop")
    parts: Any = figure.subfigures(3, 1, height_ratios=(1.0, 1.25, 1.0))
    top, thrusts, seen = parts
    time, middle = log.time, 0.5 * (log.time[1:] + log.time[:-1])
    q, flight = _true_motion(log), scenario.flight
    course = np.array(flight.position) + time[:, None] * np.array(flight.velocity)
    place, angle = top.subplots(1, 2)
    _curves(place, time, 1e3 * (q[:, :3] - course), "xyz")
    _curves(angle, time, np.degrees(euler_angles(q)), ("roll", "pitch", "yaw"))
    place.set_ylabel("off the course [mm]")
    angle.set_ylabel("attitude [deg]")
    command, thrust = 1e3 * log.measured["thruster_command"].values, 1e3 * log.truth["thrust"].values
    axes = thrusts.subplots(2, 3, sharex=True)
    for i, (axis, thruster) in enumerate(zip(axes.flat, robot.morphology.thrusters, strict=True)):
        axis.plot(middle, command[:, i], color=style.FAINT, linewidth=0.6, label="commanded")
        axis.plot(middle, thrust[:, i], color=style.BLUE, label="made")
        axis.axhline(1e3 * thruster.thrust, color=style.INK, linestyle=":", linewidth=0.9, label="limit")
        axis.set_title(thruster.name.replace("_", " "), fontsize=8)
        axis.set_ylim(-0.05e3 * thruster.thrust, 1.1e3 * thruster.thrust)
    for axis in axes[:, 0]:
        axis.set_ylabel("thrust [mN]")
    _legend(thrusts, axes[0, 0])
    panels = seen.subplots(1, 3)
    true, seen_force = log.truth["unknown"].values, log.truth["seen_disturbance"].values
    for axis, (row, name) in zip(panels, SEEN, strict=True):
        axis.plot(middle, 1e3 * true[:, row], color=style.TRUTH, linewidth=0.7, label="unknown forces")
        axis.plot(middle, 1e3 * seen_force[:, row], color=style.ESTIMATES[0], label="seen by the controller")
        axis.set_title(name, fontsize=8)
        axis.set_xlabel("time [s]")
    _legend(seen, panels[0])
    for axis in (place, angle):
        style.legend_on_top(axis, ncols=3)
        axis.set_xlabel("time [s]")
    return figure


def thrust_forces(robot: Aerobat, log: FlightLog) -> dict[str, Array]:
    """Return the force (n, 3) of each thruster in world axes [N], by the name of its frame, as interval means."""
    assert log.truth is not None
    q, thrust = _true_motion(log)[:-1], log.truth["thrust"].values
    R, thrusters = rotation_matrices(q[:, 3:7]), robot.morphology.thrusters
    return {item.name: R @ np.array(item.direction) * thrust[:, i : i + 1] for i, item in enumerate(thrusters)}


def _true_motion(log: FlightLog) -> Array:
    """Return the configurations (n, nq) of a simulated flight, without the errors of its sensors."""
    assert log.truth is not None
    return np.asarray((log.truth if "q" in log.truth else log.measured)["q"].values)


def _legend(part: Any, axis: Any) -> None:
    """Put the labels of an axis above its part of the figure."""
    part.legend(*axis.get_legend_handles_labels(), loc="outside upper center", ncols=3)
