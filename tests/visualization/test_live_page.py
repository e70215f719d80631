"""`aerobat live` in a real browser: forces by slider and by drag, saved runs, and who may come in."""

import http.client
import signal
import socket
import subprocess
import sys
import time
import urllib.parse
from collections.abc import Callable
from pathlib import Path
from typing import Any

import coal
import numpy as np
import pinocchio as pin
import pytest
import tomli_w
from support.browser import PATIENCE, needs_browser, opened
from support.commands import call, of_session, served
from support.walking_log import table, table_map, urdf, walk

from aerobat_pin.errors import ExtraError
from aerobat_pin.experiments import LiveFlight, LiveRecording, LiveRobot, LiveSource
from aerobat_pin.visualization import serve_live
from aerobat_pin.visualization.live_server import live_parts


def until(page: Any, condition: str) -> None:
    """Wait for a condition in a page that does not let strangers' code in, as `wait_for_function` would."""
    deadline = time.monotonic() + PATIENCE / 1000.0
    while not page.evaluate(condition):
        assert time.monotonic() < deadline, condition
        time.sleep(0.05)


def agree(page: Any, axis: int, least: float) -> None:
    """Wait until a true force of some size is estimated within 5 %, and stays so for ten messages."""
    true, estimate = f"live.true[{axis}]", f"live.estimate[{axis}]"
    good = f"Math.abs({true}) > {least} && Math.abs({estimate} / {true} - 1) < 0.05"
    until(page, f"live.true && {good}")
    since = page.evaluate("live.messages")
    until(page, f"live.messages > {since} + 10")
    assert page.evaluate(good)


@needs_browser
def test_a_robot_is_pushed_by_slider_and_by_drag_and_saved(browser: Any, tmp_path: Path) -> None:
    """A UR5: within 5 % of what is set; pictures and messages come; a folder with report and replay; nothing stays."""
    out = tmp_path / "live"
    with served("live", "ur5", "--out", str(out)) as (server, address):
        with opened(browser, address, "http://127.0.0.1", "ws://127.0.0.1") as page:
            until(page, "live.pictures > 5")
            assert page.inner_text("h1") == "ur5"
            slider = page.locator("#Fz")
            slider.evaluate("(one) => { one.value = 12; one.dispatchEvent(new Event('input')); }")
            agree(page, 2, 11.9)
            page.click("#release")
            until(page, "Math.abs(live.true[2]) < 1e-9 && Math.abs(live.estimate[2]) < 1")
            box, (x, y, _) = page.locator("#scene").bounding_box(), page.evaluate("placeOf(0)")
            page.mouse.move(box["x"] + x, box["y"] + y)
            page.mouse.down()
            page.mouse.move(box["x"] + x, box["y"] + y - 90, steps=4)
            agree(page, 2, 5.0)
            page.mouse.up()
            until(page, "live.true.every((one) => one === 0)")
            page.click("#pause")
            until(page, "element('pause').textContent === 'go on'")
            before = page.evaluate("now.time")
            page.evaluate("soon()")
            page.click("#save")
            until(page, "element('said').textContent.startsWith('saved in')")
            assert page.evaluate("now.time") < before + 0.5
            page.select_option("#observer", "momentum")
            page.click("#pause")
            until(page, f"now.time > {before} + 1")
        assert of_session(server.pid) == [str(server.pid)]
        server.send_signal(signal.SIGINT)
        assert server.wait(60) == 0
        assert of_session(server.pid) == []
    written = {path.name for path in out.iterdir()}
    assert {"map.toml", "metrics.json", "report.html", "replay.html", "estimate.nc"} <= written


@needs_browser
def test_a_recording_waits_for_its_page_and_keeps_its_time(browser: Any, tmp_path: Path) -> None:
    """It was over before its page was open; stamps of Unix time were one instant in single precision."""
    robot, log, chosen = tmp_path / "quadruped.urdf", tmp_path / "log.csv", tmp_path / "map.toml"
    robot.write_text(urdf())
    walked = table(walk(0.5))
    walked["t"] += 1.7e9
    walked.to_csv(log, index=False)
    chosen.write_text(tomli_w.dumps(table_map(robot) | {"log": {"time": {"column": "t"}}, "check": {}}))
    with served("live", str(log), "--map", str(chosen), "--out", str(tmp_path / "live")) as (server, address):
        time.sleep(2.0)
        with opened(browser, address, "http://127.0.0.1", "ws://127.0.0.1") as page:
            until(page, "element('said').textContent === 'the recording has ended'")
            until(page, "live.pictures > 0")
            assert page.evaluate("rows.at(-1).time - rows[0].time") > 0.1  # a busy page misses messages
            assert 0.1 < page.evaluate("now.time") < 0.51
            assert not {"push", "true", "1.00e+3"} & {*page.inner_text("#panel").split()}  # nobody knows what pushes
        with opened(browser, address, "http://127.0.0.1", "ws://127.0.0.1") as page:  # what stands still is seen, too
            until(page, "live.pictures > 0")
        server.send_signal(signal.SIGINT)
        assert server.wait(60) == 0


