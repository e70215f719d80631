"""Draw the robot as five bodies, for docs/method.md; the observer's blocks beside it are drawn by hand."""

from pathlib import Path

import matplotlib as mpl
import numpy as np
import pinocchio as pin
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Arc, Ellipse

from aerobat_pin.aerobat import load_aerobat
from aerobat_pin.visualization.style import BLUE, GREEN, INK, METADATA, MUTED, ORANGE, PURPLE, RC, VERMILLION

FIGURES = Path(__file__).resolve().parents[1] / "figures" / "method"
CRANK = np.radians(262.0)  # in the downstroke, the wings nearly spread
MM = 1e3


def arrow(axes: Axes, start: np.ndarray, end: np.ndarray, colour: str, width: float = 1.4) -> None:
    """Draw an arrow between two points of the page."""
    look = {"arrowstyle": "-|>", "color": colour, "lw": width, "shrinkA": 0, "shrinkB": 0}
    axes.annotate("", end, start, arrowprops=look)


def five_bodies() -> Figure:
    """Return the five bodies seen from behind, the left wing on the left, to scale: lengths, angles, COMs, force."""
    robot = load_aerobat("aerobat")
    closure = robot.linkage.solve(CRANK)
    q = robot.configuration([0.0] * 6 + [1.0], closure.theta_s, closure.theta_e)
    model, data = robot.model, robot.model.createData()
    pin.framesForwardKinematics(model, data, q)

    def page(point: np.ndarray) -> np.ndarray:
        return np.array([-point[1], point[2]]) * MM

    def placement(frame: str) -> pin.SE3:
        return data.oMf[model.getFrameId(frame)]

    figure = Figure(figsize=(8.6, 3.3), layout="constrained")
    axes = figure.subplots()
    body = page(placement("base_link").translation)
    axes.add_patch(Ellipse(tuple(body), 32, 36, fc="#EEF1F5", ec=INK, lw=1.2, zorder=1))
    for side, sign in (("left", 1.0), ("right", -1.0)):
        proximal, distal = placement(f"{side}_proximal"), placement(f"{side}_distal")
        span = sign * robot.morphology.wing.distal_stations[-1]
        shoulder, elbow = page(proximal.translation), page(distal.translation)
        tip = page(distal.act(np.array([0.0, span, 0.0])))
        for ends, colour in (((shoulder, elbow), BLUE), ((elbow, tip), GREEN)):
            axes.plot(*np.transpose(ends), color=colour, lw=7, alpha=0.35, solid_capstyle="round", zorder=2)
        for joint in (shoulder, elbow):
            axes.plot(*joint, "o", ms=7, mfc="white", mec=INK, zorder=4)
        for link in ("proximal", "distal"):
            inertia = model.inertias[model.frames[model.getFrameId(f"{side}_{link}")].parentJoint]
            axes.plot(*page(placement(f"{side}_{link}").act(inertia.lever)), "o", ms=5, color=INK, zorder=5)
        name = side[0].upper()
        point = placement(f"{side}_force_point")
        force = page(point.translation), page(point.act(np.array([0.0, 0.0, 0.045])))
        arrow(axes, *force, VERMILLION, 2.2)
        axes.annotate(f"$f_{name}$", force[1], (5, 1), textcoords="offset points", color=VERMILLION, fontsize=13)
        axes.annotate(f"$D_{name}$", tip, (0, 13), textcoords="offset points", color=GREEN, fontsize=12, ha="center")
        between = 0.5 * (shoulder + elbow)
        axes.annotate(f"$P_{name}$", between, (0, 12), textcoords="offset points", color=BLUE, fontsize=12, ha="center")
        if side == "left":
            lengths(axes, body, shoulder, elbow, page(distal.act(np.array(robot.morphology.distal.com))))
            angles(axes, shoulder, elbow, closure.theta_s, closure.theta_e)
    axes.plot(*body, "o", ms=5, color=INK, zorder=5)
    axes.annotate("$B$", body, (0, -30), textcoords="offset points", fontsize=12, ha="center")
    axes.annotate("$p_B$", body, (5, 3), textcoords="offset points", fontsize=11)
    corner = np.array([60.0, -52.0])
    for way, name in ((np.array([-26.0, 0.0]), "y (left)"), (np.array([0.0, 26.0]), "z (up)")):
        arrow(axes, corner, corner + way, MUTED)
        axes.annotate(name, corner + 1.12 * way + [0, 2], color=MUTED, ha="center", va="bottom", fontsize=9)
    axes.text(corner[0] + 6, corner[1], "x: into the page, forward", color=MUTED, ha="left", va="center", fontsize=9)
    axes.set(aspect="equal", xlim=(-215, 215), ylim=(-68, 62))
    axes.set(xlabel="right of the body's centre of mass [mm]", ylabel="above it [mm]")
    return figure


def lengths(axes: Axes, body: np.ndarray, shoulder: np.ndarray, elbow: np.ndarray, com: np.ndarray) -> None:
    """Draw the paper's three length vectors of the left wing."""
    for start, end, name, off in (
        (body, shoulder, "$l_{L1}$", (-12, -17)),
        (shoulder, elbow, "$l_{L2}$", (14, -25)),
        (elbow, com, "$l_{L3}$", (4, -22)),
    ):
        arrow(axes, start, end, PURPLE)
        middle = 0.5 * (start + end)
        axes.annotate(name, middle, off, textcoords="offset points", color=PURPLE, fontsize=12, ha="center")


def angles(axes: Axes, shoulder: np.ndarray, elbow: np.ndarray, theta_s: float, theta_e: float) -> None:
    """Draw shoulder and elbow angle of the left wing, each from the direction in which it is zero."""
    outward, forearm = np.array([-1.0, 0.0]), (elbow - shoulder) / np.linalg.norm(elbow - shoulder)
    for at, zero, turn, name in ((shoulder, outward, theta_s, r"$\theta_s$"), (elbow, forearm, theta_e, r"$\theta_e$")):
        axes.plot(*np.transpose([at, at + 40 * zero]), color=MUTED, lw=0.9, ls=":", zorder=3)
        start = np.degrees(np.arctan2(zero[1], zero[0]))
        end = start - np.degrees(turn)  # positive angles lift the wing: clockwise on the left, seen from behind
        axes.add_patch(Arc(tuple(at), 56, 56, theta1=min(start, end), theta2=max(start, end), color=ORANGE, lw=1.5))
        middle = np.radians(0.5 * (start + end))
        x, y = at + 37 * np.array([np.cos(middle), np.sin(middle)])
        axes.text(x, y, name, color=ORANGE, fontsize=12, ha="center", va="center")


def main() -> None:
    """Rewrite the picture."""
    FIGURES.mkdir(parents=True, exist_ok=True)
    with mpl.rc_context({**RC, "axes.grid": False, "mathtext.fontset": "cm", "text.parse_math": True}):
        five_bodies().savefig(FIGURES / "five_bodies.svg", metadata=METADATA["svg"])


if __name__ == "__main__":
    main()
