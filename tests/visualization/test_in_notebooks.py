"""Robots and flights show themselves in a notebook, without a network."""

import html
from pathlib import Path
from typing import Any

from support.browser import at, needs_browser, node, opened, ready

from aerobat_pin import load_aerobat, load_robot
from aerobat_pin.experiments import Experiment


def frame(shown: Any) -> str:
    """Return the page in the frame that a notebook would show."""
    text = shown._repr_html_()
    return html.unescape(text.partition('srcdoc="')[2].partition('"')[0])


@needs_browser
def test_a_robot_moves_in_its_frame(browser: Any, tmp_path: Path) -> None:
    """Aerobat flaps, and a robot by name swings its joints; errors and requests of the page would fail."""
    for name, shown in {"left_L1": load_aerobat(), "upper_arm_link_0": load_robot("ur5")}.items():
        page_file = tmp_path / f"{name}.html"
        page_file.write_text(frame(shown))
        with opened(browser, page_file.as_uri()) as page:
            ready(page)
            places = []
            for time in (0.5, 1.0):
                at(page, time)
                places.append(node(page, "robot", "visuals", name)["quaternion"])
            assert places[0] != places[1]


def test_a_flight_shows_its_scores_and_its_replay(paper: Experiment) -> None:
    text = paper._repr_html_()
    assert text.index("<table") < text.index("<iframe")
    assert "79 % thruster-borne" in frame(paper)
