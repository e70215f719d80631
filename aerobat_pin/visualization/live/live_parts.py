"""The visible parts of a robot as few triangles, which a browser without a graphics card draws many times a second."""

from __future__ import annotations

from typing import Any

import coal
import numpy as np
import pinocchio as pin
from scipy.spatial import ConvexHull

from aerobat_pin.numerics import Array

SIMPLE = 1200  # triangles up to which a mesh is drawn as it is; of others the hull is drawn
HULL_POINTS = 80  # of a hull, at most
CIRCLE = np.linspace(0.0, 2.0 * np.pi, 12, endpoint=False)


def live_parts(visual_model: pin.GeometryModel) -> list[dict[str, Any]]:
    """Return points [m], triangles and colour of each part in its own axes, as the page reads them."""
    parts = []
    for item in visual_model.geometryObjects:
        points, faces = _outward_triangles(item.geometry)
        red, green, blue, opacity = np.asarray(item.meshColor, float).tolist()
        parts.append(
            {
                "points": np.round(points, 5).ravel().tolist(),
                "faces": faces.ravel().tolist(),
                "colour": [round(255.0 * one) for one in (red, green, blue)],
                "opacity": opacity,
            }
        )
    return parts


def _outward_triangles(shape: Any) -> tuple[Array, Any]:
    """Return points (n, 3) and triangles (m, 3), outward, of a shape; none of a plane."""
    if hasattr(shape, "tri_indices"):
        points = np.asarray(shape.vertices(), float)
        if shape.num_tris <= SIMPLE:
            triangles = (shape.tri_indices(k) for k in range(shape.num_tris))
            return points, np.array([[one[0], one[1], one[2]] for one in triangles])
        return _hull(points[np.unique(np.argmax(_directions() @ points.T, axis=1))])
    if isinstance(shape, coal.Box):
        return _hull(np.array(np.meshgrid(*[[-1.0, 1.0]] * 3)).reshape(3, -1).T * shape.halfSide)
    if isinstance(shape, coal.Sphere | coal.Ellipsoid):
        radii = shape.radii if isinstance(shape, coal.Ellipsoid) else np.full(3, shape.radius)
        return _hull(_directions() * radii)
    if isinstance(shape, coal.Cylinder | coal.Capsule | coal.Cone):
        ring = shape.radius * np.column_stack([np.cos(CIRCLE), np.sin(CIRCLE), 0.0 * CIRCLE])
        top = ring * (0.01 if isinstance(shape, coal.Cone) else 1.0)
        up, cap = np.array([0.0, 0.0, shape.halfLength]), np.zeros((0, 3))
        if isinstance(shape, coal.Capsule):
            cap = np.array([[0.0, 0.0, sign * (shape.halfLength + shape.radius)] for sign in (-1.0, 1.0)])
        return _hull(np.concatenate([ring - up, top + up, cap]))
    return np.zeros((0, 3)), np.zeros((0, 3), int)


def _directions() -> Array:
    """Return directions (n, 3) spread over a sphere."""
    k = np.arange(HULL_POINTS) + 0.5
    height, angle = 1.0 - 2.0 * k / HULL_POINTS, np.pi * (1.0 + np.sqrt(5.0)) * k
    flat = np.sqrt(1.0 - height**2)
    return np.column_stack([flat * np.cos(angle), flat * np.sin(angle), height])


def _hull(points: Array) -> tuple[Array, Any]:
    hull = ConvexHull(points, qhull_options="QJ Pp")
    a, b, c = (points[hull.simplices[:, k]] for k in range(3))
    inward = np.sum(np.cross(b - a, c - a) * hull.equations[:, :3], axis=1) < 0.0
    return points, np.where(inward[:, None], hull.simplices[:, ::-1], hull.simplices)
