"""The node of docs/recordings.md runs with recorded messages; currents become torques by one constant."""

from __future__ import annotations

import re
import sys
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np
import pytest
import tomli_w
from support.pages import ROOT
from support.walking_log import bag, bag_map, table, table_map, urdf, walk

from aerobat_pin.errors import MapError
from aerobat_pin.estimation import estimate
from aerobat_pin.records import open_record, parse_map
from aerobat_pin.records.messages import stamp


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return the current folder, with the quadruped's URDF."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "quadruped.urdf").write_text(urdf())
    return tmp_path


class Wrench(SimpleNamespace):
    """A message as a ROS client library makes it."""

    def __init__(self) -> None:
        header = SimpleNamespace(frame_id="", stamp=SimpleNamespace(sec=0, nanosec=0))
        super().__init__(header=header, wrench=SimpleNamespace(force=SimpleNamespace()))


class Node:
    """What the example needs of `rclpy.node.Node`."""

    def __init__(self, name: str) -> None:
        self.callbacks: dict[str, Any] = {}
        self.published: dict[str, list[Wrench]] = {}

    def create_subscription(self, kind: Any, topic: str, callback: Any, depth: int) -> None:
        """Keep who hears a topic."""
        self.callbacks[topic] = callback

    def create_publisher(self, kind: Any, topic: str, depth: int) -> SimpleNamespace:
        """Return what keeps what is published."""
        return SimpleNamespace(publish=self.published.setdefault(topic, []).append)


def test_the_node_of_the_docs_publishes_the_forces(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its text as it stands, with recorded messages in the order of their stamps."""
    highlevel = pytest.importorskip("rosbags.highlevel")
    bag(walk(), folder / "walk")
    values = bag_map(Path("quadruped.urdf"))
    del values["check"]
    (folder / "map.toml").write_text(tomli_w.dumps(values))
    with highlevel.AnyReader([folder / "walk"]) as reader:
        messages = [
            (connection.topic, reader.deserialize(raw, connection.msgtype)) for connection, _, raw in reader.messages()
        ]
    spun: list[Node] = []

    def spin(node: Node) -> None:
        spun.append(node)
        for topic, message in sorted(messages, key=lambda item: stamp(item[1])):
            callback = node.callbacks.get(topic)
            if callback is not None:
                callback(message)

    names = {
        "rclpy": {"init": lambda: None, "spin": spin},
        "rclpy.node": {"Node": Node},
        "geometry_msgs.msg": {"WrenchStamped": Wrench},
        "nav_msgs.msg": {"Odometry": object},
        "sensor_msgs.msg": {"Imu": object, "JointState": object},
    }
    for name, content in names.items():
        for part in {name, name.partition(".")[0]}:
            module = ModuleType(part)
            vars(module).update(content if part == name else {})
            if part == name or part not in names:
                monkeypatch.setitem(sys.modules, part, module)
    text = (ROOT / "docs" / "recordings.md").read_text()
    node = next(code for code in re.findall(r"```python\n(.*?)```", text, re.DOTALL) if "rclpy" in code)
    exec(node, {})
    published = spun[0].published["/force/FL_FOOT"]
    assert len(published) > 1400
    middle = np.array([one.header.stamp.sec + 1e-9 * one.header.stamp.nanosec for one in published]) - 1.7e9
    truth = np.interp(middle, walk().time, walk().force[:, 0, 2])
    np.testing.assert_allclose([one.wrench.force.z for one in published[100:]], truth[100:], atol=1.0)


def test_currents_of_all_joints_have_one_constant(folder: Path) -> None:
    """Of each unit that the map states, A or mA; `*` stands for every joint; a foreign name does not."""
    frame, values = table(walk()), table_map(Path("quadruped.urdf"))
    columns = values["joints"]["effort"]["columns"]
    frame.assign(**{name: frame[name] / 3.0 for name in columns}).to_csv("walk.csv", index=False)
    values["joints"]["effort"] |= {"unit": "A", "torque_per_unit": {"*": 3.0}}
    found = estimate(open_record(Path("walk.csv"), parse_map(values, "of the test"), folder))
    assert found.warnings == []
    frame.assign(**{name: 1e3 * frame[name] / 3.0 for name in columns}).to_csv("walk.csv", index=False)
    values["joints"]["effort"] |= {"unit": "mA", "torque_per_unit": {"*": 0.003}}
    again = estimate(open_record(Path("walk.csv"), parse_map(values, "of the test"), folder))
    np.testing.assert_allclose(again.estimates["force_level"].force, found.estimates["force_level"].force, atol=1e-9)
    values["joints"]["effort"]["torque_per_unit"] = {"knee": 3.0}
    with pytest.raises(MapError, match=r"torque_per_unit: no joint 'knee'"):
        estimate(open_record(Path("walk.csv"), parse_map(values, "of the test"), folder))
