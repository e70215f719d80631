"""Draw what a simulated flight knows: force and power of the air; of a closed loop course, thrusters, what was seen."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.figure import Figure

from aerobat_pin.aerobat import FlightLog
from aerobat_pin.aerodynamics import LiftingLine
from aerobat_pin.numerics import Array
from aerobat_pin.robot import Aerobat, euler_angles, rotation_matrices, world_velocity
from aerobat_pin.scenario import Scenario
from aerobat_pin.visualization import style

COLOURED = 98.0  # percentile of the strips' forces at which the colour scale ends
SEEN = ((1, "sideways force [mN]"), (2, "upward force [mN]"), (3, "rolling moment [mN m]"))


def draw_aerodynamics(robot: Aerobat, log: FlightLog) -> Figure:
    """Draw aerodynamic lift and thrust over time, and the normal force of each strip over time and span."""
    assert log.truth is not None
    figure = Figure(figsize=(7.0, 6.6), layout="constrained")
    figure.suptitle("Force of the air on the robot, added mass included: interval means")
    lift, thrust, strips = figure.subplots(3, 1, sharex=True, height_ratios=(1.0, 1.0, 1.2))
    middle = 0.5 * (log.time[1:] + log.time[:-1])
    generalised = log.truth["aerodynamic"].values + log.truth["added_mass"].values
    force = 1e3 * world_velocity(log.measured["q"].values[:-1], generalised)  # base rows in world axes
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
    R, thrusters = rotation_matrices(q[:, 3:7]), robot.morphology.thrusters
    return {item.name: R @ np.array(item.direction) * thrust[:, i : i + 1] for i, item in enumerate(thrusters)}


def _legend(part: Any, axis: Any) -> None:
    """Put the labels of an axis above its part of the figure."""
    part.legend(*axis.get_legend_handles_labels(), loc="outside upper center", ncols=3)
