"""The linkage in motion: one turn of the crank as an animated SVG picture that needs no script.

Bars have the colours of `figures.linkage`; dimensions are millimetres.
"""

from __future__ import annotations

import numpy as np

from aerobat_pin.linkage import KineticSculpture
from aerobat_pin.numerics import Array
from aerobat_pin.visualization import style
from aerobat_pin.visualization.figures.linkage import BAR_PINS, GROUND_PINS

POSES_PER_TURN = 72
SVG_MARGIN = 4.0  # around everything [mm]
SVG_WIDTH = 560  # as shown [pixels]


def linkage_animation(linkage: KineticSculpture, turn: float) -> str:
    """Return the left wing's linkage as SVG; the turn repeats.

    Args:
        linkage: whose crank can turn.
        turn: how long a turn takes in the picture [s].
    """
    crank = np.linspace(-0.5 * np.pi, 1.5 * np.pi, POSES_PER_TURN + 1)
    closed = linkage.solve(crank)
    pins = {name: 1e3 * np.broadcast_to(point, (len(crank), 2)) * [1.0, -1.0] for name, point in closed.pins.items()}
    heading = closed.theta_s + closed.theta_e
    tip = pins["J6"] + 1e3 * linkage.lengths.L7a * np.column_stack([np.cos(heading), -np.sin(heading)])
    everything = np.concatenate([*pins.values(), tip])
    low, high = everything.min(axis=0) - SVG_MARGIN, everything.max(axis=0) + SVG_MARGIN
    width, height = high - low
    parts = [_shape(np.stack([pins["J6"], tip], axis=1), style.INK, turn)]
    for bar, names in BAR_PINS.items():
        parts.append(_shape(np.stack([pins[name] for name in names], axis=1), style.BAR_COLOURS[bar], turn))
    for name, path in pins.items():
        parts.append(_pin(path, turn, square=name in GROUND_PINS))
    place = f'x="{low[0]:.1f}" y="{low[1]:.1f}" width="{width:.1f}" height="{height:.1f}"'
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="{low[0]:.1f} {low[1]:.1f} {width:.1f} {height:.1f}" '
        f'width="{SVG_WIDTH}" height="{SVG_WIDTH * height / width:.0f}" role="img"><title>One turn of the crank</title>'
        f'<rect {place} fill="white"/>' + "".join(parts) + "</svg>\n"
    )


def _shape(poses: Array, colour: str, turn: float) -> str:
    """Return a line through points that move, (poses, points, 2), filled if it has more than two."""
    lists = [" ".join(f"{x:.1f},{y:.1f}" for x, y in pose) for pose in poses]
    fill = f'fill="{colour}" fill-opacity="0.15"' if poses.shape[1] > 2 else 'fill="none"'
    return (
        f'<polyline points="{lists[0]}" stroke="{colour}" stroke-width="1" stroke-linejoin="round" '
        f'stroke-linecap="round" {fill}>{_animate("points", lists, turn)}</polyline>'
    )


def _pin(path: Array, turn: float, square: bool) -> str:
    """Return a pin that moves along a path (poses, 2), or a square that is fixed to the body."""
    look = f'fill="white" stroke="{style.INK}" stroke-width="0.4"'
    x, y = path[0]
    if square:
        return f'<rect x="{x - 0.8:.1f}" y="{y - 0.8:.1f}" width="1.6" height="1.6" {look}/>'
    moves = "".join(
        _animate(name, [f"{value:.1f}" for value in path[:, i]], turn) for i, name in enumerate(("cx", "cy"))
    )
    return f'<circle cx="{x:.1f}" cy="{y:.1f}" r="0.7" {look}>{moves}</circle>'


def _animate(name: str, values: list[str], turn: float) -> str:
    return f'<animate attributeName="{name}" dur="{turn:.2f}s" repeatCount="indefinite" values="{";".join(values)}"/>'
