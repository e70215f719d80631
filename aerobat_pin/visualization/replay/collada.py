"""Collada meshes that the viewer cannot draw from their files, drawn as plain triangles in one colour.

meshcat's script merges all geometries of a file into one. That fails, and the page stays empty, if only some of them
have texture coordinates or colours at their corners; and a geometry of several materials loses some of its parts.
"""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from pathlib import Path

import numpy as np
import pinocchio as pin

POLYGONS = ("triangles", "polylist", "polygons")
PLAIN = (0.7, 0.7, 0.7, 1.0)  # colour of a file that names none: red, green, blue, opacity


def drawable(visual_model: pin.GeometryModel) -> pin.GeometryModel:
    """Return a copy of a robot's visible parts in which the viewer can draw every part."""
    copy = visual_model.copy()
    for part in copy.geometryObjects:
        if part.meshPath.lower().endswith(".dae") and hasattr(part.geometry, "tri_indices"):
            root = ElementTree.parse(Path(part.meshPath)).getroot()
            if not _can_be_merged(root):
                part.meshColor = part.meshColor if part.overrideMaterial else np.array(_most_used_colour(root))
                part.overrideMaterial = True
                part.meshPath, part.meshScale = "", np.ones(3)  # the triangles that Pinocchio loaded are scaled already
    return copy


def _can_be_merged(root: ElementTree.Element) -> bool:
    """Return whether all geometries of a file have one material each, and the same kinds of values at their corners."""
    kinds = set()
    for geometry in root.iterfind(".//{*}geometry"):
        pieces = [piece for name in POLYGONS for piece in geometry.iterfind(f".//{{*}}{name}")]
        if len({piece.get("material") for piece in pieces}) > 1:
            return False
        kinds |= {
            frozenset(source.get("semantic") for source in piece.iterfind("{*}input")) & {"TEXCOORD", "COLOR"}
            for piece in pieces
        }
    return len(kinds) <= 1


def _most_used_colour(root: ElementTree.Element) -> tuple[float, ...]:
    """Return the diffuse colour (4,) of the material with the most triangles."""
    effects = {effect.get("id"): effect for effect in root.iterfind(".//{*}effect")}
    counts: dict[str, int] = {}
    for name in POLYGONS:
        for piece in root.iterfind(f".//{{*}}{name}"):
            symbol = piece.get("material", "")
            counts[symbol] = counts.get(symbol, 0) + int(piece.get("count", "0"))
    targets = {bound.get("symbol"): bound.get("target", "") for bound in root.iterfind(".//{*}instance_material")}
    used = max(counts, key=lambda symbol: counts[symbol], default="")
    target = targets.get(used, f"#{used}").removeprefix("#")
    for material in root.iterfind(".//{*}material"):
        shown = material.find("{*}instance_effect")
        if material.get("id") == target and shown is not None:
            effect = effects.get(shown.get("url", "").removeprefix("#"))
            colour = None if effect is None else effect.findtext(".//{*}diffuse/{*}color")
            if colour and len(colour.split()) == 4:
                return tuple(float(value) for value in colour.split())
    return PLAIN
