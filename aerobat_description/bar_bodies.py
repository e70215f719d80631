"""Mass properties of the linkage's bars, for robots whose linkage is closed.

A bar is taken as its struts: boxes of the drawn width and thickness, with the bar's mass shared out by their lengths,
in the plane of the linkage. Its frame is that of `bars`; the right bar is the mirror image of the left one.
"""

from __future__ import annotations

from typing import Literal

from aerobat_description.bars import CLOSING, HALF_WIDTH, THICKNESS, Bar, linkage_bars
from aerobat_description.morphology import Morphology
from aerobat_description.morphology_tables import Body

BarMasses = Literal["light", "cad"]
LIGHT = 1e-2  # share of the CAD masses that light bars have: what they do to a flight is then below 0.1 deg in a second


def bar_bodies(morphology: Morphology, bars: BarMasses) -> dict[str, Body]:
    """Return the bodies of the left wing's bars L1, L2, L4, L5 and L6.

    Args:
        morphology: the robot.
        bars: `"cad"` for the masses of the morphology, `"light"` for a hundredth of them.
    """
    drawn, share = linkage_bars(morphology.linkage), {"light": LIGHT, "cad": 1.0}[bars]
    return {name: bar_body(drawn[name], share * getattr(morphology.bars, name)) for name in CLOSING}


def body_without_bars(morphology: Morphology, bars: BarMasses) -> Body:
    """Return the body less the mass of both sides' bars, so that the robot's mass remains; its inertia is kept."""
    taken = 2.0 * sum(bar.mass for bar in bar_bodies(morphology, bars).values())
    return Body(morphology.body.mass - taken, morphology.body.inertia, morphology.body.com)


def bar_body(bar: Bar, mass: float) -> Body:
    """Return mass, centre of mass and inertia of a left bar of a given mass [kg], in its frame."""
    length = sum(abs(end - start) for start, end in bar.struts)
    pieces = [(mass * abs(end - start) / length, start, end) for start, end in bar.struts]
    com = sum(piece * (start + end) / 2.0 for piece, start, end in pieces) / mass
    width, thick = 2.0 * HALF_WIDTH, THICKNESS
    xx = yy = zz = yz = 0.0
    for piece, start, end in pieces:
        along, away = end - start, (start + end) / 2.0 - com
        far, unit = abs(along), along / abs(along)
        small, large = piece * (width**2 + thick**2) / 12.0, piece * (far**2 + thick**2) / 12.0
        xx += piece * ((far**2 + width**2) / 12.0 + abs(away) ** 2)
        yy += small * unit.real**2 + large * unit.imag**2 + piece * away.imag**2
        zz += small * unit.imag**2 + large * unit.real**2 + piece * away.real**2
        yz += (small - large) * unit.real * unit.imag - piece * away.real * away.imag
    return Body(mass, (xx, yy, zz, 0.0, 0.0, yz), (0.0, com.real, com.imag))
