"""What a steady flapper leaves behind; for docs/lifting_line.md."""

from __future__ import annotations

import numpy as np
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure
from support.flapping_robot import AIRSPEED, FREQUENCY, STEPS, flap_robot

from aerobat_pin.aerodynamics import LiftingLine
from aerobat_pin.robot import load_aerobat
from aerobat_pin.visualization import style


def shed() -> Figure:
    """Draw what the robot leaves behind on its prescribed motion, and say whether it accounts for the lift."""
    (_, wake), wing = flap_robot(16, STEPS // 10), load_aerobat().wing
    mean = wake.mean_trailing(0.0, 1.0 / FREQUENCY)
    arc = np.concatenate([[0.5 * wing.span], LiftingLine(wing.span, wing.chord).y, [-0.5 * wing.span]])
    left = 0.5 * (arc[1:] + arc[:-1])
    figure = Figure(figsize=(6.4, 4.6), layout="constrained")
    trails, sheet = figure.subplots(2, 1, height_ratios=(1.6, 1.0))
    lift, push = style.WAKE_COLOURS
    colours = np.where(mean > 0.0, lift, push)
    trails.vlines(1e3 * left, 0.0, mean, colors=colours, linewidth=5.0, label="trailing vortices")
    bound = np.concatenate([[0.0], wake.bound.mean(axis=0), [0.0]])
    trails.plot(1e3 * arc, bound, marker=".", color=style.INK, label="bound circulation")
    trails.set_xlabel("arc from the right tip to the left [mm]")
    trails.set_ylabel("mean over a flap [m²/s]")
    trails.set_ylim(-0.06, 0.25)
    trails.legend(loc="upper center", ncols=2)
    flaps = range(3)
    x = np.concatenate([wake.position[..., 0] + k * AIRSPEED / FREQUENCY for k in flaps])
    y, strength = (np.tile(values, (len(flaps), 1)) for values in (wake.position[..., 1], wake.bound))
    size = float(np.percentile(np.abs(strength), 98.0))
    shades = LinearSegmentedColormap.from_list("sheet", [push, "#FFFFFF", lift])
    drawn = sheet.pcolormesh(x, y, strength, cmap=shades, vmin=-size, vmax=size, shading="gouraud", rasterized=True)
    figure.colorbar(drawn, ax=sheet, label="bound when\nit left [m²/s]")
    sheet.set_xlabel("distance flown [m]")
    sheet.set_ylabel("to the left [m]")
    sheet.set_aspect("equal")
    sheet.grid(visible=False)
    return figure
