"""Recordings of robots that are not Aerobat: Pinocchio's own samples, fixed and free; and two replays on one page."""

import re
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from support.browser import SEEK_AND_DRAW, at, needs_browser, node, opened, pixels, ready, resized
from support.further import further

from aerobat_pin.aerobat import load_aerobat
from aerobat_pin.errors import FrameNotFoundError, ShapeError
from aerobat_pin.visualization.comparison import side_by_side
from aerobat_pin.visualization.replay import moving_page
from aerobat_pin.visualization.replay.moving_page import Replay, record

DOCS = Path(__file__).resolve().parents[2] / "docs"
TIME = np.linspace(0.0, 1.0, 201)


def humanoid() -> tuple[pin.Model, pin.GeometryModel, Any]:
    """Return the sample humanoid, falling five metres while it waves."""
    model = pin.buildSampleModelHumanoid()
    q = np.tile(pin.neutral(model), (len(TIME), 1))
    q[:, 2] = -5.0 * TIME**2
    q[:, 7:] += 0.3 * np.sin(6.0 * TIME)[:, None]
    return model, pin.buildSampleGeometryModelHumanoid(model), q


def manipulator() -> tuple[pin.Model, pin.GeometryModel, Any]:
    model = pin.buildSampleModelManipulator()
    return model, pin.buildSampleGeometryModelManipulator(model), 0.4 * np.sin(np.outer(4.0 * TIME, np.arange(1, 7)))


def test_the_page_about_replays_does_what_it_says() -> None:
    """Its code runs, and makes a page with the force and the stretch that it adds."""
    block = re.findall(r"```python\n(.*?)```", (DOCS / "replay.md").read_text(), re.DOTALL)[0]
    names: dict[str, Any] = {}
    exec(compile(block, "docs/replay.md", "exec"), names)
    assert "somebody pushes, 0.5 s to 1 s" in names["page"]
    assert '"rate": 0.5' in names["page"]
    assert "N per cm" in names["page"]


@needs_browser
@pytest.mark.parametrize("robot", [humanoid, *further(manipulator)])
def test_any_model_is_shown_where_it_is_with_its_force(robot: Any, browser: Any, tmp_path: Path) -> None:
    """Every part at its place, the arrow from the frame along the force, the robot in the middle of the picture."""
    model, parts, q = robot()
    frame = model.frames[model.nframes - 1].name
    force = np.column_stack([30.0 * np.sin(5.0 * TIME), 0.0 * TIME, 40.0 + 0.0 * TIME])
    replay = record(model, parts, TIME, q, {frame: force}, title="<b>sample</b>")
    (tmp_path / "page.html").write_text(replay.html())
    data, placed = model.createData(), parts.createData()
    with opened(browser, (tmp_path / "page.html").as_uri()) as page:
        ready(page)
        assert page.inner_text("#legend h1") == "<b>sample</b>"
        scale = float(re.findall(r"([0-9.]+) N per cm", page.inner_text("#legend"))[0])
        for k in (20, 150):
            at(page, TIME[k])
            pin.updateGeometryPlacements(model, data, parts, placed, q[k])
            pin.framesForwardKinematics(model, data, q[k])
            for item, placement in zip(parts.geometryObjects, placed.oMg, strict=True):
                shown = node(page, "robot", "visuals", item.name)
                assert shown["position"] == pytest.approx(placement.translation, abs=1e-5)
                turn = pin.Quaternion(np.array(shown["quaternion"])).matrix()
                np.testing.assert_allclose(turn, placement.rotation, atol=1e-5)
            arrow = {part: node(page, "force", "force", frame, part) for part in ("shaft", "head")}
            start = data.oMf[model.getFrameId(frame)].translation
            assert arrow["shaft"]["position"] == pytest.approx(start, abs=1e-5)
            rod = np.subtract(arrow["head"]["position"], start)
            assert np.linalg.norm(np.cross(rod, force[k])) < 1e-4 * np.linalg.norm(rod) * np.linalg.norm(force[k])
            assert np.linalg.norm(rod) < 0.01 * np.linalg.norm(force[k]) / scale
            image = pixels(page)
            sky = np.median(image, axis=1, keepdims=True)
            seen = np.argwhere(np.abs(image - sky).max(axis=2) > 0.12)
            assert len(seen) > 0.003 * image.shape[0] * image.shape[1]
            assert np.all(np.abs(seen.mean(axis=0) / image.shape[:2] - 0.5) < 0.25)


