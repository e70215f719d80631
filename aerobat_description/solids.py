"""Build closed triangle meshes of simple solids, in metres.

A mesh is a list of triangles, a triangle is three points, and a point is three floats. Seen from outside, the corners
of a triangle are counter-clockwise. Solids of one mesh can overlap, but they share no edge.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence

Point = tuple[float, float, float]
Triangle = tuple[Point, Point, Point]
Mesh = list[Triangle]

DISC_CORNERS = 12


def mirrored(mesh: Mesh) -> Mesh:
    """Mirror a mesh in the x-z plane; the corners are reversed so that the outside remains outside."""
    return [tuple((x, -y, z) for x, y, z in reversed(triangle)) for triangle in mesh]  # type: ignore[misc]


def lofted(sections: Sequence[Sequence[Point]]) -> Mesh:
    """Connect a row of convex sections to a solid, and close both ends.

    They have equal numbers of points, counter-clockwise when seen from the end of the row.
    """
    mesh: Mesh = []
    for near, far in itertools.pairwise(sections):
        for i in range(len(near)):
            j = (i + 1) % len(near)
            mesh += _quad(near[i], near[j], far[j], far[i])
    first, last = sections[0], sections[-1]
    for i in range(1, len(first) - 1):
        mesh += [(first[0], first[i + 1], first[i]), (last[0], last[i], last[i + 1])]
    return [triangle for triangle in mesh if len(set(triangle)) == 3]


def thickened(outline: Sequence[Point], half: float) -> Mesh:
    """Make a plate from a convex outline, counter-clockwise seen from above, that extends `half` [m] up and down."""
    return lofted([[(x, y, z + side) for x, y, z in outline] for side in (-half, half)])


def slab(outline: Sequence[complex], aft: float, fore: float) -> Mesh:
    """Extrude a convex outline y + i z, counter-clockwise seen from ahead, from x = aft to x = fore."""
    return lofted([[(x, at.real, at.imag) for at in outline] for x in (aft, fore)])


def disc(centre: complex, radius: float) -> list[complex]:
    """Return the corners y + i z of a circle, counter-clockwise seen from ahead."""
    return [centre + radius * _unit(2.0 * math.pi * i / DISC_CORNERS) for i in range(DISC_CORNERS)]


def strut(start: complex, end: complex, half: float) -> list[complex]:
    """Return the corners y + i z of a straight bar of half width `half` between two points."""
    across = 1j * half * (end - start) / abs(end - start)
    return [start - across, end - across, end + across, start + across]


def convex_hull(points: Sequence[complex]) -> list[complex]:
    """Return the corners of the convex hull of points y + i z, counter-clockwise seen from ahead."""
    ordered = sorted(points, key=lambda point: (point.real, point.imag))
    hull: list[complex] = []
    for way in (ordered, ordered[::-1]):
        chain: list[complex] = []
        for point in way:
            while len(chain) > 1 and ((chain[-1] - chain[-2]).conjugate() * (point - chain[-1])).imag <= 1e-12:
                chain.pop()
            chain.append(point)
        hull += chain[:-1]
    return hull


def rod(start: Point, end: Point, radius: float, corners: int = 8) -> Mesh:
    """Return a round rod between two points."""
    axis = [b - a for a, b in zip(start, end, strict=True)]
    length = math.hypot(*axis)
    x, y, z = (component / length for component in axis)
    # Two unit vectors across the rod; the helper axis is the one least along it.
    helper = (0.0, 0.0, 1.0) if abs(z) < 0.9 else (1.0, 0.0, 0.0)
    u = (helper[1] * z - helper[2] * y, helper[2] * x - helper[0] * z, helper[0] * y - helper[1] * x)
    size = math.hypot(*u)
    u = (u[0] / size, u[1] / size, u[2] / size)
    w = (y * u[2] - z * u[1], z * u[0] - x * u[2], x * u[1] - y * u[0])
    around = [_unit(2.0 * math.pi * i / corners) * radius for i in range(corners)]

    def at(point: Point) -> list[Point]:
        px, py, pz = point
        return [
            (px + c.real * u[0] + c.imag * w[0], py + c.real * u[1] + c.imag * w[1], pz + c.real * u[2] + c.imag * w[2])
            for c in around
        ]

    return lofted([at(start), at(end)])


def elliptic_ring(centre_x: float, half_axes: tuple[float, float], tube: float) -> Mesh:
    """Return an elliptic ring in the x-y plane, of half axes along x and y and a radius of its tube [m]."""
    around, sides = 64, 8  # sections of the ring, corners of each

    def point(i: int, j: int) -> Point:
        turn, roll = 2.0 * math.pi * (i % around) / around, 2.0 * math.pi * (j % sides) / sides
        out = tube * math.cos(roll)
        x, y = (half_axes[0] + out) * math.cos(turn), (half_axes[1] + out) * math.sin(turn)
        return centre_x + x, y, tube * math.sin(roll)

    mesh: Mesh = []
    for i in range(around):
        for j in range(sides):
            mesh += _quad(point(i, j), point(i + 1, j), point(i + 1, j + 1), point(i, j + 1))
    return mesh


def _quad(a: Point, b: Point, c: Point, d: Point) -> Mesh:
    return [(a, b, c), (a, c, d)]


def _unit(angle: float) -> complex:
    return complex(math.cos(angle), math.sin(angle))
