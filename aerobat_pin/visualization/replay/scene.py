"""A meshcat scene that is kept, not shown: the commands that draw it, and the keyframes that move it.

No server, browser or file takes part; `page.replay_page` makes a page of the commands.
"""

from __future__ import annotations

from typing import Any

import meshcat
import meshcat.animation
import meshcat.geometry as shapes
import numpy as np
import pinocchio as pin
import umsgpack
from pinocchio.visualize import MeshcatVisualizer

from aerobat_pin.numerics import Array

SHAFT, HEAD, HEAD_LENGTH = 0.011, 0.032, 0.09  # radii of an arrow, length of its head, in sizes of the robot
HALO = 0.65  # opacity of an arrow that another one is to be seen through
FADED = 0.5  # of a sheet
SKY = ([0.97, 0.98, 0.99], [0.84, 0.87, 0.90])  # background, top and bottom


class Window:
    """A meshcat window without browser or server: it keeps the commands it is sent, in single precision."""

    def __init__(self) -> None:
        self.commands: list[bytes] = []

    def send(self, command: Any) -> None:
        """Keep one command."""
        self.commands.append(umsgpack.packb(command.lower(), force_float_precision="single"))


class Scene:
    """What there is to see, and how it moves at given times. Nodes below `world` are placed in world axes.

    Args:
        time: (m,) of the keyframes, from 0 and rising [s].
    """

    def __init__(self, time: Array) -> None:
        self.window = Window()
        self.viewer = meshcat.Visualizer(window=self.window)
        self._keys = time.tolist()
        self._animation = meshcat.animation.Animation(default_framerate=1)  # keys are seconds

    def move(self, node: str, **tracks: Array) -> None:
        """Animate `position` (m, 3), `quaternion` (m, 4, xyzw) or `scale` (m, 3) of a node."""
        clip = meshcat.animation.AnimationClip(fps=1)
        for name, rows in tracks.items():
            kind = "quaternion" if name == "quaternion" else "vector3"
            clip.tracks[name] = meshcat.animation.AnimationTrack(name, kind, self._keys, rows.tolist())
        self._animation.clips[self.viewer[node].path] = clip

    def commands(self, camera: Array) -> list[bytes]:
        """Return the commands, with the camera looking at the origin from a point (3,) [m]; the flight repeats."""
        for node in ("/Grid", "/Axes"):
            self.viewer[node].set_property("visible", False)
        for edge, colour in zip(("top_color", "bottom_color"), SKY, strict=True):
            self.viewer["/Background"].set_property(edge, colour)
        x, y, z = camera.tolist()  # the camera's own axes: x, up, -y
        self.viewer["/Cameras/default/rotated/<object>"].set_property("position", [x, z, -y])
        self.viewer.set_animation(self._animation, play=True, repetitions=10**6)
        return self.window.commands

    def robot(self, model: pin.Model, visual_model: pin.GeometryModel, placements: Array) -> None:
        """Draw a robot whose visible parts move.

        Args:
            model: of the robot.
            visual_model: its visible parts.
            placements: (m, parts, 7) position and quaternion (xyzw) of every part, world axes.
        """
        picture = MeshcatVisualizer(model, pin.GeometryModel(), visual_model)
        picture.initViewer(viewer=self.viewer)
        picture.loadViewerModel(rootNodeName="world/robot")
        for k, item in enumerate(visual_model.geometryObjects):
            node = picture.getViewerNodeName(item, pin.GeometryType.VISUAL)
            if not np.all(item.meshScale == 1.0):
                self.viewer[node].set_property("scale", item.meshScale.tolist())
            self.move(node, position=placements[:, k, :3], quaternion=placements[:, k, 3:])

    def arrow(self, node: str, colour: str, start: Array, tip: Array, size: float, *, inner: bool) -> None:
        """Animate an arrow from `start` to `tip`, each (m, 3) [m].

        Args:
            node: where it goes.
            colour: hexadecimal.
            start: of the arrow.
            tip: of the arrow.
            size: of the robot [m].
            inner: slim and solid, to be seen inside one that is not.
        """
        way = tip - start
        length = np.linalg.norm(way, axis=1)
        direction = np.where(length[:, None] > 0.0, way / np.maximum(length, 1e-12)[:, None], [0.0, 0.0, 1.0])
        turned = np.column_stack([direction[:, 2], 0.0 * length, -direction[:, 0], 1.0 + direction[:, 1]])  # from y
        turned[turned[:, 3] < 1e-9] = [1.0, 0.0, 0.0, 0.0]
        turned /= np.linalg.norm(turned, axis=1, keepdims=True)
        thin = 0.5 if inner else 1.0
        head = HEAD_LENGTH * size
        share = np.clip(length / (2.0 * head), 1e-6, 1.0)  # a short arrow is a small one
        rest = np.maximum(length - share * head, 1e-6)
        # Both count as translucent, for those the page puts in order: what is inner is drawn over its halo.
        paint = shapes.MeshLambertMaterial(color=number(colour), opacity=1.0 if inner else HALO, transparent=True)
        half = np.eye(4)
        for part, shape, middle in (
            ("shaft", shapes.Cylinder(1.0, thin * SHAFT * size), 0.5),
            ("head", shapes.Cylinder(head, radiusTop=0.0, radiusBottom=thin * HEAD * size), 0.5 * head),
        ):
            half[1, 3] = middle
            self.viewer[f"{node}/{part}/shape"].set_object(shape, paint)
            self.viewer[f"{node}/{part}/shape"].set_transform(half)
        self.move(f"{node}/shaft", position=start, quaternion=turned, scale=np.column_stack([share, rest, share]))
        self.move(
            f"{node}/head",
            position=start + rest[:, None] * direction,
            quaternion=turned,
            scale=np.column_stack([share] * 3),
        )

    def line(self, node: str, points: Array, colour: str) -> None:
        """Draw a line through points (k, 3) [m]."""
        paint = shapes.LineBasicMaterial(color=number(colour))
        self.viewer[node].set_object(shapes.Line(shapes.PointsGeometry(points.T), paint))

    def segments(self, node: str, ends: Array, colour: str) -> None:
        """Draw straight lines between ends (k, 2, 3) [m]."""
        paint = shapes.LineBasicMaterial(color=number(colour))
        self.viewer[node].set_object(shapes.LineSegments(shapes.PointsGeometry(ends.reshape(-1, 3).T), paint))

    def ball(self, node: str, place: Array, radius: float, colour: str) -> None:
        """Draw a ball at a point (3,) [m]."""
        there = np.eye(4)
        there[:3, 3] = place
        self.viewer[node].set_object(shapes.Sphere(radius), shapes.MeshLambertMaterial(color=number(colour)))
        self.viewer[node].set_transform(there)

    def sheet(self, node: str, points: Array, colours: Array) -> None:
        """Draw a translucent sheet through rows of points (k, n, 3) [m] with colours (k, n, 3), from 0 to 1.

        Its triangles are in the order of the rows, 2 (n - 1) between two of them: the page shows a stretch of them.
        """
        rows, across = points.shape[:2]
        corner = (np.arange(rows - 1)[:, None] * across + np.arange(across - 1)).reshape(-1, 1)
        faces = np.hstack([corner, corner + 1, corner + across, corner + 1, corner + across + 1, corner + across])
        shape = shapes.TriangularMeshGeometry(points.reshape(-1, 3), faces.reshape(-1, 3), colours.reshape(-1, 3))
        paint = shapes.MeshBasicMaterial(opacity=FADED, vertexColors=True)
        self.viewer[node].set_object(shape, paint)


def number(colour: str) -> int:
    """Return a hexadecimal colour as three.js counts it."""
    return int(colour[1:], 16)
