"""Animate the linkage over one turn of the crank, as an SVG picture that needs no script."""

from __future__ import annotations

import numpy as np

from aerobat_pin.linkage import KineticSculpture
from aerobat_pin.numerics import Array
from aerobat_pin.visualization import style
from aerobat_pin.visualization.figures.linkage import BAR_PINS, GROUND_PINS
from aerobat_pin.visualization.template import fill_template

POSES_PER_TURN = 72
SVG_MARGIN = 4.0  # empty margin around the drawing [mm]


def linkage_animation(linkage: KineticSculpture, turn: float) -> str:
    """Return the moving linkage of the left wing as SVG text in millimetres; the animation repeats.

    Args:
        linkage: a linkage with a crank that can turn through a full circle.
        turn: duration of a turn in the picture [s].
    """
    crank = np.linspace(-0.5 * np.pi, 1.5 * np.pi, POSES_PER_TURN + 1)
    closed = linkage.solve(crank)
    pins = {name: 1e3 * np.broadcast_to(point, (len(crank), 2)) * [1.0, -1.0] for name, point in closed.pins.items()}
    heading = closed.theta_s + closed.theta_e
    pins["tip"] = pins["J6"] + 1e3 * linkage.lengths.L7a * np.column_stack([np.cos(heading), -np.sin(heading)])
    everything = np.concatenate(list(pins.values()))
    low, high = everything.min(axis=0) - SVG_MARGIN, everything.max(axis=0) + SVG_MARGIN
    lines = [(style.INK, ("J6", "tip")), *((style.BAR_COLOURS[bar], names) for bar, names in BAR_PINS.items())]
    return fill_template(
        "linkage.svg",
        turn=turn,
        left=low[0],
        top=low[1],
        width=high[0] - low[0],
        height=high[1] - low[1],
        ink=style.INK,
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
