"""What a person looks at: figures, report, and the replay in a real browser."""

from __future__ import annotations

import io
import re
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.image import imread

from aerobat_pin.evaluation import true_force
from aerobat_pin.experiment import Experiment, write
from aerobat_pin.figures import draw_all
from aerobat_pin.gallery import draw

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
FLAGS = ["--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
needs_browser = pytest.mark.skipif(
    CHROMIUM is None, reason="no Chromium on this machine: install it, e.g. `apt-get install chromium`"
)


@pytest.fixture(scope="module")
def folder(paper: Experiment, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the paper's experiment written with everything."""
    target = tmp_path_factory.mktemp("paper")
    write(paper, target)
    draw(paper, target)
    return target


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    """Start headless Chromium with software rendering."""
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        running = playwright.chromium.launch(executable_path=CHROMIUM, args=FLAGS)
        yield running
        running.close()


def test_the_papers_figures_are_drawn_as_png_and_pdf(folder: Path) -> None:
    """Five figures, none of them blank, the PDF a vector file."""
    names = {"position", "states", "stick_diagram", "estimation", "linkage"}
    assert {path.stem for path in (folder / "figures").iterdir()} == names
    for name in names:
        pixels = imread(folder / "figures" / f"{name}.png")
        assert pixels.shape[1] >= 1000
        assert pixels[..., :3].std() > 0.02
        assert (folder / "figures" / f"{name}.pdf").read_bytes().startswith(b"%PDF")


def test_the_figures_show_the_channels_they_name(paper: Experiment) -> None:
    """Lines hold the log's own numbers: joints, X Y Z, truth and estimates; the titles say what holds the robot."""
    drawn = draw_all(paper.robot, paper.log, paper.estimates, paper.metrics["note"])
    q = paper.log.measured["q"]
    shoulder, elbow = (line.get_ydata() for line in drawn["states"].axes[0].lines)
    np.testing.assert_allclose(np.radians(shoulder), q.sel(q_axis="left_shoulder"))
    np.testing.assert_allclose(np.radians(elbow), q.sel(q_axis="left_elbow"))
    for axis, name in zip(drawn["position"].axes, "xyz", strict=True):
        np.testing.assert_array_equal(axis.lines[0].get_ydata(), q.sel(q_axis=name))
    right_fz = drawn["estimation"].axes[5]
    truth = true_force(paper.log, "right_force_point")[0]
    np.testing.assert_array_equal(right_fz.lines[0].get_ydata(), truth[:, 2])
    np.testing.assert_array_equal(right_fz.lines[1].get_ydata(), paper.estimates["momentum"].force[:, 1, 2])
    for name in ("position", "states", "stick_diagram", "estimation"):
        assert "79 % thruster-borne" in drawn[name].get_suptitle()


def test_the_same_run_draws_the_same_figures(paper: Experiment, folder: Path, tmp_path: Path) -> None:
    """Byte for byte: no date, no random order (the replay's viewer numbers its objects at random)."""
    write(paper, tmp_path)
    draw(paper, tmp_path)
    for path in sorted(folder.rglob("*")):
        if path.suffix in (".png", ".pdf", ".json", ".toml"):
            assert path.read_bytes() == (tmp_path / path.relative_to(folder)).read_bytes(), path.name


def test_the_report_is_self_contained_and_holds_the_table(folder: Path) -> None:
    """No address to fetch, five embedded pictures, a row per observer, wing and axis."""
    page = (folder / "report.html").read_text()
    assert not re.search(r'(?:src|href)="(?!data:)', page)
    assert page.count("data:image/png;base64,") == 5
    assert page.count("mN</td>") == 12
    assert "79 % thruster-borne" in page


@needs_browser
def test_the_report_opens_without_a_request_or_an_error(folder: Path, browser: Any) -> None:
    """From disk, offline."""
    page = browser.new_page()
    problems: list[str] = []
    requests: list[str] = []
    page.on("pageerror", lambda error: problems.append(str(error)))
    page.on("request", lambda request: requests.append(request.url))
    page.goto((folder / "report.html").as_uri())
    assert page.locator("figure img").count() == 5
    assert page.evaluate("[...document.images].every((image) => image.naturalWidth > 500)")
    assert problems == []
    assert [url for url in requests if not url.startswith(("file:", "data:"))] == []
    page.close()


@needs_browser
def test_the_replay_plays_the_flight_with_moving_arrows(paper: Experiment, folder: Path, browser: Any) -> None:
    """From disk, offline: as long as the flight, robot and arrows in the scene, the arrows change, pause holds."""
    page = browser.new_page(viewport={"width": 1000, "height": 650})
    problems: list[str] = []
    requests: list[str] = []
    page.on("pageerror", lambda error: problems.append(str(error)))
    page.on("request", lambda request: requests.append(request.url))
    page.goto((folder / "replay.html").as_uri())
    page.wait_for_function("window.viewer && viewer.animator.time > 0.02", timeout=60_000)
    assert page.evaluate("viewer.animator.duration") == pytest.approx(2.0, abs=0.02)
    shaft = "viewer.scene_tree.find(['meshcat', 'force', 'estimated', 'left_force_point', 'shaft']).object"
    lengths = []
    for time in (0.1, 0.13, 0.18):
        page.evaluate(f"viewer.animator.pause(); viewer.animator.seek({time})")
        lengths.append(page.evaluate(f"{shaft}.scale.y"))
    assert max(lengths) - min(lengths) > 0.02
    # The head of the estimated arrow lies ahead of its tail along the force.
    where = "viewer.scene_tree.find(['meshcat', 'force', 'estimated', 'left_force_point', '{}'])"
    where += ".object.position.toArray()"
    ahead = np.subtract(*(page.evaluate(where.format(part)) for part in ("head", "shaft")))
    force = paper.estimates["momentum"].force[180, 0]
    assert float(ahead @ force) > 0.99 * float(np.linalg.norm(ahead) * np.linalg.norm(force))
    held = page.evaluate("viewer.animator.actions[0].time")
    page.wait_for_timeout(300)
    assert page.evaluate("viewer.animator.actions[0].time") == held
    assert float(re.findall(r"([0-9.]+) N per cm", page.inner_text("#legend"))[0]) > 0.0
    page.add_style_tag(content="#legend, .dg { display: none !important; }")
    pixels = imread(io.BytesIO(page.screenshot()))[..., :3]
    dark = pixels.sum(axis=2) < 1.2  # body, guard and arrows against a pale sky
    columns = np.flatnonzero(dark.any(axis=0))
    assert columns.size, "the robot is not in the picture"
    assert columns.max() - columns.min() > 0.1 * pixels.shape[1]
    assert problems == []
    assert [url for url in requests if not url.startswith(("file:", "data:"))] == []
    page.close()
