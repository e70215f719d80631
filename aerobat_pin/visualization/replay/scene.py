"""Build a meshcat scene: the commands that draw it and the keyframes that move it, without a server or browser.

Collada meshes that the viewer cannot draw from their files are drawn as plain triangles in one colour: meshcat's script
merges all geometries of a file into one. That fails, and the page stays empty, if only some of them have texture
coordinates or colours at their corners; and a geometry of several materials loses some of its parts.
"""

from __future__ import annotations

import itertools
import xml.etree.ElementTree as ElementTree
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import meshcat
import meshcat.animation
import meshcat.geometry as shapes
import numpy as np
import pinocchio as pin
import umsgpack
from pinocchio.visualize import MeshcatVisualizer

from aerobat_pin.numerics import Array

# Length of the longest force arrow, radii of shaft and head, and length of the head, in sizes of the robot.
LONGEST_ARROW, SHAFT_RADIUS, HEAD_RADIUS, HEAD_LENGTH = 0.6, 0.011, 0.032, 0.09
HALO_OPACITY = 0.65  # opacity of an arrow that can have another arrow inside
SHEET_OPACITY = 0.5
UNBOUNDED = 1e3  # [m]: a larger shape is treated as infinite, such as a plane
SKY_COLOURS = ([0.97, 0.98, 0.99], [0.84, 0.87, 0.90])  # background, top and bottom
POLYGONS = ("triangles", "polylist", "polygons")
PLAIN = (0.7, 0.7, 0.7, 1.0)  # colour of a file that names none: red, green, blue, opacity


@dataclass(frozen=True)
class Sheet:
    """A translucent sheet that trails behind the robot, such as its wake.

    Each keyframe adds a row of points, which is then shown for a fixed time.

    Attributes:
        label: text in the legend.
        colour: colour of the mark in the legend, hexadecimal.
        points: (m, k, 3) points of each row where they would be without drift, world axes [m].
        colours: (m, k, 3) red, green and blue of each point, from 0 to 1.
        drift: (m, 3) displacement of the whole sheet at each keyframe, world axes [m].
        lasting: time for which a row is shown [s].
    """

    label: str
    colour: str
    points: Array
    colours: Array
    drift: Array
    lasting: float


class LegendLine(NamedTuple):
    """A line of the legend. The shape of its mark is `bar`, `line`, `grid`, or empty for no mark.

    With `choices`, pairs of a node below `world/force` and its name, the line lets people choose which one is shown.
    """

    shape: str
    colour: str
    text: str
    opacity: float = 1.0
    choices: Sequence[tuple[str, str]] = ()


class Zone(NamedTuple):
    """A stretch of time, from `start` to `end` [s], that is marked on the time bar with a label."""

    start: float
    end: float
    label: str
    colour: str


def packed(values: Any) -> bytes:
    """Return values as msgpack, in single precision."""
    return bytes(umsgpack.packb(values, force_float_precision="single"))


class Window:
    """A replacement for meshcat's window: it stores the commands sent to it."""

    def __init__(self) -> None:
        self.commands: list[bytes] = []

    def send(self, command: Any) -> None:
        """Store one command."""
        self.commands.append(packed(command.lower()))


