"""A flight as one HTML file: meshcat's viewer, the robot, true and estimated forces as arrows, a time slider.

The page needs no server and no network. The scene follows the robot: what is fixed to the ground moves backward.
"""

from __future__ import annotations

import base64
import json
from collections.abc import Mapping
from html import escape
from importlib import resources
from typing import Any

import meshcat
import meshcat.animation
import meshcat.geometry as shapes
import numpy as np
import pinocchio as pin
import umsgpack
from pinocchio.visualize import MeshcatVisualizer

from aerobat_pin import style
from aerobat_pin.arrays import Array
from aerobat_pin.evaluation import true_force
from aerobat_pin.flight_log import FlightLog
from aerobat_pin.observers import Estimate
from aerobat_pin.robot import Aerobat

FRAMES_PER_SECOND = 120  # of flight time: 25 a flap at 4.75 Hz
SLOW_MOTION = 0.1  # the page starts at this speed: a flap is too fast to be watched
METRES_PER_NEWTON = 0.6  # length of an arrow
CAMERA = (-0.42, 0.24, 0.38)  # three.js axes: x, up, -y of the world [m], seen from the robot
SHAFT, HEAD = 0.003, 0.009  # radii of an arrow [m]
TRUE_COLOUR, ESTIMATED_COLOUR = style.TRUTH, style.ESTIMATES[0]


class Recorder:
    """A meshcat window without a browser or server: it keeps the commands it is sent."""

    def __init__(self) -> None:
        self.commands: list[bytes] = []

    def send(self, command: Any) -> None:
        """Keep one command."""
        self.commands.append(umsgpack.packb(command.lower()))


def replay_html(robot: Aerobat, log: FlightLog, estimates: Mapping[str, Estimate], note: str) -> str:
    """Return the page.

    Args:
        robot: the robot that flew.
        log: its flight.
        estimates: by observer; the first one's forces are drawn.
        note: a line about the flight, shown on the page.
    """
    recorder = Recorder()
    viewer = meshcat.Visualizer(window=recorder)
    picture = MeshcatVisualizer(robot.model, robot.collision_model, robot.visual_model)
    picture.initViewer(viewer=viewer)
    picture.loadViewerModel(rootNodeName="robot")
    chosen = np.unique(np.round(np.arange(0.0, log.time[-1], 1.0 / FRAMES_PER_SECOND) / np.median(np.diff(log.time))))
    index = chosen.astype(int)[chosen < len(log.time) - 1]
    time = log.time[index]
    q = log.measured["q"].values[index]
    _ground(viewer, log.measured["q"].values[:, :3])
    tracks = _Tracks(viewer, time)
    tracks.add("ground", position=-q[:, :3] * np.array([1.0, 1.0, 0.0]))
    centred = q.copy()
    centred[:, :2] = 0.0
    data, visual_data = robot.model.createData(), robot.visual_model.createData()
    placed: list[list[pin.SE3]] = []
    points: list[list[Array]] = []
    estimate = next(iter(estimates.values()))
    frames = [robot.model.getFrameId(name) for name in estimate.frames]
    for one in centred:
        pin.forwardKinematics(robot.model, data, one)
        pin.updateFramePlacements(robot.model, data)
        pin.updateGeometryPlacements(robot.model, data, robot.visual_model, visual_data)
        placed.append([pin.SE3(placement) for placement in visual_data.oMg])
        points.append([data.oMf[frame].translation.copy() for frame in frames])
    for k, item in enumerate(robot.visual_model.geometryObjects):
        node = picture.getViewerNodeName(item, pin.GeometryType.VISUAL)
        tracks.add(
            node,
            position=np.array([row[k].translation for row in placed]),
            quaternion=np.array([pin.Quaternion(row[k].rotation).coeffs() for row in placed]),
        )
    for k, frame in enumerate(estimate.frames):
        start = np.array([row[k] for row in points])
        if log.truth is not None:
            _arrow(viewer, tracks, f"force/true/{frame}", TRUE_COLOUR, start, true_force(log, frame)[0][index])
        _arrow(viewer, tracks, f"force/estimated/{frame}", ESTIMATED_COLOUR, start, estimate.force[index, k], slim=True)
    tracks.send()
    viewer["/Grid"].set_property("visible", False)
    viewer["/Axes"].set_property("visible", False)
    viewer["/Background"].set_property("top_color", [0.93, 0.95, 0.97])
    viewer["/Background"].set_property("bottom_color", [0.80, 0.84, 0.88])
    viewer["/Cameras/default/rotated/<object>"].set_property("position", list(CAMERA))
    title = f"{log.measured.attrs.get('scenario', 'flight')}: {note}"
    return _page(recorder.commands, title, estimate.observer)


