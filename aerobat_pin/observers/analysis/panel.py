"""A flat polygon in space, such as a panel of a wing: its plane, and the distance of a point from its outline."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from aerobat_pin.errors import ObserverError
from aerobat_pin.numerics import Array

FLAT = 1.0e-3  # largest distance of a corner from the plane, as a share of the panel's size


class Panel:
    """A flat polygon, convex or not.

    Args:
        outline: (k, 3) corners in order [m].

    Raises:
        ObserverError: there are fewer than three corners, or they are not finite, not flat or enclose no area.

    Attributes:
        corners: (k, 3) corners, repeated ones removed [m].
        normal: (3,) unit normal, about which the corners run counter-clockwise.
    """

    def __init__(self, outline: ArrayLike) -> None:
        """Check the corners and find their plane."""
        corners = np.array(outline, float)
        if corners.ndim != 2 or corners.shape[1] != 3 or len(corners) < 3 or not np.all(np.isfinite(corners)):
            raise ObserverError(f"outline of shape {corners.shape}: three finite corners (k, 3) or more were expected")
        corners = corners[np.any(corners != np.roll(corners, -1, axis=0), axis=1)]  # a repeated corner has no edge
        if len(corners) < 3:
            raise ObserverError("outline: three different corners or more were expected")
        arms = corners - corners[0]
        area = 0.5 * np.cross(arms, np.roll(arms, -1, axis=0)).sum(axis=0)
        size = float(np.linalg.norm(area))
        reach = float(np.linalg.norm(arms, axis=1).max())
        if not size > 1e-12 * reach**2 or np.abs(arms @ area / size).max() > FLAT * reach:
            raise ObserverError("outline: the corners of a flat polygon with an area were expected")
        self.corners: Array = corners
        self.normal: Array = area / size

    def margin(self, point: Array) -> tuple[float, Array]:
        """Return a point's distance from the outline [m], negative outside, and the unit vector (3,) along that gap.

        Args:
            point: (3,) a point in the plane [m].
        """
        edges = np.roll(self.corners, -1, axis=0) - self.corners
        away = point - self.corners
        share = np.clip(np.sum(away * edges, axis=1) / np.maximum(np.sum(edges**2, axis=1), 1e-300), 0.0, 1.0)
        gaps = away - share[:, None] * edges
        distances = np.linalg.norm(gaps, axis=1)
        nearest = int(np.argmin(distances))
        distance = float(distances[nearest])
        across = np.cross(self.normal, edges[nearest])
        along = gaps[nearest] / distance if distance > 0.0 else across / np.linalg.norm(across)
        return (distance if self._inside(away) else -distance), along

    def _inside(self, away: Array) -> bool:
        """Return whether a point is inside the outline; `away` (k, 3) are the vectors from the corners to the point."""
        first, second = away, np.roll(away, -1, axis=0)
        turn = np.arctan2(np.cross(first, second) @ self.normal, np.sum(first * second, axis=1))
        return bool(abs(turn.sum()) > np.pi)
