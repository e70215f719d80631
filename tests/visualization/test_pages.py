"""What a person looks at after a run: figures, report and replay, on a desk and on a phone; what a notebook shows."""

import html
import itertools
import re
from html import escape
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
import xarray as xr
from matplotlib.figure import Figure
from matplotlib.image import imread
from support.browser import at, needs_browser, node, opened, pixels, ready, resized
from support.further import further
from support.shipped import flown

from aerobat_pin import load_aerobat, load_robot
from aerobat_pin.aerobat.flight_log import FlightLog, true_force
from aerobat_pin.experiments import Experiment, run, run_recorded
from aerobat_pin.scenario.scenario import load_scenario
from aerobat_pin.visualization import draw_all, draw_estimation, replay_result, report_html
from aerobat_pin.visualization.figures.flight import draw_states, draw_stick_diagram
from aerobat_pin.visualization.figures.lines import thinned


def test_the_papers_figures_are_drawn_as_png_and_pdf(paper_folder: Path) -> None:
    """The paper's five, what the air does, and what no force explains; none of them blank, the PDF a vector file."""
    names = {"position", "states", "stick_diagram", "estimation", "linkage", "aerodynamics", "power", "unexplained"}
    assert {path.stem for path in (paper_folder / "figures").iterdir()} == names
    for name in names:
        pixels = imread(paper_folder / "figures" / f"{name}.png")
        assert pixels.shape[1] >= 1000
        assert pixels[..., :3].std() > 0.02
        assert (paper_folder / "figures" / f"{name}.pdf").read_bytes().startswith(b"%PDF")


@pytest.fixture(scope="module")
def drawn(paper: Experiment) -> dict[str, Figure]:
    return draw_all(paper)


def test_the_figures_show_the_channels_they_name(paper: Experiment, drawn: dict[str, Figure]) -> None:
    """Lines hold the log's own numbers: joints, X Y Z, truth and estimates; the titles say what holds the robot."""
    q = paper.log.measured["q"]
    shoulder, elbow = (line.get_ydata() for line in drawn["states"].axes[0].lines)
    np.testing.assert_allclose(np.radians(shoulder), q.sel(q_axis="left_shoulder"))
    np.testing.assert_allclose(np.radians(elbow), q.sel(q_axis="left_elbow"))
    for axis, name in zip(drawn["position"].axes, "xyz", strict=True):
        np.testing.assert_array_equal(axis.lines[0].get_ydata(), q.sel(q_axis=name))
    right_fz = drawn["estimation"].axes[9]  # two columns, an error below each force
    truth = true_force(paper.log, "right_force_point")[0]
    np.testing.assert_array_equal(right_fz.lines[0].get_ydata(), truth[:, 2])
    np.testing.assert_array_equal(right_fz.lines[1].get_ydata(), paper.estimates["momentum"].force[:, 1, 2])
    for name in ("position", "states", "stick_diagram", "estimation"):
        assert "79 % thruster-borne" in drawn[name].get_suptitle()
    assert "Unknown force at each wing" in drawn["estimation"].get_suptitle()
    curves, limits = (drawn["unexplained"].axes[0].lines[first::2] for first in (0, 1))
    assert [line.get_color() for line in limits] == [line.get_color() for line in curves]


def test_a_force_that_acts_on_no_wing_is_not_said_to() -> None:
    """The title of the figure follows the frames at which the observers look."""
    figure = draw_estimation(flown("guard").scores)
    assert "Unknown force at each point" in figure.get_suptitle()
    assert figure.axes[0].get_title() == "thruster_1"


def test_rows_alone_are_drawn_and_replayed() -> None:
    """Without points, the close-up looks at the base's row along the step, and the replay has no estimated force."""
    made = run(load_scenario("paper", ["observers.frames=[]", "observers.names=['momentum']"]))
    figure = draw_estimation(made.scores)
    assert [axis.get_ylabel().partition(" ")[0] for axis in figure.axes[:3]] == ["base.Fx", "base.Fy", "base.Fz"]
    assert figure.axes[-1].get_ylabel().startswith("base.F")
    assert "estimated" not in replay_result(made).html()


