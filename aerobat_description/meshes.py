"""Build the visible parts of a morphology as small closed triangle meshes, and write them as STL or OBJ, in metres."""

from __future__ import annotations

import itertools
import math
import struct
from collections.abc import Callable, Sequence
from functools import partial
from typing import NamedTuple

from aerobat_description.bars import LINK_OF, linkage_bars
from aerobat_description.fuselage import body, frame, guard, motors, propellers
from aerobat_description.morphology import Morphology
from aerobat_description.morphology_tables import Fin, Surface, WingShape
from aerobat_description.solids import Mesh, Point, lofted, mirrored, slab, thickened

MEMBRANE_THICKNESS = 0.6e-3  # [m]; affects only the looks
ROOT_GAP = 5.0e-3  # [m] from the shoulder axis to the panels, which begin outside the lugs of the shoulders
# Share of the distal panel that is not drawn. It is the pointed tip, 0.4 % of the area; under the body it would cross
# the tip of the other wing.
TIP_CUT = 0.07
TAIL_SWEEP = 0.25  # share of the tail's chord that is cut off its front corners, where the wings' trailing edges pass


class Part(NamedTuple):
    """A visible part."""

    link: str  # name of the link in whose frame it is drawn
    material: str
    mesh: Callable[[], Mesh]


def parts(morphology: Morphology) -> dict[str, Part]:
    """Return all visible parts of the URDF: name -> part.

    These are body, frame, guard, motors, propellers, tail and fin, as far as the robot has them, and the panels and
    bones (L3, L7) of both wings.
    """
    visible = {
        "body": Part("base_link", "carbon", partial(body, morphology)),
        "frame": Part("base_link", "frame", partial(frame, morphology)),
    }
    if morphology.guard is not None:
        visible["guard"] = Part("base_link", "guard", partial(guard, morphology, morphology.guard))
    if morphology.thrusters:
        visible["motors"] = Part("base_link", "carbon", partial(motors, morphology.thrusters))
        visible["propellers"] = Part("base_link", "propeller", partial(propellers, morphology.thrusters))
    if morphology.tail is not None:
        visible["tail"] = Part("base_link", "tail", partial(plate, morphology.tail))
    if morphology.fin is not None:
        visible["fin"] = Part("base_link", "tail", partial(blade, morphology.fin))
    bars = linkage_bars(morphology.linkage)
    for panel, stations in panels(morphology).items():
        left = partial(membrane, stations)
        # Not named like their links: viser would take them for each other and move neither.
        visible[f"left_{panel}_membrane"] = Part(f"left_{panel}", "membrane", left)
        visible[f"right_{panel}_membrane"] = Part(f"right_{panel}", "membrane", partial(_mirrored, left))
    for bar, link in LINK_OF.items():
        for side in ("left", "right"):
            visible[f"{side}_{bar}"] = Part(f"{side}_{link}", "bone", partial(bars[bar].mesh, side))
    return visible


def panels(morphology: Morphology) -> dict[str, list[tuple[Point, Point]]]:
    """Return the outlines of the left wing's panels as they are drawn.

    The proximal panel lies along the straight line from shoulder to elbow, so that the panels meet.

    Returns:
        Panel -> (leading edge point, trailing edge point) of each station, in the frame of the panel's link [m].
    """
    wing = morphology.wing
    _, along, up = morphology.elbow
    length = wing.proximal_stations[-1]
    inner = _cut(wing, "proximal", ROOT_GAP * length / math.hypot(along, up), length)
    outer = _cut(wing, "distal", 0.0, (1.0 - TIP_CUT) * wing.distal_stations[-1])
    return {
        "proximal": [tuple((x, y / length * along, y / length * up) for x in xs) for y, *xs in inner],  # type: ignore[misc]
        "distal": [((fore, y, 0.0), (aft, y, 0.0)) for y, fore, aft in outer],
    }


def plate(surface: Surface) -> Mesh:
    """Return the mesh of a horizontal surface: a thin plate with swept front corners, in body axes."""
    x, y, z = surface.position
    run, rise = math.cos(surface.incidence), math.sin(surface.incidence)
    front, half = surface.chord / 2, surface.span / 2
    swept = front - TAIL_SWEEP * surface.chord
    outline = ((swept, -half), (front, -half / 3), (front, half / 3), (swept, half), (-front, half), (-front, -half))
    # Seen from above, x is forward and y to the left: the outline is counter-clockwise if y increases along the front.
    corners = [(x + u * run, y + v, z + u * rise) for u, v in outline]
    return thickened(corners, MEMBRANE_THICKNESS / 2)


def blade(fin: Fin) -> Mesh:
    """Return the mesh of a vertical surface: a thin square plate of the fin's area, in body axes."""
    x, y, z = fin.position
    half, thin = math.sqrt(fin.area) / 2, MEMBRANE_THICKNESS / 2
    return slab(
        [complex(y + a * thin, z + b * half) for a, b in ((-1, -1), (1, -1), (1, 1), (-1, 1))], x - half, x + half
    )


def membrane(stations: Sequence[tuple[Point, Point]]) -> Mesh:
    """Return a thin closed plate from the leading and trailing edge points of each station."""
    half = MEMBRANE_THICKNESS / 2
    rim = ((0, half), (0, -half), (1, -half), (1, half))
    return lofted([[(*station[i][:2], station[i][2] + rise) for i, rise in rim] for station in stations])


def binary_stl(mesh: Mesh) -> bytes:
    """Pack a mesh as binary STL (little-endian float32, metres)."""
    chunks = [b"Aerobat, metres".ljust(80, b" "), struct.pack("<I", len(mesh))]
    for triangle in mesh:
        normal = _normal(*triangle)
        chunks.append(struct.pack("<12fH", *normal, *triangle[0], *triangle[1], *triangle[2], 0))
    return b"".join(chunks)


def obj_text(mesh: Mesh) -> str:
    """Write a mesh as Wavefront OBJ text in metres; Drake reads no other meshes from MJCF."""
    numbers: dict[Point, int] = {}
    for point in itertools.chain(*mesh):
        numbers.setdefault(point, len(numbers) + 1)
    lines = [f"v {x + 0.0:.6g} {y + 0.0:.6g} {z + 0.0:.6g}" for x, y, z in numbers]
    lines += ["f " + " ".join(str(numbers[point]) for point in triangle) for triangle in mesh]
    return "\n".join(lines) + "\n"


def _cut(wing: WingShape, panel: str, start: float, end: float) -> list[tuple[float, float, float]]:
    """Return rows of (station, leading edge, trailing edge) of a panel, cut to the stations from `start` to `end`."""
    edges = list(zip(*wing.outline(panel), strict=True))

    def at(y: float) -> tuple[float, float, float]:
        (y0, *low), (y1, *high) = next(pair for pair in itertools.pairwise(edges) if y <= pair[1][0])
        share = (y - y0) / (y1 - y0)
        fore, aft = (a + share * (b - a) for a, b in zip(low, high, strict=True))
        return y, fore, aft

    return [at(start), *(edge for edge in edges if start < edge[0] < end), at(end)]


def _mirrored(build: Callable[[], Mesh]) -> Mesh:
    return mirrored(build())


def _normal(a: Point, b: Point, c: Point) -> Point:
    u = [b[k] - a[k] for k in range(3)]
    w = [c[k] - a[k] for k in range(3)]
    n = (u[1] * w[2] - u[2] * w[1], u[2] * w[0] - u[0] * w[2], u[0] * w[1] - u[1] * w[0])
    size = math.hypot(*n) or 1.0
    return n[0] / size, n[1] / size, n[2] / size
