"""Small closed triangle meshes of a morphology's parts, written as binary STL in metres.

A mesh is a list of triangles, a triangle three points, a point three floats; the corners turn counter-clockwise seen
from outside.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

from aerobat_description.morphology import Fin, Guard, Morphology, Surface

Point = tuple[float, float, float]
Triangle = tuple[Point, Point, Point]
Mesh = list[Triangle]

MEMBRANE_THICKNESS = 1.0e-3  # [m], for the eye only


@dataclass(frozen=True)
class Part:
    """A visible part: the link in whose frame it is drawn, the name of its material, and its mesh."""

    link: str
    material: str
    build: Callable[[], Mesh]

    @property
    def mesh(self) -> Mesh:
        """Its triangles, built when they are asked for."""
        return self.build()


def parts(morphology: Morphology) -> dict[str, Part]:
    """Return every visible part of a morphology by name: body, guard, tail, left and right wing panels."""
    wing = morphology.wing
    hull = morphology.hull
    half_axes = (hull.length / 2, hull.width / 2, hull.height / 2)
    made = {"body": Part("base_link", "carbon", partial(ellipsoid, half_axes))}
    if morphology.guard is not None:
        made["guard"] = Part("base_link", "guard", partial(ring, morphology.guard))
    if morphology.tail is not None:
        made["tail"] = Part("base_link", "tail", partial(plate, morphology.tail))
    if morphology.fin is not None:
        made["fin"] = Part("base_link", "tail", partial(blade, morphology.fin))
    # The proximal panel is drawn along the straight line from shoulder to elbow, so that the panels meet.
    _, along, up = morphology.elbow
    length = wing.proximal_stations[-1]
    panels = {
        "proximal": [(y / length * along, y / length * up) for y in wing.proximal_stations],
        "distal": [(y, 0.0) for y in wing.distal_stations],
    }
    for panel, stations in panels.items():
        edges = getattr(wing, f"{panel}_leading_edge"), getattr(wing, f"{panel}_trailing_edge")
        left = partial(membrane, stations, *edges)
        made[f"left_{panel}"] = Part(f"left_{panel}", "membrane", left)
        made[f"right_{panel}"] = Part(f"right_{panel}", "membrane", partial(_mirrored, left))
    return made


def _mirrored(build: Callable[[], Mesh]) -> Mesh:
    return mirrored(build())


def plate(surface: Surface) -> Mesh:
    """Return a thin rectangular plate for a horizontal surface, in body axes."""
    x, y, z = surface.position
    nose, rise = surface.chord / 2 * math.cos(surface.incidence), surface.chord / 2 * math.sin(surface.incidence)
    half = surface.span / 2
    top = [(x + nose, y - half, z + rise), (x + nose, y + half, z + rise)]
    top += [(x - nose, y + half, z - rise), (x - nose, y - half, z - rise)]
    return prism(top, [(0, 1, 2, 3)])


def blade(fin: Fin) -> Mesh:
    """Return a thin square plate for a vertical surface, in body axes."""
    x, y, z = fin.position
    half, thin = math.sqrt(fin.area) / 2, MEMBRANE_THICKNESS / 2
    corners = [(x + a * half, z + b * half) for a, b in ((1, -1), (1, 1), (-1, 1), (-1, -1))]
    left, right = ([(u, y + side * thin, w) for u, w in corners] for side in (1.0, -1.0))
    mesh = _quad(*reversed(left)) + _quad(*right)
    for i in range(4):
        j = (i + 1) % 4
        mesh += _quad(right[j], right[i], left[i], left[j])
    return mesh


def membrane(stations: Sequence[tuple[float, float]], leading: Sequence[float], trailing: Sequence[float]) -> Mesh:
    """Cut a thin plate from a planform: stations (y, z) with the x of the leading and the trailing edge [m]."""
    outline: list[Point] = [
        *((x, y, z) for x, (y, z) in zip(leading, stations, strict=True)),
        *((x, y, z) for x, (y, z) in reversed(list(zip(trailing, stations, strict=True)))),
    ]
    last = len(outline) - 1
    return prism(outline, [(i, i + 1, last - i - 1, last - i) for i in range(len(stations) - 1)])


def prism(outline: Sequence[Point], quads: Sequence[tuple[int, int, int, int]]) -> Mesh:
    """Thicken an outline, counter-clockwise seen from above and cut into quads, by the membrane thickness along z."""
    half = MEMBRANE_THICKNESS / 2
    top = [(x, y, z + half) for x, y, z in outline]
    bottom = [(x, y, z - half) for x, y, z in outline]
    mesh: Mesh = []
    for quad in quads:
        mesh += _quad(*(top[j] for j in quad))
        mesh += _quad(*(bottom[j] for j in reversed(quad)))
    for i in range(len(outline)):
        j = (i + 1) % len(outline)
        mesh += _quad(top[j], top[i], bottom[i], bottom[j])
    return [triangle for triangle in mesh if len(set(triangle)) == 3]


def ellipsoid(half_axes: Point, meridians: int = 24, parallels: int = 12) -> Mesh:
    """Return an ellipsoid about the origin with the given half axes [m]."""
    a, b, c = half_axes

    def point(i: int, j: int) -> Point:
        latitude, longitude = math.pi * i / parallels, 2 * math.pi * (j % meridians) / meridians
        r = 0.0 if i in (0, parallels) else math.sin(latitude)
        return a * math.cos(latitude), b * r * math.cos(longitude), c * r * math.sin(longitude)

    mesh: Mesh = []
    for i in range(parallels):
        for j in range(meridians):
            mesh += _quad(point(i, j), point(i + 1, j), point(i + 1, j + 1), point(i, j + 1))
    return [triangle for triangle in mesh if len(set(triangle)) == 3]


def ring(guard: Guard, around: int = 48, tube: int = 8) -> Mesh:
    """Return the guard: an elliptic ring in the body's x-y plane."""

    def point(i: int, j: int) -> Point:
        turn, roll = 2 * math.pi * (i % around) / around, 2 * math.pi * (j % tube) / tube
        out = guard.tube * math.cos(roll)
        x, y = (guard.radius[0] + out) * math.cos(turn), (guard.radius[1] + out) * math.sin(turn)
        return x, y, guard.tube * math.sin(roll)

    mesh: Mesh = []
    for i in range(around):
        for j in range(tube):
            mesh += _quad(point(i, j), point(i + 1, j), point(i + 1, j + 1), point(i, j + 1))
    return mesh


