"""The wing as input of a lifting line: an arc along the links from tip to tip, with chord and leading edge.

The arc coordinate y runs from the right tip (-span/2) over the body to the left tip (+span/2). The length of the arc
stays the same when the wings fold. The body between the shoulders has the chord of the wing root.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from aerobat_description.morphology import Morphology
from aerobat_pin.errors import FrameNotFoundError
from aerobat_pin.numerics import Array, guarded

LINKS = ("base_link", "left_proximal", "left_distal", "right_proximal", "right_distal")


@guarded()
@dataclass(frozen=True)
class Wing:
    """Planform of both wings along the arc."""

    morphology: Morphology

    @property
    def breaks(self) -> tuple[float, float, float]:
        """Arc coordinates of the left shoulder, elbow and tip [m]."""
        shoulder = self.morphology.shoulder[1]
        elbow = shoulder + math.hypot(*self.morphology.elbow)
        return shoulder, elbow, elbow + self.morphology.wing.distal_stations[-1]

    @property
    def span(self) -> float:
        """Length of the arc from tip to tip [m]."""
        return self.morphology.span

    @guarded()
    def leading_edge(self, y: ArrayLike) -> Array:
        """Return the leading edge's x in the wing frame [m] at arc coordinates y [m]."""
        return self._edge(y, "leading_edge")

    @guarded()
    def chord(self, y: ArrayLike) -> Array:
        """Return the chord [m] at arc coordinates y [m], not less than the morphology's minimum chord."""
        chord = self._edge(y, "leading_edge") - self._edge(y, "trailing_edge")
        return np.maximum(chord, self.morphology.wing.minimum_chord)

    @guarded(y=[(), ("n",)])
    def attach(self, y: ArrayLike) -> tuple[NDArray[np.intp], Array]:
        """Return the link and the point on it that belong to each arc coordinate (n,) [m].

        Returns:
            Indices into `LINKS` (n,), and points (n, 3) [m] in the frames of these links, at x = 0 of the wing frame.
            Add the chordwise x of the wing frame to get a point of the membrane.
        """
        y = np.atleast_1d(np.asarray(y, float))
        shoulder, elbow, _ = self.breaks
        out, side = np.abs(y), np.where(y >= 0.0, 1.0, -1.0)
        panel = np.searchsorted([shoulder, elbow], out, side="right")  # 0 body, 1 proximal, 2 distal
        link = np.where(panel == 0, 0, np.where(y >= 0.0, panel, panel + 2))
        points = np.zeros((len(y), 3))
        body, proximal, distal = (panel == i for i in range(3))
        points[body] = self.morphology.shoulder
        points[body, 1] = y[body]
        along = (out[proximal] - shoulder) / (elbow - shoulder)
        points[proximal] = along[:, None] * np.asarray(self.morphology.elbow)
        points[distal, 1] = out[distal] - elbow
        points[~body, 1] *= side[~body]
        return link, points

    @guarded()
    def outline(self, link: str) -> Array:
        """Return the corners (k, 3) [m] of a link's membrane in the link's frame, out along the leading edge and back.

        The body between the shoulders counts as a panel with the edges of the wing root. The membrane ends in a point
        at the tip, whereas `chord` never falls below a minimum.

        Raises:
            FrameNotFoundError: `link` is not one of `LINKS`.
        """
        if link not in LINKS:
            raise FrameNotFoundError(link, list(LINKS))
        shoulder, elbow, tip = self.breaks
        panel = link.rpartition("_")[2]
        inner, outer = {"link": (-shoulder, shoulder), "proximal": (shoulder, elbow), "distal": (elbow, tip)}[panel]
        y = np.array([inner, *(s for s in self._stations if inner < s < outer), outer])
        edge = np.nextafter(y, 0.5 * (inner + outer))  # moved inside, so that `attach` puts both ends on this link
        side = -1.0 if link.startswith("right") else 1.0
        line = self.attach(side * edge)[1]
        forward = np.array([1.0, 0.0, 0.0])
        front, back = self._edge(y, "leading_edge"), self._edge(y, "trailing_edge")
        leading, trailing = (line + edge[:, None] * forward for edge in (front, back))
        return np.concatenate([leading, trailing[back < front][::-1]])

    @property
    def _stations(self) -> list[float]:
        """Arc coordinates [m] of the corners of both edges; the proximal panel is stretched to reach the elbow."""
        wing, (shoulder, elbow, _) = self.morphology.wing, self.breaks
        stretch = (elbow - shoulder) / wing.proximal_stations[-1]
        return [shoulder + stretch * s for s in wing.proximal_stations] + [elbow + s for s in wing.distal_stations]

    def _edge(self, y: ArrayLike, edge: str) -> Array:
        """Interpolate the x of an edge in the wing frame [m] at arc coordinates y [m]."""
        wing = self.morphology.wing
        edges = getattr(wing, f"proximal_{edge}") + getattr(wing, f"distal_{edge}")
        return np.asarray(np.interp(np.abs(np.asarray(y, float)), self._stations, edges))
