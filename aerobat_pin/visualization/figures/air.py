"""Draw the aerodynamic force, and the power of motor and air, for flights whose log contains the true forces."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from aerobat_pin.aerobat import FlightLog
from aerobat_pin.aerodynamics import LiftingLine
from aerobat_pin.robot import Aerobat, world_velocity
from aerobat_pin.visualization import style

COLOURED = 98.0  # percentile of the strips' forces at which the colour scale ends


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
