"""Take the pictures of the robot in meshcat, MuJoCo and viser: docs/figures/tools/*.png.

MuJoCo draws without a window by EGL. viser stands in the environment of `make tools`; where that is missing, its picture
stays as it is.
"""

from __future__ import annotations

import os
import subprocess
from pathlib import Path

os.environ.setdefault("MUJOCO_GL", "egl")

import matplotlib.image
import mujoco
import numpy as np
from support.browser import started

import aerobat_description as description
from aerobat_pin import load_aerobat
from aerobat_pin.visualization import open_robot

SIZE = 960, 540
FIGURES = Path(__file__).parents[1] / "figures" / "tools"
VISER = Path(__file__).parents[2] / ".venv-tools" / "viser" / "bin" / "python"
SHOW = """
import aerobat_description as description, viser, yourdfpy
from viser.extras import ViserUrdf
server = viser.ViserServer(port=0, verbose=False)
server.gui.configure_theme(control_layout="collapsible", show_logo=False, show_share_button=False)
robot = ViserUrdf(server, yourdfpy.URDF.load(description.URDF_PATH))
robot.update_cfg(__import__("numpy").array([0.3, -0.6, 0.3, -0.6]))
@server.on_client_connect
def _(client):
    client.camera.position, client.camera.look_at = (0.24, -0.36, 0.2), (0.0, 0.0, -0.02)
print(server.get_port(), flush=True)
server.sleep_forever()
"""


def in_meshcat() -> None:
    """Open the robot as `open_robot` does."""
    view = open_robot(load_aerobat(), browser=False)
    with started() as browser:
        page = browser.new_page(viewport={"width": SIZE[0], "height": SIZE[1]})
        page.goto(view.url)
        page.add_style_tag(content=".dg { display: none !important; }")
        page.wait_for_timeout(3000)
        page.screenshot(path=FIGURES / "meshcat.png")
    view.close()


def in_mujoco() -> None:
    """Draw the MJCF half a second after its crank has started."""
    model = mujoco.MjModel.from_xml_path(description.MJCF_PATH)
    model.vis.global_.offwidth, model.vis.global_.offheight = SIZE
    model.opt.gravity[:] = 0.0
    data = mujoco.MjData(model)
    data.ctrl[0] = 2.0 * np.pi * 4.75
    while data.joint("left_crank").qpos[0] < np.pi:
        mujoco.mj_step(model, data)
    camera = mujoco.MjvCamera()
    camera.lookat[:], camera.distance, camera.azimuth, camera.elevation = data.body("base_link").xpos, 0.42, 215, -22
    with mujoco.Renderer(model, SIZE[1], SIZE[0]) as renderer:
        renderer.update_scene(data, camera)
        picture = renderer.render()
    matplotlib.image.imsave(FIGURES / "mujoco.png", picture)


def in_viser() -> None:
    """Open the page of viser's server in Chromium."""
    environment = {**os.environ, "PYTHONPATH": description.REPOSITORY_PATH}
    server = subprocess.Popen([VISER, "-c", SHOW], env=environment, stdout=subprocess.PIPE, text=True)
    try:
        assert server.stdout is not None
        port = next(line for line in server.stdout if line.strip().isdigit()).strip()  # after viser's own greeting
        with started() as browser:
            page = browser.new_page(viewport={"width": SIZE[0], "height": SIZE[1]})
            page.goto(f"http://127.0.0.1:{port}")
            page.wait_for_timeout(6000)
            page.add_style_tag(content="[class*=Notification] { display: none !important; }")
            page.screenshot(clip={"x": 130, "y": 150, "width": 420, "height": 260}, path=FIGURES / "viser.png")
    finally:
        server.kill()


if __name__ == "__main__":
    in_meshcat()
    in_mujoco()
    if VISER.exists():
        in_viser()
