"""Report and replay on a desk and on a phone, by day and by night: nothing overlaps, buttons fit a finger."""

import itertools
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from support.browser import at, needs_browser, opened, pixels, ready, resized
from support.further import further

from aerobat_pin.experiments.experiment import Experiment, run
from aerobat_pin.scenario.scenario import load_scenario
from aerobat_pin.visualization.result_pages import report_html

SIZES = ((1440, 900), (844, 390), (390, 844))
FINGER = 44  # [px]
BOXES = """(names) => names.flatMap((name) => [...document.querySelectorAll(name)].map((one) => {
    const {left, top, right, bottom} = one.getBoundingClientRect();
    return [name + " " + (one.textContent || one.id).trim().slice(0, 30), left, top, right, bottom];
}))"""
TOUCHED = ("#controls button", "#time", "#clock", "#zones", "#legend")
BLOCKS = ("main > *",)


def boxes(page: Any, names: tuple[str, ...]) -> list[tuple[str, Any]]:
    """Return name and left, top, right, bottom [px] of elements that take room on the page."""
    found = [(name, np.array(box)) for name, *box in page.evaluate(BOXES, list(names))]
    return [(name, box) for name, box in found if box[2] > box[0] and box[3] > box[1]]


def overlaps(found: list[tuple[str, Any]]) -> list[tuple[str, str]]:
    """Return the pairs of boxes that share more than half a pixel."""
    return [
        (a, b)
        for (a, one), (b, other) in itertools.combinations(found, 2)
        if np.all(np.minimum(one[2:], other[2:]) - np.maximum(one[:2], other[:2]) > 0.5)
    ]


@needs_browser
@pytest.mark.parametrize("size", [SIZES[0], SIZES[2], *further((SIZES[1],))])
def test_the_replays_controls_cover_nothing(paper_folder: Path, browser: Any, size: tuple[int, int]) -> None:
    """Folded or not, all is on the screen; on a phone it begins folded, buttons fit a finger, panels do not cover."""
    with opened(browser, (paper_folder / "replay.html").as_uri(), size=size) as page:
        ready(page)
        page.evaluate("animator.pause()")
        small = min(size) < 500
        assert page.evaluate("document.getElementById('legend').open") == (not small)
        for _ in range(2):
            found = boxes(page, TOUCHED)
            assert len(found) == 7 + 4
            assert overlaps(found) == []
            for name, box in found:
                assert np.all(box[:2] >= 0.0), name
                assert np.all(box[2:] <= size), name
            page.locator("#legend summary").click()
        if small:
            for name, box in boxes(page, ("#controls button", "#legend summary")):
                assert np.all(box[2:] - box[:2] >= FINGER - 0.01), name
        assert page.locator(".dg:visible").count() == 0, "meshcat's own strip of controls"
        for width, height in () if small else (SIZES[2], SIZES[1]):
            resized(page, width, height)
            page.wait_for_function("(width) => viewer.camera.view.fullWidth === width", arg=width)
            assert overlaps(boxes(page, TOUCHED)) == []
            assert page.evaluate("seen()")


@needs_browser
def test_the_time_bar_follows_the_arrow_keys_and_the_replay_is_dark_by_night(page: Any) -> None:
    """Even right after the bar was used; one estimate is shown, keys are named; at night panels and sky are dark."""
    node = 'viewer.scene_tree.find(["meshcat", "world", "force", `estimated force (${name})`])'
    shown = f"(name) => {node}.object.visible"
    page.locator("#time").fill("1.25")
    page.locator("#time").focus()
    for _ in range(3):
        page.keyboard.press("ArrowRight")
    page.wait_for_function("Math.abs(document.getElementById('time').value - 1.275) < 1e-3")
    for name, other in (("momentum", "force_level"), ("force_level", "momentum")):
        page.locator("#observer").select_option(label=name)
        assert page.evaluate(shown, name)
        assert not page.evaluate(shown, other)
    before = page.evaluate("viewer.animator.actions[0].time")
    page.keyboard.press("ArrowLeft")
    assert page.evaluate("viewer.animator.actions[0].time") < before
    assert "space: play or pause; arrow keys" in page.inner_text("#legend")
    assert page.locator("#legend a").get_attribute("href") == "report.html"
    true = """(() => { let colour; viewer.scene_tree.find(["meshcat", "world", "force", "true force"]).object.traverse(
        (one) => { if (one.isMesh) colour = one.material.color.getHexString(); }); return colour; })()"""
    at(page, 0.5)
    light = {}
    for scheme in ("light", "dark", "light"):
        page.emulate_media(color_scheme=scheme)
        page.wait_for_function(f"(colour) => {true} === colour", arg="ffffff" if scheme == "dark" else "000000")
        at(page, 0.5)
        light[scheme] = float(np.median(pixels(page)[:100]))
    assert light["light"] > 0.9
    assert light["dark"] < 0.5


@needs_browser
def test_the_report_fits_every_screen(paper_folder: Path, browser: Any) -> None:
    """The page does not scroll sideways, wide tables do; blocks do not overlap; the replay is linked."""
    with opened(browser, (paper_folder / "report.html").as_uri()) as page:
        for scheme, size in itertools.product(("light", "dark"), SIZES):
            page.emulate_media(color_scheme=scheme)
            resized(page, *size)
            assert page.evaluate("document.documentElement.scrollWidth") <= size[0]
            found = boxes(page, BLOCKS)
            assert len(found) > 15
            assert overlaps(found) == []
            assert all(box[2] <= size[0] for _, box in found)
            [(_, verdict)], [(_, picture), *_] = boxes(page, (".verdict",)), boxes(page, ("figure",))
            assert verdict[3] < picture[1] < 0.75 * size[1] or size[1] < 500, "both are on the first screen"
        assert page.locator("table").count() == page.locator(".scroll > table").count()
        assert page.locator("nav a[href='replay.html']").count() == 1
        assert "one newton of force" in page.inner_text("main")


def test_what_was_changed_is_said_in_the_report() -> None:
    """The description of the shipped scenario stands apart; an R2 below 0 is explained, as in the terminal."""
    changed = run(load_scenario("paper", ["simulation.duration=0.3", "believed.air.density=1.47"]))
    page = report_html(changed, {})
    line = "changed from paper: simulation.duration = 0.3, believed.air.density = 1.47"
    assert line in page
    assert str(changed.scores).splitlines()[2] == line
    assert "The shipped scenario, without these changes: The paper" in page
    assert "R2 below 0 is worse than no estimate" in page
    assert "R2 below 0 is worse than no estimate" in str(changed.scores)


def test_what_is_shipped_is_described_as_it_is(paper: Experiment, paper_folder: Path) -> None:
    """No line about changes, no hint where there is nothing to hint at; each observer is explained."""
    page = (paper_folder / "report.html").read_text()
    assert "changed from" not in page + str(paper.scores)
    assert not any("below 0" in hint for hint in paper.scores.hints)
    assert paper.metrics["changed"] == {}
    for name in paper.estimates:
        assert f"<li><b>{name}</b>: " in page