@pytest.mark.parametrize(
    ("name", "row", "span", "legend"),
    [
        ("guard", 1, (0.35, 1.25), ["push", "push, enlarged in the last row"]),
        *further(
            ("impact", 2, (0.675, 0.735), ["impulse", "impulse, enlarged in the last row"]),
            ("paper", 1, (0.97, 1.03), ["step", "step, enlarged in the last row"]),
            ("gust", 1, (0.6, 1.2), ["gust", "gust, enlarged in the last row"]),
        ),
    ],
)
def test_the_close_up_is_where_it_happens(name: str, row: int, span: tuple[float, float], legend: list[str]) -> None:
    """The axis and the time of the first event, of a step its onset; boxes are explained, and hide no line."""
    made = flown(name)
    figure = draw_all(made)["estimation"]
    columns = len(made.estimates["momentum"].frames)
    close, looked_at = figure.axes[6 * columns], figure.axes[2 * row * columns]
    assert close.get_ylabel() == f"$F_{'xyz'[row]}$ [N], enlarged"
    assert close.get_xlim() == pytest.approx(span)
    truth = looked_at.lines[0].get_ydata()
    low, high = close.get_ylim()
    middle = looked_at.lines[0].get_xdata()
    assert np.all((truth >= low) & (truth <= high), where=(middle > span[0]) & (middle < span[1]))
    [words] = figure.legends
    assert [text.get_text() for text in words.get_texts()][-2:] == legend
    assert all(box.get_zorder() < looked_at.lines[0].get_zorder() for box in looked_at.patches)


def test_events_are_drawn_in_a_log_that_begins_late() -> None:
    """The figure's times count from the start; the events of a log 100 s later were taken for ones after its end."""
    made, late = flown("guard"), []
    with xr.set_options(keep_attrs=True):
        for data in (made.log.measured, made.log.truth):
            assert data is not None
            moved = {name: data[name] + 100.0 for name in ("event_start", "event_end") if name in data}
            times = {name: data[name] + 100.0 for name in ("time", "interval") if name in data.coords}
            late.append(data.assign(moved).assign_coords(times))
    figure = draw_estimation(run_recorded(FlightLog(*late), made.scenario).scores)
    assert figure.axes[-1].get_xlim() == pytest.approx((0.35, 1.25))
    assert figure.legends[0].get_texts()[-1].get_text() == "push, enlarged in the last row"


def test_the_panels_of_the_forces_can_be_compared(paper: Experiment) -> None:
    """Left and right on one scale; errors, in mN, on others, as those of Fx are a tenth."""
    axes = draw_estimation(paper.scores).axes
    for row in range(6):
        assert axes[2 * row].get_ylim() == axes[2 * row + 1].get_ylim()
    for row in (1, 3, 5):
        risen = [line.get_ydata()[25:] for column in (0, 1) for line in axes[2 * row + column].lines]
        assert np.ptp(risen) > 0.9 * np.ptp(axes[2 * row].get_ylim())
    np.testing.assert_allclose(np.ptp(axes[12].get_ylim()), np.ptp(axes[13].get_ylim()))
    error = paper.estimates["momentum"].force[:, 0, 1] - true_force(paper.log, "left_force_point")[0][:, 1]
    np.testing.assert_allclose(axes[6].lines[0].get_ydata(), 1e3 * error)


def test_a_noisy_estimate_does_not_hide_the_truth_and_shows_its_deviation() -> None:
    """It is drawn behind; a band of two standard deviations where the observer states them; long titles are broken."""
    made = run(load_scenario("noisy_sensors", ["simulation.duration=0.4", "sensors.attitude.bias=[0.0,0.3,0.0]"]))
    drawn = draw_all(made)
    assert made.flight is not None
    lift = np.mean(drawn["aerodynamics"].axes[0].lines[0].get_ydata()) / (1e3 * made.robot.mass * 9.81)
    assert lift == pytest.approx(made.flight.aerodynamic_lift_over_weight)  # by the true attitude
    figure = drawn["estimation"]
    truth, noisy = figure.axes[4].lines[:2]
    assert noisy.get_zorder() < truth.get_zorder()
    [band] = figure.axes[4].collections
    assert "2 standard deviations" in str(band.get_label())
    for picture in drawn.values():
        picture.draw_without_rendering()
        title = picture._suptitle.get_window_extent() if picture._suptitle else None
        assert title is None or title.width <= picture.bbox.width


@pytest.fixture(scope="module")
def tumble() -> Experiment:
    return flown("tumble")


def test_an_angle_that_wraps_leaves_a_gap(tumble: Experiment) -> None:
    """No vertical line from -180 to 180 deg: no two neighbours are further apart than half a turn."""
    angles = [line.get_ydata() for line in draw_states(tumble.log).axes[1].lines]
    assert any(np.isnan(one).any() for one in angles)
    assert all(np.nanmax(np.abs(np.diff(one))) <= 180.0 for one in angles)


@pytest.mark.parametrize(("name", "drawn"), [("paper", 2.5), ("tumble", 1.0)])
def test_the_stick_diagram_fills_its_picture(name: str, drawn: float, request: pytest.FixtureRequest) -> None:
    """A straight flight wide and stretched, one that turns away in its true shape; either over most of the width."""
    made = request.getfixturevalue(name)
    figure = draw_stick_diagram(made.robot, made.drawn)
    figure.draw_without_rendering()
    [axis] = figure.axes
    assert axis.get_aspect() == drawn
    assert ("times larger" in figure.get_suptitle()) == (drawn > 1.0)
    assert axis.get_position().width > 0.85
    low, high = axis.get_xlim()
    assert np.ptp(made.log.measured["q"].values[:, 0]) > 0.8 * (high - low)