def test_nobody_else_comes_in(tmp_path: Path) -> None:
    """No wrong token, host or origin, for page and socket, and no other address of this machine."""
    with served("live", "double_pendulum", "--out", str(tmp_path / "live")) as (server, address):
        where = urllib.parse.urlsplit(address)
        host, token = where.netloc, where.query

        def answer(path: str, **headers: str) -> int:
            connection = http.client.HTTPConnection("127.0.0.1", where.port, timeout=60)
            connection.putrequest("GET", path, skip_host=True)
            for name, value in ({"Host": host} | headers).items():
                connection.putheader(name.replace("_", "-"), value)
            connection.endheaders()
            return connection.getresponse().status

        upgrade = {"Upgrade": "websocket", "Connection": "Upgrade", "Sec_WebSocket_Version": "13"}
        upgrade["Sec_WebSocket_Key"] = "dGhlIHNhbXBsZSBub25jZQ=="
        own = {"Origin": f"http://{host}"}
        assert answer(f"/?{token}") == 200
        assert answer(f"/live?{token}", **upgrade, **own) == 101
        for path in ("/", "/?token=", "/?token=guess", f"/?{token}&token=guess", "/live?token=guess"):
            assert answer(path, **upgrade, **own) == 403, path
        for path in (f"/?{token}", f"/live?{token}"):
            assert answer(path, **upgrade, **own, Host="evil.example") == 403
            for origin in ("http://evil.example", "null", f"https://{host}", "http://localhost:1"):
                assert answer(path, **upgrade, Origin=origin) == 403
        assert answer(f"/live?{token}", **upgrade) == 403
        assert answer("/etc/passwd") == 404
        with pytest.raises(ConnectionRefusedError):
            socket.create_connection(("127.0.0.2", where.port), timeout=10)
        server.send_signal(signal.SIGTERM)
        assert server.wait(60) == 143


LOSES = """
import os, signal, pinocchio as pin
from aerobat_pin.errors import end_on_signals
from aerobat_pin.experiments import LiveSource
from aerobat_pin.visualization import serve_live

class Loses(LiveSource):
    def step(self):
        self.time += 1.0
        try:
            if self.time == 1.0:
                os.kill(os.getpid(), signal.SIGINT)
                sum(range(1_000_000))
        except KeyboardInterrupt:
            pass
        return []

end_on_signals()
model = pin.buildSampleModelManipulator()
source = Loses("an arm", model, ("effector_body",), "momentum", 50.0)
serve_live(source, print, str)
"""


def test_ctrl_c_that_a_library_loses_ends_it_all_the_same(here: Path) -> None:
    """An exception that a signal raises in a callback may be caught there; the page then lived on."""
    done = subprocess.run([sys.executable, "-c", LOSES], capture_output=True, text=True, timeout=60, check=False)
    assert (done.returncode, done.stderr) == (0, "")


def test_shapes_are_drawn_as_closed_surfaces() -> None:
    """Of known volumes, outward: boxes exactly, round ones a little less; a mesh of many triangles by its hull."""
    visual = pin.GeometryModel()
    shapes = {
        "box": (coal.Box(1.0, 2.0, 3.0), 6.0),
        "ball": (coal.Sphere(1.0), 4.0 / 3.0 * np.pi),
        "rod": (coal.Cylinder(0.5, 2.0), 0.5 * np.pi),
        "capsule": (coal.Capsule(0.5, 2.0), 0.5 * np.pi + np.pi / 6.0),
        "egg": (coal.Ellipsoid(1.0, 2.0, 0.5), 4.0 / 3.0 * np.pi),
        "cone": (coal.Cone(1.0, 3.0), np.pi),
    }
    for name, (shape, _) in shapes.items():
        visual.addGeometryObject(pin.GeometryObject(name, 0, pin.SE3.Identity(), shape))
    for part, (_, volume) in zip(live_parts(visual), shapes.values(), strict=True):
        points, faces = np.reshape(part["points"], (-1, 3)), np.reshape(part["faces"], (-1, 3))
        corners = points[faces]
        found = np.sum(np.linalg.det(corners)) / 6.0
        assert 0.8 * volume < found < 1.001 * volume  # a capsule ends in points


def test_what_lives_is_what_the_words_name(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """A scenario, a robot by its name or file, or a recording; each thing that is saved has a folder of its own."""
    served_sources: list[LiveSource] = []

    def serve(source: LiveSource, announce: object, save: Callable[[], str], port: int) -> None:
        served_sources.append(source)
        if isinstance(source, LiveRobot):
            source.advance(0.2, 100.0)
            assert Path(save()).name == ("live" if len(served_sources) == 1 else "live-2")

    monkeypatch.setattr("aerobat_pin.visualization.serve_live", serve)
    monkeypatch.setattr("aerobat_pin.visualization.write_figures_and_pages", lambda *_: None)
    robot, log, chosen = tmp_path / "quadruped.urdf", tmp_path / "log.csv", tmp_path / "map.toml"
    robot.write_text(urdf())
    table(walk(0.1)).to_csv(log, index=False)
    chosen.write_text(tomli_w.dumps(table_map(robot) | {"log": {"time": {"column": "t"}}, "check": {}}))
    out = ("--out", str(tmp_path / "live"))
    assert call("live", "double_pendulum", *out) == 0
    assert call("live", str(robot), "--points", "FL_FOOT, trunk", *out) == 2  # the trunk is held
    assert call("live", str(robot), "--points", "FL_FOOT", *out) == 0
    assert call("live", str(log), "--map", str(chosen), *out) == 0
    assert call("live", "--set", "air.strips=4", *out) == 0
    assert call("live", "paper", *out) == 2
    kinds = [type(one) for one in served_sources]
    assert kinds == [LiveRobot, LiveRobot, LiveRecording, LiveFlight]
    assert served_sources[1].points == ("FL_FOOT",)


def test_without_tornado_it_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(__import__("sys").modules, "tornado.web", None)
    with pytest.raises(ExtraError, match=r"aerobat-pinocchio\[live\]"):
        serve_live(LiveRobot("double_pendulum"), print, lambda: "")
