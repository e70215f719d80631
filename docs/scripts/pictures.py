"""Render the robot for docs/robot.md, off screen with MuJoCo: `make docs`, or `python docs/scripts/pictures.py`."""

import os
from dataclasses import dataclass
from pathlib import Path

os.environ.setdefault("MUJOCO_GL", "egl")

import mujoco
import numpy as np
import pinocchio as pin
from matplotlib.figure import Figure

from aerobat_description import MORPHOLOGIES
from aerobat_description.bars import layer, linkage_bars
from aerobat_pin.aerobat import Aerobat, load_aerobat, place_bars, visual_model_with_bars
from aerobat_pin.visualization import style

FIGURES = Path(__file__).resolve().parents[1] / "figures"
MID_DOWNSTROKE = np.radians(-37.0)  # crank angle: theta_s is -27 deg, between 29 and -84, and falling
FIELD_OF_VIEW = 45.0  # [deg], vertical
STUDIO = f"""<mujoco>
  <visual>
    <global offwidth="2400" offheight="1600" fovy="{FIELD_OF_VIEW}"/>
    <quality offsamples="8"/>
    <headlight ambient="0.35 0.35 0.35" diffuse="0.25 0.25 0.25" specular="0 0 0"/>
    <map znear="0.005" fogstart="100" fogend="200"/>
  </visual>
  <asset>
    <texture name="sky" type="skybox" builtin="flat" rgb1="1 1 1" rgb2="1 1 1" width="16" height="16"/>
  </asset>
  <worldbody>
    <light directional="true" dir="-0.6 -1 -1.6" diffuse="0.55 0.55 0.55" specular="0.1 0.1 0.1" castshadow="false"/>
    <light directional="true" dir="-0.8 1 -0.9" diffuse="0.25 0.25 0.25" specular="0.1 0.1 0.1" castshadow="false"/>
  </worldbody>
</mujoco>"""
LABELS = {  # offsets [pt]
    "L1": (-34, -10),
    "L2": (28, -8),
    "L3": (6, -20),
    "L4": (-40, 0),
    "L5": (0, 16),
    "L6": (18, 6),
    "L7": (-8, 16),
}


def scene(robot: Aerobat, faint: tuple[str, ...] = ()) -> mujoco.MjModel:
    """Return a still scene of a robot at the origin, half way down, bars in place; faint parts are nearly transparent."""
    spec = mujoco.MjSpec.from_string(STUDIO)
    closure = robot.linkage.solve(MID_DOWNSTROKE)
    q = robot.configuration([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0], closure.theta_s, closure.theta_e)
    picture = visual_model_with_bars(robot)
    place_bars(robot, picture, MID_DOWNSTROKE)
    data, placed = robot.model.createData(), picture.createData()
    pin.updateGeometryPlacements(robot.model, data, picture, placed, q)
    for item, placement in zip(picture.geometryObjects, placed.oMg, strict=True):
        shape = item.geometry
        mesh = spec.add_mesh(name=item.name, inertia=mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL)
        mesh.uservert = shape.vertices().ravel()
        mesh.userface = np.array([[t[0], t[1], t[2]] for t in map(shape.tri_indices, range(shape.num_tris))]).ravel()
        colour = [*item.meshColor[:3], 0.12 if item.name in faint else item.meshColor[3]]
        spec.worldbody.add_geom(
            type=mujoco.mjtGeom.mjGEOM_MESH,
            meshname=item.name,
            pos=placement.translation,
            quat=np.roll(pin.Quaternion(placement.rotation).coeffs(), 1),
            rgba=colour,
        )
    return spec.compile()


