"""Draw the linkage: the mechanism with the names of its parts, and both joint angles over a turn (paper, Fig. 2).

It is also animated, as an SVG picture that needs no script.
"""

from __future__ import annotations

from collections.abc import Mapping

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke

from aerobat_pin.linkage import Closure, KineticSculpture
from aerobat_pin.numerics import Array
from aerobat_pin.visualization import style

SHOWN_DEG = 235.0  # crank angle of the pose that is drawn with names
FAINT_DEG = range(-90, 270, 30)  # crank angles of the faint poses behind it
INSET_HALF_SIZE = (0.95, 0.78)  # half width and half height, in lengths of the crank
BAR_PINS = {
    "L1": ("J1", "J2"),
    "L2": ("J2", "J3", "J4", "J2"),
    "L3": ("J4", "J5", "J6", "J4"),
    "L4": ("J3", "J7"),
    "L5": ("J7", "J8", "J9", "J7"),
    "L6": ("J9", "J10"),
    "L7": ("J6", "J10"),
}
GROUND_PINS = ("J1", "J5", "J8")
FAINT_PINS = ("J5", "J6", "J10", "J9", "J8")
# Position of each name: offset from its pin, or from the middle between the bar's last two pins [points].
NAME_OFFSETS = {
    "J4": (-4, -12),
    "J5": (3, -13),
    "J6": (-5, 6),
    "J7": (-12, 5),
    "J8": (2, -13),
    "J9": (5, 3),
    "J10": (7, -3),
    "L2": (9, -8),
    "L3": (-10, 7),
    "L4": (-15, 0),
    "L5": (-6, 5),
    "L6": (6, 2),
    "L7": (55, -68),
}
POSES_PER_TURN = 72  # of the animation
SVG_MARGIN = 4.0  # empty margin around the drawing [mm]
INSET_NAME_OFFSETS = {"J1": (9, -3), "J2": (-4, -14), "J3": (-16, -2), "L1": (-5, -4)}


def draw_linkage(linkage: KineticSculpture) -> Figure:
    """Draw the linkage of the left wing.

    On the left, one pose with names over faint poses of a turn; on the right, both joint angles over the crank angle.
    """
    with mpl.rc_context(style.RC):
        figure = Figure(figsize=(10.0, 5.6), layout="constrained")
        left, right = figure.subplots(1, 2, width_ratios=(1.9, 1.0))
        _draw_mechanism(left, linkage)
        _draw_joints(right, linkage)
    return figure


def _draw_mechanism(axis: Axes, linkage: KineticSculpture) -> None:
    shown = linkage.solve(np.radians(SHOWN_DEG))
    turn = 1e3 * np.stack([linkage.solve(np.radians(FAINT_DEG)).pins[name] for name in FAINT_PINS])
    axis.plot(turn[..., 0], turn[..., 1], color=style.FAINT, linewidth=0.7, zorder=0.5)
    pins = {name: 1e3 * point for name, point in shown.pins.items()}
    _draw_angles(axis, pins, shown)
    _draw_bars(axis, pins)
    _write_names(axis, pins, NAME_OFFSETS)
    inset = axis.inset_axes((0.015, 0.03, 0.36, 0.36))
    _draw_bars(inset, pins)
    _write_names(inset, pins, INSET_NAME_OFFSETS)
    x, y = np.mean([pins[name] for name in ("J1", "J2", "J3")], axis=0)
    wide, high = (1e3 * linkage.lengths.L1 * half for half in INSET_HALF_SIZE)
    inset.set(xlim=(x - wide, x + wide), ylim=(y - high, y + high), xticks=[], yticks=[], aspect="equal")
    inset.spines[:].set(visible=True, color=style.MUTED, linewidth=0.8)
    axis.indicate_inset_zoom(inset, edgecolor=style.MUTED)
    axis.set_aspect("equal")
    axis.set_xlabel("outboard [mm]")
    axis.set_ylabel("up [mm]")
    axis.set_title(f"Left wing, crank at {SHOWN_DEG:g} deg; squares fixed to the body; grey: every 30 deg")


def _draw_bars(axis: Axes, pins: Mapping[str, Array]) -> None:
    for bar, names in BAR_PINS.items():
        points = np.array([pins[name] for name in names])
        axis.plot(points[:, 0], points[:, 1], "-", color=style.BAR_COLOURS[bar], linewidth=2.2, solid_capstyle="round")
        if len(names) > 2:
            axis.fill(points[:, 0], points[:, 1], color=style.BAR_COLOURS[bar], alpha=0.15)
    for name, point in pins.items():
        ground = name in GROUND_PINS
        axis.plot(*point, "s" if ground else "o", ms=6 if ground else 4.5, mfc="white", mec=style.INK, zorder=5)


def _write_names(axis: Axes, pins: Mapping[str, Array], offsets: Mapping[str, tuple[float, float]]) -> None:
    for name, offset in offsets.items():
        pin = name in pins
        x, y = pins[name] if pin else np.mean([pins[end] for end in BAR_PINS[name][-2:]], axis=0)
        axis.annotate(
            name,
            (x, y),
            xytext=offset,
            textcoords="offset points",
            color=style.INK,
            fontsize=8 if pin else 9,
            fontweight="normal" if pin else "bold",
            path_effects=[withStroke(linewidth=2.5, foreground="white")],
            zorder=6,
        )