def mirrored(mesh: Mesh) -> Mesh:
    """Reflect a mesh in the x-z plane; the corners change order so that outside stays outside."""
    return [tuple((x, -y, z) for x, y, z in reversed(triangle)) for triangle in mesh]  # type: ignore[misc]


def binary_stl(mesh: Mesh) -> bytes:
    """Pack a mesh as binary STL (little-endian float32, metres)."""
    chunks = [b"Aerobat, metres".ljust(80, b" "), struct.pack("<I", len(mesh))]
    for triangle in mesh:
        normal = _normal(*triangle)
        chunks.append(struct.pack("<12fH", *normal, *triangle[0], *triangle[1], *triangle[2], 0))
    return b"".join(chunks)


def _quad(a: Point, b: Point, c: Point, d: Point) -> Mesh:
    return [(a, b, c), (a, c, d)]


def _normal(a: Point, b: Point, c: Point) -> Point:
    u = [b[k] - a[k] for k in range(3)]
    w = [c[k] - a[k] for k in range(3)]
    n = (u[1] * w[2] - u[2] * w[1], u[2] * w[0] - u[0] * w[2], u[0] * w[1] - u[1] * w[0])
    size = math.hypot(*n) or 1.0
    return n[0] / size, n[1] / size, n[2] / size
