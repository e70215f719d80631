"""The linkage to look at: the page that closes it as Python does, `open_robot` in meshcat, and the sheet."""

import itertools
from dataclasses import replace
from pathlib import Path
from typing import Any
from urllib.error import URLError
from urllib.request import urlopen

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.image import imread
from matplotlib.text import Annotation
from support.browser import PATIENCE, frames, needs_browser, opened, pixels
from support.commands import aerobat, call
from support.further import further

from aerobat_description.morphology import Morphology
from aerobat_description.position_closure import ClosureError, close_linkage
from aerobat_pin.aerobat import load_aerobat
from aerobat_pin.errors import ArgumentError
from aerobat_pin.linkage import KineticSculpture
from aerobat_pin.visualization import crank_page, open_robot, style
from aerobat_pin.visualization.figures import linkage as linkage_sheet

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


LINKAGE = KineticSculpture()


def test_every_pin_bar_and_joint_angle_is_named_and_no_name_lies_on_another() -> None:
    """L1..L7, J1..J10, theta_s and theta_e, as in the paper's Fig. 2; boxes of names do not overlap."""
    figure = linkage_sheet.draw_linkage(LINKAGE)
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    mechanism = figure.axes[0]
    names = [text for axis in (mechanism, *mechanism.child_axes) for text in axis.texts if isinstance(text, Annotation)]
    shown = [text.get_text() for text in names]
    wanted = [f"L{i}" for i in range(1, 8)] + [f"J{i}" for i in range(1, 11)] + [r"$\theta_s$", r"$\theta_e$"]
    assert sorted(shown) == sorted(wanted)
    boxes = [text.get_window_extent(canvas.get_renderer()) for text in names]
    for (one, a), (other, b) in itertools.combinations(zip(shown, boxes, strict=True), 2):
        assert not a.overlaps(b), f"{one} lies on {other}"
    for name, box in zip(shown, boxes, strict=True):
        assert mechanism.bbox.contains(box.x0, box.y0), name
        assert mechanism.bbox.contains(box.x1, box.y1), name


def test_the_pose_is_the_linkages_own_over_faint_ones_of_a_whole_turn() -> None:
    """Pins where the closure has them; twelve faint poses; both joint angles over the crank angle beside it."""
    figure = linkage_sheet.draw_linkage(LINKAGE)
    mechanism, curves = figure.axes[:2]
    shown = LINKAGE.solve(np.radians(linkage_sheet.SHOWN_DEG))
    marks = {tuple(np.round(line.get_xydata()[0], 9)) for line in mechanism.lines if line.get_marker() in "so"}
    assert {tuple(np.round(1e3 * pin, 9)) for pin in shown.pins.values()} <= marks
    faint = [line for line in mechanism.lines if line.get_color() == style.FAINT]
    assert len(faint) == 12
    for line, crank in zip(faint, range(-90, 270, 30), strict=True):
        assert line.get_xydata()[1] == pytest.approx(1e3 * LINKAGE.solve(np.radians(crank)).pins["J6"])
    shoulder, elbow = curves.lines[:2]
    turn = LINKAGE.solve(np.radians(shoulder.get_xdata()))
    assert np.radians(shoulder.get_ydata()) == pytest.approx(turn.theta_s)
    assert np.radians(elbow.get_ydata()) == pytest.approx(turn.theta_e)


def in_the_middle(point: tuple[float, float], line: np.ndarray) -> bool:
    """Say whether a point [mm] is the middle of a stretch of a line (n, 2) [mm]."""
    return bool(np.min(np.linalg.norm(0.5 * (line[1:] + line[:-1]) - point, axis=1), initial=np.inf) < 1e-6)


