"""Draw the description's frames: a picture in which every kind of frame has its name, or an error."""

import io
import sys
from pathlib import Path

import matplotlib as mpl
import numpy as np
import pinocchio as pin
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from PIL import Image

from aerobat_description import PACKAGE_PATH
from aerobat_description.meshes import parts
from aerobat_pin.aerobat import Aerobat, load_aerobat
from aerobat_pin.visualization.style import AXIS_COLOURS, INK, MUTED, RC

PICTURE = Path(PACKAGE_PATH, "frames.png")
ARROW = 0.024  # [m]
LIGHT = np.array([0.36, 0.48, 0.80])

# Frame -> where its name stands, in points from the origin. A joint has the place and axes of the link it moves.
OBLIQUE = {
    "base_link": (2, -34),
    "left_proximal": (-6, 56),
    "left_distal": (10, 44),
    "left_force_point": (10, -40),
    "right_proximal": (-90, -22),
    "right_distal": (-62, 40),
    "right_force_point": (-40, -34),
}
FRONT = {
    "base_link": (-6, -38),
    "left_linkage_J1": (-66, -20),
    "left_linkage_J8": (-62, 22),
    "left_proximal": (2, 36),
    "left_distal": (-16, 48),
    "left_force_point": (-12, -36),
}
JOINT = {"proximal": "shoulder", "distal": "elbow"}


def camera(azimuth: float, elevation: float) -> np.ndarray:
    """Return the rotation to page axes: rows point right, up and out of the page; angles of the eye [deg]."""
    a, e = np.radians([azimuth, elevation])
    out = np.array([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)])
    right = np.array([-np.sin(a), np.cos(a), 0.0])
    return np.array([right, np.cross(out, right), out])


def draw_view(axes: Axes, robot: Aerobat, q: np.ndarray, view: np.ndarray, names: dict[str, tuple[int, int]]) -> None:
    """Draw the visible parts, far ones first, and the named frames as three arrows each."""
    model, data = robot.model, robot.model.createData()
    pin.framesForwardKinematics(model, data, q)
    meshes, painted = parts(robot.morphology), []
    for item in robot.visual_model.geometryObjects:
        place = data.oMi[item.parentJoint] * item.placement
        for triangle in np.array(meshes[item.name].mesh()) @ place.rotation.T + place.translation:
            normal = np.cross(triangle[1] - triangle[0], triangle[2] - triangle[0])
            shade = 0.55 + 0.45 * abs(normal @ LIGHT) / (np.linalg.norm(normal) + 1e-12)
            pale = 1.0 - 0.42 * (1.0 - np.array(item.meshColor[:3]))
            face, colour = triangle @ view.T, np.clip(pale * shade + (1.0 - shade) * 0.5, 0.0, 1.0)
            solid = item.meshColor[3] == 1.0  # what is translucent is painted first, so that nothing hides in it
            painted.append((solid, face[:, 2].mean(), face[:, :2], colour))
    painted.sort(key=lambda one: one[:2])
    _, _, faces, shades = zip(*painted, strict=True)
    axes.add_collection(PolyCollection(faces, facecolors=shades, edgecolors=shades, linewidths=0.3, zorder=1))
    for name, offset in names.items():
        place = data.oMf[model.getFrameId(name)]
        origin = view @ place.translation
        for axis, colour in zip(place.rotation.T, AXIS_COLOURS, strict=True):
            tip = view @ (place.translation + ARROW * axis)
            if np.linalg.norm((tip - origin)[:2]) < 0.1 * ARROW:  # along the line of sight: a dot
                axes.plot(*origin[:2], "o", color=colour, markersize=4.0, zorder=4)
                continue
            style = {"arrowstyle": "-|>", "color": colour, "linewidth": 1.6, "shrinkA": 0, "shrinkB": 0}
            axes.annotate("", tip[:2], origin[:2], arrowprops=style, zorder=3)
        side, _, link = name.partition("_")
        label = f"{name}\n({side}_{JOINT[link]})" if link in JOINT else name
        leader = {"arrowstyle": "-", "color": MUTED, "linewidth": 0.6, "shrinkA": 1, "shrinkB": 3}
        look = {"fontsize": 7.5, "color": INK, "arrowprops": leader, "zorder": 5, "linespacing": 1.1}
        axes.annotate(label, origin[:2], offset, textcoords="offset points", **look)
    axes.set_aspect("equal")
    axes.set_axis_off()


def figure() -> Figure:
    """Return the picture: the robot with bent wings, and its left half spread flat, seen from the front."""
    robot = load_aerobat()
    with mpl.rc_context(RC):
        page = Figure(figsize=(8.4, 7.2), layout="constrained", facecolor="white")
        bent, flat = page.subplots(2, 1, height_ratios=(2.1, 1.0))
        draw_view(bent, robot, robot.q0, camera(38.0, 30.0), OBLIQUE)
        bent.set_title("Crank straight down: x, y, z axes of each link's frame", loc="left")
        draw_view(flat, robot, pin.neutral(robot.model), camera(0.0, 0.0), FRONT)
        flat.set_title("Zero pose, left half, from the front: all frames are parallel", loc="left")
        flat.set_xlim(-0.06, 0.215)
        flat.set_ylim(-0.045, 0.06)
        bent.autoscale_view()
        for name, colour, place in zip("xyz", AXIS_COLOURS, (0.90, 0.93, 0.96), strict=True):
            page.text(place, 0.965, name, color=to_rgb(colour), fontsize=11, weight="bold")
    return page


def differences(picture: Figure) -> list[str]:
    """Return the frames of the robot that a picture does not name, and the names in it that no frame has."""
    labels = {text.get_text().split("\n")[0] for axes in picture.axes for text in axes.texts} - {""}
    model = load_aerobat().model
    frames = {frame.name for frame in model.frames if frame.name.startswith(("base_link", "left_", "right_"))}
    frames = {name for name in frames if "fixed" not in name and model.existBodyName(name)}
    unnamed = frames - labels - {"right_linkage_J1", "right_linkage_J8"}  # the left ones stand for these
    return [f"{name} is not named" for name in unnamed] + [f"{name} is no frame" for name in labels - frames]


def main() -> None:
    """Write the picture into the description with 128 colours and without a date: small, and the same every time."""
    picture, drawn = figure(), io.BytesIO()
    if wrong := differences(picture):
        sys.exit("\n".join(wrong))
    picture.savefig(drawn, dpi=140)
    Image.open(drawn).convert("RGB").quantize(128, dither=Image.Dither.NONE).save(PICTURE, optimize=True)


if __name__ == "__main__":
    main()
