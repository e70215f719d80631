"""The bars of the linkage: the pins that each bar joins, the positions of these pins, and the mesh of the bar.

Pins are given in the frame of their bar. This frame has its origin at the bar's first pin and its x axis forward. On
the left wing it is rotated relative to the body frame by the bar's angle about +x, so that y runs along the bar; on the
right wing it is rotated by the same angle about -x, and the bar is mirrored. The frames of the humerus L3 and of the
forearm L7 are those of the proximal and of the distal link. Points are complex numbers, outboard + i up [m].

Where the linkage is closed, its bars have masses. A bar is then taken as its struts: boxes of the drawn width and
thickness, with the bar's mass shared out by their lengths, in the plane of the linkage.
"""

from __future__ import annotations

import cmath
from dataclasses import dataclass
from typing import Literal

from aerobat_description.morphology import Morphology
from aerobat_description.morphology_tables import Body, LinkageLengths
from aerobat_description.position_closure import elbow
from aerobat_description.solids import Mesh, disc, mirrored, slab, strut

# On the robot, the linkage planes of the two wings are 9.4 mm apart along x, the left one ahead [V8]. The model has the
# axes of both wings in the plane half way between. Only the meshes of the bars are drawn in two planes, since in a
# common plane they would cut each other.
STAGGER = 4.7e-3
LAYER = 1.6e-3  # [own] distance along x between neighbouring layers of bars, away from the frame
THICKNESS, BOSS_THICKNESS = 1.1e-3, 1.6e-3  # [own]; bosses of neighbouring bars touch
FOREARM = 0.75  # [own] drawn length of the forearm over L7a; the membrane behind it ends there
HALF_WIDTH, BOSS_RADIUS = 1.3e-3, 2.2e-3  # [own]
# Bars that meet at a pin lie in neighbouring layers; bars that pass each other within a turn lie in different layers.
LAYERS = {"L1": 0, "L2": 1, "L3": 2, "L4": 2, "L5": 3, "L6": 2, "L7": 1}
LINK_OF = {"L3": "proximal", "L7": "distal"}  # bars that belong to links of the URDF
CLOSING = tuple(bar for bar in LAYERS if bar not in LINK_OF)

BarMasses = Literal["light", "cad"]
LIGHT = 1e-2  # share of the CAD masses that light bars have: what they do to a flight is then below 0.1 deg in a second


@dataclass(frozen=True)
class Bar:
    """A bar of the linkage.

    Attributes:
        name: name of the bar, L1 to L7.
        pins: pin -> position in the bar's frame, outboard + i up [m]; the first pin is at the origin.
        struts: pairs of points that a strut joins.
    """

    name: str
    pins: dict[str, complex]
    struts: tuple[tuple[complex, complex], ...]

    @property
    def origin(self) -> str:
        """Name of the pin at the origin of the bar's frame."""
        return next(iter(self.pins))

    def mesh(self, side: str) -> Mesh:
        """Return the mesh of the bar in its frame: struts, and a boss around every pin; `side` is left or right."""
        sign = 1.0 if side == "left" else -1.0
        centre = sign * layer(self.name)
        mesh: Mesh = []
        for start, end in self.struts:
            mesh += slab(strut(start, end, HALF_WIDTH), centre - THICKNESS / 2, centre + THICKNESS / 2)
        for pin in self.pins.values():
            mesh += slab(disc(pin, BOSS_RADIUS), centre - BOSS_THICKNESS / 2, centre + BOSS_THICKNESS / 2)
        return mesh if side == "left" else mirrored(mesh)


def layer(bar: str) -> float:
    """Return the x coordinate of the middle plane of a left bar in its frame [m]; right bars have the opposite sign."""
    return STAGGER + LAYER * (LAYERS[bar] - 1.5)


def linkage_bars(lengths: LinkageLengths) -> dict[str, Bar]:
    """Return the bars of a linkage: name, L1 to L7 -> bar."""
    crank, arm, push, pull = (complex(length) for length in (lengths.L1, lengths.L2a, lengths.L4, lengths.L6))
    coupler = complex(lengths.L2b, lengths.L2c)
    rocker = cmath.rect(1.0, -lengths.alpha3) * complex(-lengths.L3b, lengths.L3c)
    lever, long_lever = complex(-lengths.L5a, lengths.L5b), complex(lengths.L5c, lengths.L5d)
    horn, tip = complex(lengths.L7b, lengths.L7c), complex(FOREARM * lengths.L7a)
    o = 0j
    bars = (
        Bar("L1", {"J1": o, "J2": crank}, ((o, crank),)),
        Bar("L2", {"J2": o, "J3": coupler, "J4": arm}, ((o, arm), (coupler, arm))),
        Bar("L3", {"J5": o, "J4": rocker, "J6": elbow(lengths)}, ((o, rocker), (o, elbow(lengths)))),
        Bar("L4", {"J3": o, "J7": push}, ((o, push),)),
        Bar("L5", {"J8": o, "J7": lever, "J9": long_lever}, ((o, lever), (o, long_lever))),
        Bar("L6", {"J9": o, "J10": pull}, ((o, pull),)),
        Bar("L7", {"J6": o, "J10": horn}, ((o, horn), (o, tip), (horn, tip))),
    )
    return {bar.name: bar for bar in bars}


def closing_bars(lengths: LinkageLengths) -> dict[str, tuple[Bar, str]]:
    """Return the bars that close the loops of the URDF's tree: side and name, such as `left_L1` -> (bar, side)."""
    bars = linkage_bars(lengths)
    return {f"{side}_{name}": (bars[name], side) for name in CLOSING for side in ("left", "right")}


def bar_bodies(morphology: Morphology, bars: BarMasses) -> dict[str, Body]:
    """Return the bodies of the left wing's bars L1, L2, L4, L5 and L6.

    Their masses are those of the morphology, `"cad"`, or a hundredth of them, `"light"`.
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
