"""Two replays on one page: one clock, one camera and one scale for both."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from support.browser import needs_browser, opened

from aerobat_pin.robot import load_aerobat
from aerobat_pin.visualization.comparison import side_by_side
from aerobat_pin.visualization.replay.recording import Recording

READY = "window.panes && panes.every((pane) => !pane.viewer.animator.playing)"


def resting(duration: float, push: float) -> Recording:
    """Return a recording of a robot at rest with a force [N] on its left wing."""
    robot = load_aerobat()
    time = np.linspace(0.0, duration, 13)
    recording = Recording(robot.model, robot.visual_model, time, np.tile(robot.q0, (len(time), 1)), title="at rest")
    recording.add_forces("force", "#0072b2", {"left_force_point": np.tile([0.0, 0.0, push], (len(time), 1))})
    return recording


def test_arrows_have_the_coarser_scale_of_both() -> None:
    """So that a longer arrow is a larger force; titles begin with the labels."""
    weak, strong = resting(0.1, 0.01), resting(0.1, 1.0)
    coarse = strong.newtons_per_centimetre
    assert weak.newtons_per_centimetre < coarse
    page = side_by_side(weak, strong, ("weak", "strong <b>"), 0.1)
    assert weak.newtons_per_centimetre == strong.newtons_per_centimetre == coarse
    assert "strong &lt;b&gt;: at rest" in page or "strong &amp;lt;b&amp;gt;: at rest" in page
    assert "strong <b>" not in page


@needs_browser
def test_two_flights_share_clock_and_camera(tmp_path: Path, browser: Any) -> None:
    """Both are at the time that is asked for, the shorter one at its end after that, and turn together."""
    (tmp_path / "replay.html").write_text(side_by_side(resting(0.1, 0.1), resting(0.05, 0.1), ("one", "two"), 0.1))
    with opened(browser, (tmp_path / "replay.html").as_uri(), "about:srcdoc") as page:
        page.wait_for_function(READY, timeout=120_000)
        for asked, shown in ((0.02, [0.02, 0.02]), (0.08, [0.08, 0.05])):
            page.evaluate(f"seek({asked})")
            times = page.evaluate("panes.map((pane) => pane.viewer.animator.actions[0].time)")
            assert times == pytest.approx(shown, abs=1e-6)
        page.wait_for_function("document.getElementById('clock').textContent === '0.080 s'", timeout=60_000)
        page.evaluate("panes[0].viewer.camera.position.multiplyScalar(1.5)")
        same = "panes[0].viewer.camera.position.distanceTo(panes[1].viewer.camera.position) < 1e-9"
        page.wait_for_function(same, timeout=60_000)
        page.keyboard.press("ArrowLeft")
        page.wait_for_function("Number(document.getElementById('time').value) < 0.079", timeout=60_000)
