"""Added mass of a finite wing: by how much the open tips reduce pi rho b^2 per span along a planform.

A plate that accelerates along its normal in still air carries a potential jump mu(x, y), which makes the normal velocity
of the air equal to that of the plate. The added mass per span is rho times the integral of mu over the chord, at unit
velocity. Here mu is constant on each panel of a grid, a ring vortex along the panel's edge; no-flow is required at the
panels' centres. Grid lines and centres lie at equal angles of a cosine along span and chord, since mu falls to zero as
the square root of the distance from the edge.

The factor is local: 1 in the middle of a long wing, falling to 0 at its tips. It is exact for a wing that plunges, and
used for every motion. On an elliptic wing it is the same at every section, 1 / E (Lamb, Hydrodynamics, art. 373; the
disc: 2 / pi); on rectangular wings its mean is the coefficient of Blevins (Formulas for natural frequency and mode
shape, 1979, table 14-1). By reciprocity, local factors of a plunging wing also give the total force of any other motion
along the normal exactly. The moment of inertia against flapping is 5 % too large at aspect ratio 4, 3 % at 6.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from aerobat_pin.numerics import Array

PANELS = (6, 48)  # along chord and span: 0.2 % of the tabulated coefficients


def added_mass_factor(chord: Callable[[Array], Array], span: float, y: Array) -> Array:
    """Return the added mass per span, divided by pi rho b^2, at stations of a planform.

    Args:
        chord: function from spanwise coordinates (n,) to the chord there [m].
        span: length of the wing from tip to tip [m].
        y: stations (n,) [m].
    """
    edge_x, x = _edges_and_centres(PANELS[0])
    edge_y, centre = _edges_and_centres(PANELS[1])
    out, middle = 0.5 * span * edge_y, 0.5 * span * centre
    length = chord(middle)
    corner_x, corner_y = 0.5 * np.outer(edge_x, chord(out)), np.broadcast_to(out, (len(edge_x), len(out)))
    at_x, at_y = 0.5 * np.outer(x, length).ravel(), np.tile(middle, len(x))
    jump = np.linalg.solve(_rings(corner_x, corner_y, at_x, at_y), np.ones(len(at_x))).reshape(len(x), -1)
    factor = np.abs(0.5 * np.diff(edge_x) @ jump) * length / (0.25 * np.pi * length**2)
    # mu vanishes at the tips as a square root: interpolating over the angle of the cosine follows it.
    angles, factors = np.arccos([1.0, *centre[::-1], -1.0]), [0.0, *factor[::-1], 0.0]
    return np.asarray(np.interp(np.arccos(2.0 * y / span), angles, factors))


def _edges_and_centres(panels: int) -> tuple[Array, Array]:
    """Return the edges (n + 1,) and centres (n,) of panels between -1 and 1, equally spaced in the cosine's angle."""
    angles = np.linspace(np.pi, 0.0, 2 * panels + 1)
    return np.cos(angles[::2]), np.cos(angles[1::2])


def _rings(corner_x: Array, corner_y: Array, x: Array, y: Array) -> Array:
    """Return the normal velocities at points (m,) due to unit ring vortices around the panels of a plane grid (m, n)."""
    corners = [(slice(None, -1), slice(None, -1)), (slice(1, None), slice(None, -1)), (slice(1, None), slice(1, None))]
    corners.append((slice(None, -1), slice(1, None)))
    ring = [(corner_x[at].ravel(), corner_y[at].ravel()) for at in corners]
    total = np.zeros((len(x), len(ring[0][0])))
    for (x1, y1), (x2, y2) in zip(ring, [*ring[1:], ring[0]], strict=True):
        ax, ay, bx, by = x[:, None] - x1, y[:, None] - y1, x[:, None] - x2, y[:, None] - y2
        across = ax * by - ay * bx
        turn = (x2 - x1) * (ax / np.hypot(ax, ay) - bx / np.hypot(bx, by))
        turn += (y2 - y1) * (ay / np.hypot(ax, ay) - by / np.hypot(bx, by))
        total += turn / np.where(across == 0.0, np.inf, across)
    return total / (4.0 * np.pi)
