"""Arrows as messages `foxglove_msgs/msg/SceneUpdate`, which Foxglove's 3D panel draws.

The fields are those of Foxglove's documentation (docs.foxglove.dev, schemas SceneUpdate, SceneEntity and its
primitives). An entity replaces the one before with the same `id`.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pinocchio as pin

from aerobat_pin.numerics import Array

PACKAGE = "foxglove_msgs/msg"
POSED = "geometry_msgs/Pose pose"
COLOUR_FIELD = "foxglove_msgs/Color color"
PRIMITIVES = {  # list in an entity -> type of its entries, and their fields
    "arrows": (
        "ArrowPrimitive",
        (POSED, *(f"float64 {part}" for part in ("shaft_length", "shaft_diameter", "head_length", "head_diameter"))),
    ),
    "cubes": ("CubePrimitive", (POSED, "geometry_msgs/Vector3 size")),
    "spheres": ("SpherePrimitive", (POSED, "geometry_msgs/Vector3 size")),
    "cylinders": (
        "CylinderPrimitive",
        (POSED, "geometry_msgs/Vector3 size", "float64 bottom_scale", "float64 top_scale"),
    ),
    "lines": (
        "LinePrimitive",
        ("uint8 type", POSED, "float64 thickness", "bool scale_invariant", "geometry_msgs/Point[] points"),
    ),
    "triangles": ("TriangleListPrimitive", (POSED, "geometry_msgs/Point[] points")),
    "texts": ("TextPrimitive", (POSED, "bool billboard", "float64 font_size", "bool scale_invariant")),
    "models": ("ModelPrimitive", (POSED, "geometry_msgs/Vector3 scale")),
}
AFTER_COLOUR = {
    "LinePrimitive": ("foxglove_msgs/Color[] colors", "uint32[] indices"),
    "TriangleListPrimitive": ("foxglove_msgs/Color[] colors", "uint32[] indices"),
    "TextPrimitive": ("string text",),
    "ModelPrimitive": ("bool override_color", "string url", "string media_type", "uint8[] data"),
}
DEFINITIONS = {
    "Color": tuple(f"float64 {part}" for part in "rgba"),
    "KeyValuePair": ("string key", "string value"),
    **{kind: (*fields, COLOUR_FIELD, *AFTER_COLOUR.get(kind, ())) for kind, fields in PRIMITIVES.values()},
    "SceneEntityDeletion": ("builtin_interfaces/Time timestamp", "uint8 type", "string id"),
    "SceneEntity": (
        "builtin_interfaces/Time timestamp",
        "string frame_id",
        "string id",
        "builtin_interfaces/Duration lifetime",
        "bool frame_locked",
        "foxglove_msgs/KeyValuePair[] metadata",
        *(f"foxglove_msgs/{kind}[] {name}" for name, (kind, _) in PRIMITIVES.items()),
    ),
    "SceneUpdate": ("foxglove_msgs/SceneEntityDeletion[] deletions", "foxglove_msgs/SceneEntity[] entities"),
}
HEAD_SHARE = 0.25  # of an arrow's length
SHAFT, HEAD_WIDTH = 0.01, 0.02  # diameters [m]
SHOWN_FOR = 100_000_000  # [ns]


def register_scene(store: Any) -> None:
    """Make the types of a scene known to a type store of rosbags."""
    from rosbags.typesys import get_types_from_msg

    for kind, fields in DEFINITIONS.items():
        store.register(get_types_from_msg("\n".join(fields), f"{PACKAGE}/{kind}"))


def scene_arrow(name: str, stamp: Mapping[str, int], start: Array, along: Array, colour: Mapping[str, float]) -> Any:
    """Return the fields of an entity with one arrow.

    Args:
        name: the entity's id.
        stamp: `sec` and `nanosec`.
        start: (3,) where the arrow begins, world axes [m].
        along: (3,) the arrow, world axes [m].
        colour: shares of `r`, `g`, `b` and `a`.
    """
    length = float(np.linalg.norm(along))
    turn = pin.Quaternion.FromTwoVectors(np.array([1.0, 0.0, 0.0]), along) if length else pin.Quaternion.Identity()
    arrow = {
        "pose": {
            "position": dict(zip("xyz", start.tolist(), strict=True)),
            "orientation": {axis: float(getattr(turn, axis)) for axis in "xyzw"},
        },
        "shaft_length": (1.0 - HEAD_SHARE) * length,
        "shaft_diameter": SHAFT,
        "head_length": HEAD_SHARE * length,
        "head_diameter": HEAD_WIDTH,
        "color": colour,
    }
    return {"timestamp": stamp, "frame_id": "world", "id": name, "lifetime": {"nanosec": SHOWN_FOR}, "arrows": [arrow]}
