"""`aerobat node` with real ROS 2: forces, contacts and health of a walk, over the network of this machine."""

import importlib.util
import json
import os
import signal
import subprocess
import sys
import tomllib
from pathlib import Path
from unittest.mock import MagicMock

import numpy as np
import pytest
import tomli_w
from support.pages import ROOT
from support.walking_log import FEET, bag_map, urdf, walk

from aerobat_pin.errors import ExtraError, MapError
from aerobat_pin.estimation import OnlineEstimator, OnlineSample
from aerobat_pin.experiments import ForceNode, LiveRow, LiveTopics
from aerobat_pin.forces.contacts import END_SHARE, ONSET_SHARE, ContactWatch, touching
from aerobat_pin.records import load_map, parse_map

SAMPLES = 600  # `make evidence` publishes for minutes
BEGIN = 1_700_000_000.0


@pytest.fixture
def chosen(tmp_path: Path) -> Path:
    """Return the map of the walk's topics, in a folder with the robot."""
    (tmp_path / "quadruped.urdf").write_text(urdf())
    values = bag_map(Path("quadruped.urdf"))
    del values["check"]
    values["observer"] = {"names": ["momentum"], "gain": 1000.0}
    (tmp_path / "map.toml").write_text(tomli_w.dumps(values))
    return tmp_path / "map.toml"


def streamed(chosen: Path) -> list[OnlineSample]:
    """Return what a stream makes of the same numbers, without ROS."""
    walked, stream, found = walk(), OnlineEstimator(load_map(chosen), chosen.parent), []
    for k, t in enumerate((BEGIN + walked.time[:SAMPLES]).tolist()):
        whole = round((t - BEGIN) * 1e9)
        stamp = BEGIN + whole // 10**9 + 1e-9 * (whole % 10**9)
        q, v, turn = walked.q[k], walked.v[k], dict(zip("xyzw", walked.q[k, 3:7], strict=True))
        values = {f"/joint_states.position.{name}": x for name, x in zip(walked.joints, q[7:], strict=True)}
        values |= {f"/joint_states.velocity.{name}": x for name, x in zip(walked.joints, v[6:], strict=True)}
        values |= {f"/joint_states.effort.{name}": x for name, x in zip(walked.joints, walked.tau[k], strict=True)}
        values |= {f"/imu.angular_velocity.{axis}": x for axis, x in zip("xyz", v[3:6], strict=True)}
        if k % 2 == 0:
            values |= {f"/odom.position.{axis}": x for axis, x in zip("xyz", q[:3], strict=True)}
            values |= {f"/odom.orientation.{axis}": x for axis, x in turn.items()}
            values |= {f"/odom.linear.{axis}": x for axis, x in zip("xyz", v[:3], strict=True)}
        found += stream.push(stamp, values)
    return found


