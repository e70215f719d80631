"""What a steady flapper leaves behind it: mean trailing vortices, the sheet, and the lift they account for."""

from __future__ import annotations

import numpy as np
from flapping_robot import AIRSPEED, FREQUENCY, PITCH, STEPS, flap_robot
from ladder import Rung
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure

from aerobat_pin.aerodynamics import LiftingLine, Stroke, Wind, fly
from aerobat_pin.flight import Wake
from aerobat_pin.numerics import Array
from aerobat_pin.robot import load_aerobat
from aerobat_pin.visualization import style

DENSITY = 1.225  # [kg/m3]


def impulse_lift(wake: Wake) -> float:
    """Return the mean rate of the wake's vertical impulse [N], while it sheds in still air.

    A ring of strength Gamma has the impulse rho Gamma times its area: what a strip leaves behind in a second is a ring
    around the area that its trailing edge sweeps, seen from above.
    """
    ends = wake.position[:, :1], wake.position[:, -1:]
    edges = np.concatenate([ends[0], 0.5 * (wake.position[:, 1:] + wake.position[:, :-1]), ends[1]], axis=1)
    swept = np.cross(np.gradient(wake.position, wake.time, axis=0), edges[:, :-1] - edges[:, 1:])
    return float(DENSITY * np.mean(np.sum(wake.bound * swept[..., 2], axis=1)))


def rectangle_wake(stroke: Stroke, time: Array, last: int) -> tuple[float, Wake]:
    """Fly the lattice's rectangle: its mean lift [N] without added mass, and what it sheds, over the last instants."""
    line = LiftingLine(0.40, 0.10)
    flight, half = fly(line, stroke, time, added_mass=0.0), np.where(line.y > 0.0, 0, 1)
    points = np.column_stack([np.full(line.strips, -0.05), line.y, np.zeros(line.strips)])
    position = np.array([np.einsum("nij,nj->ni", stroke(t).rotation[half], points) for t in time[-last:]])
    position[..., 0] += stroke.airspeed * time[-last:, None]
    wake = Wake(time[-last:], position, flight.circulation[-last:], Wind())
    return float(flight.force[-last:, 2].mean()), wake


def shed() -> Rung:
    """Draw what the robot leaves behind on its prescribed motion, and say whether it accounts for the lift."""
    (force, wake), wing = flap_robot(16, STEPS // 10), load_aerobat().wing
    mean = wake.mean_trailing(0.0, 1.0 / FREQUENCY)
    arc = np.concatenate([[0.5 * wing.span], LiftingLine(wing.span, wing.chord).y, [-0.5 * wing.span]])
    left = 0.5 * (arc[1:] + arc[:-1])
    figure = Figure(figsize=(6.4, 4.6), layout="constrained")
    trails, sheet = figure.subplots(2, 1, height_ratios=(1.6, 1.0))
    lift, push = style.CIRCULATION
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
    y, strength = (np.tile(one, (len(flaps), 1)) for one in (wake.position[..., 1], wake.bound))
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
        f"The robot on a prescribed motion, {AIRSPEED:g} m/s, {np.degrees(PITCH):.0f} deg nose up, {FREQUENCY:g} Hz, 16 strips. Above, what stays behind over a "
        f"flap (`Wake.mean_trailing`): {mean[mean > 0.0].sum():.3f} m²/s behind the left wing, as much the other way round behind the right one, nothing in "
        "sum. Below, the sheet of three flaps from above, coloured as in the replay: wide where the wings were spread, narrow where "
        "they were folded, blue where they lifted, orange where they pushed down.\n\n"
        "The sheet's vertical impulse grows by rho Gamma times the area that the trailing edges sweep, and this should be the mean "
        f"lift. It is, for the rectangle of above at 5 deg: {', '.join(shares)} of flapping. For the robot's strips it is "
        f"{pairs[0][0]:.0f} of {pairs[0][1]:.0f} mN, {100.0 * pairs[0][0] / pairs[0][1]:.0f} %, and with 160 strips {pairs[1][0]:.0f} of {pairs[1][1]:.0f} mN, {100.0 * pairs[1][0] / pairs[1][1]:.0f} %. "
        "At such angles the strips' law is not that of a vortex sheet, and with 16 strips the joints cost what the study above says."
    )
    return Rung("shed", "What a steady flapper leaves behind", figure, caption)