class _Tracks:
    """Keyframes of several nodes, handed to the viewer as one animation."""

    def __init__(self, viewer: meshcat.Visualizer, time: Array) -> None:
        self.viewer = viewer
        self.keys = [float(t) * FRAMES_PER_SECOND for t in time]
        self.animation = meshcat.animation.Animation(default_framerate=FRAMES_PER_SECOND)

    def add(self, node: str, **values: Array) -> None:
        """Animate `position` (n, 3), `quaternion` (n, 4, xyzw) or `scale` (n, 3) of a node."""
        clip = meshcat.animation.AnimationClip(fps=FRAMES_PER_SECOND)
        for name, rows in values.items():
            kind = "quaternion" if name == "quaternion" else "vector3"
            listed = [[float(x) for x in row] for row in rows]
            clip.tracks[name] = meshcat.animation.AnimationTrack(name, kind, self.keys, listed)
        self.animation.clips[self.viewer[node].path] = clip

    def send(self) -> None:
        """Hand the animation over; it repeats until it is paused."""
        self.viewer.set_animation(self.animation, play=True, repetitions=1000)


def _ground(viewer: meshcat.Visualizer, path: Array) -> None:
    """Draw stripes on the ground every half metre and the path of the body."""
    low, high = float(path[:, 0].min()) - 1.0, float(path[:, 0].max()) + 1.0
    floor = float(path[:, 2].min()) - 0.35
    across = [[[x, -1.0, floor], [x, 1.0, floor]] for x in np.arange(np.floor(low), high, 0.5)]
    along = [[[low, y, floor], [high, y, floor]] for y in np.arange(-1.0, 1.01, 0.5)]
    lines = np.array([point for line in across + along for point in line]).T
    pale = shapes.LineBasicMaterial(color=0xA9B2BC)
    viewer["ground/stripes"].set_object(shapes.LineSegments(shapes.PointsGeometry(lines), pale))
    trail = shapes.LineBasicMaterial(color=int(style.LEFT[1:], 16))
    viewer["ground/path"].set_object(shapes.Line(shapes.PointsGeometry(path[::5].T), trail))


def _arrow(
    viewer: meshcat.Visualizer, tracks: _Tracks, node: str, colour: str, start: Array, force: Array, slim: bool = False
) -> None:
    """Animate an arrow from `start` (n, 3) [m] along `force` (n, 3) [N], world axes."""
    size = np.linalg.norm(force, axis=1)
    length = np.maximum(METRES_PER_NEWTON * size, 1e-4)
    direction = np.where(size[:, None] > 1e-9, force / np.maximum(size, 1e-9)[:, None], [0.0, 0.0, 1.0])
    turned = np.array([pin.Quaternion.FromTwoVectors(np.array([0.0, 1.0, 0.0]), one).coeffs() for one in direction])
    thin = 0.6 if slim else 1.0
    paint = shapes.MeshLambertMaterial(color=int(colour[1:], 16), transparent=not slim, opacity=1.0 if slim else 0.35)
    shift = np.eye(4)
    shift[1, 3] = 0.5
    viewer[f"{node}/shaft/rod"].set_object(shapes.Cylinder(1.0, SHAFT * thin), paint)
    viewer[f"{node}/shaft/rod"].set_transform(shift)
    cone = shapes.Cylinder(2.0 * HEAD * thin, radiusTop=0.0, radiusBottom=HEAD * thin)
    viewer[f"{node}/head/cone"].set_object(cone, paint)
    stretch = np.column_stack([np.ones_like(length), length, np.ones_like(length)])
    tracks.add(f"{node}/shaft", position=start, quaternion=turned, scale=stretch)
    tracks.add(f"{node}/head", position=start + length[:, None] * direction, quaternion=turned)


def _page(commands: list[bytes], title: str, observer: str) -> str:
    script = (resources.files("meshcat") / "viewer" / "dist" / "main.min.js").read_text(encoding="utf-8")
    packed = json.dumps([base64.b64encode(command).decode("ascii") for command in commands])
    return f"""<!DOCTYPE html>
<html lang="en">
<head><meta charset="utf-8"><title>Aerobat: {escape(title)}</title>
<style>
body {{ margin: 0; font: 14px/1.5 system-ui, sans-serif; }}
#meshcat-pane {{ width: 100vw; height: 100vh; overflow: hidden; }}
#legend {{ position: fixed; left: 1rem; bottom: 1rem; background: rgba(255, 255, 255, .85); padding: .6rem .9rem;
  border-radius: .4rem; }}
#legend b {{ display: inline-block; width: 1.2rem; height: .5rem; margin-right: .5rem; }}
</style></head>
<body><div id="meshcat-pane"></div>
<div id="legend">{escape(title)}<br>
<b style="background:{TRUE_COLOUR};opacity:.35"></b>true force<br>
<b style="background:{ESTIMATED_COLOUR}"></b>estimated force ({escape(observer)})<br>
arrows: {1.0 / METRES_PER_NEWTON / 100.0:.3f} N per cm; stripes every 0.5 m; speed {SLOW_MOTION:g} (timeScale)</div>
<script>{script}</script>
<script>
const viewer = new MeshCat.Viewer(document.getElementById("meshcat-pane"));
for (const command of {packed}) {{
  viewer.handle_command_bytearray(Uint8Array.from(atob(command), (c) => c.charCodeAt(0)));
}}
viewer.animator.mixer.timeScale = {SLOW_MOTION};
window.viewer = viewer;
</script></body></html>
"""