@pytest.mark.skipif(importlib.util.find_spec("rclpy") is None, reason="no package of ROS 2 for this Python and system")
def test_a_node_loses_nothing_and_says_what_the_stream_says(chosen: Path) -> None:
    """At 500 Hz over three topics with Unix stamps: every sample is taken, forces are equal to the bit."""
    here = dict(os.environ, ROS_DOMAIN_ID=str(os.getpid() % 100 + 1), ROS_AUTOMATIC_DISCOVERY_RANGE="LOCALHOST")
    here["PYTHONPATH"] = os.pathsep.join([str(ROOT), str(ROOT / "tests")])
    expected = streamed(chosen)  # compiles what the node needs
    command = [sys.executable, "-m", "aerobat_pin", "node", "--map", str(chosen), "--name", "forces"]
    node = subprocess.Popen(command, env=here, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    try:
        program, out = ROOT / "tests" / "support" / "ros_walk.py", chosen.parent / "out.json"
        talk = [sys.executable, str(program), "forces", str(out), "500", str(SAMPLES), "100"]
        subprocess.run(talk, env=here, check=True, timeout=400, capture_output=True)
    finally:
        node.send_signal(signal.SIGINT)
        said, errors = node.communicate(timeout=60)
    assert node.returncode == 0, errors
    assert f"{len(expected)} estimates, 1 starts\n" in said
    assert "hears /odom (nav_msgs/msg/Odometry)" in said
    found = json.loads(out.read_text())
    for foot in FEET:
        forces = np.array(found["forces"][foot])
        wanted = [[one.components[f"{foot}.F{axis}"] for axis in "xyz"] for one in expected]
        np.testing.assert_array_equal(forces[:, 1:], wanted)
        np.testing.assert_allclose(forces[:, 0] * 500.0, np.round(forces[:, 0] * 500.0), rtol=0.0, atol=1e-9)
        np.testing.assert_allclose(forces[:, 0], [one.end - BEGIN for one in expected], rtol=0.0, atol=3e-7)
    weight = 9.81 * 9.6
    up = np.array([[one.components[f"{foot}.Fz"] for foot in FEET] for one in expected])
    stands = map(ContactWatch(weight).take, up)
    assert found["contacts"] == [[foot for foot, on in zip(FEET, row, strict=True) if on] for row in stands]
    counts = {key: int(value) for key, value in found["health"].items()}
    assert counts["estimates"] == len(expected) >= SAMPLES - 3
    assert [counts[fate] for fate in ("refused", "duplicate", "late", "outlier", "clock_step", "failed")] == [0] * 6


@pytest.mark.skipif(importlib.util.find_spec("rclpy") is None, reason="no package of ROS 2 for this Python and system")
def test_a_live_page_hears_topics(chosen: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The node within it publishes as ever; the page has every estimate, equal to the bit, and the robot's pose."""
    monkeypatch.setenv("ROS_DOMAIN_ID", str(os.getpid() % 100 + 102))
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(ROOT), str(ROOT / "tests")]))
    expected, said, rows = streamed(chosen), list[str](), list[LiveRow]()
    live = LiveTopics(load_map(chosen), chosen.parent, said.append)
    program, out = ROOT / "tests" / "support" / "ros_walk.py", chosen.parent / "out.json"
    with subprocess.Popen([sys.executable, str(program), "aerobat", str(out), "500", str(SAMPLES), "100"]) as talk:
        while talk.poll() is None:
            rows += live.advance(0.04, 0.02)
    live.close()
    assert len(said) == 3
    wanted = np.array([list(one.components.values()) for one in expected]).reshape(-1, len(FEET), 3)
    np.testing.assert_array_equal([row.estimate for row in rows], wanted)
    assert np.isnan(rows[0].true).all()
    np.testing.assert_allclose(live.q[7:], walk().q[SAMPLES - 2, 7:], atol=1e-2)


def test_a_contact_is_known_live_where_it_reaches_its_size() -> None:
    """Its end is that of a record; its onset is later, by the time between 4 and 8 % of the weight."""
    rng, weight = np.random.default_rng(4), 100.0
    force = weight * rng.uniform(0.5 * END_SHARE, 1.5 * ONSET_SHARE, (400, 3))
    watch = ContactWatch(weight)
    live, whole = np.array([watch.take(row) for row in force]).T, np.array([touching(up, weight) for up in force.T])
    assert np.all(force.T[whole & ~live] < ONSET_SHARE * weight)
    ends, others = (np.diff(on.astype(int), axis=1) < 0 for on in (live, whole))
    np.testing.assert_array_equal(ends, others)
    assert ends.sum() > 100
    assert np.all(whole >= live)


def test_a_map_with_columns_is_no_map_of_a_node(chosen: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """It would have waited for a topic of that name for ever; ROS itself is a stand-in here."""
    for name in ("rclpy", "rclpy.qos", "rclpy.signals", "geometry_msgs.msg", "sensor_msgs.msg", "diagnostic_msgs.msg"):
        monkeypatch.setitem(sys.modules, name, MagicMock())
    values = tomllib.loads(chosen.read_text())
    values["base"]["rate"] = {"columns": ["gyro_x", "gyro_y", "gyro_z"]}
    with pytest.raises(MapError, match=r"'gyro_x' is a column: a node hears topics, such as topic = "):
        ForceNode(parse_map(values, "of the test"), chosen.parent, print)


def test_without_ros_the_command_says_what_to_install(chosen: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Before anything is compiled."""
    monkeypatch.setitem(sys.modules, "rclpy", None)
    with pytest.raises(ExtraError, match=r"node: rclpy cannot be imported .*'aerobat-pinocchio\[ros2\]'"):
        ForceNode(load_map(chosen), chosen.parent, print)
