"""Recordings of any robot: the right map gives the right forces, and every wrong one is refused or named."""

import os
import re
import struct
import zlib
from ast import literal_eval
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pandas as pd
import pinocchio as pin
import pytest
import tomli_w
from scipy.spatial.transform import Rotation
from support.drone import DRAG, MAP, drag_slopes, flight, plain_force
from support.further import further
from support.pages import ROOT
from support.recorded import edited, recorded
from support.robot_parts import channels, efforts, joint, link
from support.walking_log import bag, bag_map, table, table_map, urdf, walk

from aerobat_pin import open_record
from aerobat_pin.aerobat import needs_map
from aerobat_pin.errors import AerobatError, LogError, MapError, OutputError
from aerobat_pin.estimation import OnlineEstimator, Result, calibrate, estimate, record_findings
from aerobat_pin.estimation.checks.agreement import accelerometer_findings, agreement_findings, read_attitudes
from aerobat_pin.estimation.checks.result import fit_findings
from aerobat_pin.experiments.write_mcap import McapStretch, write_mcap_stretches
from aerobat_pin.forces.fit_known_forces import fitted_forces
from aerobat_pin.forces.known_forces import Fit, FittedValues, KnownForces
from aerobat_pin.numerics import compare_series
from aerobat_pin.records import (
    Agreement,
    LogTable,
    Record,
    Spool,
    load_map,
    mcap_is_sealed,
    parse_map,
    read_columns,
    stamp,
    suggested_map,
)
from aerobat_pin.records.bag_columns import _Topic
from aerobat_pin.records.resample import line_means, turn_rates

Change = Callable[[pd.DataFrame], pd.DataFrame]


def estimated(log: Path, values: dict[str, Any]) -> Result:
    """Return the estimate of a log whose robot lies beside it."""
    return estimate(recorded(log, values))


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Return a folder with the quadruped's URDF."""
    (tmp_path / "quadruped.urdf").write_text(urdf())
    return tmp_path