@needs_browser
def test_every_stretch_is_marked_however_short_and_whether_it_ends(browser: Any, tmp_path: Path) -> None:
    """Balls where the body is at onset and end, also between two keyframes; none where nothing ends or is not seen."""
    model, parts, q = humanoid()
    replay = record(model, parts, TIME, q)
    stretches = {"blow": (0.201, 0.203), "step": (0.4, 0.6), "calm": (0.8, np.inf), "later": (2.0, 3.0)}
    for label, (start, end) in stretches.items():
        replay.add_zone(start, end, label, "#CC79A7")
    (tmp_path / "page.html").write_text(replay.html())
    with opened(browser, (tmp_path / "page.html").as_uri()) as page:
        ready(page)
        at(page, 0.0)
        legend = page.inner_text("#legend")
        for text in ("blow, 0.201 s to 0.203 s", "step, 0.4 s to 0.6 s", "calm, from 0.8 s on"):
            assert text in legend
        for i, (start, end) in enumerate(stretches.values()):
            for name, time in (("onset", start), ("end", end)):
                there = f"'{name}' in (viewer.scene_tree.find(['meshcat', 'world', 'zone', '{i}']).children)"
                assert page.evaluate(there) == (time <= 1.0)
                if time <= 1.0:
                    height = node(page, "zone", str(i), name)["position"][2]
                    assert height == pytest.approx(-5.0 * time**2, abs=1e-3)  # it falls 5 t^2
        bar, *marks = (one.bounding_box() for one in page.locator("#zones, #zones b").all())
        for mark, (start, end) in zip(marks[:3], stretches.values(), strict=False):
            assert mark["x"] - bar["x"] == pytest.approx(start * bar["width"], abs=1.0)
            assert mark["width"] == pytest.approx(max((min(end, 1.0) - start) * bar["width"], 3.0), abs=1.0)


def test_the_arrows_scale_is_a_round_number() -> None:
    """1, 2 or 5 times a power of ten newtons a centimetre; the largest arrow is about half a robot long."""
    model, parts, q = manipulator()
    frame = model.frames[model.nframes - 1].name
    for size in (1e-3, 0.7, 42.0, 9e4):
        replay = record(model, parts, TIME, q, {frame: np.tile([0.0, 0.0, size], (len(TIME), 1))})
        scale = replay.newtons_per_centimetre
        assert round(scale / 10.0 ** np.floor(np.log10(scale) + 1e-9), 9) in (1.0, 2.0, 5.0)
        assert 0.2 < 0.01 * size / scale / replay.size <= 0.6 + 1e-9


def test_keyframes_are_no_denser_than_needed() -> None:
    """About 120 a second of a dense record, all rows of a sparse one, always the first and the last."""
    model, parts, _ = manipulator()
    for n, expected in ((3001, 361), (31, 31)):
        time = np.linspace(2.0, 5.0, n)
        replay = Replay(model, parts, time, np.zeros((n, model.nq)))
        assert len(replay.index) == pytest.approx(expected, abs=1)
        assert (replay.time[0], replay.time[-1]) == (2.0, 5.0)
    repeated = Replay(model, parts, [0.0, 0.0, 0.5, 0.5, 1.0, 1.0], np.zeros((6, model.nq)))
    assert repeated.time.tolist() == [0.0, 0.5, 1.0]


def test_a_page_that_would_be_too_large_ends_early_and_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    """A minute of a dense record; here a second, of three. A whole one says nothing of the kind."""
    model, parts, _ = manipulator()
    monkeypatch.setattr(moving_page, "MOST_KEYFRAMES", 121)
    for end, said in ((3.0, "arm (the first 1 s of 3 s)"), (1.0, "arm")):
        time = np.linspace(0.0, end, round(1200 * end) + 1)
        replay = Replay(model, parts, time, np.zeros((len(time), model.nq)), title="arm")
        assert replay.duration == pytest.approx(1.0)
        assert f"<title>{said}</title>" in replay.html()


def test_nobody_elses_model_is_changed() -> None:
    """Parts that `move` places are the replay's own."""
    model, parts, q = manipulator()
    before = [pin.SE3(item.placement) for item in parts.geometryObjects]

    def lift(visible: pin.GeometryModel, row: int) -> None:
        visible.geometryObjects[0].placement = pin.SE3(np.eye(3), np.array([0.0, 0.0, 0.01 * row]))

    Replay(model, parts, TIME, q, move=lift)
    assert all(item.placement == old for item, old in zip(parts.geometryObjects, before, strict=True))


