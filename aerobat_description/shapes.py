"""Boxes that stand for the links in collision checks, and vectors as the text of an XML attribute."""

from __future__ import annotations

import math

from aerobat_description.meshes import ROOT_GAP, TIP_CUT
from aerobat_description.morphology import Morphology
from aerobat_description.morphology_tables import Vector, Vector3

BOX_THICKNESS = 2.0e-3  # [m] of the wings' boxes
HINGE_GAP = 3.0e-3  # [m] from the elbow axis to the boxes on both sides, which would touch when the wing folds

Box = tuple[Vector3, Vector3, float]


def hull_box(morphology: Morphology) -> tuple[Vector3, Vector3]:
    """Return centre and size [m] of the body's box, in body axes."""
    hull = morphology.hull
    return (0.0, 0.0, hull.drop), (hull.length, hull.width, hull.height)


def wing_boxes(morphology: Morphology) -> dict[str, Box]:
    """Return the boxes of the left wing's links: panel -> (centre [m], size [m], roll [rad] about x), link axes.

    The proximal box lies along the line from shoulder to elbow. The boxes leave out what the drawn membranes leave out,
    the root and the pointed tip, so that those of the shipped robots overlap at no crank angle.
    """
    wing, (_, along, up) = morphology.wing, morphology.elbow
    roll = math.atan2(up, along)
    made: dict[str, Box] = {}
    for panel, start, end, tilt in (
        ("proximal", ROOT_GAP, math.hypot(along, up) - HINGE_GAP, roll),
        ("distal", HINGE_GAP, (1.0 - TIP_CUT) * wing.distal_stations[-1], 0.0),
    ):
        front, back = max(getattr(wing, f"{panel}_leading_edge")), min(getattr(wing, f"{panel}_trailing_edge"))
        middle = 0.5 * (start + end)
        centre = (0.5 * (front + back), middle * math.cos(tilt), middle * math.sin(tilt))
        made[panel] = centre, (front - back, end - start, BOX_THICKNESS), tilt
    return made


def on_side(point: Vector, sign: float) -> Vector:
    """Return a point of the left wing (`sign` 1), or the same point of the right wing (`sign` -1)."""
    return point[0], sign * point[1], point[2]


def spaced(vector: Vector) -> str:
    """Return numbers with spaces between them, such that reading them gives exactly the same doubles."""
    return " ".join(repr(float(x) + 0.0) for x in vector)
