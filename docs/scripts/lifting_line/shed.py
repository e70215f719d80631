"""What a steady flapper leaves behind; for docs/lifting_line.md."""

from __future__ import annotations

import numpy as np
from ladder import Rung
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure
from support.flapping_robot import AIRSPEED, FREQUENCY, PITCH, STEPS, flap_robot
from support.shed_wake import impulse_lift, rectangle_wake

from aerobat_pin.aerodynamics import LiftingLine, Stroke
from aerobat_pin.robot import load_aerobat
from aerobat_pin.visualization import style


def shed() -> Rung:
    """Draw what the robot leaves behind on its prescribed motion, and say whether it accounts for the lift."""
    (force, wake), wing = flap_robot(16, STEPS // 10), load_aerobat().wing
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
    time = np.linspace(0.0, 1.0, 501)
    shares = [
        f"{100.0 * impulse_lift(trail) / ours:.1f} % at {flap:.0f} deg"
        for flap in (0.0, 10.0, 30.0)
        for ours, trail in [rectangle_wake(Stroke(4.0, np.radians(5.0), 5.0, flap=np.radians(flap)), time, 101)]
    ]
    finer, trail = flap_robot(160, STEPS)
    pairs = [(1e3 * impulse_lift(of), 1e3 * lifts[:, 2].mean()) for lifts, of in ((force, wake), (finer, trail))]
    caption = (
        f"The robot on a prescribed motion, {AIRSPEED:g} m/s, {np.degrees(PITCH):.0f} deg nose up, {FREQUENCY:g} Hz, 16 strips. Above, the trailing vortices, mean over a "
        f"flap (`Wake.mean_trailing`): {mean[mean > 0.0].sum():.3f} m²/s behind the left wing, as much behind the right one with the other sense, nothing in "
        "sum. Below, the sheet of three flaps seen from above, coloured as in the replay. It is wide where the wings were spread and narrow where "
        "they were folded, blue where they lifted and orange where they pushed down.\n\n"
        "The sheet's vertical impulse grows by rho Gamma times the area that the trailing edges sweep in a second. This rate should be the mean "
        f"lift, and for the rectangle of above at 5 deg of incidence it is: {', '.join(shares)} of flapping. For the robot's strips it is "
        f"{pairs[0][0]:.0f} of {pairs[0][1]:.0f} mN, {100.0 * pairs[0][0] / pairs[0][1]:.0f} %, and with 160 strips {pairs[1][0]:.0f} of {pairs[1][1]:.0f} mN, {100.0 * pairs[1][0] / pairs[1][1]:.0f} %. "
        "At the robot's angles the strips' law is not that of a vortex sheet."
    )
    return Rung("shed", "What a steady flapper leaves behind", figure, caption)