class Scene:
    """The objects of a scene, and their animation by keyframes at times (m,) that increase from 0 [s].

    Nodes below `world` are placed in world axes.
    """

    def __init__(self, time: Array) -> None:
        self.window = Window()
        self.viewer = meshcat.Visualizer(window=self.window)
        self._keys = time.tolist()
        self._clips: dict[str, bytes] = {}  # packed node by node: as objects, numbers take ten times the memory

    def move(self, node: str, **tracks: Array) -> None:
        """Animate `position` (m, 3), `quaternion` (m, 4, xyzw) or `scale` (m, 3) of a node."""
        clip = meshcat.animation.AnimationClip(fps=1)  # so that keys are in seconds
        for name, rows in tracks.items():
            kind = "quaternion" if name == "quaternion" else "vector3"
            clip.tracks[name] = meshcat.animation.AnimationTrack(name, kind, self._keys, rows.tolist())
        path = self.viewer[node].path.lower()
        self._clips[path] = packed({"path": path, "clip": clip.lower()})

    def commands(self, camera: Array) -> list[bytes]:
        """Return all commands of the scene; its animation repeats. From `camera` (3,) [m] one looks at the origin."""
        clear_background(self.viewer)
        x, y, z = camera.tolist()  # meshcat expects the camera's position as (x, z, -y)
        self.viewer["/Cameras/default/rotated/<object>"].set_property("position", [x, z, -y])
        self.viewer.set_animation(meshcat.animation.Animation(), play=True, repetitions=10**6)
        count, commands = len(self._clips), self.window.commands
        before, after = commands.pop().split(packed("animations") + packed([]))
        head = before + packed("animations") + packed([None] * count)[:-count]  # an array's length, then its entries
        return [*commands, b"".join([head, *self._clips.values(), after])]

    def robot(self, model: pin.Model, visual_model: pin.GeometryModel, placements: Array) -> None:
        """Draw a robot whose visible parts move by placements (m, parts, 7): position, quaternion xyzw, world axes."""
        visual_model = drawable(visual_model)
        picture = MeshcatVisualizer(model, pin.GeometryModel(), visual_model)
        picture.initViewer(viewer=self.viewer)
        picture.loadViewerModel(rootNodeName="world/robot")
        for k, item in enumerate(visual_model.geometryObjects):
            node = picture.getViewerNodeName(item, pin.GeometryType.VISUAL)
            if not np.all(item.meshScale == 1.0):
                self.viewer[node].set_property("scale", item.meshScale.tolist())
            self.move(node, position=placements[:, k, :3], quaternion=placements[:, k, 3:])

    def arrow(
        self, node: str, colour: str, start: Array, force: Array, scale: float, size: float, *, inner: bool
    ) -> None:
        """Animate the arrow of a force (m, 3) [N] that begins at points (m, 3) [m].

        Its scale is in N/cm, its thickness follows the robot's `size` [m]. An `inner` arrow is slim and opaque, and
        remains visible inside a thick, translucent one.
        """
        arrow = force / (100.0 * scale)
        length = np.linalg.norm(arrow, axis=1)
        direction = np.where(length[:, None] > 0.0, arrow / np.maximum(length, 1e-12)[:, None], [0.0, 0.0, 1.0])
        rotation = np.column_stack([direction[:, 2], 0.0 * length, -direction[:, 0], 1.0 + direction[:, 1]])  # from y
        rotation[rotation[:, 3] < 1e-9] = [1.0, 0.0, 0.0, 0.0]
        rotation /= np.linalg.norm(rotation, axis=1, keepdims=True)
        thickness = 0.5 if inner else 1.0
        head = HEAD_LENGTH * size
        share = np.clip(length / (2.0 * head), 1e-6, 1.0)  # short arrows are scaled down as a whole
        shaft = np.maximum(length - share * head, 1e-6)
        # Both kinds count as translucent: the page then draws the inner arrow over its halo.
        opacity = 1.0 if inner else HALO_OPACITY
        paint = shapes.MeshLambertMaterial(color=rgb_number(colour), opacity=opacity, transparent=True)
        offset = np.eye(4)
        for part, shape, middle in (
            ("shaft", shapes.Cylinder(1.0, thickness * SHAFT_RADIUS * size), 0.5),
            ("head", shapes.Cylinder(head, radiusTop=0.0, radiusBottom=thickness * HEAD_RADIUS * size), 0.5 * head),
        ):
            offset[1, 3] = middle
            self.viewer[f"{node}/{part}/shape"].set_object(shape, paint)
            self.viewer[f"{node}/{part}/shape"].set_transform(offset)
        head_start = start + shaft[:, None] * direction
        self.move(f"{node}/shaft", position=start, quaternion=rotation, scale=np.column_stack([share, shaft, share]))
        self.move(f"{node}/head", position=head_start, quaternion=rotation, scale=np.column_stack([share] * 3))

    def segments(self, node: str, ends: Array, colour: str) -> None:
        """Draw straight lines between ends (k, 2, 3) [m]."""
        paint = shapes.LineBasicMaterial(color=rgb_number(colour))
        self.viewer[node].set_object(shapes.LineSegments(shapes.PointsGeometry(ends.reshape(-1, 3).T), paint))

    def ball(self, node: str, centre: Array, radius: float, colour: str) -> None:
        """Draw a ball about a point (3,) [m]."""
        transform = np.eye(4)
        transform[:3, 3] = centre
        self.viewer[node].set_object(shapes.Sphere(radius), shapes.MeshLambertMaterial(color=rgb_number(colour)))
        self.viewer[node].set_transform(transform)

    def sheet(self, node: str, points: Array, colours: Array) -> None:
        """Draw a translucent sheet through rows of points (k, n, 3) [m] with colours (k, n, 3), from 0 to 1.

        The 2 (n - 1) triangles between two rows follow each other, so that the page can show some of the rows alone.
        """
        rows, across = points.shape[:2]
        corner = (np.arange(rows - 1)[:, None] * across + np.arange(across - 1)).reshape(-1, 1)
        faces = np.hstack([corner, corner + 1, corner + across, corner + 1, corner + across + 1, corner + across])
        shape = shapes.TriangularMeshGeometry(points.reshape(-1, 3), faces.reshape(-1, 3), colours.reshape(-1, 3))
        paint = shapes.MeshBasicMaterial(opacity=SHEET_OPACITY, vertexColors=True)
        self.viewer[node].set_object(shape, paint)


def box_corners(part: pin.GeometryObject) -> Array:
    """Return the corners (8, 3) of a part's bounding box in the part's axes [m]; all zero for an infinite shape."""
    part.geometry.computeLocalAABB()
    box = part.geometry.aabb_local
    ends = np.array([box.min_, box.max_])  # of the triangles as Pinocchio loaded them, which are scaled already
    if not np.all(np.abs(ends) < UNBOUNDED):
        ends = np.zeros((2, 3))
    return np.array(list(itertools.product(*ends.T)))


def round_number_above(value: float) -> float:
    """Return the smallest number that is 1, 2 or 5 times a power of ten and not smaller than the value."""
    power = 10.0 ** np.floor(np.log10(value))
    return float(next(digit * power for digit in (1.0, 2.0, 5.0, 10.0) if digit * power >= value * (1.0 - 1e-9)))


def clear_background(viewer: meshcat.Visualizer) -> None:
    """Replace meshcat's grid and axes by a light sky."""
    for node in ("/Grid", "/Axes"):
        viewer[node].set_property("visible", False)
    for edge, colour in zip(("top_color", "bottom_color"), SKY_COLOURS, strict=True):
        viewer["/Background"].set_property(edge, colour)


def rgb_number(colour: str) -> int:
    """Convert a hexadecimal colour to a number, as three.js expects it."""
    return int(colour[1:], 16)


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
