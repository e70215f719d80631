"""`open_robot`: meshcat shows the robot large and whole, and Python turns the crank in it."""

from __future__ import annotations

from typing import Any
from urllib.error import URLError
from urllib.request import urlopen

import numpy as np
import pytest
from support.browser import frames, needs_browser, opened, pixels

from aerobat_pin.errors import ArgumentError
from aerobat_pin.robot.aerobat import load_aerobat
from aerobat_pin.visualization.replay.open_robot import open_robot

ROBOT = "viewer.scene_tree.find(['meshcat', 'aerobat']).object"
PART = "viewer.scene_tree.find(['meshcat', 'aerobat', 'visuals', '{}']).object"


@needs_browser
@pytest.mark.parametrize("name", ["aerobat", "aerobat_guard"])
def test_the_camera_frames_the_robot_and_the_crank_turns_it(name: str, browser: Any) -> None:
    """At least a third of the width of a page of 1000 pixels, nothing cut off; parts move to the closure's places."""
    robot = load_aerobat(name)
    view = open_robot(robot, browser=False)
    with opened(browser, view.url, "http://127.0.0.1", "ws://127.0.0.1", "blob:") as page:
        page.wait_for_function("typeof viewer !== 'undefined'")
        for part in robot.visual_model.geometryObjects:
            page.wait_for_function(f"{PART.format(part.name)}.children.length")
        page.wait_for_function("viewer.camera.position.length() < 1.5")  # sent last; meshcat's own is 3.2 m away
        pictures = []
        for visible in ("true", "false"):
            page.evaluate(f"{ROBOT}.visible = {visible}; viewer.set_dirty()")
            frames(page)
            pictures.append(pixels(page))
        drawn = np.abs(pictures[0] - pictures[1]).max(axis=2) > 0.05
        columns, rows = (np.flatnonzero(drawn.any(axis=axis)) for axis in (0, 1))
        assert np.ptp(columns) > 330
        assert columns[0] > 0
        assert columns[-1] < drawn.shape[1] - 1
        assert rows[0] > 0
        assert rows[-1] < drawn.shape[0] - 1
        view.turn(0.7)
        place = [robot.morphology.wing.offset_x, *robot.linkage.solve(0.7).pins["J9"]]
        page.wait_for_function(
            f"(place) => place.every((x, k) => Math.abs({PART.format('left_L6')}.matrix.elements[12 + k] - x) < 1e-6)",
            arg=place,
        )
    view.close()
    with pytest.raises(URLError):
        urlopen(view.url)


def test_what_is_no_robot_is_refused() -> None:
    """Before a server starts."""
    with pytest.raises(ArgumentError, match="robot"):
        open_robot("aerobat")  # type: ignore[arg-type]
