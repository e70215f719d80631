"""Build the page on which one turns the crank by hand: the robot, its linkage, and sliders for angle and lengths.

The page is a single HTML file that needs no network. It closes the linkage itself, in JavaScript; tests compare it with
`aerobat_pin.linkage`.
"""

from __future__ import annotations

from dataclasses import asdict

import meshcat
import meshcat.geometry as shapes
import numpy as np

from aerobat_description.bars import BOSS_RADIUS, BOSS_THICKNESS, HALF_WIDTH, THICKNESS, Bar, layer, linkage_bars
from aerobat_description.meshes import parts
from aerobat_description.morphology import Morphology
from aerobat_description.position_closure import turn
from aerobat_description.write_urdf import MATERIALS, SIDES
from aerobat_pin.visualization import style
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
    bars, sliders = linkage_bars(morphology.linkage), []
    for key, what in WHAT.items():
        built = getattr(morphology.linkage, key)
        low, high = sorted(share * built for share in SLIDER)
        sliders.append({"key": key, "what": what, "value": built, "low": low, "high": high, "step": LENGTH_STEP})
    return fill_template(
        "crank.html",
        title=f"{morphology.name}: turn the crank",
        window=_window(morphology),
        sliders=sliders,
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
    )


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
            corners = np.array(part.mesh()).reshape(-1, 3)
            mesh = shapes.TriangularMeshGeometry(corners, np.arange(len(corners)).reshape(-1, 3))
            *colour, alpha = MATERIALS[part.material]
            number = int.from_bytes(bytes(round(255.0 * share) for share in colour))
            paint = shapes.MeshLambertMaterial(color=number, opacity=alpha, transparent=alpha < 1.0)
            viewer[f"world/robot/{part.link}/{name}"].set_object(mesh, paint)
    for side, sign in SIDES:
        for name, bar in bars.items():
            place, sideways = np.eye(4), np.eye(4)
            sideways[:3, :3] = [[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]  # a cylinder's axis from y to x
            place[0, 3] = sideways[0, 3] = sign * layer(name)
            paint = shapes.MeshLambertMaterial(color=rgb_number(style.BAR_COLOURS[name]))
            node = viewer[f"world/robot/{side}_{name}"]
            for k in range(len(bar.struts)):
                node[f"strut{k}"].set_object(shapes.Box([THICKNESS, 1.0, 2.0 * HALF_WIDTH]), paint)
                node[f"strut{k}"].set_transform(place)
            for pin in bar.pins:
                node[f"{pin}/boss"].set_object(shapes.Cylinder(BOSS_THICKNESS, BOSS_RADIUS), paint)
                node[f"{pin}/boss"].set_transform(sideways)
    return window.commands
