"""The replay of a flight in a real browser: it plays, it shows what happened, and what it says is to scale."""

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from support.browser import at, frames, needs_browser, node, opened, pixels, ready
from support.shed_wake import wake_at

from aerobat_description.write_urdf import MATERIALS
from aerobat_pin.aerobat import FlightLog, read_log, true_force
from aerobat_pin.aerobat.closed_model import bar_placements
from aerobat_pin.experiments import Experiment, estimate_dataset, run
from aerobat_pin.flight.motion_and_wake import wake_of
from aerobat_pin.numerics.arrays import Array
from aerobat_pin.scenario.scenario import load_scenario
from aerobat_pin.visualization import SLOW_MOTION, replay_flight, style

# Linear RGB as seen without red and without green cones: Machado, Oliveira & Fernandes (2009), severity 1.
BLIND = {
    "protanopia": [[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216], [-0.003882, -0.048116, 1.051998]],
    "deuteranopia": [[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413], [-0.011820, 0.042940, 0.968881]],
}

# First and last corner of the wake that is drawn; nothing where none of it is.
SHOWN = """(() => {
    const node = viewer.scene_tree.find(['meshcat', 'world', 'air', 'sheet']).object;
    let mesh;
    node.traverse((one) => { if (one.isMesh) mesh = one; });
    const {start, count} = mesh.geometry.drawRange, place = mesh.geometry.attributes.position.array;
    const point = (k) => Array.from(place.slice(3 * k, 3 * k + 3)), index = mesh.geometry.index.array;
    return count ? [point(index[start]), point(index[start + count - 2])] : null;
})()"""


@needs_browser
def test_it_plays_from_disk_as_long_as_the_flight_and_pauses(page: Any) -> None:
    """Offline, without an error; a click on the button stops it, the bar seeks, buttons mark speeds from 1/50 to 1."""
    assert page.evaluate("viewer.animator.duration") == pytest.approx(2.0, abs=1e-3)
    assert page.evaluate("viewer.animator.mixer.timeScale") == SLOW_MOTION
    page.get_by_role("button", name="pause").click()
    held = page.evaluate("viewer.animator.actions[0].time")
    frames(page)
    assert page.evaluate("viewer.animator.actions[0].time") == held
    page.get_by_role("button", name="play").click()
    page.wait_for_function(f"viewer.animator.actions[0].time != {held}")
    page.locator("#time").fill("1.25")
    page.wait_for_function("document.getElementById('clock').textContent === '1.250 s'")
    assert page.evaluate("viewer.animator.actions[0].time") == pytest.approx(1.25)
    buttons = page.locator("#speeds button[data-rate]")
    rates = buttons.evaluate_all("(all) => all.map((one) => Number(one.dataset.rate))")
    assert rates == [0.02, 0.05, 0.1, 0.25, 0.5, 1.0]
    page.evaluate("animator.pause()")
    for speed in (0.02, 1.0):
        page.locator(f"#speeds button[data-rate='{speed:g}']").click()
        assert page.evaluate("viewer.animator.mixer.timeScale") == speed
        marked = page.locator(f"#speeds button[data-rate='{speed:g}'][aria-pressed=true]")
        marked.wait_for()


@needs_browser
def test_arrows_bars_and_robot_are_where_the_log_says(paper: Experiment, shown: Any) -> None:
    """In world axes: the tip of each arrow is its force away from the force point, to the scale of the legend."""
    data = paper.robot.model.createData()
    scale = float(re.findall(r"([0-9.]+) N per cm", shown.inner_text("#legend"))[0])
    lengths = []
    for k in (100, 225, 575, 1300):  # multiples of 25 ms are keyframes
        at(shown, paper.log.time[k])
        q = paper.log.measured["q"].values[k]
        pin.framesForwardKinematics(paper.robot.model, data, q)
        for frame in ("left_force_point", "right_force_point"):
            i = paper.estimates["momentum"].frames.index(frame)
            forces = {
                "estimated force (momentum)": paper.estimates["momentum"].force[k, i],
                "true force": true_force(paper.log, frame)[0][k],
            }
            for kind, force in forces.items():
                shaft, head = (node(shown, "force", kind, frame, part) for part in ("shaft", "head"))
                start = np.array(shaft["position"])
                assert start == pytest.approx(data.oMf[paper.robot.model.getFrameId(frame)].translation, abs=1e-5)
                rod = np.subtract(head["position"], start)
                assert shaft["scale"][1] == pytest.approx(np.linalg.norm(rod), abs=1e-6)
                length = 0.01 * np.linalg.norm(force) / scale
                assert float(rod @ force) > 0.9999 * float(np.linalg.norm(rod) * np.linalg.norm(force))
                turn = pin.Quaternion(np.array(head["quaternion"])).matrix()
                assert turn[:, 1] @ force > 0.9999 * np.linalg.norm(force)
                cone = head["scale"][1] * shown.evaluate(
                    f"viewer.scene_tree.find(['meshcat', 'world', 'force', '{kind}', '{frame}', 'head', 'shape',"
                    " '<object>']).object.geometry.parameters.height"
                )
                assert np.linalg.norm(rod) + cone == pytest.approx(length, abs=2e-5)
                lengths.append(length)
        bars = bar_placements(paper.robot, paper.log.measured["crank_angle"].values[k])
        for name, placement in bars.items():
            origin = pin.XYZQUATToSE3(q[:7]).act(placement.translation)
            assert node(shown, "robot", "visuals", name)["position"] == pytest.approx(origin, abs=1e-5)
    assert max(lengths) > 3.0 * min(lengths)


