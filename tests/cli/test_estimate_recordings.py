"""`aerobat estimate --map`, `--suggest`, `convert` and `describe map`, as a user types them."""

import json
import re
import sys
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pandas as pd
import pytest
import tomli_w
from scipy.spatial.transform import Rotation
from support.commands import call
from support.walking_log import FEET, bag, table, table_map, urdf, walk

from aerobat_pin import load_aerobat, records
from aerobat_pin.experiments import read_run, write_flight_mcap
from aerobat_pin.records import open_by_map, parse_map

WALK = walk(1.0)
pytestmark = pytest.mark.usefixtures("unrendered")  # tests/estimation/test_legs.py looks at such figures


@pytest.fixture
def folder(here: Path) -> Path:
    """Return the current folder, with the quadruped, its walk and its map."""
    (here / "quadruped.urdf").write_text(urdf())
    table(WALK).to_csv(here / "walk.csv", index=False)
    (here / "map.toml").write_text(tomli_w.dumps(table_map(Path("quadruped.urdf"))))
    return here


def test_a_map_gives_every_file(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Forces, metrics scored against the sensor, report, replay, figures, and an MCAP file that can be read back."""
    highlevel = pytest.importorskip("rosbags.highlevel")
    words = ["estimate", "walk.csv", "--map", "map.toml", "--out", "out", "--out-mcap", "forces.mcap"]
    assert call(*words, "--points", "FL_FOOT,FR_FOOT,RL_FOOT,RR_FOOT") == 0
    said = capsys.readouterr().out
    assert re.search(r"force_level FL_FOOT Fz +(1\.0000|0\.9999)", said)
    metrics = json.loads((folder / "out" / "metrics.json").read_text())
    assert metrics["observers"]["force_level"]["FL_FOOT"]["Fz"]["r2"] > 0.999
    assert metrics["warnings"] == []
    with h5py.File(folder / "out" / "estimate.nc") as file:
        assert file["force_W"].shape == (1, 500, 4, 3)
    assert len(pd.read_csv(folder / "out" / "estimate.csv")) == 500
    for name in ("report.html", "replay.html", "map.toml"):
        assert (folder / "out" / name).stat().st_size > 200
    assert open_by_map(folder / "walk.csv", folder / "out" / "map.toml").robot.title == "quadruped"  # from there, too
    assert {"estimation.png", "motion.pdf"} <= {path.name for path in (folder / "out" / "figures").iterdir()}
    assert "http://" not in (folder / "out" / "report.html").read_text()
    with highlevel.AnyReader([folder / "forces.mcap"]) as reader:
        counts = {topic: info.msgcount for topic, info in reader.topics.items()}
        connection = next(one for one in reader.connections if one.topic == "/force/force_level/FL_FOOT")
        messages = [reader.deserialize(raw, connection.msgtype) for *_, raw in reader.messages([connection])]
        forces = [one.wrench.force.z for one in messages]
        scene = next(one for one in reader.connections if one.topic == "/scene")
        states = next(one for one in reader.connections if one.topic == "/joint_states")
        efforts = [reader.deserialize(raw, states.msgtype).effort for _, _, raw in reader.messages([states])]
        assert scene.msgtype == "foxglove_msgs/msg/SceneUpdate"  # the name by which Foxglove knows it
        updates = [(time, reader.deserialize(raw, scene.msgtype)) for _, time, raw in reader.messages([scene])]
    assert counts["/joint_states"] == counts["/pose"] == counts["/truth/FL_FOOT"] == 500
    assert counts["/arrows"] == counts["/scene"] == len(updates) > 15
    check_arrows(*updates[10])
    np.testing.assert_allclose(forces[20:], WALK.force[20:-1, 0, 2], atol=0.2)
    late = [np.std(np.array(efforts)[20:-20] - WALK.tau[20 + k : -21 + k]) for k in (-1, 0, 1)]
    assert late[1] < 0.2 * min(late[0], late[2])  # each effort is that of its stamp
    assert call(*words) == 2  # the folder is not empty
    words = ["estimate", "walk.csv", "--map", "map.toml", "--out", "again.MCAP"]
    (folder / "runs" / "walk-estimate").mkdir(parents=True)
    (folder / "runs" / "walk-estimate" / "report.html").write_text("of an earlier run")
    (folder / "runs" / "walk-estimate" / "estimate.nc").write_text("of an earlier run")
    assert call(*words) == 2
    assert call(*words, "--force") == 0
    assert (folder / "again.MCAP").is_file()
    assert "force_level" in (folder / "runs" / "walk-estimate" / "report.html").read_text()


def test_a_self_check_opens_the_record_once(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Its results come first, then those of the estimate."""
    opened: list[Path] = []

    def counted(log: Path, *rest: Any) -> records.Record:
        opened.append(log)
        return open_by_map(log, *rest)

    monkeypatch.setattr(records, "open_by_map", counted)
    assert call("estimate", "walk.csv", "--map", "map.toml", "--self-check") == 0
    said = capsys.readouterr().out
    assert said.index("self-check: 12 of 12 known forces") < said.index("force_level FL_FOOT Fz")
    assert opened == [Path("walk.csv")]


def check_arrows(time: int, update: Any) -> None:
    """Check that each foot has an arrow in a scene that points as its force does and is as long, on one scale."""
    arrows = {entity.id: entity.arrows[0] for entity in update.entities}
    assert set(arrows) == {f"/force/force_level/{foot}" for foot in FEET} | {"/truth/FL_FOOT"}
    at = int(np.argmin(np.abs(WALK.time - 1e-9 * time)))
    scales = []
    for k, foot in enumerate(FEET):
        arrow, force = arrows[f"/force/force_level/{foot}"], WALK.force[at, k]
        turn = arrow.pose.orientation
        along = Rotation.from_quat([turn.x, turn.y, turn.z, turn.w]).apply([1.0, 0.0, 0.0])
        size = float(np.linalg.norm(force))
        if size > 1.0:
            assert along @ force / size > 0.999
            scales.append((arrow.shaft_length + arrow.head_length) / size)
    np.testing.assert_allclose(scales, scales[0], rtol=0.02)


def test_a_suggested_map_is_a_map(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Of a table and of a bag; with its questions answered, it estimates, in whatever folder it is."""
    pytest.importorskip("rosbags")
    import tomllib

    bag(WALK, folder / "walk_bag")
    for log in ("walk.csv", "walk_bag"):
        assert call("estimate", log, "--suggest", "--urdf", "quadruped.urdf") == 0
        text = capsys.readouterr().out
        assert "#" in text
        suggested = parse_map(tomllib.loads(text), log)
        assert suggested.robot.root == "free_flyer"
        assert suggested.observer.gain == 100.0, "a fifth of the joints' 500 Hz"
        values = tomllib.loads(text)
        values["robot"]["points"] = list(FEET)
        if "wrench" in values["check"]:
            values["check"]["wrench"]["point"] = "FL_FOOT"
        (folder / "maps").mkdir(exist_ok=True)
        (folder / "maps" / "suggested.toml").write_text(tomli_w.dumps(values))
        assert call("estimate", log, "--map", "maps/suggested.toml", "--out", f"out_{log}") == 0
        found = json.loads((folder / f"out_{log}" / "metrics.json").read_text())["observers"]["force_level"]
        assert found["FL_FOOT"]["Fz"]["r2"] > 0.99
        capsys.readouterr()


@pytest.mark.parametrize("log", ["walk.csv", "walk_bag"])
def test_a_robot_without_a_map_is_told_what_to_do(log: str, folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """In one sentence, whatever the log is; it was told to name columns in a map that it did not have."""
    assert call("estimate", log, "--urdf", "quadruped.urdf", "--points", "FL_FOOT") == 2
    said = capsys.readouterr().err
    assert f"`aerobat estimate {log} --suggest --urdf quadruped.urdf` prints one to begin with" in said
    assert said.count("error: ") == 1


@pytest.mark.parametrize(
    "words",
    [("estimate", "no.csv", "--map", "map.toml", "--out-mcap", "x.mcap"), ("convert", "no_run", "--out", "x.mcap")],
)
def test_a_missing_extra_is_told_before_anything_is_read(
    words: tuple[str, ...], folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """It was told when all had been estimated and drawn."""
    monkeypatch.setitem(sys.modules, "mcap.writer", None)
    assert call(*words) == 2
    assert "x.mcap: writing MCAP needs the extra ros: pip install" in capsys.readouterr().err


def test_a_simulated_flight_becomes_mcap(here: Path) -> None:
    highlevel = pytest.importorskip("rosbags.highlevel")
    assert call("run", "paper", "--out", "flown", "--no-report", "--set", "simulation.duration=0.02") == 0
    assert call("convert", "flown", "--out", "paper.mcap") == 0
    with highlevel.AnyReader([here / "paper.mcap"]) as reader:
        assert {"/pose", "/joint_states", "/arrows", "/truth/left_force_point"} <= set(reader.topics)
    _, log, estimates = read_run(here / "flown")
    total = estimates.isel(point=[0]).assign_coords(point=["sum"])  # as of raw samples without torques
    write_flight_mcap(load_aerobat("aerobat_guard").model, log, total, here / "sum.mcap")
    with highlevel.AnyReader([here / "sum.mcap"]) as reader:
        assert "/force/momentum/sum" in reader.topics


def test_the_map_is_described(capsys: pytest.CaptureFixture[str]) -> None:
    assert call("describe", "map") == 0
    said = capsys.readouterr().out
    assert "[joints.friction]" in said
    assert "xyzw" in said