@dataclass(frozen=True)
class View:
    """Where the camera looks, from how far [m] and from where: azimuth 180 looks from ahead, angles in degrees."""

    look_at: tuple[float, float, float]
    distance: float
    azimuth: float
    elevation: float

    def image(self, model: mujoco.MjModel, width: int, height: int) -> np.ndarray:
        """Return the image (height, width, 3), from 0 to 1."""
        data = mujoco.MjData(model)
        mujoco.mj_forward(model, data)
        camera = mujoco.MjvCamera()
        camera.lookat, camera.distance = self.look_at, self.distance
        camera.azimuth, camera.elevation = self.azimuth, self.elevation
        with mujoco.Renderer(model, 2 * height, 2 * width) as renderer:
            renderer.update_scene(data, camera)
            image = renderer.render().astype(float)
        # Twice the pixels in each direction: what the driver does not smooth, this does.
        return np.clip(image.reshape(height, 2, width, 2, 3).mean(axis=(1, 3)) / 255.0, 0.0, 1.0)

    def project(self, point: np.ndarray, width: int, height: int) -> tuple[float, float]:
        """Return the pixel (right, down) of a point [m]."""
        azimuth, elevation = np.radians([self.azimuth, self.elevation])
        level = np.array([np.cos(azimuth), np.sin(azimuth), 0.0])
        forward = np.cos(elevation) * level + np.sin(elevation) * np.array([0.0, 0.0, 1.0])
        right = np.array([np.sin(azimuth), -np.cos(azimuth), 0.0])
        away = point - (np.array(self.look_at) - self.distance * forward)
        focal = 0.5 * height / np.tan(np.radians(0.5 * FIELD_OF_VIEW))
        scale = focal / float(away @ forward)
        return 0.5 * width + scale * float(away @ right), 0.5 * height - scale * float(away @ np.cross(right, forward))


def morphologies() -> Figure:
    """Draw the shipped robots at one scale, half way through the downstroke."""
    widths, height = (430, 680, 430), 320
    figure = Figure(figsize=(sum(widths) / 150.0, (height + 40) / 150.0), dpi=150, layout="constrained")
    for axis, name, width in zip(figure.subplots(1, 3, width_ratios=widths), MORPHOLOGIES, widths, strict=True):
        robot = load_aerobat(name)
        view = View((0.0, 0.0, -0.025), 0.445, 146.0, -34.0)
        axis.imshow(view.image(scene(robot), width, height))
        axis.set_title(f"{name}, {1e3 * robot.mass:.1f} g", fontsize=9)
        axis.axis("off")
    return figure


def linkage_in_the_robot() -> Figure:
    """Draw the left linkage from ahead, bars labelled; body and membranes are nearly transparent."""
    width, height = 1100, 640
    robot = load_aerobat("aerobat")
    view = View((0.012, 0.036, 0.008), 0.165, 163.0, -14.0)
    membranes = (f"{side}_{panel}_membrane" for side in ("left", "right") for panel in ("proximal", "distal"))
    figure = Figure(figsize=(width / 150.0, height / 150.0), dpi=150)
    axis = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    axis.imshow(view.image(scene(robot, ("body", "tail", *membranes)), width, height))
    axis.axis("off")
    closure = robot.linkage.solve(MID_DOWNSTROKE)
    for bar in linkage_bars(robot.morphology.linkage).values():
        ends = closure.pins[bar.origin], closure.pins[list(bar.pins)[-1]]
        outboard, up = np.mean(ends, axis=0)
        x = robot.morphology.wing.offset_x + layer(bar.name)
        at = view.project(np.array([x, outboard, up]), width, height)
        label = {"fontsize": 9, "ha": "center", "va": "center", "color": style.INK}
        arrow = {"arrowstyle": "-", "color": style.INK, "linewidth": 0.7}
        axis.annotate(bar.name, at, xytext=LABELS[bar.name], textcoords="offset points", arrowprops=arrow, **label)
    return figure


def main() -> None:
    """Rewrite the pictures."""
    for draw in (morphologies, linkage_in_the_robot):
        draw().savefig(FIGURES / f"{draw.__name__}.png", pil_kwargs={"optimize": True})


if __name__ == "__main__":
    main()