def test_a_bars_name_stands_on_the_bar_of_its_lengths() -> None:
    """On a linkage whose bars all differ: each side, as the morphology's lengths say, has its name at its middle."""
    bars = replace(LINKAGE.lengths, L4=36.5e-3, L6=35.5e-3)
    bend = complex(bars.L3a + bars.L3c * np.sin(bars.alpha3), bars.L3c * np.cos(bars.alpha3))
    rocker = np.exp(-1j * bars.alpha3) * complex(-bars.L3b, bars.L3c)
    corners = {
        "L1": (0j, bars.L1),
        "L2": (0j, complex(bars.L2b, bars.L2c), bars.L2a),
        "L3": (rocker, 0j, bend),
        "L4": (0j, bars.L4),
        "L5": (complex(-bars.L5a, bars.L5b), 0j, complex(bars.L5c, bars.L5d)),
        "L6": (0j, bars.L6),
        "L7": (0j, complex(bars.L7b, bars.L7c)),
    }
    mechanism = linkage_sheet.draw_linkage(KineticSculpture(bars)).axes[0]
    labels = {text.get_text(): text for axis in (mechanism, *mechanism.child_axes) for text in axis.texts}
    for name, points in corners.items():
        sides = sorted(1e3 * abs(a - b) for a, b in itertools.combinations(points, 2))
        (drawn,) = (line for line in mechanism.lines if in_the_middle(labels[name].xy, line.get_xydata()))
        ends = np.unique(np.round(drawn.get_xydata(), 9), axis=0)
        assert sorted(np.linalg.norm(a - b) for a, b in itertools.combinations(ends, 2)) == pytest.approx(sides), name


@pytest.mark.parametrize(("kind", "begin"), [("svg", b"<?xml"), ("png", b"\x89PNG"), ("pdf", b"%PDF")])
def test_the_same_linkage_gives_the_same_files(kind: str, begin: bytes) -> None:
    first, second = (style.render_figure(linkage_sheet.draw_linkage(LINKAGE), kind) for _ in range(2))
    assert first == second
    assert first.startswith(begin)


def test_the_table_holds_the_known_ranges() -> None:
    """The golden figures of the nominal linkage, measured on the laboratory's published bar lengths."""
    rows = {line[:20].strip(): line[20:].split() for line in linkage_sheet.range_table(LINKAGE).splitlines()}
    assert rows["shoulder theta_s"] == ["-83.52", "37.3", "29.40", "218.0"]
    assert rows["elbow theta_e"] == ["-108.85", "188.9", "45.67", "5.4"]
    for pin, lowest, highest in (("J4", 31.5, 145.6), ("J7", 23.8, 87.2), ("J10", 21.5, 97.6)):
        low, _, high, _ = (float(cell) for cell in rows[f"transmission at {pin}"])
        assert (low, high) == pytest.approx((lowest, highest), abs=0.05)


def test_the_command_draws_and_prints(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Into runs/linkage, into a folder, or into one file of the kind its name ends with."""
    assert call("linkage") == 0
    printed = capsys.readouterr().out
    assert "shoulder theta_s" in printed
    assert "transmission at J10" in printed
    assert "drawn to runs/linkage/aerobat.png, runs/linkage/aerobat.pdf" in printed
    assert imread(here / "runs" / "linkage" / "aerobat.png").shape[1] >= 1000
    (here / "mine").mkdir()
    assert call("linkage", "aerobat_light", "--out", "mine") == 0
    assert call("linkage", "--out", "mine/one.svg") == 0
    assert call("linkage", "--out", "mine/two.PDF") == 0
    names = ["aerobat_light.pdf", "aerobat_light.png", "one.svg", "two.PDF"]
    assert sorted(path.name for path in (here / "mine").iterdir()) == names
    assert (here / "mine" / "two.PDF").read_bytes().startswith(b"%PDF")


def test_the_command_line_warns_in_a_line_of_a_nearly_singular_linkage(tmp_path: Path) -> None:
    """Once, on standard error, without the place in our code; the picture is drawn all the same."""
    (tmp_path / "tight.toml").write_text('extends = "aerobat"\nname = "tight"\n[linkage]\nL5a = 9e-3\n')
    done = aerobat("linkage", "tight.toml", "--out", "tight.png", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    lines = [line for line in done.stderr.splitlines() if "nearly singular" in line]
    assert len(lines) == 1
    assert lines[0].startswith("warning: the linkage is nearly singular at J7: its bars make 13.0 deg")
    assert (tmp_path / "tight.png").exists()