def test_what_is_no_motion_is_refused() -> None:
    """Shapes, times that fall or stand still, frames that there are not."""
    model, parts, q = manipulator()
    with pytest.raises(ShapeError, match="never decreasing"):
        record(model, parts, TIME[::-1], q)
    with pytest.raises(ShapeError, match="the same in all rows"):
        record(model, parts, 0.0 * TIME, q)
    with pytest.raises(ShapeError, match=r"q has shape \(201, 5\): \(201, 6\) was expected"):
        record(model, parts, TIME, q[:, :5])
    with pytest.raises(ShapeError, match="NaN"):
        record(model, parts, TIME, np.nan * q)
    with pytest.raises(FrameNotFoundError, match="no frame named 'tool'"):
        record(model, parts, TIME, q, {"tool": np.zeros((201, 3))})
    with pytest.raises(ShapeError, match="force at universe"):
        record(model, parts, TIME, q, {"universe": np.zeros((201, 2))})


@needs_browser
@pytest.mark.parametrize(("width", "height"), [(420, 800), *further((1280, 720))])
def test_the_opening_shows_robot_and_ground(browser: Any, tmp_path: Path, width: int, height: int) -> None:
    """The ground before the robot as behind it, nothing of the robot under the controls."""
    model, parts, q = humanoid()
    (tmp_path / "page.html").write_text(record(model, parts, TIME, q).html())
    with opened(browser, (tmp_path / "page.html").as_uri(), size=(width, height)) as page:
        ready(page)
        at(page, 0.0)
        controls = page.locator("#controls").bounding_box()
        page.evaluate("viewer.scene_tree.find(['meshcat', 'world', 'robot']).object.visible = false")
        page.evaluate(SEEK_AND_DRAW, 0.0)
        ground = pixels(page)
        page.evaluate("viewer.scene_tree.find(['meshcat', 'world', 'robot']).object.visible = true")
        page.evaluate(SEEK_AND_DRAW, 0.0)
        robot = np.argwhere(np.abs(pixels(page) - ground).max(axis=2) > 0.02)
        assert robot[:, 0].min() > 0
        assert robot[:, 0].max() < controls["y"]
        lines = np.abs(ground - np.median(ground, axis=1, keepdims=True)).max(axis=2) > 0.02
        assert lines[round(0.75 * height) :].mean() > 0.001  # in the lowest quarter, nearest to the camera


@needs_browser
def test_a_true_force_is_black_inside_its_halo(browser: Any, tmp_path: Path) -> None:
    """Seen in the picture: of the slim arrow's shaft as many pixels are black as where there is no halo."""
    model, parts, q = manipulator()
    frame = model.frames[model.nframes - 1].name
    force, black = {frame: np.tile([0.0, 0.0, 5.0], (len(TIME), 1))}, []
    for halo in (False, True):
        replay = Replay(model, parts, TIME, q)
        if halo:
            replay.add_forces("estimated", "#D55E00", force)
        replay.add_forces("true", "#000000", force, inner=True)
        (tmp_path / "page.html").write_text(replay.html())
        with opened(browser, (tmp_path / "page.html").as_uri()) as page:
            ready(page)
            at(page, 0.5)
            black.append(int(np.sum(pixels(page).max(axis=2) < 0.05)))
    assert black[0] > 100
    assert black[1] == pytest.approx(black[0], rel=0.05)


READY = "window.panes && panes.every((pane) => !pane.viewer.animator.playing)"


def resting(duration: float, push: float) -> Replay:
    """Return a replay of a robot at rest with a force [N] on its left wing."""
    robot = load_aerobat()
    time = np.linspace(0.0, duration, 13)
    replay = Replay(robot.model, robot.visual_model, time, np.tile(robot.q0, (len(time), 1)), title="at rest")
    replay.add_forces("force", "#0072b2", {"left_force_point": np.tile([0.0, 0.0, push], (len(time), 1))})
    return replay


def test_arrows_have_the_coarser_scale_of_both() -> None:
    """So that a longer arrow is a larger force; titles begin with the labels."""
    weak, strong = resting(0.1, 0.01), resting(0.1, 1.0)
    coarse = strong.newtons_per_centimetre
    assert weak.newtons_per_centimetre < coarse
    page = side_by_side(weak, strong, ("weak", "strong <b>"), 0.1)
    assert weak.newtons_per_centimetre == strong.newtons_per_centimetre == coarse
    assert "strong &lt;b&gt;: at rest" in page or "strong &amp;lt;b&amp;gt;: at rest" in page
    assert "strong <b>" not in page
    assert weak.title == "weak: at rest"
    side_by_side(weak, strong, ("weak", "strong <b>"), 0.1)
    assert weak.title == "weak: at rest", "not twice"


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
        bottom, top = (
            "document.getElementById('pair').getBoundingClientRect().bottom",
            "controls.getBoundingClientRect().top",
        )
        for size in ((1440, 900), (844, 390), (390, 844)):
            resized(page, *size)
            assert page.evaluate(f"{bottom} <= {top}"), "the controls cover no legend"
