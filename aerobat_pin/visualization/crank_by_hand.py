"""Build the page on which one turns the crank by hand: the robot, its linkage, and sliders for angle and lengths.

The page is a single HTML file that needs no network. It closes the linkage itself, in JavaScript; tests compare it with
`aerobat_pin.linkage`.
"""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

import meshcat
import meshcat.geometry as shapes
import numpy as np

from aerobat_description.bars import BOSS_RADIUS, BOSS_THICKNESS, HALF_WIDTH, THICKNESS, Bar, layer, linkage_bars
from aerobat_description.meshes import parts
from aerobat_description.morphology import Morphology
from aerobat_description.position_closure import turn
from aerobat_description.solids import Mesh
from aerobat_description.write_urdf import MATERIALS, SIDES
from aerobat_pin.visualization import style
from aerobat_pin.visualization.replay.page import viewer_script
from aerobat_pin.visualization.replay.scene import Window, clear_background, rgb_number
from aerobat_pin.visualization.template import base64_text, fill_template

# Lengths that the robot's morphing control changes, and how far: shares of the length as built. Aerobat_MuJoCo,
# symbolic_functions_faster/parameter.py. Within them the crank turns; the sliders go further, to where it gets stuck.
MORPHING = {"L3b": (0.876, 3.0), "L5a": (0.876, 1.648), "L5b": (0.876, 1.166)}
WHAT = {"L3b": "rocker arm of the humerus L3", "L5a": "inner arm of L5, along", "L5b": "inner arm of L5, across"}
SLIDER = (0.5, 3.0)
LENGTH_STEP = 1e-5  # [m] of a slider
STRAIGHT_DEG = 15.0  # a transmission angle this close to 0 or 180 deg is pointed out, as `NearSingularWarning` does
# Where the camera stands from what it looks at, body axes [m]; for the robot the page moves it back until all is seen.
VIEWPOINTS = {"robot": (0.105, -0.165, 0.083), "linkage": (0.165, 0.05, 0.05)}
PLANE_MARGIN = 9.0  # [mm] around all that the pins reach in a turn


def crank_page(morphology: Morphology) -> str:
    """Return the page of a robot as HTML."""
    bars = linkage_bars(morphology.linkage)
    return fill_template(
        "crank.html",
        title=f"{morphology.name}: turn the crank",
        window=_window(morphology),
        sliders=[_slider(morphology, key) for key in MORPHING],
        scene={
            "commands": [base64_text(command) for command in _commands(morphology, bars)],
            "lengths": asdict(morphology.linkage),
            "offset": morphology.wing.offset_x,
            "bars": {name: _struts(bar) for name, bar in bars.items()},
            "links": {"proximal": "L3", "distal": "L7"},
            "cameras": VIEWPOINTS,
            "morphing": MORPHING,
            "colours": style.BAR_COLOURS,
            "straight": STRAIGHT_DEG,
        },
        meshcat=viewer_script(),
    )


def _slider(morphology: Morphology, key: str) -> dict[str, Any]:
    """Return name, meaning, value and range [m] of the slider for an adjustable length."""
    built = getattr(morphology.linkage, key)
    low, high = sorted(share * built for share in SLIDER)
    return {"key": key, "what": WHAT[key], "value": built, "low": low, "high": high, "step": LENGTH_STEP}


def _window(morphology: Morphology) -> str:
    """Return the part of the linkage's plane that the page shows: left, top, width and height [mm], y downward."""
    pins = np.array([1e3 * at for pose in turn(morphology.linkage) for at in pose.pins.values()])
    left, right = pins.real.min() - PLANE_MARGIN, pins.real.max() + PLANE_MARGIN
    top, bottom = -pins.imag.max() - PLANE_MARGIN, -pins.imag.min() + PLANE_MARGIN
    return f"{left:.1f} {top:.1f} {right - left:.1f} {bottom - top:.1f}"


def _struts(bar: Bar) -> list[tuple[str, str]]:
    """Return the ends of a bar's struts: pins, or `tip` for the end of the forearm."""
    names = {at: pin for pin, at in bar.pins.items()}
    return [(names.get(start, "tip"), names.get(end, "tip")) for start, end in bar.struts]


def _commands(morphology: Morphology, bars: dict[str, Bar]) -> list[bytes]:
    """Return the meshcat commands that draw all parts, each below the node of its link or bar.

    The struts of the bars are boxes of unit length, which the page stretches between their pins.
    """
    window = Window()
    viewer = meshcat.Visualizer(window=window)
    clear_background(viewer)
    for name, part in parts(morphology).items():
        if not name.endswith(("_L3", "_L7")):
            viewer[f"world/robot/{part.link}/{name}"].set_object(_triangles(part.mesh), _paint(part.material))
    sideways = np.eye(4)
    sideways[:3, :3] = [[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]  # a cylinder's axis from y to x
    for side, sign in SIDES:
        for name, bar in bars.items():
            paint = shapes.MeshLambertMaterial(color=rgb_number(style.BAR_COLOURS[name]))
            node = viewer[f"world/robot/{side}_{name}"]
            for k in range(len(bar.struts)):
                place = np.eye(4)
                place[0, 3] = sign * layer(name)
                node[f"strut{k}"].set_object(shapes.Box([THICKNESS, 1.0, 2.0 * HALF_WIDTH]), paint)
                node[f"strut{k}"].set_transform(place)
            for pin in bar.pins:
                place = sideways.copy()
                place[0, 3] = sign * layer(name)
                node[f"{pin}/boss"].set_object(shapes.Cylinder(BOSS_THICKNESS, BOSS_RADIUS), paint)
                node[f"{pin}/boss"].set_transform(place)
    return window.commands


def _triangles(mesh: Mesh) -> shapes.TriangularMeshGeometry:
    corners = np.array(mesh).reshape(-1, 3)
    return shapes.TriangularMeshGeometry(corners, np.arange(len(corners)).reshape(-1, 3))


def _paint(material: str) -> shapes.MeshLambertMaterial:
    red, green, blue, alpha = MATERIALS[material]
    colour = int("".join(f"{round(255 * part):02x}" for part in (red, green, blue)), 16)
    return shapes.MeshLambertMaterial(color=colour, opacity=alpha, transparent=alpha < 1.0)
