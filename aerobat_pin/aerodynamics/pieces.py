"""Divide the strips of a wing into pieces, each on one link, where a strip lies across a joint."""

from __future__ import annotations

import numpy as np

from aerobat_pin.aerodynamics.lifting_line import LiftingLine
from aerobat_pin.aerodynamics.strip_forces import Pieces
from aerobat_pin.numerics import Array
from aerobat_pin.robot import Wing

SMALLEST_SHARE = 1e-6  # a smaller share of a strip is a joint that lies on the strip's edge, up to rounding


def divide(wing: Wing, line: LiftingLine, added_mass: Array) -> Pieces:
    """Divide the strips of a lifting line along the links.

    A strip reaches to midway between its station and the next one, in the angle of the cosine, and to the tip. A piece
    lies at its strip's station, or, if the strip is divided, in the middle of its own part.

    Args:
        wing: planform along the links.
        line: lifting line on that planform.
        added_mass: added mass of each strip (N,) [kg].
    """
    shoulder, elbow, _ = wing.breaks
    joints = np.array([elbow, shoulder, -shoulder, -elbow])
    midway = 0.5 * line.span * np.cos((np.arange(1, line.strips) + 0.5) * np.pi / (line.strips + 1))
    edges = np.concatenate([[0.5 * line.span], midway, [-0.5 * line.span]])
    cuts = np.sort(np.concatenate([edges, joints[np.abs(joints) < 0.5 * line.span]]))[::-1]
    middle = 0.5 * (cuts[:-1] + cuts[1:])
    strip = np.clip(np.searchsorted(-edges, -middle) - 1, 0, line.strips - 1)
    share = -np.diff(cuts) / -np.diff(edges)[strip]
    strip, middle, share = (part[share > SMALLEST_SHARE] for part in (strip, middle, share))
    share /= np.bincount(strip, share)[strip]
    y = np.where(np.bincount(strip)[strip] == 1, line.y[strip], middle)
    link, point = wing.attach(y)
    point[:, 0] += wing.leading_edge(y) - 0.5 * wing.chord(y)
    x, y, z = point.T
    return Pieces(strip, link, x, y, z, share, 0.5 * share * (added_mass * line.semichord)[strip])
