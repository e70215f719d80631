"""Recordings of any robot: the right map gives the right forces, and every wrong one is refused or named."""

import os
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from scipy.spatial.transform import Rotation
from support.further import further
from support.recorded import edited, recorded
from support.walking_log import bag, bag_map, table, table_map, urdf, walk

from aerobat_pin.aerobat import needs_map
from aerobat_pin.errors import AerobatError, LogError, MapError
from aerobat_pin.estimation import Result, estimate, record_findings
from aerobat_pin.estimation.checks.agreement import accelerometer_findings, agreement_findings
from aerobat_pin.numerics import compare_series
from aerobat_pin.records import Agreement, Record, Spool, load_map, suggested_map
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
    pytest.importorskip("rosbags")
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
    pytest.importorskip("rosbags")
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
    pytest.importorskip("rosbags")
    bag(walk(2.0), folder / "twists")
    shared = bag_map(folder / "quadruped.urdf")
    said = ({}, {"base.velocity": {"axes": "body"}}, {"base.velocity": {"axes": "world"}}, {"base.rate.axes": "world"})
    plain, body, world, turning = (
        recorded(folder / "twists", edited(shared, changes)).block(0, 900).v for changes in said
    )
    np.testing.assert_array_equal(plain, body)
    assert np.max(np.abs(plain[:, :3] - world[:, :3])) > 0.01
    assert np.max(np.abs(plain[:, 3:6] - turning[:, 3:6])) > 0.01


def test_a_topic_of_a_bag_with_another_clock_is_named_with_its_delay(folder: Path) -> None:
    """A motion capture's computer 0.4 s ahead: beyond what any comparison of channels can find."""
    pytest.importorskip("rosbags")
    bag(walk(2.0), folder / "ahead", odometry_ahead=0.4)
    told = record_findings(recorded(folder / "ahead", bag_map(folder / "quadruped.urdf")))
    (text,) = (str(one) for one in told if one.check == "recorder clock" and one.warns)
    assert "/odom" in text
    assert "another clock" in text
    assert "delay = 0.400" in text


@pytest.mark.parametrize("fast", [0.01, *further(-0.01)])
def test_a_topic_of_a_bag_whose_clock_runs_at_another_rate_is_named(fast: float, folder: Path) -> None:
    """By 1 %: over a log of seconds that is less than two clocks were told apart by, and nothing was said."""
    pytest.importorskip("rosbags")
    bag(walk(2.0), folder / f"rate{fast}", odometry_fast=fast)
    told = record_findings(recorded(folder / f"rate{fast}", bag_map(folder / "quadruped.urdf")))
    (found,) = (one for one in told if one.check == "recorder clock" and one.warns)
    assert "/odom" in found.text
    assert "a clock of another rate" in found.text
    assert found.value == pytest.approx(-0.9 * fast * walk(2.0).time[-1], rel=0.2)


@pytest.mark.parametrize(("factor", "wrong"), [(1.0, False), (1.3, True)])
def test_what_steady_motion_shows_to_be_right_is_not_off_by_a_factor(factor: float, wrong: bool) -> None:
    """A sensor smooths a quick wobble of 3 mm of a robot that falls: a velocity 1 times what follows was warned of."""
    time = np.arange(1000) / 400.0
    place, pace = 0.003 * np.sin(40.0 * time), 0.12 * np.cos(40.0 * time)
    noise = 0.02 * np.random.default_rng(0).standard_normal(len(time))
    series = ((0.3 * time + place)[:, None], factor * (0.3 + 0.6 * pace + noise)[:, None])
    pair = Agreement("position", ("a", "b"), time, *series, "rates", ("along x",), "m", 0.01, "m")
    assert any(one.warns for one in agreement_findings(pair)) == wrong


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
