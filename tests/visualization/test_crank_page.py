"""`aerobat crank`: the page closes the linkage as Python does, by mouse, keys and touch; `open_robot` in meshcat."""

from dataclasses import replace
from pathlib import Path
from typing import Any
from urllib.error import URLError
from urllib.request import urlopen

import numpy as np
import pytest
from support.browser import PATIENCE, frames, needs_browser, opened, pixels
from support.commands import aerobat
from support.further import further

from aerobat_description.morphology import Morphology
from aerobat_description.position_closure import ClosureError, close_linkage
from aerobat_pin.aerobat import load_aerobat
from aerobat_pin.errors import ArgumentError
from aerobat_pin.visualization import crank_page, open_robot

BARS = {"L1": "J1 J2", "L2": "J2 J3 J4", "L3": "J5 J4 J6", "L4": "J3 J7", "L5": "J8 J7 J9", "L6": "J9 J10"}
BARS["L7"] = "J6 J10"
SET = """([crank, lengths]) => {
    for (const [key, length] of Object.entries(lengths)) element(key).value = element(key).dataset.exact = length;
    element("crank").step = "any";
    element("crank").value = crank;
    return show().open;
}"""
DRAWN = """(bars) => Object.fromEntries(["left", "right"].flatMap((side) => Object.entries(bars).flatMap(
    ([bar, pins]) => pins.split(" ").map((pin) => [`${side} ${bar} ${pin}`, drawn(side, bar, pin)]))))"""
WING = "(link) => node(link).position.toArray().concat(node(link).quaternion.toArray())"


@pytest.fixture(scope="module")
def page_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("crank")
    done = aerobat("crank", cwd=folder)
    assert (done.returncode, done.stderr) == (0, "")
    return folder / "crank.html"


@needs_browser
@pytest.mark.parametrize("lengths", [{"L3b": 7.2e-3, "L5b": 9.3e-3}, *further({}, {"L5a": 12.4e-3, "L5b": 10.8e-3})])
def test_pins_are_where_python_closes_the_linkage(lengths: dict[str, float], page_file: Path, browser: Any) -> None:
    """Both sides, each pin on each of its bars, at 9 crank angles, to 1e-6 m; wings as the closure turns them."""
    shape = Morphology.load("aerobat")
    bars = replace(shape.linkage, **lengths)
    with opened(browser, page_file.as_uri()) as page:
        for crank in np.linspace(-180.0, 180.0, 9):
            pose = close_linkage(bars, np.radians(crank))
            assert page.evaluate(SET, [crank, lengths]) is None
            for name, found in page.evaluate(DRAWN, BARS).items():
                side, _, pin = name.split()
                at, sign = pose.pins[pin], 1.0 if side == "left" else -1.0
                assert found == pytest.approx([shape.wing.offset_x, sign * at.real, at.imag], abs=1e-6), (name, crank)
            x, y, z, turn, _, _, cosine = page.evaluate(WING, "right_distal")
            assert (x, y, z) == pytest.approx((shape.wing.offset_x, -pose.pins["J6"].real, pose.pins["J6"].imag))
            assert 2.0 * np.arctan2(turn, cosine) == pytest.approx(-pose.angles["L7"], abs=1e-9)
            shown = float(page.inner_text("#theta_e td:last-child").removesuffix("°"))
            assert shown == pytest.approx(np.degrees(pose.theta_e), abs=0.006)


@needs_browser
def test_sliders_move_the_wings_by_mouse_and_keys(page_file: Path, browser: Any) -> None:
    """A click on the slider, arrow keys, a length, the button that turns, and the one that restores."""
    with opened(browser, page_file.as_uri()) as page:
        start = page.evaluate(WING, "left_proximal")
        slider = page.locator("#crank")
        box = slider.bounding_box()
        page.mouse.click(box["x"] + 0.75 * box["width"], box["y"] + 0.5 * box["height"])
        assert float(slider.input_value()) == pytest.approx(90.0, abs=5.0)
        clicked = page.evaluate(WING, "left_proximal")
        assert clicked != start
        before = float(slider.input_value())
        slider.press("ArrowRight")
        assert float(slider.input_value()) == before + 0.5
        assert page.evaluate(WING, "left_proximal") != clicked
        elbow = page.inner_text("#theta_e td:last-child")
        page.locator("#L5a").press("PageUp")
        assert page.inner_text("#L5a-said") == "11.68 mm (1.045)"
        assert page.inner_text("#theta_e td:last-child") != elbow
        page.get_by_role("button", name="as built").click()
        assert page.inner_text("#theta_e td:last-child") == elbow
        page.get_by_role("button", name="turn").click()
        page.wait_for_function(f"Number(element('crank').value) > {before + 2.0}")
        page.get_by_role("button", name="turn").click()
        page.get_by_role("button", name="linkage").click()
        assert page.locator("button[data-look=linkage][aria-pressed=true]").count() == 1


