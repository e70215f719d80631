"""Draw a closed loop: errors about the course, what the thrusters were told and made, and what the controller saw."""

from __future__ import annotations

from typing import Any

import numpy as np
import pinocchio as pin
from matplotlib.figure import Figure

from aerobat_pin.aerobat import FlightLog
from aerobat_pin.numerics import Array
from aerobat_pin.robot import Aerobat, euler_angles
from aerobat_pin.scenario import Scenario
from aerobat_pin.visualization import style

SEEN = ((1, "sideways force [mN]"), (2, "upward force [mN]"), (3, "rolling moment [mN m]"))


def draw_control(robot: Aerobat, scenario: Scenario, log: FlightLog) -> Figure:
    """Draw a flight that a controller flew: four rows over time."""
    assert log.truth is not None
    figure = Figure(figsize=(7.4, 9.0), layout="constrained")
    figure.suptitle("Closed loop")
    parts: Any = figure.subfigures(3, 1, height_ratios=(1.0, 1.25, 1.0))
    top, thrusts, seen = parts
    time, middle = log.time, 0.5 * (log.time[1:] + log.time[:-1])
    q = (log.truth if "q" in log.truth else log.measured)["q"].values
    flight = scenario.flight
    course = np.array(flight.position) + time[:, None] * np.array(flight.velocity)
    place, angle = top.subplots(1, 2)
    for i, name in enumerate("xyz"):
        place.plot(time, 1e3 * (q[:, i] - course[:, i]), style.LINE_STYLES[i], color=style.AXIS_COLOURS[i], label=name)
    for i, name in enumerate(("roll", "pitch", "yaw")):
        values = np.degrees(euler_angles(q)[:, i])
        angle.plot(time, values, style.LINE_STYLES[i], color=style.AXIS_COLOURS[i], label=name)
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
    q, thrust = (log.truth if "q" in log.truth else log.measured)["q"].values[:-1], log.truth["thrust"].values
    attitudes = [pin.Quaternion(row[3:7]).matrix() for row in q]
    return {
        thruster.name: np.array([R @ np.array(thruster.direction) for R in attitudes]) * thrust[:, i : i + 1]
        for i, thruster in enumerate(robot.morphology.thrusters)
    }


def _legend(part: Any, axis: Any) -> None:
    """Put the labels of an axis above its part of the figure."""
    part.legend(*axis.get_legend_handles_labels(), loc="outside upper center", ncols=3)
