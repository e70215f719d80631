"""`aerobat play`: served, as a page, as pictures; runs, logs and tables; and nothing left behind."""

import asyncio
import itertools
import shutil
import signal
import socket
import struct
import subprocess
import sys
import threading
import time
import urllib.error
import urllib.request
from pathlib import Path
from typing import Any

import numpy as np
import psutil
import pytest
from matplotlib.image import imread
from support.bad_inputs import AllAnswers
from support.bad_robots import ARM, SHAPE
from support.browser import at, needs_browser, node, opened, ready
from support.commands import call, interrupted, last_words, of_session, served

from aerobat_description import PACKAGE_PATH, URDF_PATH
from aerobat_pin.aerobat import FlightLog, write_csv
from aerobat_pin.errors import BrowserError, LogError
from aerobat_pin.experiments.experiment import Experiment
from aerobat_pin.visualization import replay_table, serve, snapshots


def sent_again(connection: socket.socket) -> int:
    """Return how many packets of a connection nobody confirmed at first: `tcpi_total_retrans` of Linux."""
    told = connection.getsockopt(socket.IPPROTO_TCP, socket.TCP_INFO, 104)
    return int(struct.unpack_from("I", told, 100)[0])


def test_a_run_is_served_until_it_is_stopped_and_nothing_stays(paper_folder: Path) -> None:
    """The address is printed and gives the page; one process alone; afterwards it is gone and its port is free."""
    with served("play", str(paper_folder), "--rate", "0.05") as (server, address):
        assert address.startswith("http://127.0.0.1:")
        with urllib.request.urlopen(address) as answer:
            page = answer.read().decode()
        assert "79 % thruster-borne" in page
        assert '"rate": 0.05' in page
        with pytest.raises(urllib.error.HTTPError, match="404"):
            urllib.request.urlopen(address + "etc/passwd")
        assert of_session(server.pid) == [str(server.pid)]
        server.send_signal(signal.SIGINT)
        assert server.wait() == 0
        assert of_session(server.pid) == []
        with socket.socket() as again:
            again.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            again.bind(("127.0.0.1", int(address.rstrip("/").rsplit(":", 1)[1])))


def test_a_hundred_clients_that_leave_early_do_not_end_the_server(tmp_path: Path) -> None:
    """Some close their connection while the page is on its way, some reset it, some leave before they have asked."""
    (tmp_path / "arm.urdf").write_text(ARM)
    motion = table(tmp_path, "time,hinge", [[0, 0], [1, 0]])
    with served("play", "--from-csv", str(motion), "--urdf", str(tmp_path / "arm.urdf")) as (server, address):
        host, port = address.removeprefix("http://").rstrip("/").split(":")
        asked = f"GET / HTTP/1.1\r\nHost: {host}:{port}\r\n\r\n".encode()
        for k in range(102):
            with socket.create_connection((host, int(port))) as client:
                client.sendall(asked[: 20 if k % 3 == 0 else None])
                if k % 2 == 0:
                    client.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))  # close resets
        with urllib.request.urlopen(address) as answer:
            assert answer.read().endswith(b"</html>")
        server.send_signal(signal.SIGTERM)
        assert server.wait() == 143


def test_a_page_is_served_at_its_own_address_only_and_beside_300_idle_connections() -> None:
    """A name of a foreign site can lead here, but its requests name that site; whoever says nothing is cut."""
    addresses: list[str] = []
    threading.Thread(target=serve, args=("the page", addresses.append), daemon=True).start()
    while not addresses:
        time.sleep(0.01)
    for host, status in ((None, 200), ("localhost:{}", 200), ("evil.example", 403), ("127.0.0.1", 403), ("", 403)):
        asked = urllib.request.Request(addresses[0])
        port = asked.host.rpartition(":")[2]
        if host is not None:
            asked.add_header("Host", host.format(port))
        answer = urllib.request.build_opener(AllAnswers).open(asked)
        assert (answer.status, answer.read() == b"the page") == (status, status == 200)
    for twice in (f"Host: 127.0.0.1:{port}\r\nHost: evil.example", f"Host : evil\r\nHost: 127.0.0.1:{port}"):
        with socket.create_connection(("127.0.0.1", int(port))) as client:
            client.sendall(f"GET / HTTP/1.0\r\n{twice}\r\n\r\n".encode())
            assert client.makefile("rb").readline().split()[1] == b"403"
    before = threading.active_count()
    idle = [socket.create_connection(("127.0.0.1", int(port))) for _ in range(300)]
    assert sum(map(sent_again, idle)) < 5  # 36 where few can wait to be accepted: a second each
    for one in idle[::3]:
        one.sendall(b"GET / HT")
    with urllib.request.urlopen(addresses[0]) as answer:
        assert answer.read() == b"the page"
    assert threading.active_count() < before + 100
    for one in idle:
        one.close()