@needs_browser
def test_where_it_cannot_close_it_says_so(page_file: Path, browser: Any) -> None:
    """The pin and the lengths of Python's own message; the wings stay where they were."""
    shortest = 0.5 * Morphology.load("aerobat").linkage.L3b
    bars = replace(Morphology.load("aerobat").linkage, L3b=shortest)
    with pytest.raises(ClosureError) as said:
        [close_linkage(bars, np.radians(angle)) for angle in range(-90, 270)]
    stuck = float(np.degrees(said.value.crank_angle))
    with opened(browser, page_file.as_uri()) as page:
        before = page.evaluate(WING, "left_distal")
        page.locator("#L3b").press("Home")
        page.evaluate("judgeTurn()")
        open_dyad = page.evaluate(SET, [stuck, {"L3b": shortest}])
        assert open_dyad["pin"] == said.value.dyad
        assert f"cannot close at {said.value.dyad}: its bars of" in page.inner_text("#words")
        assert "cannot turn all the way" in page.inner_text("#words")
        assert page.inner_text("#theta_s td:last-child") == "\N{EN DASH}"
        assert page.inner_text("#L3b-reach") == ", beyond the robot's own 0.876 to 3"
        page.get_by_role("button", name="as built").click()
        page.evaluate(SET, [-90.0, {}])
        assert page.evaluate(WING, "left_distal") == pytest.approx(before)
        assert page.inner_text("#words") == "With these lengths the crank turns all the way."


@needs_browser
def test_it_can_be_used_on_a_telephone(page_file: Path, browser: Any) -> None:
    """390 pixels wide, by touch: nothing is cut off, and a tap on the slider moves the wings, which one sees."""
    context = browser.new_context(viewport={"width": 390, "height": 844}, has_touch=True, is_mobile=True)
    context.set_default_timeout(PATIENCE)
    requests: list[str] = []
    page = context.new_page()
    page.on("request", lambda request: requests.append(request.url))
    page.goto(page_file.as_uri())
    assert page.evaluate("document.documentElement.scrollWidth") == 390
    view, canvas = (page.locator(name).bounding_box() for name in ("#view", "#meshcat-pane canvas"))
    assert canvas["height"] == pytest.approx(view["height"], abs=2.0)
    assert view["height"] < 400.0
    for name in ("crank", "L3b", "L5a", "L5b"):
        assert page.locator(f"#{name}").bounding_box()["height"] >= 32.0
    before, box = page.evaluate(WING, "left_distal"), page.locator("#crank").bounding_box()
    page.touchscreen.tap(box["x"] + 0.6 * box["width"], box["y"] + 0.5 * box["height"])
    page.wait_for_function(f"(before) => ({WING})('left_distal').some((x, k) => x !== before[k])", arg=before)
    page.locator("#L5b").scroll_into_view_if_needed()
    assert page.locator("#view").bounding_box()["y"] == pytest.approx(0.0, abs=1.0)
    assert all(url.startswith(("file:", "data:")) for url in requests)
    context.close()


@pytest.mark.parametrize("name", ["aerobat_guard", "aerobat_light"])
def test_every_robot_has_its_page(name: str) -> None:
    page = crank_page(Morphology.load(name))
    assert f"{name}: turn the crank" in page
    assert len(page) < 1.3e6


ROBOT = "viewer.scene_tree.find(['meshcat', 'aerobat']).object"
PART = "viewer.scene_tree.find(['meshcat', 'aerobat', 'visuals', '{}']).object"


@needs_browser
@pytest.mark.parametrize("name", ["aerobat", *further("aerobat_guard")])
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
