"""Meshes of the body: two pods, the frame between them that carries the linkages, the guard and the thrusters.

From front to rear, the parts are:

    nose pod | linkage of the left wing | frame | linkage of the right wing | electronics pod | booms

A keel joins the pods below the cranks. The body is no wider than the shoulders, where the wings swing down.
"""

from __future__ import annotations

import math

from aerobat_description.bars import LAYER, STAGGER, layer
from aerobat_description.morphology import Morphology
from aerobat_description.morphology_tables import Guard, Hull, Thruster
from aerobat_description.solids import Mesh, Point, convex_hull, disc, elliptic_ring, lofted, rod, slab

# All numbers are [own] and affect only the looks of the robot [m].
PLATE = 0.9e-3  # half thickness of the frame
LUG = 2.4e-3  # radius of the frame around its pivots
PIVOT_RADIUS = 1.1e-3
BAY = STAGGER + 1.5 * LAYER + 3.0e-3  # half length of the bay between the pods
KEEL = 1.5e-3  # half height of the keel
ARM = 1.5e-3  # radius of the guard's arms
MOTOR, PROPELLER = (4.0e-3, 6.0e-3), (16.0e-3, 0.5e-3)  # radius and half height

Profile = tuple[tuple[float, float, float, float], ...]
# Sections of the pods: position along the pod from the bay, half width, half height, rise of the middle; the position
# is a fraction of the pod's length, the width and the other two are fractions of the hull's half width and half height.
NOSE = (
    (0.0, 0.62, 1.0, 0.0),
    (0.25, 0.64, 0.96, 0.0),
    (0.55, 0.54, 0.75, -0.1),
    (0.8, 0.36, 0.46, -0.2),
    (0.95, 0.16, 0.2, -0.28),
    (1.0, 0.04, 0.05, -0.3),
)
REAR = ((0.0, 1.0, 1.0, 0.0), (0.55, 1.0, 1.0, 0.0), (0.8, 0.8, 0.72, 0.12), (1.0, 0.3, 0.3, 0.3))


def body(morphology: Morphology) -> Mesh:
    """Return the mesh of both pods, the keel, and the booms to tail and fin, in body axes."""
    hull, bay = morphology.hull, morphology.wing.offset_x
    front, rear = ends(morphology)
    mesh = lofted(_pod(hull, NOSE, bay + BAY, front)) + lofted(_pod(hull, REAR, bay - BAY, rear)[::-1])
    low, inside = hull.drop - hull.height / 2 + KEEL, 0.3 * (bay - BAY - rear)
    keel = [complex(y, low + z) for y, z in ((-3e-3, -KEEL), (3e-3, -KEEL), (3e-3, KEEL), (-3e-3, KEEL))]
    mesh += slab(keel, bay - BAY - inside, bay + BAY + 0.25 * (front - bay - BAY))
    for surface in (morphology.tail, morphology.fin):
        if surface is not None:
            mesh += rod((rear + 5e-3, 0.0, _middle(hull)), surface.position, hull.boom)
    return mesh


def ends(morphology: Morphology) -> tuple[float, float]:
    """Return the x coordinates of nose and rear end [m].

    They are those of the hull, unless the wing is moved so far that a pod must be longer to reach the wing's bay.
    """
    bay, half = morphology.wing.offset_x, morphology.hull.length / 2
    return max(half, bay + BAY + 20e-3), min(-half, bay - BAY - 20e-3)


def frame(morphology: Morphology) -> Mesh:
    """Return the mesh of the plate between the two linkages, with the pivots J1, J5 and J8 of both, in body axes."""
    bars, bay, hull = morphology.linkage, morphology.wing.offset_x, morphology.hull
    pivots = {"L1": complex(*bars.P1), "L3": complex(*bars.P5), "L5": complex(*bars.P8)}
    corners = [complex(y, hull.drop - hull.height / 2) for y in (-3e-3, 3e-3)]
    mesh: Mesh = []
    for name, pivot in pivots.items():
        for sign, at in ((1.0, pivot), (-1.0, -pivot.conjugate())):
            corners += disc(at, LUG)
            aft, fore = sorted((bay, bay + sign * layer(name)))  # from the plate's middle to the middle of the bar
            mesh += slab(disc(at, PIVOT_RADIUS), aft, fore)
    return mesh + slab(convex_hull(corners), bay - PLATE, bay + PLATE)


def guard(morphology: Morphology, ring: Guard) -> Mesh:
    """Return the mesh of the guard, in body axes: ring, arms from nose and rear, and spokes to thrusters inside it."""
    hull = morphology.hull
    front, rear = ends(morphology)
    a, b = ring.radius
    mesh = elliptic_ring(ring.centre, ring.radius, ring.tube)
    nose, stern = (front - 10e-3, 0.0, hull.drop + NOSE[-1][3] * hull.height / 2), (rear + 5e-3, 0.0, _middle(hull))
    mesh += rod(nose, (ring.centre + a, 0.0, 0.0), ARM) + rod(stern, (ring.centre - a, 0.0, 0.0), ARM)
    for thruster in morphology.thrusters:
        x, y, _ = thruster.position
        level = 1.0 - ((x - ring.centre) / a) ** 2
        rim = math.copysign(b * math.sqrt(max(level, 0.0)), y)
        if abs(rim) - abs(y) > 2.0 * ring.tube:
            mesh += rod((x, rim, 0.0), (x, y, 0.0), ARM)
    return mesh


def motors(thrusters: tuple[Thruster, ...]) -> Mesh:
    """Return the mesh of the thrusters' motors, in body axes."""
    return [triangle for thruster in thrusters for triangle in _along(thruster, *MOTOR, 0.0, 10)]


def propellers(thrusters: tuple[Thruster, ...]) -> Mesh:
    """Return the mesh of the discs that the propellers sweep, ahead of their motors, in body axes."""
    return [triangle for thruster in thrusters for triangle in _along(thruster, *PROPELLER, MOTOR[1] + 1e-3, 24)]


def _along(thruster: Thruster, radius: float, half: float, ahead: float, corners: int) -> Mesh:
    def at(distance: float) -> Point:
        x, y, z = (p + distance * d for p, d in zip(thruster.position, thruster.direction, strict=True))
        return x, y, z

    return rod(at(ahead - half), at(ahead + half), radius, corners)


def _pod(hull: Hull, profile: Profile, start: float, end: float) -> list[list[Point]]:
    sections = []
    for along, wide, high, rise in profile:
        x, half = start + along * (end - start), hull.height / 2
        middle = hull.drop + rise * half
        sections.append([(x, wide * hull.width / 2 * y, middle + high * half * z) for y, z in _rounded_square()])
    return sections


def _rounded_square() -> list[tuple[float, float]]:
    """Return twenty corners (y, z) of a square of half width 1 with round corners, counter-clockwise seen from ahead.

    The curve is y^4 + z^4 = 1.
    """
    turns = [2.0 * math.pi * (i + 0.5) / 20 for i in range(20)]
    return [tuple(math.copysign(math.sqrt(abs(c)), c) for c in (math.cos(t), math.sin(t))) for t in turns]  # type: ignore[misc]


def _middle(hull: Hull) -> float:
    """Return the height at which the rear pod ends [m]."""
    return hull.drop + REAR[-1][3] * hull.height / 2