def test_importing_opens_no_port_and_writes_no_file(tmp_path: Path) -> None:
    modules = "any_robot, moving_page, flight_replay, scene, serve, snapshots"
    code = f"""
import os
import aerobat_pin.cli
from aerobat_pin.visualization.replay import {modules}
sockets = {{os.readlink(f'/proc/self/fd/{{fd}}')[8:-1] for fd in os.listdir('/proc/self/fd')
           if os.path.islink(f'/proc/self/fd/{{fd}}') and os.readlink(f'/proc/self/fd/{{fd}}').startswith('socket:')}}
rows = [row.split() for name in ('tcp', 'tcp6') for row in open(f'/proc/self/net/{{name}}').readlines()[1:]]
print([row[1] for row in rows if row[9] in sockets])
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=tmp_path, check=True)
    assert done.stdout.strip() == "[]"
    assert list(tmp_path.iterdir()) == []


def test_runs_and_logs_become_pages(paper_folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The run's page is the run's own replay but for random names; a log is estimated on the way."""
    run, log = tmp_path / "run.html", tmp_path / "log.html"
    assert call("play", str(paper_folder), "--out", str(run)) == 0
    assert f"written to {run}" in capsys.readouterr().out
    assert len(run.read_text()) == pytest.approx(len((paper_folder / "replay.html").read_text()), rel=1e-3)
    assert call("play", str(paper_folder / "flight.nc"), "--out", str(log)) == 0
    assert "recorded flight of 2 s" in log.read_text()
    assert "estimated force (momentum)" in log.read_text()
    assert call("play", str(paper_folder), "--out", str(run)) == 2
    assert "--force overwrites it" in capsys.readouterr().err
    assert call("play", str(paper_folder), "--out", str(run), "--force") == 0


def test_a_recorded_table_is_played_by_the_robot_believed_to_have_flown_it(paper: Experiment, tmp_path: Path) -> None:
    """A table notes no robot: `--morphology` says it, as for `aerobat estimate`, else it is the default one."""
    short = paper.log.measured.isel(time=slice(201), interval=slice(200))
    write_csv(FlightLog(short), tmp_path / "log.csv")
    for words, name in (([], "aerobat"), (["--morphology", "aerobat_guard"], "aerobat_guard")):
        page = tmp_path / f"{name}.html"
        assert call("play", str(tmp_path / "log.csv"), "--out", str(page), *words) == 0
        assert f"believed robot {name}</title>" in page.read_text()