def test_the_figures_of_the_air_show_its_force_and_power(paper: Experiment, drawn: dict[str, Figure]) -> None:
    """Lift and thrust against an own rotation to world axes, weight, power; the colours hold every strip."""
    truth = paper.log.truth
    lift, thrust, strips = drawn["aerodynamics"].axes[:3]
    force = (truth["aerodynamic"] + truth["added_mass"]).values
    for k in (0, 700, 1999):
        world = 1e3 * pin.XYZQUATToSE3(paper.log.measured["q"].values[k, :7]).rotation @ force[k, :3]
        assert lift.lines[0].get_ydata()[k] == pytest.approx(world[2], rel=1e-9)
        assert thrust.lines[0].get_ydata()[k] == pytest.approx(world[0], rel=1e-9)
    assert lift.lines[2].get_ydata()[0] == pytest.approx(92.1 * 9.81, rel=1e-3)  # 92.1 g under standard gravity
    assert strips.collections[0].get_array().shape == truth["circulation"].shape[::-1]
    motor, air = (line.get_ydata() for line in drawn["power"].axes[0].lines)
    np.testing.assert_array_equal(motor, truth["motor_power"])
    np.testing.assert_array_equal(air, truth["air_power"])


def test_the_report_is_self_contained_and_holds_the_tables(paper: Experiment, paper_folder: Path) -> None:
    """No address to fetch, eight embedded pictures, a row per observer, wing and axis; inputs, versions, scenario."""
    page = (paper_folder / "report.html").read_text()
    assert not re.search(r'(?:src|href)="(?!data:|#|replay\.html")', page)
    assert "url(" not in page
    assert page.count("data:image/png;base64,") == 8
    assert page.count("mN</td>") == 12 + 8  # errors of two observers, wings and three axes; four sizes of each belief
    assert "79 % thruster-borne" in page
    for name, source in paper.metrics["inputs"].items():
        assert re.search(rf">{name}</td><td[^>]*>{source}", page), name
    for name, version in paper.metrics["versions"].items():
        assert f'>{name}</td><td class="text">{version}' in page
    assert ">6 of 6<" in page
    assert "Every combination of forces can be estimated" in page
    assert "[simulation]" in page


def test_the_report_says_in_words_what_nobody_can_see() -> None:
    """With the base rows alone an equal and opposite pair leaves no trace: rank five, and a sentence."""
    blind = run(load_scenario("paper", ["observers.torque=none", "simulation.duration=0.05"]))
    page = report_html(blind, {})
    assert ">5 of 6<" in page
    assert ">infinite<" in page
    [pattern] = blind.scores.observers["momentum"].unseen
    assert escape(pattern) in page
    assert "No estimate contains them" in page


SHOWN_AT = """time => new Promise((done) => {
    const drawing = document.querySelector("figure svg");
    drawing.pauseAnimations();
    drawing.setCurrentTime(time);
    requestAnimationFrame(() => requestAnimationFrame(done));
})"""


@needs_browser
def test_the_report_opens_without_a_request_or_an_error(paper_folder: Path, browser: Any) -> None:
    """From disk, offline, readable by day and by night; the linkage turns."""
    with opened(browser, (paper_folder / "report.html").as_uri()) as page:
        assert page.locator("figure img").count() == 8
        assert page.evaluate("[...document.images].every((image) => image.naturalWidth > 500)")
        look = "getComputedStyle(document.body)"
        for scheme in ("light", "dark"):
            page.emulate_media(color_scheme=scheme)
            ink, ground = (page.evaluate(f"{look}.{name}") for name in ("color", "backgroundColor"))
            ink, ground = (np.mean([float(x) for x in re.findall(r"[0-9.]+", one)[:3]]) for one in (ink, ground))
            assert abs(ink - ground) > 150
            assert (ink > ground) == (scheme == "dark")
        crank = "document.querySelectorAll('figure svg polyline')[1].animatedPoints[1]"
        where = []
        for time in (0.0, 0.5):
            page.evaluate(SHOWN_AT, time)
            where.append(page.evaluate(f"[{crank}.x, {crank}.y]"))
        assert np.hypot(*np.subtract(*where)) > 1.0  # [mm]


def test_a_long_series_keeps_its_peaks_beside_a_sample_that_is_not_seen() -> None:
    """One sample that is NaN hid its whole stretch, with 50 N in it."""
    values = np.full(40_000, 0.1)
    values[20_000], values[20_003] = 50.0, np.nan
    time, drawn = thinned(len(values), lambda first, last: (np.arange(first, last) * 1e-3, values[first:last, None]))
    assert len(time) < 10_000
    assert np.nanmax(drawn) == 50.0


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