@needs_browser
def test_the_robot_fills_the_picture_and_stays_in_it(paper: Experiment, shown: Any) -> None:
    """At least a tenth of the width from begin to end of six metres; the picture changes as it flies."""
    seen = []
    for time in (0.0, 0.7, 1.9):
        at(shown, time)
        seen.append(pixels(shown))
        dark = seen[-1].max(axis=2) < 0.45  # body, guard and arrows against a pale sky
        columns = np.flatnonzero(dark.any(axis=0))
        assert columns.max() - columns.min() > 0.1 * dark.shape[1]
        assert abs(0.5 * (columns.max() + columns.min()) / dark.shape[1] - 0.5) < 0.2
    assert all(np.mean(np.abs(one - seen[0]) > 0.1) > 0.005 for one in seen[1:])


@needs_browser
def test_nothing_translucent_hides_or_tints_the_arrows_about_it(shown: Any) -> None:
    """Membranes, propellers, halos and wake write no depth, so a halo behind is seen; arrows are drawn after all."""
    orders = """(() => {
        const found = {arrow: [], other: [], depth: []}, arrows = new Set();
        viewer.scene_tree.find(["meshcat", "world", "force"]).object.traverse((one) => arrows.add(one));
        viewer.scene.traverse((one) => {
            if (!one.isMesh || !one.material.transparent) return;
            found[arrows.has(one) ? "arrow" : "other"].push(one.renderOrder);
            found.depth.push(one.material.depthWrite);
        });
        return found; })()"""
    found = shown.evaluate(orders)
    assert len(found["depth"]) >= 4 + 1 + 1 + 4 + 1  # membranes, tail, propellers, two halos of two parts, wake
    assert not any(found["depth"])
    assert min(found["arrow"]) > max(found["other"])
    assert set(found["arrow"]) == {2, 3}


@needs_browser
def test_the_step_is_marked_on_the_time_bar_and_on_the_way(paper: Experiment, shown: Any) -> None:
    """From 1 s to 1.6 s of 2 s; balls where the body is at onset and end."""
    bar, zone = (shown.locator(name).bounding_box() for name in ("#zones", "#zones b"))
    assert (zone["x"] - bar["x"]) / bar["width"] == pytest.approx(0.5, abs=0.01)
    assert zone["width"] / bar["width"] == pytest.approx(0.3, abs=0.01)
    for name, k in (("onset", 1000), ("end", 1600)):
        at_event = paper.log.measured["q"].values[k, :3]
        assert node(shown, "zone", "0", name)["position"] == pytest.approx(at_event, abs=1e-3)


@needs_browser
def test_the_wake_grows_behind_the_wing_and_fades(paper: Experiment, shown: Any) -> None:
    """The rows drawn end at the trailing edge of the moment and begin half a second earlier."""
    wake = wake_of(paper.log, paper.robot, paper.scenario.air)
    at(shown, 0.0)
    assert shown.evaluate(SHOWN) is None
    for k, first in ((400, 0), (1500, 1000)):
        at(shown, paper.log.time[k])
        begin, end = shown.evaluate(SHOWN)
        assert begin == pytest.approx(wake.position[first, 0], abs=2e-5)
        assert end == pytest.approx(wake.position[k, -1], abs=2e-5)
    assert node(shown, "air")["position"] == [0.0, 0.0, 0.0]


def test_two_seconds_of_flight_are_less_than_five_megabytes(paper_folder: Path) -> None:
    """With 120 keyframes a second, 25 a flap at 4.75 Hz; the viewer alone is 0.85 MB."""
    page = (paper_folder / "replay.html").read_text()
    assert len(page) < 5e6
    times = np.array(eval(re.findall(r'"times": (\[[^\]]*\])', page)[0]))
    assert len(times) >= 120 * 2
    assert np.diff(times).max() < 9.1e-3


