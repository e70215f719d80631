"""The stream of docs/recordings.md runs with recorded messages; currents become torques by one constant."""

import re
from pathlib import Path

import numpy as np
import pytest
import tomli_w
from support.pages import ROOT
from support.recorded import recorded
from support.walking_log import bag, bag_map, table, table_map, urdf, walk

from aerobat_pin.errors import MapError
from aerobat_pin.estimation import estimate
from aerobat_pin.records.messages import stamp


@pytest.fixture
def folder(here: Path) -> Path:
    """Return the current folder, with the quadruped's URDF."""
    (here / "quadruped.urdf").write_text(urdf())
    return here


def test_the_stream_of_the_docs_finds_the_forces(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
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
    text = (ROOT / "docs" / "recordings.md").read_text()
    [stream] = [code for code in re.findall(r"```python\n(.*?)```", text, re.DOTALL) if "OnlineEstimator" in code]
    exec(stream, {"messages": sorted(messages, key=lambda item: stamp(item[1]))})
    said = re.findall(r"^([\d.]+) .*'FL_FOOT.Fz': ([-\d.]+),.* True$", capsys.readouterr().out, re.MULTILINE)
    assert len(said) > 1400
    end, force = np.array(said, float).T
    np.testing.assert_allclose(force[100:], np.interp(end - 1.7e9, walk().time, walk().force[:, 0, 2])[100:], atol=1.0)


def test_currents_of_all_joints_have_one_constant(folder: Path) -> None:
    """Of each unit that the map states, A or mA; `*` stands for every joint; a foreign name does not."""
    frame, values = table(walk()), table_map(Path("quadruped.urdf"))
    columns = values["joints"]["effort"]["columns"]
    frame.assign(**{name: frame[name] / 3.0 for name in columns}).to_csv("walk.csv", index=False)
    values["joints"]["effort"] |= {"unit": "A", "torque_per_unit": {"*": 3.0}}
    found = estimate(recorded(Path("walk.csv"), values))
    assert found.warnings == []
    frame.assign(**{name: 1e3 * frame[name] / 3.0 for name in columns}).to_csv("walk.csv", index=False)
    values["joints"]["effort"] |= {"unit": "mA", "torque_per_unit": {"*": 0.003}}
    again = estimate(recorded(Path("walk.csv"), values))
    np.testing.assert_allclose(again.estimates["force_level"].force, found.estimates["force_level"].force, atol=1e-9)
    values["joints"]["effort"]["torque_per_unit"] = {"knee": 3.0}
    with pytest.raises(MapError, match=r"torque_per_unit: no joint 'knee'"):
        estimate(recorded(Path("walk.csv"), values))