@pytest.fixture(scope="module")
def bagged(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with the quadruped's URDF and the bag of its walk."""
    path = tmp_path_factory.mktemp("bagged")
    (path / "quadruped.urdf").write_text(urdf())
    bag(walk(2.0), path / "walk")
    return path


def foot_errors(found: Result, begin: float) -> np.ndarray:
    """Return the rms error (12,) [N] of the feet, but for the filter's first time constants."""
    walked, estimate = walk(2.0), found.estimates["force_level"]
    middle = 0.5 * (estimate.time[1:] + estimate.time[:-1]) - begin
    truth = np.stack([np.interp(middle, walked.time, column) for column in walked.force.reshape(-1, 12).T], axis=1)
    good = middle > middle[0] + 0.02
    return np.asarray(np.sqrt(np.mean((estimate.components - truth)[good] ** 2, axis=0)))


def test_a_table_gives_the_feet_their_forces(folder: Path) -> None:
    """Within 0.035 N at 25 N, a third of what is stated, and no check finds anything."""
    table(walk(2.0)).to_csv(folder / "walk.csv", index=False)
    found = estimated(folder / "walk.csv", table_map(folder / "quadruped.urdf"))
    assert np.max(foot_errors(found, 0.0)) < 0.035
    assert found.warnings == []
    score = found.observers["force_level"].points["FL_FOOT"]["Fz"]
    assert score.r2 > 0.9999
    assert score.factor == pytest.approx(1.0, abs=1e-3)


def test_the_weight_is_expected_where_known_forces_do_not_carry_it(folder: Path) -> None:
    """A known pull of a twentieth of it leaves the rest to the feet."""
    table(walk(1.0)).assign(hx=3.0, hy=0.0, hz=3.0).to_csv(folder / "walk.csv", index=False)
    handle = {"handle": {"columns": ["hx", "hy", "hz"], "axes": "world"}}
    found = estimated(folder / "walk.csv", {**table_map(folder / "quadruped.urdf"), "known": handle})
    assert [each.verdict for each in found.findings if each.check == "mean force"] == ["good"]


@pytest.mark.parametrize(("tilt", "words"), [(91.0, "is the log's y axis up"), (170.0, "up is down")])
def test_a_world_on_its_side_is_asked_for_its_axes(tilt: float, words: str) -> None:
    """Of a body at rest."""
    up = 9.81 * np.array([0.0, np.sin(np.radians(tilt)), np.cos(np.radians(tilt))])
    still, attitude = np.zeros((50, 3)), np.tile([0.0, 0.0, 0.0, 1.0], (50, 1))
    (found,) = accelerometer_findings(still + up, attitude, still, np.arange(50) / 50.0, 9.81, 100.0)
    assert found.verdict == "refused"
    assert words in found.text


def test_an_accelerometer_without_gravity_is_told_so(tmp_path: Path) -> None:
    """As phones and some drivers give it; "up is down: log.world or base.axes" was said, or "g is read as m/s2"."""
    log = flight(seconds=6.0)
    felt, R = [f"imu_acc_{axis}" for axis in "xyz"], Rotation.from_quat(log[["qx", "qy", "qz", "qw"]])
    for gravity, said in ((0.0, ""), (1.0, "gravity seems to be taken off it")):
        without = log.copy()
        without[felt] -= gravity * R.inv().apply([0.0, 0.0, 1.0])
        found = record_findings(recorded(tmp_path / "log.csv", MAP, table=without))
        told = [one for one in found if one.check == "accelerometer against gravity"]
        assert [(one.verdict, said in one.text) for one in told] == [("warning" if said else "good", True)]


def test_vibration_of_several_g_takes_no_gravity_off_an_accelerometer() -> None:
    """Its mean was 1 of gravity, "its median is 4.07 of gravity, ...: gravity seems to be taken off it"."""
    time, up = np.arange(1000) / 500.0, np.array([0.0, 0.0, 9.81])
    still, attitude = np.zeros((1000, 3)), np.tile([0.0, 0.0, 0.0, 1.0], (1000, 1))
    felt = up * (1.0 + 6.0 * np.sin(2.0 * np.pi * 20.0 * time))[:, None]
    (found,) = accelerometer_findings(felt, attitude, still, time, 9.81, 100.0)
    assert found.verdict == "good"
    (found,) = accelerometer_findings(felt - up, attitude, still, time, 9.81, 100.0)
    assert "gravity seems to be taken off it" in found.text


def test_a_bag_by_its_headers_and_by_its_recorder(bagged: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Topics at their own rates: 0.1 N by the sensors' stamps; by the recorder's, a warning names the 3 ms."""
    monkeypatch.setattr("aerobat_pin.records.bag_columns.REORDERED", 100)  # as of a long bag
    found = estimated(bagged / "walk", bag_map(bagged / "quadruped.urdf"))
    assert np.max(foot_errors(found, 1.7e9)) < 0.1
    assert found.warnings == []
    one_file = bagged / "WALK.MCAP"  # as some recorders and file systems write it
    one_file.write_bytes(next((bagged / "walk").glob("*.mcap")).read_bytes())
    late = estimated(one_file, bag_map(bagged / "quadruped.urdf", "recorder"))
    assert np.max(foot_errors(late, 1.7e9)) > 0.3
    assert any(re.search(r"recorder clock: /joint_states: .* 3\.0 ms late", text) for text in late.warnings)
    assert not any("another clock" in text for text in late.warnings)
    monkeypatch.setattr(
        "aerobat_pin.estimation.checks.samples.CLOCK_DELAY", 1.0
    )  # as of a recorder that is hardly late
    punctual = record_findings(recorded(one_file, bag_map(bagged / "quadruped.urdf", "recorder")))
    assert {each.text[-14:] for each in punctual if each.check == "recorder clock"} == {"these are used"}
    missing = bag_map(bagged / "quadruped.urdf") | {"joints": {"topic": "/joint_stats"}}
    with pytest.raises(LogError, match=r"no topic '/joint_stats', which joints\.topic .*did you mean '/joint_states'"):
        recorded(bagged / "walk", missing)


@pytest.mark.parametrize("clock", ["header", "recorder"])
def test_messages_before_the_first_stamp_are_left_out(clock: str, folder: Path) -> None:
    """Where the first message had none, all of its topic had the recorder's stamps, 3 ms late, without a word."""
    bag(walk(0.5), folder / "early", unstamped=0.011)
    record = recorded(folder / "early", bag_map(folder / "quadruped.urdf", clock))
    clocks = record.log.clocks if record.log else {}
    first, off = (1.7e9 + 0.012, 6) if clock == "header" else (1.7e9 + 0.003, 0)
    assert clocks["/joint_states"].time[0] == pytest.approx(first, abs=4e-3 if off == 0 else 1e-6)
    assert (clocks["/joint_states"].off, clocks["/odom"].off) == (off, off // 2)
    assert (clocks["/imu"].late is not None) == (clock == "header")


def test_a_topic_whose_first_messages_have_no_stamp_has_one_clock(monkeypatch: pytest.MonkeyPatch) -> None:
    """The recorder's, throughout: the first 10,000 were handed on by its stamps, later ones by their own."""
    monkeypatch.setattr("aerobat_pin.records.bag_columns.REORDERED", 10)
    topic = _Topic(Spool(), "header")
    for k in range(60):
        topic.add(max(k - 24.0, 0.0), 1.7e9 + k, {"x": float(k)})
    clock, columns = topic.finished()
    np.testing.assert_array_equal(clock.time[:], 1.7e9 + np.arange(60.0))
    np.testing.assert_array_equal(columns["x"][:], np.arange(60.0))
    assert (clock.not_used, clock.late) == ("", None)
    fewer = _Topic(Spool(), "header")  # in pairs the wrong way round, which those without a stamp do not part
    for k in range(60):
        fewer.add(max((k ^ 1) - 11.0, 0.0), 1.7e9 + k, {"x": float(k)})
    assert fewer.finished()[0].not_used.startswith("; 12 rows have no stamp")


def test_joints_of_a_topic_without_efforts_cost_their_own_rows_alone(folder: Path) -> None:
    """As `joint_state_broadcaster` writes them, NaN: the log was refused."""
    joints = walk(2.0).joints
    bag(walk(2.0), folder / "lame", unmeasured=joints[:3])
    lame = estimated(folder / "lame", edited(bag_map(folder / "quadruped.urdf"), {"check.wrench": None}))
    assert f"no effort of {', '.join(joints[:3])} is recorded" in "\n".join(lame.record.notes)
    assert lame.record.driven == joints[3:]
    assert np.max(foot_errors(lame, 1.7e9)[1:]) < 1.0
    bag(walk(0.3), folder / "none", unmeasured=joints)
    none = recorded(folder / "none", bag_map(folder / "quadruped.urdf"))
    assert "joints.effort" not in none.channels


def test_each_channel_of_joints_can_have_a_topic_of_its_own(bagged: Path) -> None:
    """As where the drives publish the efforts; such a topic was not read, and its absence was not said."""
    shared = bag_map(bagged / "quadruped.urdf")
    own = {part: {"topic": "/joint_states"} for part in ("position", "velocity", "effort")}
    apart = recorded(bagged / "walk", {**shared, "joints": {"names": list(walk(2.0).joints), **own}})
    block, whole = apart.block(0, 900), recorded(bagged / "walk", shared).block(0, 900)
    np.testing.assert_array_equal(block.tau, whole.tau)
    np.testing.assert_array_equal(block.v, whole.v)
    with pytest.raises(LogError, match=r"'/drives\.effort\.\S+', which joints\.effort of the map names"):
        recorded(bagged / "walk", edited(shared, {"joints.effort.topic": "/drives"}))


def test_axes_that_the_map_states_count_for_an_odometry_topic_too(folder: Path) -> None:
    """A twist is in the body's axes by its definition; where a driver has the world's, the map's key was ignored."""
    bag(walk(2.0), folder / "twists")
    shared = bag_map(folder / "quadruped.urdf")
    said = ({}, {"base.velocity": {"axes": "body"}}, {"base.velocity": {"axes": "world"}}, {"base.rate.axes": "world"})
    plain, body, world, turning = (
        recorded(folder / "twists", edited(shared, changes)).block(0, 900).v for changes in said
    )
    np.testing.assert_array_equal(plain, body)
    assert np.max(np.abs(plain[:, :3] - world[:, :3])) > 0.01
    assert np.max(np.abs(plain[:, 3:6] - turning[:, 3:6])) > 0.01


def test_rates_that_nobody_filled_are_found_from_the_positions(folder: Path) -> None:
    """Messages of motion capture and of drivers often hold a pose or angles alone, and zeros beside them."""
    walked = walk(2.0)
    bag(replace(walked, v=np.zeros_like(walked.v)), folder / "zeros")
    shared = edited(bag_map(folder / "quadruped.urdf"), {"base.rate": {"from": "pose"}})
    found = recorded(folder / "zeros", shared)
    block = found.block(0, 900)
    assert block.source["v"] == "reconstructed"
    assert sum("are 0 in every message" in note for note in found.notes) == 2  # the odometry's, the joints'
    at = np.searchsorted(walked.time, block.time - block.time[0] + walked.time[1])
    assert np.sqrt(np.mean((block.v - walked.v[at])[100:-100] ** 2)) < 0.05 * np.sqrt(np.mean(walked.v**2))


def test_rates_of_some_joints_alone_are_not_said_to_be_0(bagged: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """As where a gripper's messages hold positions alone; a note said that all joints' are 0 in every message."""

    def without_one(*asked: Any) -> Any:
        columns = read_columns(*asked)
        held = {name: series for name, series in columns.values.items() if name != "/joint_states.velocity.FR_HAA"}
        return replace(columns, values=held)

    monkeypatch.setattr("aerobat_pin.records.file_source.read_columns", without_one)
    assert recorded(bagged / "walk", bag_map(bagged / "quadruped.urdf")).notes == ()


@pytest.mark.parametrize(
    ("how", "said", "late"),
    [
        ({"odometry_ahead": 0.4}, "another clock", 0.4),  # beyond what any comparison of channels can find
        ({"odometry_fast": 0.01}, "a clock of another rate", 0.009 * walk(2.0).time[-1]),  # over seconds, little
        *further(({"odometry_fast": -0.01}, "a clock of another rate", -0.009 * walk(2.0).time[-1])),
    ],
)
def test_a_topic_of_a_bag_with_another_clock_is_named(how: Any, said: str, late: float, folder: Path) -> None:
    """A motion capture's computer 0.4 s ahead, or 1 % too fast: nothing was said."""
    bag(walk(2.0), folder / "clock", **how)
    told = record_findings(recorded(folder / "clock", bag_map(folder / "quadruped.urdf")))
    (found,) = (one for one in told if one.check == "recorder clock" and one.warns)
    assert "/odom" in found.text
    assert said in found.text
    assert ("delay = 0.400" in found.text) == (late == 0.4)
    assert found.value == pytest.approx(-late, rel=0.2)


@pytest.mark.parametrize(("factor", "wrong"), [(1.0, False), (1.3, True)])
def test_what_steady_motion_shows_to_be_right_is_not_off_by_a_factor(factor: float, wrong: bool) -> None:
    """A sensor smooths a quick wobble of 3 mm of a robot that falls: a velocity 1 times what follows was warned of."""
    time = np.arange(1000) / 400.0
    place, pace = 0.003 * np.sin(40.0 * time), 0.12 * np.cos(40.0 * time)
    noise = 0.02 * np.random.default_rng(0).standard_normal(len(time))
    series = ((0.3 * time + place)[:, None], factor * (0.3 + 0.6 * pace + noise)[:, None])
    pair = Agreement("position", ("a", "b"), time, *series, "rates", ("along x",), "m", 0.01, "m")
    assert any(one.warns for one in agreement_findings(pair)) == wrong


def test_a_noise_of_rates_within_what_is_allowed_is_no_factor() -> None:
    """Beside a robot that hardly moves: velocities "0.67 times what follows", by a correlation of 0.15."""
    time, rng = np.arange(2000) / 100.0, np.random.default_rng(0)
    place = 1e-3 * np.sin(time)[:, None] * [1.0, 2.0, 3.0] + [[0.0, 0.0, 0.5]]
    pace = 0.05 * rng.standard_normal((len(time), 3))
    pair = Agreement("position", ("a", "b"), time, place, pace, "rates", ("x", "y", "z"), "m", 0.01, "m")
    assert not any(one.warns for one in agreement_findings(pair))


def scaled(names: list[str], factor: float) -> Change:
    """Return a change of a table: columns times a factor."""
    return lambda frame: frame.assign(**{name: frame[name] * factor for name in names})


TAU = [f"{joint}_tau" for joint in walk(2.0).joints]
GYRO, ACC = ["gyro_x", "gyro_y", "gyro_z"], ["acc_x", "acc_y", "acc_z"]
AS_MA = {"columns": TAU, "unit": "mA"}
WRONG: dict[str, tuple[Change | None, dict[str, Any], str]] = {  # change of the table, and of keys of the map
    "accelerometer in g": (scaled(ACC, 1 / 9.80665), {}, r"REFUSED.*0\.1\d* of gravity: g is read as m/s2"),
    "quaternion order": (None, {"base.quaternion.order": "wxyz"}, r"REFUSED.*order = \"xyzw\""),
    "quaternion sense": (None, {"base.quaternion.sense": "world_to_body"}, r"REFUSED.*sense = \"body_to_world\""),
    "world upside down": (
        None,
        {"log": {"world": "ned"}},
        r"REFUSED.*180\.00 deg off the vertical: 188 N of seeming force; up is down",
    ),
    "trunk too heavy by 20 %": (
        None,
        {"robot.urdf": "heavy.urdf"},
        r"the record wants 0\.8\d times the believed mass of the base link",
    ),
    "effort in ampere": (scaled(TAU, 1 / 3), {}, r"all efforts would .* 3(\.0\d)? times as large.*\(A, N m\)"),
    "torque for each A, of mA": (
        scaled(TAU, 1e3 / 3.0),
        {"joints.effort": {**AS_MA, "torque_per_unit": {"*": 3.0}}},
        r"REFUSED.*torque_per_unit: \* = 3 N m for each mA.*: 0\.003 was expected",
    ),
    "small torque for each A, of mA": (
        scaled(TAU, 1e3 / 0.3),
        {"joints.effort": {**AS_MA, "torque_per_unit": {"*": 0.3}}},
        r"REFUSED.* 0\.001 times as large: torque_per_unit counts for each mA.*: a thousandth was expected",
    ),
    "missing column": (
        None,
        {"joints.effort.columns": ["FL_HAA_ta", *TAU[1:]]},
        r"REFUSED.*no column 'FL_HAA_ta', which joints\.effort .* 'FL_HAA_tau'",
    ),
    "gap of 0.5 s": (lambda frame: frame[(frame.t < 1.0) | (frame.t > 1.5)], {}, r"for 0\.50 s, from 1\.00 s on"),
    "file appended to itself": (lambda frame: pd.concat([frame, frame]), {}, r"1001 of 2002 samples go back"),
    "sensor's sign": (None, {"check.wrench.sign": -1}, r"-1 times the estimate.*sign"),
    "unknown unit": (None, {"base.rate.unit": "dps"}, r"REFUSED.*'dps': one of rad/s, deg/s"),
    "misspelt key": (None, {"base.rate.axis": "body"}, r"REFUSED.*unknown key 'base\.rate\.axis'"),
    "time in ms read as s": (scaled(["t"], 1e3), {}, r"REFUSED|times what follows from"),
}


@pytest.mark.parametrize("name", WRONG)
def test_a_wrong_map_or_log_is_refused_or_named(name: str, folder: Path) -> None:
    """None is silent, and the message has the measured figure."""
    change, keys, expected = WRONG[name]
    (folder / "heavy.urdf").write_text(urdf().replace('value="6.0"', 'value="7.2"'))
    log = table(walk(2.0))
    (log if change is None else change(log)).to_csv(folder / "walk.csv", index=False)
    try:
        said = estimated(folder / "walk.csv", edited(table_map(Path("quadruped.urdf")), keys)).warnings
    except AerobatError as error:
        said = [f"REFUSED {error}"]
    assert any(re.search(expected, text) for text in said), said


def test_a_file_under_two_names_is_named(folder: Path) -> None:
    """Also one whose name no result could hold."""
    for name in (b"walk.csv", b"other.csv", b"\xfc.csv"):
        table(walk(0.5)).to_csv(folder / os.fsdecode(name), index=False)
    found = estimated(folder / "walk.csv", table_map(folder / "quadruped.urdf"))
    for name in ("other", "\ufffd"):
        assert any(f"{name}.csv beside it holds the same bytes" in text for text in found.warnings)


def test_a_command_that_is_told_can_be_pasted() -> None:
    """Paths with spaces are quoted."""
    told = str(needs_map(Path("my arm.csv"), robot="my arm.urdf"))
    assert "`aerobat estimate 'my arm.csv' --suggest --urdf 'my arm.urdf'`" in told


@pytest.mark.parametrize(
    ("said", "expected"),
    [
        ("ur7", "robot 'ur7': did you mean 'ur5'"),
        ("ur7.urdf", "robot {here}/ur7.urdf: there is no such file"),
        ("arms/ur7", "robot {here}/arms/ur7: there is no such file"),
    ],
)
def test_a_robot_that_an_option_misspells_is_a_name_or_a_file(here: Path, said: str, expected: str) -> None:
    """A word without folder and ending was taken for a file where no robot had that name."""
    (here / "log.csv").write_text("t,q1\n0,0\n1,1\n")
    with pytest.raises(AerobatError, match=re.escape(expected.format(here=here))):
        suggested_map(here / "log.csv", said)


def test_a_map_without_a_line_is_said_to_be_empty(here: Path) -> None:
    """As `--suggest > map.toml` leaves one behind when the log is not there."""
    (here / "map.toml").touch()
    with pytest.raises(MapError, match=r"^map map\.toml: the file is empty"):
        load_map(Path("map.toml"))


def test_other_axes_and_orders_give_the_same_forces(folder: Path) -> None:
    """Axes with z down, quaternions with w first that turn the world to the body, a velocity in body axes."""
    frame, half = table(walk(2.0)), np.diag([1.0, -1.0, -1.0])
    R = Rotation.from_quat(frame[["qx", "qy", "qz", "qw"]].to_numpy()).as_matrix()
    inverse = Rotation.from_matrix(np.swapaxes(half @ R @ half, 1, 2)).as_quat()
    frame[["px", "py", "pz"]] = frame[["px", "py", "pz"]].to_numpy() @ half
    frame[["vx", "vy", "vz"]] = np.einsum("nji,nj->ni", R, frame[["vx", "vy", "vz"]].to_numpy()) @ half
    for names in (GYRO, ACC, ["fl_fx", "fl_fy", "fl_fz"]):
        frame[names] = frame[names].to_numpy() @ half
    frame[["qw", "qx", "qy", "qz"]] = np.roll(inverse, 1, axis=1)
    frame.to_csv(folder / "walk.csv", index=False)
    values = table_map(folder / "quadruped.urdf")
    values["log"] = {"world": "ned"}
    values["base"] |= {"axes": "frd"}
    values["base"]["quaternion"] = {"columns": ["qw", "qx", "qy", "qz"], "order": "wxyz", "sense": "world_to_body"}
    values["base"]["velocity"]["axes"] = "body"
    found = estimated(folder / "walk.csv", values)
    assert np.max(foot_errors(found, 0.0)) < 0.035
    assert found.warnings == []


def test_separators_and_decimal_commas_are_found(folder: Path) -> None:
    """As other programs write tables; a unit of time is converted."""
    frame = table(walk(0.5))
    frame.assign(t=frame.t * 1e3).to_csv(folder / "walk.csv", index=False, sep=";", decimal=",")
    values = edited(table_map(folder / "quadruped.urdf"), {"log.time": {"column": "t", "unit": "ms"}})
    is_the_walk(recorded(folder / "walk.csv", values))


def test_a_time_that_is_not_found_is_asked_for(folder: Path) -> None:
    """With the columns there are; a rate takes its place."""
    table(walk(0.5)).drop(columns="t").to_csv(folder / "walk.csv", index=False)
    values = table_map(folder / "quadruped.urdf")
    with pytest.raises(LogError, match=r"which column is the time\? Write \[log\] time = .*columns: px, py"):
        recorded(folder / "walk.csv", values)
    is_the_walk(recorded(folder / "walk.csv", edited(values, {"log.time.rate": 500})))


def is_the_walk(record: Record) -> None:
    """Check that a record is half a second of the walk."""
    walked, block = walk(0.5), record.block(0, 250)
    np.testing.assert_allclose(block.time, walked.time, atol=1e-9)
    efforts = 0.5 * (walked.tau[1:] + walked.tau[:-1])
    for found, true in ((block.q, walked.q), (block.v, walked.v), (block.tau[:, 6:], efforts)):
        np.testing.assert_allclose(found, true, atol=1e-6)


def test_joints_must_be_known_or_held(folder: Path) -> None:
    """A joint without a channel is asked for by name."""
    values = table_map(folder / "quadruped.urdf")
    values["joints"] = {}
    table(walk(2.0)).to_csv(folder / "walk.csv", index=False)
    with pytest.raises(MapError, match=r"FL_HAA, .* have no channel; .* joints\.held = \{FL_HAA = 0\.0\}"):
        estimated(folder / "walk.csv", values)


def test_the_rule_of_the_means_is_the_integral_of_straight_lines() -> None:
    """Against a fine sum, for stamps that are not even."""
    rng = np.random.default_rng(0)
    time = np.sort(rng.uniform(0.0, 1.0, 40))
    values = rng.standard_normal((40, 2))
    wanted = np.linspace(time[0], time[-1], 12)
    found = line_means(time, values, wanted)
    for k in range(11):
        fine = np.linspace(wanted[k], wanted[k + 1], 20001)
        mean = [np.trapezoid(np.interp(fine, time, column), fine) / (fine[-1] - fine[0]) for column in values.T]
        np.testing.assert_allclose(found[k], mean, atol=1e-6)


def test_a_steady_turn_has_its_rate() -> None:
    """About a body axis, with the sign of the right hand."""
    time, axis = np.arange(200) * 1e-3, np.array([0.6, 0.0, 0.8])
    quaternions = np.column_stack([np.sin(1.5 * time)[:, None] * axis, np.cos(1.5 * time)])
    np.testing.assert_allclose(turn_rates(quaternions, 1e-3, 0.02)[20:-20], np.tile(3.0 * axis, (160, 1)), atol=1e-4)


def test_a_comparison_finds_factor_and_lag() -> None:
    """To a tenth of a sample."""
    time = np.arange(3000) * 1e-3
    series = np.stack([np.sin(7.0 * time) + 0.3 * np.cos(31.0 * time)], axis=1)
    late = 2.0 * np.interp(time - 0.0123, time, series[:, 0])[:, None]
    found = compare_series(series, late, time)
    assert found.factor[0] == pytest.approx(2.0, rel=0.01)
    assert found.lag == pytest.approx(0.0123, abs=1e-4)


@pytest.mark.usefixtures("here")
def test_the_stream_of_the_docs_finds_the_forces(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Its text as it stands, with recorded messages in the order of their stamps, against the bag as a whole."""
    highlevel = pytest.importorskip("rosbags.highlevel")
    bag(walk(), folder / "walk")
    values = edited(bag_map(Path("quadruped.urdf")), {"check": None})
    (folder / "map.toml").write_text(tomli_w.dumps(values))
    whole = estimate(recorded(folder / "walk", values)).estimates["force_level"]
    with highlevel.AnyReader([folder / "walk"]) as reader:
        messages = [(one.topic, reader.deserialize(raw, one.msgtype)) for one, _, raw in reader.messages()]
    text = (ROOT / "docs" / "recordings.md").read_text()
    [stream] = [code for code in re.findall(r"```python\n(.*?)```", text, re.DOTALL) if "OnlineEstimator" in code]
    space = {"messages": sorted(messages, key=lambda item: stamp(item[1]))}
    exec(stream, space)
    said = re.findall(r"^([\d.]+) (\{.*\}) True$", capsys.readouterr().out, re.MULTILINE)
    assert len(said) > 1400
    end, found = np.array([time for time, _ in said], float), [literal_eval(forces) for _, forces in said]
    up = [forces["FL_FOOT.Fz"] for forces in found[100:]]
    np.testing.assert_allclose(up, np.interp(end - 1.7e9, walk().time, walk().force[:, 0, 2])[100:], atol=1.0)
    for k in range(100, 1400, 100):
        at = int(np.argmin(np.abs(whole.time[1:] - end[k])))
        np.testing.assert_allclose([*found[k].values()], whole.components[at], atol=0.06)  # which knows friction
    online = space["stream"]
    first = next(message for topic, message in messages if topic == "/joint_states")
    assert online.message("/joint_states", first) == []
    assert online.health.samples["joints.position"]["late"] + online.health.samples["joints.position"]["outlier"] == 1
    assert online.health.starts == 1


def test_threads_that_read_bags_at_once_leave_their_reader_as_it_was(folder: Path) -> None:
    """One put back what another had replaced: a budget of unpacked bytes stayed for all that is read later."""
    storage = pytest.importorskip("rosbags.rosbag2.storage_mcap")
    own = storage.DECOMPRESSORS
    bag(walk(0.3), folder / "walk")
    with ThreadPoolExecutor(3) as pool:
        read = pool.map(lambda _: read_columns(folder / "walk", LogTable()), range(9))
        assert len({columns.names for columns in read}) == 1
    assert storage.DECOMPRESSORS is own


@pytest.mark.usefixtures("here")
def test_currents_of_all_joints_have_one_constant(folder: Path) -> None:
    """Of each unit that the map states, A or mA; `*` stands for every joint; a foreign name does not."""
    frame, values = table(walk(1.0)), table_map(Path("quadruped.urdf"))
    columns = values["joints"]["effort"]["columns"]
    frame.assign(**{name: frame[name] / 3.0 for name in columns}).to_csv("walk.csv", index=False)
    values["joints"]["effort"] |= {"unit": "A", "torque_per_unit": {"*": 3.0}}
    found = estimate(recorded(Path("walk.csv"), values))
    assert found.warnings == []
    frame.assign(**{name: 1e3 * frame[name] / 3.0 for name in columns}).to_csv("walk.csv", index=False)
    values["joints"]["effort"] |= {"unit": "mA", "torque_per_unit": {"*": 0.003}}
    again = recorded(Path("walk.csv"), values)
    np.testing.assert_allclose(again.block(0, 300).tau, found.record.block(0, 300).tau, atol=1e-9)
    values["joints"]["effort"]["torque_per_unit"] = {"knee": 3.0}
    with pytest.raises(MapError, match=r"torque_per_unit: no joint 'knee'"):
        recorded(Path("walk.csv"), values)


def test_damage_to_a_sealed_bag_is_noticed(tmp_path: Path) -> None:
    """A bag of rosbags has no checksums, which a note says; sealed, it is refused where one bit in it is wrong."""
    mcap_reader, mcap_writer = pytest.importorskip("mcap.reader"), pytest.importorskip("mcap.writer")
    (tmp_path / "quadruped.urdf").write_text(urdf())
    chosen = parse_map(bag_map(Path("quadruped.urdf")), "of the test")
    bag(walk(0.6), tmp_path / "walk")
    file = next((tmp_path / "walk").glob("*.mcap"))
    plain = estimate(open_record(file, chosen, tmp_path))
    told = [str(found) for found in plain.findings if found.check == "checksums"]
    assert told == [f"checksums: {file.name} has none: damaged numbers would not be noticed"]
    sealed_file = tmp_path / "sealed.mcap"
    with file.open("rb") as source, sealed_file.open("wb") as target:
        writer = mcap_writer.Writer(target, compression=mcap_writer.CompressionType.NONE)
        writer.start("ros2")
        channels: dict[str, int] = {}
        for schema, channel, message in mcap_reader.make_reader(source).iter_messages():
            if channel.topic not in channels:
                kind = writer.register_schema(schema.name, schema.encoding, schema.data)
                channels[channel.topic] = writer.register_channel(channel.topic, "cdr", kind)
            writer.add_message(channels[channel.topic], message.log_time, message.data, message.publish_time)
        writer.finish()
    assert mcap_is_sealed(sealed_file)
    sealed = estimate(open_record(sealed_file, chosen, tmp_path))
    assert not any(found.check == "checksums" for found in sealed.findings)
    content = sealed_file.read_bytes()
    sealed_file.write_bytes(content[:5000] + bytes([content[5000] ^ 1]) + content[5001:])
    with pytest.raises(LogError, match="checksum mismatch"):
        estimate(open_record(sealed_file, chosen, tmp_path))


def test_our_own_file_is_whole(tmp_path: Path) -> None:
    """Every checksum that the format has, of the chunks, the data and the summary, as its own library computes them."""
    reader = pytest.importorskip("mcap.reader")
    path = tmp_path / "forces.mcap"
    model = pin.buildSampleModelHumanoidRandom()
    time, force = np.linspace(0.0, 1.0, 101), np.tile([1.0, 2.0, 3.0], (100, 1))
    q, v = np.tile(pin.neutral(model), (101, 1)), np.zeros((101, model.nv))
    stretch = McapStretch(model, time, q, v, None, {"/truth/here": ("universe", force)}, 4.0)
    for off, span in ((-1.0, "-1 to 0"), (2.0**31 - 1.0, r"2\.14748e\+09 to 2\.14748e\+09")):
        with pytest.raises(OutputError, match=rf"forces\.mcap: {span} s: ROS 2 has 0 to"):
            write_mcap_stretches([replace(stretch, time=time + off)], path)
    write_mcap_stretches([stretch], path)
    assert mcap_is_sealed(path)
    content = path.read_bytes()
    start, _, summary = struct.unpack("<QQI", content[-28:-8])  # of the footer: before the closing magic
    assert summary == zlib.crc32(content[start:-12])
    end = start - 13  # the end of the data: opcode, length and checksum
    assert struct.unpack("<BQI", content[end:start]) == (0x0F, 4, zlib.crc32(content[:end]))
    with path.open("rb") as file:
        counts = reader.make_reader(file, validate_crcs=True).get_summary().statistics.channel_message_counts
    assert sorted(counts.values()) == [34, 34, 100, 100, 100]


def test_drag_by_a_map_is_that_of_a_plain_script(tmp_path: Path) -> None:
    """Within 0.5 mN per m/s of it; and within 1 of the truth. The command's lead is found."""
    table = flight()
    found = estimate(recorded(tmp_path / "flight.csv", MAP, table=table))
    level = found.estimates["force_level"]
    middle = 0.5 * (level.time[1:] + level.time[:-1]) - 1 / 20.0  # 1/K late
    velocity = np.stack([np.interp(middle, table.t, table[f"v{axis}"]) for axis in "xyz"], axis=1)
    inside = slice(100, len(middle) - 100)
    ours = drag_slopes(level.force[inside, 0], velocity[inside])
    plain = drag_slopes(plain_force(table)[inside], table[["vx", "vy", "vz"]].to_numpy()[inside])
    np.testing.assert_allclose(ours, plain, atol=0.5e-3)
    np.testing.assert_allclose(ours, -DRAG[:2], atol=1.0e-3)
    fit = found.forces.fits[0]
    assert fit.outside < 0.02 * fit.before + 4e-3
    said = estimate(recorded(tmp_path / "flight.csv", edited(MAP, {"known.thrust.delay": 0.0}))).warnings
    assert any(re.search(r"known\.thrust leads the acceleration by (3[6-9]|4\d) ms", text) for text in said), said


@pytest.mark.parametrize(("push", "worn", "told"), [(0.5, 0.0, 0), (0.0, 0.6, 1)])
def test_a_push_is_no_fit_that_does_not_hold(push: float, worn: float, told: int, tmp_path: Path) -> None:
    """For seven of the fifteen seconds that test the fit; another size of thrusts in all of them is told."""
    table = flight()
    time = table.t - table.t[0]
    table["imu_acc_z"] += push * time.between(17.0, 24.0)
    table["m1"] *= 1.0 + worn * (time > 15.0)
    found = [*fit_findings(fitted_forces(recorded(tmp_path / "flight.csv", MAP, table=table)))]
    assert len(found) == told


@pytest.mark.parametrize(
    ("inside", "outside", "told"), [(1.0, 0.99, False), (1.0, 1.01, False), (1.0, 1.03, True), (3e-14, 1e-13, False)]
)
def test_a_fit_of_next_to_nothing_does_no_harm(inside: float, outside: float, told: bool, tmp_path: Path) -> None:
    """Friction of 0 that left .0495 N m where none left .0495 was said not to hold; 3 % more than without is told.

    Nor is rounding: of a simulated arm at rest 1e-13 N m were left on the rest, 3e-14 where fitted.
    """
    record = recorded(tmp_path / "flight.csv", MAP, table=flight())
    fit = Fit("friction of elbow", {}, "N m", before=1.0, inside=inside, outside=outside)
    forces = cast(KnownForces, SimpleNamespace(record=record, fits=(fit,), values=FittedValues()))
    assert any("does not hold" in one.text for one in fit_findings(forces)) == told


def test_a_misread_attitude_makes_two_weights_of_force(tmp_path: Path) -> None:
    """Without gyro and accelerometer the quaternion cannot be checked; the mean force still says so, and is refused."""
    thrust = {"known.thrust.coefficients": [0.0067, 0.00132], "known.thrust.fit": None}
    values = edited(MAP, {"check": None, "base.rate": {"from": "pose"}, **thrust})
    estimate(recorded(tmp_path / "flight.csv", values, table=flight()))
    faint = edited(values, {"known.thrust.coefficients": [7e-5, 1.4e-5]})  # as of another unit
    assert any("little was expected" in text for text in estimate(recorded(tmp_path / "flight.csv", faint)).warnings)
    misread = edited(values, {"base.quaternion.columns": ["qw", "qx", "qy", "qz"]})
    with pytest.raises(LogError, match=r"mean force over weight is .*, 2\.0\d+ .*about 2 if the attitude is misread"):
        estimate(recorded(tmp_path / "flight.csv", misread))


@pytest.mark.parametrize(
    ("order", "signs", "said"),
    [
        ([0, 1, 2], [1, 1, 1], "read as roll, pitch, yaw, body to world"),
        ([0, 1, 2], [1, -1, 1], "the columns seem to be roll, -pitch, yaw, body to world"),
        ([0, 1, 2], [-1, 1, 1], "the columns seem to be -roll, pitch, yaw, body to world"),
        ([2, 1, 0], [1, 1, 1], "the columns seem to be yaw, pitch, roll, body to world"),
    ],
)
def test_an_angle_that_counts_the_other_way_is_named(
    order: list[int], signs: list[int], said: str, tmp_path: Path
) -> None:
    """The gyro's sign was said to be wrong, and angles to be read as x, y, z, w."""
    log, names = flight(seconds=6.0), ["roll", "pitch", "yaw"]
    angles = Rotation.from_quat(log[["qx", "qy", "qz", "qw"]]).as_euler("xyz")
    log[names] = (signs * angles)[:, order]
    record = recorded(tmp_path / "log.csv", edited(MAP, {"base.quaternion": {"columns": names}}), table=log)
    told = [each for each in record_findings(record) if each.check == "quaternion order"]
    assert [said in each.text for each in told] == [True]
    assert told[0].warns == ("seem" in said)


def test_angles_of_a_nose_that_is_straight_up_are_read_without_a_warning() -> None:
    """As of a tail-sitter: "Gimbal lock detected. Setting third angle to zero" stood between the findings."""
    chosen = parse_map(edited(MAP, {"base.quaternion": {"columns": ["roll", "pitch", "yaw"]}}), "of the test")
    raw, time = Rotation.from_euler("xyz", [[0.1, -0.5 * np.pi, 0.2]] * 3).as_quat(), np.arange(3.0)
    record = SimpleNamespace(map=chosen, knots=time, channels={"base.quaternion": SimpleNamespace(time=time)})
    read = read_attitudes(cast(Record, record), time, raw)
    assert len(read) == 12
    turned = read["roll, pitch, -yaw", "body_to_world"]
    np.testing.assert_allclose(Rotation.from_quat(turned).apply([1.0, 0.0, 0.0]), [[0.0, 0.0, 1.0]] * 3, atol=1e-7)


def test_a_pose_that_stands_still_and_jumps_is_said(tmp_path: Path) -> None:
    """Motion capture that loses its markers for 0.3 s, or writes zeros; a robot that rests does not jump afterwards."""
    log, pose = flight(seconds=6.0), ["px", "py", "pz", "qx", "qy", "qz", "qw"]
    frozen, rests = log.copy(), log.copy()
    frozen.loc[200:229, pose] = log.loc[200, pose].to_numpy()
    rests[pose] = log.loc[np.maximum(np.arange(len(log)) - 30, 0), pose].to_numpy()
    waits = log.assign(**log.loc[np.maximum(np.arange(len(log)) - 100, 0), pose].reset_index(drop=True))
    for table_, held in ((log, 0), (rests, 0), (frozen, 2)):
        found = record_findings(recorded(tmp_path / "log.csv", MAP, table=table_))
        told = [each.text for each in found if each.check == "held channel" and "does not change" in each.text]
        assert len(told) == held
        assert all("for 0.30 s, from 1.96 s on; leave its cells empty" in text for text in told)
    found = record_findings(recorded(tmp_path / "log.csv", MAP, table=waits))
    assert not any("leave its cells empty" in each.text for each in found if "does not change for" in each.text)
    log.loc[200:202, pose] = 0.0
    with pytest.raises(LogError, match=r"has length 0 at .* s: 1 was expected; where it was lost, leave its cells"):
        recorded(tmp_path / "log.csv", MAP, table=log)


def test_roll_pitch_and_yaw_are_an_attitude(tmp_path: Path) -> None:
    """As autopilots log them, in deg and past 180; four columns were expected, and `--suggest` did not know them."""
    one = flight(seconds=3.0)
    yaw = 10.0 * np.arange(len(one))[:, None]
    turned = Rotation.from_euler("z", yaw, degrees=True) * Rotation.from_quat(one[["qx", "qy", "qz", "qw"]])
    one[["qx", "qy", "qz", "qw"]] = turned.as_quat()
    names = [f"att_{axis}_deg" for axis in ("roll", "pitch", "yaw")]
    other = one.drop(columns=["qx", "qy", "qz", "qw"])
    other[names] = turned.as_euler("ZYX", degrees=True)[:, ::-1]
    angles = edited(MAP, {"base.quaternion": {"columns": names, "unit": "deg"}})
    records = recorded(tmp_path / "one.csv", MAP, table=one), recorded(tmp_path / "other.csv", angles, table=other)
    q, expected = (record.block(*record.parts[0]).q[:, 3:] for record in (records[1], records[0]))
    np.testing.assert_allclose(np.abs(np.sum(q * expected, axis=1)), 1.0, atol=1e-9)
    other.loc[other.index % 5 > 0, names[2]] = np.nan  # a slower compass: yaw went from 179 deg to -179 through 0
    seldom = recorded(tmp_path / "seldom.csv", angles, table=other)
    q = seldom.block(*seldom.parts[0]).q[:, 3:]
    np.testing.assert_allclose(np.abs(np.sum(q * expected[: len(q)], axis=1)), 1.0, atol=1e-3)
    assert f'quaternion = {{columns = {names}, unit = "deg"}}'.replace("'", '"') in suggested_map(
        tmp_path / "other.csv", None
    )
    measured = edited(angles, {"known": None, "check": None})
    with pytest.raises(MapError, match=r"online: base\.quaternion: four columns were expected; roll, pitch and yaw"):
        OnlineEstimator(parse_map(measured, "-"), tmp_path)


def leg(rail: str) -> str:
    """Return a leg of two joints below a base, which slides on a rail (`prismatic`) or is screwed to it (`fixed`)."""
    parts = [link("root"), link("base_link", 0.5, moments=(1e-3, 1e-3, 1e-3)), link("contact")]
    parts += [
        link("upper", 0.15, "0 0 -0.08", (4e-4, 4e-4, 3e-5)),
        link("lower", 0.04, "0 0 -0.09", (1e-4, 1e-4, 1e-5)),
    ]
    parts += [
        joint("rail", rail, "root", "base_link", axis="0 0 1", limit=9),
        joint("hip", "revolute", "base_link", "upper", limit=9),
        joint("knee", "revolute", "upper", "lower", "0 0 -0.16", limit=9),
        joint("foot", "fixed", "lower", "contact", "0 0 -0.16"),
    ]
    return f'<robot name="leg">{"".join(parts)}</robot>'


def hopper(folder: Path, moves: float = 0.0) -> None:
    """Write leg.urdf, hopper.csv: a leg on a rail over a force sensor, friction, torque scale; moved [m]: `height`."""
    (folder / "leg.urdf").write_text(leg("prismatic"))
    model = pin.buildModelFromXML(leg("prismatic"))
    time = np.arange(8000) * 1e-3
    hip, knee = 0.6 + 0.25 * np.sin(2.6 * time), -1.2 + 0.4 * np.sin(2.6 * time + 0.4)
    height = moves * np.sin(9.0 * time)
    q = np.column_stack([height, hip, knee])
    v = np.gradient(q, 1e-3, axis=0)
    a = np.gradient(v, 1e-3, axis=0)
    force = np.column_stack([2.0 * np.sin(1.9 * time), 0 * time, 12.0 + 8.0 * np.sin(3.1 * time)])
    tau = efforts(model, "contact", q, v, a, force)[:, 1:]
    friction = np.array([0.05, 0.12]) * np.tanh(v[:, 1:] / 0.02) + 0.02 * v[:, 1:]
    shown = (tau + friction) / 0.9 + 0.002 * np.random.default_rng(0).standard_normal(tau.shape)
    columns = {"time": time, "height": height, "q_hip": hip, "q_knee": knee}
    columns |= {"tau_hip": shown[:, 0], "tau_knee": shown[:, 1]}
    columns |= {f"f{axis}": force[:, k] for k, axis in enumerate("xyz")}
    pd.DataFrame(columns).to_csv(folder / "hopper.csv", index=False)


HOPPER = {
    "robot": {"urdf": "leg.urdf", "root": "fixed", "points": ["contact"]},
    "joints": channels(["hip", "knee"], position="q_{}", effort="tau_{}")
    | {"names": ["hip", "knee"], "held": {"rail": 0.0}, "velocity": {"from": "position", "window": 0.02}},
    "check": {"wrench": {"columns": ["fx", "fy", "fz"], "filter": 30}},
}
RUBBING = edited(HOPPER, {"joints.friction": {"fit": [0, 4], "to": "check.wrench", "scale": True}})


def test_friction_and_torque_scale_of_a_hopper(tmp_path: Path) -> None:
    """Fitted on the first half against the sensor, they hold on the second; the rail's row is not believed."""
    hopper(tmp_path)
    plain, fitted = (estimate(recorded(tmp_path / "hopper.csv", values)) for values in (HOPPER, RUBBING))
    before, after = (one.observers["force_level"].points["contact"] for one in (plain, fitted))
    assert before["Fz"].r2 < 0.97
    assert after["Fz"].r2_outside_fit > 0.995
    assert any("contact.Fy: seen 0% of the time" in finding.text for finding in fitted.findings)
    knee = fitted.forces.fits[1].values
    assert knee["effort times"] == pytest.approx(0.9, abs=0.02)
    assert knee["coulomb"] == pytest.approx(0.12, abs=0.02)
    learnt = calibrate([fitted.record])
    assert not np.any(learnt.fitted.friction.offset)  # which is also the sensor's tare
    assert learnt.fitted.fits[1].values == {**knee, "offset": 0.0}
    assert learnt.detection is None  # it was pushed all the time
    assert any("offsets" in note for note in learnt.notes)


def test_a_rail_that_moves_though_the_map_holds_it(tmp_path: Path) -> None:
    """A note asks; with its place in the map, in m beside angles in degrees and without an effort, Fx is right."""
    hopper(tmp_path, moves=0.05)
    table = pd.read_csv(tmp_path / "hopper.csv")
    table[["q_hip", "q_knee"]] *= 180.0 / np.pi
    table.to_csv(tmp_path / "degrees.csv", index=False)
    values = edited(RUBBING, {"robot.rows": {"ignore": ["rail"]}, "joints.position.unit": "deg"})
    seen = {"joints.names": ["rail", "hip", "knee"], "joints.position.columns": ["height", "q_hip", "q_knee"]}
    moving, held = (
        estimate(recorded(tmp_path / "degrees.csv", chosen))
        for chosen in (edited(values, {**seen, "joints.held": None}), values)
    )
    right, wrong = (one.observers["force_level"].points["contact"]["Fx"].rmse_outside_fit for one in (moving, held))
    assert right < 0.15
    assert wrong > 2.0 * right
    assert any(re.search(r"contact at 0\.\d+ m/s.*move in its place \(rail\)", str(one)) for one in held.findings)
    assert not any(one.check == "held still" for one in moving.findings)


def bench(folder: Path) -> np.ndarray:
    """Write arm.urdf and bench.csv: a leg shaken on a force plate; return the true force at its tip."""
    text = leg("fixed")
    (folder / "arm.urdf").write_text(text)
    model = pin.buildModelFromXML(text, pin.JointModelFreeFlyer())
    time = np.arange(3000) * 1e-3
    joints = np.column_stack([0.5 * np.sin(9.0 * time), -0.8 + 0.4 * np.sin(11.0 * time)])
    rates = np.gradient(joints, 1e-3, axis=0)
    bends = np.gradient(rates, 1e-3, axis=0)
    tip = np.column_stack([0.6 * np.sin(5.0 * time), 0.3 * np.cos(4.0 * time), 0.5 + 0.4 * np.sin(7.0 * time)])
    q = np.column_stack([np.tile([0, 0, 0, 0, 0, 0, 1], (len(time), 1)), joints])
    v, a = (np.pad(values, ((0, 0), (6, 0))) for values in (rates, bends))
    plate = efforts(model, "contact", q, v, a, tip)[:, :6]
    columns = {"t": time, "hip": joints[:, 0], "knee": joints[:, 1]}
    names = ("fx", "fy", "fz", "mx", "my", "mz")
    columns |= {name: -plate[:, k] for k, name in enumerate(names)}  # a load cell shows the force on itself
    columns |= {f"tip_f{axis}": tip[:, k] for k, axis in enumerate("xyz")}
    pd.DataFrame(columns).to_csv(folder / "bench.csv", index=False)
    return tip


def test_a_load_cell_as_known_input_and_as_truth(tmp_path: Path) -> None:
    """Without any joint torque: the plate's wrench gives the force at the tip, and the force at the plate is found."""
    tip = bench(tmp_path)
    values = {
        "robot": {"urdf": "arm.urdf", "points": ["contact"]},
        "base": {"held": True},
        "joints": {"names": ["hip", "knee"], "position": {"columns": ["hip", "knee"]}},
        "known": {"plate": {"columns": ["fx", "fy", "fz", "mx", "my", "mz"], "sign": -1}},
        "check": {"wrench": {"columns": ["tip_fx", "tip_fy", "tip_fz"], "point": "contact"}},
        "observer": {"gain": 500},
    }
    found = estimate(recorded(tmp_path / "bench.csv", values))
    error = found.estimates["force_level"].force[50:, 0] - tip[50:-1]
    assert np.sqrt(np.mean(error**2)) < 0.02
    assert "rows of hip, knee are not believed" in " ".join(found.notes)
    truth = values | {
        "robot": {"urdf": "arm.urdf", "wrenches": ["base_link"]},
        "known": {"push": {"columns": ["tip_fx", "tip_fy", "tip_fz"], "frame": "contact", "axes": "world"}},
        "check": {"wrench": {"columns": ["fx", "fy", "fz", "mx", "my", "mz"], "sign": -1, "point": "base_link"}},
    }
    other = estimate(recorded(tmp_path / "bench.csv", truth))
    for score in other.observers["force_level"].points["base_link"].values():
        assert score.r2 is None or score.r2 > 0.985  # what nobody measured is believed to a tenth