@needs_browser
def test_quasi_steady_air_leaves_no_wake_and_wind_carries_one(browser: Any, tmp_path: Path) -> None:
    """A model without a wake shows none; with wind it moves over ground with the air."""
    short = ["simulation.duration=0.3", "air.warm_up_cycles=1"]
    still = made(run(load_scenario("paper", [*short, "air.model=quasi_steady"])))
    assert '"sheet": null' in still
    windy = run(load_scenario("paper", [*short, "air.wind=[0.5, 0.0, 0.2]"]))
    (tmp_path / "windy.html").write_text(made(windy))
    with opened(browser, (tmp_path / "windy.html").as_uri()) as page:
        ready(page)
        at(page, 0.25)
        moved = node(page, "air")["position"]
        assert moved == pytest.approx([0.125, 0.0, 0.05], abs=1e-6)
        wake = wake_of(windy.log, windy.robot, windy.scenario.air)
        now = len(wake_at(wake, 0.25)[0]) - 1
        begin, end = (np.add(corner, moved) for corner in page.evaluate(SHOWN))
        assert begin == pytest.approx(wake_at(wake, 0.25)[0][0, 0], abs=2e-5)  # shed first, carried furthest
        assert end == pytest.approx(wake.position[now, -1], abs=2e-5)  # at the wing still


def made(experiment: Experiment, log: FlightLog | None = None) -> str:
    estimates = estimate_dataset(experiment.estimates)
    flight = experiment.log if log is None else log
    return replay_flight(experiment.robot, flight, experiment.scenario.air, estimates, "note").html(SLOW_MOTION)


def test_a_recorded_flight_is_replayed_without_truth(paper: Experiment, paper_folder: Path) -> None:
    """No true force, no wake, no step; the estimate is there."""
    assert "step at left, right, 1 s to 1.6 s" in (paper_folder / "replay.html").read_text()
    page = made(paper, replace(paper.log, truth=None))
    assert "true force" not in page
    assert "estimated force (momentum)" in page
    assert "step at" not in page
    assert '"sheet": null' in page


def test_poses_and_a_crank_angle_are_enough(paper: Experiment, tmp_path: Path) -> None:
    """A table as a laboratory records it: the linkage supplies the joints, and no estimate is needed."""
    seen = paper.log.measured
    rows = np.column_stack([paper.log.time, seen["q"].values[:, :7], seen["crank_angle"].values])[::5]
    np.savetxt(tmp_path / "log.csv", rows, delimiter=",", header="time,x,y,z,qx,qy,qz,qw,crank_angle", comments="")
    recording = replay_flight(paper.robot, read_log(tmp_path / "log.csv"), paper.scenario.air, None, "recorded")
    assert recording.duration == pytest.approx(2.0)
    assert "estimated force" not in recording.html()


def test_a_log_may_begin_at_any_time(paper: Experiment) -> None:
    """The animation begins at zero, the clock does not."""
    late = paper.log.measured.assign_coords(time=paper.log.time + 100.0)
    page = made(paper, FlightLog(late))
    assert '"start": 100.0' in page
    assert re.findall(r'"times": \[(\S+),', page) == ["0.0"]


def lab(colour: Array) -> Array:
    """Return CIE L*a*b* of linear RGB under D65."""
    to_xyz = [[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]]
    xyz = np.clip(np.array(to_xyz) @ colour, 0.0, None) / [0.9505, 1.0, 1.089]
    f = np.where(xyz > 216.0 / 24389.0, np.cbrt(xyz), (24389.0 / 27.0 * xyz + 16.0) / 116.0)
    return np.array([116.0 * f[1] - 16.0, 500.0 * (f[0] - f[1]), 200.0 * (f[1] - f[2])])


@pytest.mark.parametrize("eyes", ["normal", *BLIND])
def test_arrows_are_told_from_each_other_and_from_every_bar(eyes: str) -> None:
    """With and without red or green cones, by more than 15 in CIE L*a*b*, where 2 is just noticed."""
    seen = np.eye(3) if eyes == "normal" else np.array(BLIND[eyes])

    def look(colour: Any) -> Array:
        rgb = np.array(colour)
        linear = np.where(rgb <= 0.04045, rgb / 12.92, ((rgb + 0.055) / 1.055) ** 2.4)
        return lab(np.clip(seen @ linear, 0.0, 1.0))

    true, estimated = (look(style.rgb(colour)) for colour in (style.TRUTH, style.ESTIMATES[0]))
    assert np.linalg.norm(true - estimated) > 15.0
    for part in ("crank", "bar", "bone"):
        for arrow in (true, estimated):
            assert np.linalg.norm(look(MATERIALS[part][:3]) - arrow) > 15.0, part


def test_the_robots_materials_are_of_the_palette() -> None:
    """Bars, bones, crank and membranes: Okabe & Ito's colours, which are named once."""
    palette = [style.rgb(getattr(style, name)) for name in ("BLUE", "ORANGE", "PURPLE", "SKY_BLUE")]
    for part, colour in zip(("bone", "bar", "crank", "membrane"), palette, strict=True):
        assert MATERIALS[part][:3] == pytest.approx(colour, abs=0.01), part