@needs_browser
def test_pictures_have_the_rate_asked(paper_folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Two seconds at 20 times their speed are three pictures; old ones do not stay; the time is all of the controls."""
    out = tmp_path / "frames"
    arguments = [str(paper_folder), "--frames", str(out), "--rate"]
    assert call("play", *arguments, "30") == 0
    assert "2 pictures, 30 a second" in capsys.readouterr().out
    arguments += ["20"]
    assert call("play", *arguments) == 2
    assert "is not empty" in capsys.readouterr().err
    (out / "frame_00099.png").write_text("of an earlier run")
    (out / "notes.txt").write_text("mine")
    assert call("play", *arguments, "--force") == 0
    assert "3 pictures, 30 a second" in capsys.readouterr().out
    names = [f"frame_{k:05d}.png" for k in range(3)]
    assert sorted(path.name for path in out.iterdir()) == [*names, "notes.txt"]
    images = [imread(out / name)[..., :3] for name in names]
    assert all(image.shape == (720, 1280, 3) and image.std() > 0.05 for image in images)
    for before, after in itertools.pairwise(images):
        assert np.mean(np.abs(after - before).max(axis=2) > 0.1) > 0.003
    assert all(image[-60:, 150:600].max(axis=(0, 1)).min() < 0.95 for image in images)  # where white controls would be
    for before, after in itertools.pairwise(image[-50:-20, 20:110] for image in images):
        assert before.max(axis=(0, 1)).min() > 0.95  # a panel
        assert before.min() < 0.5  # and dark digits
        assert np.mean(np.abs(after - before).max(axis=2) > 0.1) > 0.003  # that change


@needs_browser
def test_pictures_are_taken_beside_a_running_loop_and_may_be_left(paper_folder: Path, browser: Any) -> None:
    """As in a notebook; whoever wants no more of them leaves no browser behind."""

    def children() -> set[str]:
        return {str(child.pid) for child in psutil.Process().children()}

    assert asyncio.get_running_loop().is_running()  # the other browser's
    before = children()
    pictures = snapshots((paper_folder / "replay.html").read_text(), [0.1, 0.2, 0.3], (200, 150))
    assert next(pictures).startswith(b"\x89PNG")
    assert children() - before
    pictures.close()
    assert children() <= before


@needs_browser
def test_ctrl_c_among_pictures_leaves_a_line_and_nothing_else(paper_folder: Path, tmp_path: Path) -> None:
    """Exit code 130; neither the pictures that were taken nor the page."""
    words = ["play", str(paper_folder), "--frames", "frames", "--out", "page.html", "--rate", "0.001"]
    done = interrupted(*words, cwd=tmp_path, at=".aerobat-frames/new/frame_00002.png")
    assert (done.returncode, done.stdout, last_words(done)) == (130, "", "interrupted: nothing was written\n")
    assert list(tmp_path.iterdir()) == []


def test_without_a_browser_the_error_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    """Without Playwright, and without a Chromium that starts."""
    monkeypatch.setitem(sys.modules, "playwright.sync_api", None)
    with pytest.raises(BrowserError, match=r"pip install 'aerobat-pinocchio\[frames\]'.*apt-get install chromium"):
        next(snapshots("", [0.0]))
    monkeypatch.undo()
    monkeypatch.setattr(shutil, "which", lambda name: sys.executable)
    with pytest.raises(BrowserError, match=r"none starts.*apt-get install chromium"):
        next(snapshots("", [0.0]))


def table(folder: Path, header: str, rows: Any) -> Path:
    np.savetxt(folder / "motion.csv", rows, delimiter=",", header=header, comments="")
    return folder / "motion.csv"


@needs_browser
def test_any_table_moves_any_robot(tmp_path: Path, browser: Any) -> None:
    """A hinge that turns by a quarter in two seconds, pushed at its bar; fixed, and on a free base."""
    (tmp_path / "arm.urdf").write_text(ARM.replace("<visual>", '<visual><origin xyz="0 0 0.5"/>'))
    clock, angle = np.linspace(5.0, 7.0, 41), np.linspace(0.0, 0.5 * np.pi, 41)
    still = np.zeros_like(angle)
    header = "time [s], hinge [rad], bar.Fx [N], bar.Fy [N], bar.Fz [N]"
    rows = np.column_stack([clock, angle, 10.0 + still, still, still])
    fixed, out = table(tmp_path, header, rows), tmp_path / "arm.html"
    urdf = str(tmp_path / "arm.urdf")
    assert call("play", "--from-csv", str(fixed), "--urdf", urdf, "--out", str(out)) == 0
    with opened(browser, out.as_uri()) as page:
        ready(page)
        assert page.evaluate("viewer.animator.mixer.timeScale") == 1.0
        at(page, 2.0)
        assert node(page, "robot", "visuals", "bar_0")["position"] == pytest.approx([0.5, 0.0, 0.0], abs=1e-6)
        assert node(page, "force", "force", "bar", "head")["position"][0] > 0.1
        assert page.inner_text("#clock") == "7.000 s"
    base = np.column_stack([clock, 3.0 * (clock - 5.0), still, still, still, still, still, 1.0 + still])
    free = replay_table(table(tmp_path, "time,x,y,z,qx,qy,qz,qw,hinge", np.column_stack([base, angle])), Path(urdf))
    assert free.model.nq == 8
    assert "path of the body" in free.html()


def test_the_robots_own_urdf_finds_its_meshes(tmp_path: Path) -> None:
    """Beside it or where `package://` points to."""
    q = np.hstack([np.zeros((3, 6)), np.ones((3, 1)), np.zeros((3, 4))])
    names = "time,x,y,z,qx,qy,qz,qw,left_elbow,left_shoulder,right_elbow,right_shoulder"
    motion = table(tmp_path, names, np.column_stack([[0.0, 0.1, 0.2], q]))
    found = replay_table(motion, Path(URDF_PATH))
    assert found.size == pytest.approx(0.25, abs=0.08)  # half of some 0.4 m of span and 0.2 m of length
    assert Path(URDF_PATH).is_relative_to(PACKAGE_PATH)


def test_meshes_are_found_however_far_above_and_where_ros_says(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """A package beside the sixth folder up, or elsewhere by ROS_PACKAGE_PATH; else the message names both."""
    monkeypatch.delenv("ROS_PACKAGE_PATH", raising=False)
    deep = tmp_path / "a" / "b" / "c" / "d" / "e" / "f"
    deep.mkdir(parents=True)
    mesh = '<mesh filename="package://bird/body.stl"/>'
    (deep / "arm.urdf").write_text(ARM.replace(SHAPE, mesh))
    motion = table(tmp_path, "time,hinge", [[0, 0], [1, 0]])
    with pytest.raises(LogError, match=r"bird/body\.stl: a file .* package\.xml, .* or in one of ROS_PACKAGE_PATH"):
        replay_table(motion, deep / "arm.urdf")
    for place in (tmp_path, tmp_path / "elsewhere"):
        (place / "bird").mkdir(parents=True)
        if place == tmp_path:
            (place / "bird" / "package.xml").touch()
        shutil.copy(Path(PACKAGE_PATH) / "meshes" / "aerobat_body.stl", place / "bird" / "body.stl")
        assert replay_table(motion, deep / "arm.urdf").visual_model.ngeoms == 1
        shutil.rmtree(place / "bird")
        monkeypatch.setenv("ROS_PACKAGE_PATH", str(tmp_path / "elsewhere"))