def _draw_angles(axis: Axes, pins: Mapping[str, Array], shown: Closure) -> None:
    """Draw the distal wing to the length L7a, and both joint angles.

    theta_s is the angle from the horizontal to the y axis of the proximal frame, theta_e the angle from that axis to
    the y axis of the distal frame.
    """
    radius, length = 0.4e3 * shown.lengths.L3a, 1e3 * shown.lengths.L7a
    theta_s, theta_e = float(shown.theta_s), float(shown.theta_e)
    for name, pivot, start, angle in (("s", pins["J5"], 0.0, theta_s), ("e", pins["J6"], theta_s, theta_e)):
        for direction, line in ((start, ":"), (start + angle, "-" if name == "e" else ":")):
            reach = length if line == "-" else 1.35 * radius
            end = pivot + reach * np.array([np.cos(direction), np.sin(direction)])
            colour, width = (style.INK, 2.2) if line == "-" else (style.MUTED, 1.0)
            axis.plot(*zip(pivot, end, strict=True), line, color=colour, linewidth=width)
        sweep = start + angle * np.linspace(0.0, 1.0, 40)
        arc = np.stack([np.cos(sweep), np.sin(sweep)])
        axis.plot(*(pivot[:, None] + radius * arc), color=style.AXIS_COLOURS[0], linewidth=1.2)
        middle = pivot + 1.15 * radius * arc[:, 20]
        axis.annotate(
            rf"$\theta_{name}$",
            (middle[0], middle[1]),
            color=style.AXIS_COLOURS[0],
            fontsize=11,
            va="center",
            parse_math=True,
        )


def _draw_joints(axis: Axes, linkage: KineticSculpture) -> None:
    crank = np.linspace(-90.0, 270.0, 721)
    cycle = linkage.solve(np.radians(crank))
    axis.plot(crank, np.degrees(cycle.theta_s), color=style.LEFT, label="shoulder θₛ")
    axis.plot(crank, np.degrees(cycle.theta_e), "--", color=style.RIGHT, label="elbow θₑ")
    shown = linkage.solve(np.radians(SHOWN_DEG))
    both = np.degrees([shown.theta_s, shown.theta_e])
    axis.plot([SHOWN_DEG] * 2, both, "o", ms=4.5, mfc="white", mec=style.INK, label="pose on the left")
    axis.set_xlabel("crank angle [deg]")
    axis.set_ylabel("joint angle [deg]")
    axis.set_xticks(range(-90, 271, 90))
    axis.set_title("One turn of the crank")
    axis.legend()


def range_table(linkage: KineticSculpture) -> str:
    """Return a table as text: lowest and highest joint and transmission angles in a turn, each with its crank angle."""
    crank = np.arange(0.0, 360.0, 0.1)
    turn = linkage.solve(np.radians(crank))
    rows = {"shoulder theta_s": turn.theta_s, "elbow theta_e": turn.theta_e}
    rows |= {f"transmission at {pin}": angle for pin, angle in turn.transmission.items()}
    lines = [f"{'[deg]':<20} {'lowest':>8} {'at crank':>9} {'highest':>8} {'at crank':>9}"]
    for name, angle in rows.items():
        cells = [(np.degrees(angle[k]), crank[k]) for k in (np.argmin(angle), np.argmax(angle))]
        lines.append(f"{name:<20} " + " ".join(f"{value:8.2f} {at:9.1f}" for value, at in cells))
    return "\n".join(lines)


def linkage_animation(linkage: KineticSculpture, turn: float) -> str:
    """Return the left linkage as SVG text in millimetres, whose crank turns again and again, once in `turn` [s]."""
    from aerobat_pin.visualization.template import fill_template  # a figure alone does without jinja2

    crank = np.linspace(-0.5 * np.pi, 1.5 * np.pi, POSES_PER_TURN + 1)
    closed = linkage.solve(crank)
    pins = {name: 1e3 * np.broadcast_to(point, (len(crank), 2)) * [1.0, -1.0] for name, point in closed.pins.items()}
    heading = closed.theta_s + closed.theta_e
    pins["tip"] = pins["J6"] + 1e3 * linkage.lengths.L7a * np.column_stack([np.cos(heading), -np.sin(heading)])
    everything = np.concatenate(list(pins.values()))
    low, high = everything.min(axis=0) - SVG_MARGIN, everything.max(axis=0) + SVG_MARGIN
    colours = style.BAR_COLOURS | {"L7": style.MUTED}  # which is seen by day and by night
    lines = [(style.MUTED, ("J6", "tip")), *((colours[bar], names) for bar, names in BAR_PINS.items())]
    return fill_template(
        "linkage.svg",
        turn=turn,
        left=low[0],
        top=low[1],
        width=high[0] - low[0],
        height=high[1] - low[1],
        bars=[
            (colour, len(names) > 2, [_points(pose) for pose in np.stack([pins[name] for name in names], axis=1)])
            for colour, names in lines
        ],
        ground=[pins[name][0] for name in GROUND_PINS],
        joints=[
            [[f"{value:.1f}" for value in axis] for axis in path.T]
            for name, path in pins.items()
            if name not in (*GROUND_PINS, "tip")
        ],
    )


def _points(pose: Array) -> str:
    return " ".join(f"{x:.1f},{y:.1f}" for x, y in pose)
