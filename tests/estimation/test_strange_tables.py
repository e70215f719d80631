"""Tables as other programs write them: numbered columns, decimals of both kinds, a silent force sensor, bad stamps."""

import re
import tomllib
from collections.abc import Callable, Iterable, Sequence
from contextlib import nullcontext
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import h5py
import numpy as np
import pandas as pd
import pytest
import xarray as xr
from support.recorded import edited, recorded, suggestion
from support.robot_parts import joint, link
from support.walking_log import table, table_map, urdf, walk

from aerobat_pin.errors import LogError
from aerobat_pin.estimation import OnlineEstimator, estimate
from aerobat_pin.estimation.checks.samples import channel_findings
from aerobat_pin.numerics import Array
from aerobat_pin.records import Channel, Columns, LogTable, Spool, parse_map, read_columns, series_of, suggested_map
from aerobat_pin.records.channels import Request, channel_of
from aerobat_pin.records.csv_columns import read_csv_columns
from aerobat_pin.records.joint_columns import columns_by_name


def test_decimals_are_judged_over_the_whole_table(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Whole numbers in its first pieces and decimal commas later are right; points and commas in one column are not."""
    monkeypatch.setattr("aerobat_pin.records.csv_columns.ROWS_AT_ONCE", 100)
    whole, points = [str(k) for k in range(250)], [f"{k}.5" for k in range(250)]
    commas = [f"{k},5" for k in range(250, 500)]
    log = tmp_path / "log.csv"
    log.write_text("t;x\n" + "".join(f"{k};{x}\n" for k, x in enumerate(whole + commas)))
    found = read_csv_columns(log, LogTable(), ["x"]).values["x"][:]
    np.testing.assert_array_equal(found, [*range(250), *(k + 0.5 for k in range(250, 500))])
    log.write_text("t;x\n" + "".join(f"{k};{x}\n" for k, x in enumerate(points + commas)))
    with pytest.raises(LogError, match=r"'x' has decimal points and decimal commas \(rows 202 to 301\)"):
        read_csv_columns(log, LogTable(), ["x"])


@pytest.mark.parametrize(("separator", "small"), [(",", "987"), (",", "0.5"), (",", "0,5"), (";", "987")])
def test_commas_between_thousands_are_no_decimals(separator: str, small: str, tmp_path: Path) -> None:
    """`987` beside `"1,012"` was 987 beside 1.012; between semicolons, or beside `"0,5"`, these are decimals."""
    rows = [f'{k}{separator}"{x}"\n' for k, x in enumerate((small, small, "1,012", "-1,013"))]
    (tmp_path / "log.csv").write_text("".join([f"t{separator}x\n", *rows]))
    known = separator == ";" or small == "0,5"
    with nullcontext() if known else pytest.raises(LogError, match=r"and nothing between thousands"):
        found = read_csv_columns(tmp_path / "log.csv", LogTable(), ["x"])
        np.testing.assert_array_equal(found.values["x"][2:], [1.012, -1.013])


@pytest.mark.parametrize("empty", [0, 2])
def test_a_cell_without_its_list_is_no_sample(empty: int, tmp_path: Path) -> None:
    """Where lists come less often than rows: it ended in a traceback, and a first one in another error."""
    cells = ["[0.5, 1]", "[2.5, 3]", "[4.5, 5]"]
    cells[empty] = ""
    (tmp_path / "log.csv").write_text("t;v\n" + "".join(f"{k};{cell}\n" for k, cell in enumerate(cells)))
    found = read_csv_columns(tmp_path / "log.csv", LogTable(), ["v.1"])
    np.testing.assert_array_equal(found.values["v.1"], np.where(np.arange(3) == empty, np.nan, [1.0, 3.0, 5.0]))


def test_a_list_of_contacts_is_one(tmp_path: Path) -> None:
    """As JSON writes it; since a unit in brackets is no list, these were texts: "a number was expected"."""
    (tmp_path / "log.csv").write_text("t;on\n0;[true, false]\n1;[true, true]\n")
    found = read_csv_columns(tmp_path / "log.csv", LogTable(), ["on.1"])
    np.testing.assert_array_equal(found.values["on.1"], [0.0, 1.0])


@pytest.mark.parametrize(("separator", "comments"), [(" ", "# "), (",", "# "), ("\t", "%")])
def test_a_header_behind_the_sign_of_a_comment_names_the_columns(separator: str, comments: str, tmp_path: Path) -> None:
    """As numpy.savetxt writes it: between spaces the sign passed for a column, and each name for that of the next."""
    values = np.arange(12.0).reshape(4, 3)
    np.savetxt(tmp_path / "log.txt", values, delimiter=separator, header=separator.join("txy"), comments=comments)
    found = read_csv_columns(tmp_path / "log.txt", LogTable(), None)
    assert found.names == ("t", "x", "y")
    np.testing.assert_array_equal(np.stack([found.values[name][:] for name in "xy"], axis=1), values[:, 1:])
    with pytest.raises(LogError, match=r"'t', which use\.when\.column of the map names, is the time"):
        found.series("t", "use.when.column")


@pytest.mark.parametrize("above", ["# logged by me\n# 2026-11-01", "# logged by me", "sep=,"])
def test_what_stands_above_the_names_of_columns_is_no_header(above: str, tmp_path: Path) -> None:
    """Three columns, named logged, by and me, were looked for a robot's; Excel's `sep=,` was a header of two."""
    (tmp_path / "log.csv").write_text(f"{above}\nt,x,y\n0,1,2\n1,2,3\n")
    with pytest.raises(LogError, match=r"'(# logged by me|sep=,)': take off what stands above the columns' names"):
        suggested_map(tmp_path / "log.csv", None)


@pytest.mark.parametrize("units", ["s,m", "[s],[m]", "[s],[m/s^2]"])
def test_a_line_of_units_below_the_names_is_said_to_be_one(units: str, tmp_path: Path) -> None:
    """A map without a column was suggested for it, and units in brackets were lists of different lengths."""
    (tmp_path / "log.csv").write_text(f"t,x\n{units}\n0.0,1.0\n0.1,2.0\n")
    with pytest.raises(LogError, match="no column holds numbers alone; is there a line of units below the names"):
        suggested_map(tmp_path / "log.csv", None)
    with pytest.raises(LogError, match=r"line 2: t = '.*s.*': a number was expected.*a unit stands behind the column"):
        read_columns(tmp_path / "log.csv", LogTable(), ["x"])


@pytest.mark.parametrize(
    ("upset", "told"),
    [
        (lambda t: t[::-1], r"has 1 samples: two or more were expected; \d+ rows have no stamp or an earlier one"),
        (np.floor, r"= 0.1 s was expected; \d+ rows repeat the stamp before \(log.time: are stamps rounded"),
    ],
)
def test_stamps_that_do_not_rise_are_counted(upset: Callable[[Array], Array], told: str, tmp_path: Path) -> None:
    """Falling ones, and those in whole seconds: of both it was said how few samples there are, not why."""
    (tmp_path / "quadruped.urdf").write_text(urdf())
    values = table(walk())
    stamps = values.columns[0]
    values[stamps] = upset(values[stamps].to_numpy())
    values.to_csv(tmp_path / "log.csv", index=False)
    with pytest.raises(LogError, match=told):
        recorded(tmp_path / "log.csv", table_map(tmp_path / "quadruped.urdf"))


@pytest.mark.parametrize("way", ["%Y-%m-%dT%H:%M:%S.%f", "%Y-%m-%d %H:%M:%S.%f+00:00", "%Y-%m-%d %H:%M:%S,%f"])
def test_dates_of_iso_8601_are_times(way: str, tmp_path: Path) -> None:
    """As pandas, databases and loggers write them, with or without a zone; a cell that is none is refused."""
    time = pd.Timestamp("2026-03-04T10:11:12") + pd.to_timedelta(0.01 * np.arange(300), unit="s")
    table = pd.DataFrame({"timestamp": time.strftime(way), "q1": np.sin(np.arange(300.0)), "tau1": np.arange(300.0)})
    table.to_csv(tmp_path / "log.csv", index=False)
    columns = read_csv_columns(tmp_path / "log.csv", LogTable(), None)
    np.testing.assert_allclose(columns.clocks["table"].time, 1772619072.0 + 0.01 * np.arange(300), atol=1e-6)
    table.loc[200, "timestamp"] = "yesterday"
    table.to_csv(tmp_path / "log.csv", index=False)
    with pytest.raises(LogError, match="line 202: no time in 'timestamp'"):
        read_csv_columns(tmp_path / "log.csv", LogTable(), {"q1"})


def test_columns_may_be_aligned_by_spaces(tmp_path: Path) -> None:
    """A column without a name was said to appear twice."""
    (tmp_path / "log.txt").write_text(" t   x    y\n 0   1.5  2\n 1  10    3 \n")
    found = read_csv_columns(tmp_path / "log.txt", LogTable(), ["x", "y"])
    np.testing.assert_array_equal(np.stack([found.values[name][:] for name in "xy"]), [[1.5, 10.0], [2.0, 3.0]])


@pytest.mark.parametrize(
    ("header", "row", "cells"),
    [
        ('"t" "q"', '"{}" {} 0.5', 3),
        ("t  q", " {}  {} 0.5 ", 3),
        ('"t","q"', "{},{},0.5", 3),
        ('"t","q","of, it"', '{},"0,{}"', 2),
        ('"t","q","of, it"', '{},{},"a ""b"", 5"', 0),
    ],
)
def test_cells_are_counted_between_spaces_and_quotes_too(header: str, row: str, cells: int, tmp_path: Path) -> None:
    """R writes the names of rows and none for their column: the rows' numbers were the time, the time a joint."""
    rows = [row.format(k, k) for k in range(1, 5)]
    (tmp_path / "log.txt").write_text("\n".join(["", header, *rows, ""]))
    if cells:
        with pytest.raises(LogError, match=f"line 3: {cells} cells: {header.count('t') + 1}, as in the header"):
            read_csv_columns(tmp_path / "log.txt", LogTable(), ["q"])
    else:
        (tmp_path / "log.txt").write_text("\n".join([header, *rows, '5,"5', ""]))  # and the last row is cut
        found = read_csv_columns(tmp_path / "log.txt", LogTable(), ["q"])
        np.testing.assert_array_equal(found.values["q"], range(1, 5))


def test_numbered_columns_are_suggested_for_the_joints_in_order(tmp_path: Path) -> None:
    """And four numbered columns of length 1 for the attitude, in an order to ask about; as is a second force sensor."""
    frame = table(walk())
    numbers = {f"quat{k}": frame[f"q{axis}"] for k, axis in enumerate("wxyz")}
    for k, name in enumerate(walk().joints):
        numbers |= {f"q{k + 1}": frame[f"{name}_pos"], f"dq_{k + 1}": frame[f"{name}_vel"]}
        numbers[f"tau_J{k + 1}"] = frame[f"{name}_tau"]
    for axis in "xyz":
        numbers |= {f"left_foot_force_{axis}": frame[f"fl_f{axis}"], f"base_pos_{axis}": frame[f"p{axis}"]}
        numbers |= {f"right_foot_force_{axis}": frame[f"fl_f{axis}"], f"base_ang_vel_{axis}": frame[f"gyro_{axis}"]}
    text = suggestion(tmp_path, {"t": frame.t, **numbers}, urdf())
    suggested = tomllib.loads(text)
    assert suggested["joints"]["names"] == list(walk().joints)
    for part, name in (("position", "q{}"), ("velocity", "dq_{}"), ("effort", "tau_J{}")):
        assert suggested["joints"][part]["columns"] == [name.format(k) for k in range(1, 13)]
    assert suggested["base"]["quaternion"]["columns"] == list(numbers)[:4]
    assert 'order = "wxyz", sense = "body_to_world"}  # or xyzw?' in text
    assert suggested["base"]["rate"]["columns"] == [f"base_ang_vel_{axis}" for axis in "xyz"]
    assert suggested["check"]["wrench"]["columns"] == [f"left_foot_force_{axis}" for axis in "xyz"]
    assert "# And right_foot_force_x, right_foot_force_y, right_foot_force_z?" in text
    assert "# the columns are not called like the joints" in text


def test_an_attitude_whose_columns_say_their_axes_has_their_order(tmp_path: Path) -> None:
    """Also upside down, where x is the largest, and with a word behind the axis."""
    turn = 0.01 * np.arange(50.0)
    values = {"x": np.cos(turn), "y": np.sin(turn), "z": 0.0 * turn, "w": 0.0 * turn}
    columns = {f"base_pos_{axis}": turn for axis in "xyz"} | {f"quat_{axis}_imu": one for axis, one in values.items()}
    lines = suggestion(tmp_path, {"t": turn, **columns}).splitlines()
    line = next(one for one in lines if one.startswith("quaternion"))
    assert 'order = "xyzw"' in line
    assert "# or" not in line


@pytest.mark.parametrize("names", [("wrist", "wrist_roll"), ("wrist_roll", "wrist"), ("roll", "wrist_roll")])
def test_a_column_is_that_of_the_joint_with_the_longest_name_in_it(names: tuple[str, str], tmp_path: Path) -> None:
    """Whatever stands first in the log: wrist_roll's columns were suggested for both joints, without a question."""
    columns = [column for name in reversed(names) for column in (f"{name}_pos", f"{name}_vel", f"f_{name}")]
    columns = [f"force_{names[0]}", *columns, f"{names[0]}_torque"]
    joints = tomllib.loads(suggestion(tmp_path, swings(columns), arm_of(names)))["joints"]
    assert joints["names"] == list(names)
    for part, column in (("position", "{}_pos"), ("velocity", "{}_vel")):
        assert joints[part]["columns"] == [column.format(name) for name in names]
    assert joints["effort"]["columns"] == [f"{names[0]}_torque", f"f_{names[1]}"]  # a force only if there is no torque


def test_words_that_only_humps_part_are_read(tmp_path: Path) -> None:
    """BaseAx to BaseAz, of an accelerometer, were suggested as the base's position, JointPosFR_hip as no joint's."""
    names = [f"{part}{side}_hip" for side in ("FR", "FL") for part in ("TargetPos", "JointPos", "JointTorque")]
    names += [f"BaseA{axis}" for axis in "xyz"]
    text = suggestion(tmp_path, swings(names), arm_of(["FL_hip_joint", "FR_hip_joint"]))
    assert "spring or a gear" not in text, "what was wanted is no other side of a gear"
    found = tomllib.loads(text)
    assert (found["robot"]["root"], found["check"]["specific_force"]["columns"]) == ("fixed", names[-3:])
    for part, word in (("position", "JointPos"), ("effort", "JointTorque")):
        assert found["joints"][part]["columns"] == [f"{word}{side}_hip" for side in ("FL", "FR")]


def test_humps_part_the_names_of_joints_as_those_of_columns() -> None:
    """The columns of wristRoll were those of a wrist, and wristRoll was suggested as held."""
    names = [f"{joint}{part}" for joint in ("wristRoll", "wrist") for part in ("Pos", "Tau")]
    columns = cast(Columns, SimpleNamespace(values=dict.fromkeys(names)))
    found = columns_by_name(columns, ["wrist", "wristRoll"])
    assert found == {joint: {"position": f"{joint}Pos", "effort": f"{joint}Tau"} for joint in ("wristRoll", "wrist")}


def test_a_robot_without_joints_moves_as_a_whole(tmp_path: Path) -> None:
    """A drone's log without a position was refused ("no joint of it moves"); w first was suggested as w last.

    What turns it was taken for 0, unless it had no file: of a lift of 11.8 N 5.3 N were estimated, give or take 6.
    """
    turn = 0.1 * np.sin(0.1 * np.arange(50.0))
    attitude = {f"q{k}": each for k, each in enumerate((np.cos(turn), np.sin(turn), 0.0 * turn, 0.0 * turn))}
    rate = {f"ang_vel_{axis}": turn for axis in "xyz"}
    body = link("body", 1.0, "0 0 0", 3 * [0.01])
    text = suggestion(tmp_path, {"t": 0.01 * np.arange(50.0), **attitude, **rate}, body)
    robot = tomllib.loads(text)["robot"]
    assert (robot["root"], robot["rows"]) == ("free_flyer", {"ignore": ["base.Mx", "base.My", "base.Mz"]})
    assert '# quaternion = {columns = ["q0", "q1", "q2", "q3"], order = "wxyz"' in text
    assert "[joints]" not in text


def test_places_may_be_northings(tmp_path: Path) -> None:
    """A position of 5812 km on a grid of the Earth was refused; of 500 km, it was "interpolated", being so large."""
    (tmp_path / "robot.urdf").write_text(urdf())
    walked, chosen = table(walk()), table_map(tmp_path / "robot.urdf")
    near = estimate(recorded(tmp_path / "log.csv", chosen, table=walked))
    walked[["px", "py", "pz"]] += [500_123.0, 5_812_345.0, 2500.0]
    far = estimate(recorded(tmp_path / "log.csv", chosen, table=walked))
    assert [each.check for each in far.findings] == [each.check for each in near.findings]
    (forces,), (expected,) = (each.estimates.values() for each in (far, near))
    np.testing.assert_allclose(forces.components, expected.components, rtol=0.0, atol=1e-4)
    stream = OnlineEstimator(parse_map(edited(chosen, {"check": None}), "of the test"), tmp_path)
    every = [one for row in walked[:400].to_dict("records") for one in stream.push(row.pop("t"), row)]
    np.testing.assert_allclose([*every[-1].components.values()], expected.components[len(every) - 1], atol=0.05)


def test_names_with_quotes_are_texts_of_a_suggested_map(tmp_path: Path) -> None:
    """The map was no TOML: the reader said so of a file that this program had written."""
    names = ['my "t"', 'joint1 "abs" pos', "joint2\\pos", "joint1_torque", 'joint2 "motor" torque', 'in "K"']
    time = 0.01 * np.arange(50.0)
    table = pd.DataFrame({name: np.sin(time + k) for k, name in enumerate(names)}).assign(**{names[0]: time})
    text = suggestion(tmp_path, table, arm_of(2))
    found = tomllib.loads(text)
    assert found["log"]["time"]["column"] == names[0]
    assert [found["joints"][part]["columns"] for part in ("position", "effort")] == [names[1:3], names[3:5]]
    assert "# Columns that are not used here: " + ", ".join(names[5:]) in text
    text = suggestion(tmp_path, table.drop(columns=names[3]), arm_of(2))
    assert r'# effort = {columns = [..., "joint2 \"motor\" torque"], unit' in text


def test_topics_of_an_autopilot_in_one_table_are_its_attitude_gyro_and_accelerometer(tmp_path: Path) -> None:
    """As ulog2csv writes PX4's, in rows of their own: no attitude was found, and the gyro was "3 joints?"."""
    first, turned = np.arange(100) % 2 == 0, np.sin(0.1 * np.arange(100.0))
    table = {"timestamp": 5e3 * np.arange(100.0), "x": 0.0, "y": 0.0, "z": turned, "a.output[0]": 0.0}
    parts = enumerate((np.cos(turned), 0.0, 0.0, np.sin(turned)))
    table |= {f"q[{k}]": np.where(first, part, np.nan) for k, part in parts}
    for name in ("s.gyro_rad", "s.accelerometer_m_s2"):
        table |= {f"{name}[{k}]": np.where(first, np.nan, k * turned) for k in range(3)}
    words = suggestion(tmp_path, table)
    assert "joints?" not in words
    suggested = tomllib.loads(words)
    assert suggested["base"]["quaternion"]["columns"] == [f"q[{k}]" for k in range(4)]
    assert suggested["base"]["quaternion"]["order"] == "wxyz"
    assert suggested["base"]["rate"]["columns"] == [f"s.gyro_rad[{k}]" for k in range(3)]
    assert suggested["check"]["specific_force"]["columns"] == [f"s.accelerometer_m_s2[{k}]" for k in range(3)]


def test_columns_of_lists_are_suggested(tmp_path: Path) -> None:
    """Lists of three ended in a traceback, as their own column counted as a fourth."""
    table = {"time": 0.01 * np.arange(100.0), "q": [str([0.1 * k, 0.2, 0.3 * k]) for k in range(100)]}
    assert 'position = {columns = ["q.0", "q.1", "q.2"]' in suggestion(tmp_path, table, arm_of(3))


def test_accelerations_of_three_joints_are_no_accelerometer(tmp_path: Path) -> None:
    """Of an arm that stands on the floor `specific_force = {columns = ["joint_acc_1", ...` was suggested."""
    table = {f"{part}_{k}": np.sin(0.1 * k * np.arange(100.0)) for part in ("q", "joint_acc", "tau") for k in (1, 2, 3)}
    assert "specific_force" not in suggestion(tmp_path, {"time": 0.01 * np.arange(100.0), **table}, arm_of(3))


def test_a_column_that_may_be_another_is_asked_for(tmp_path: Path) -> None:
    """Of a spring in the joint the motor's side was taken, with the rate of the link's, without a question."""
    names = ("motor_pos", "link_pos", "link_vel", "cmd_pos", "motor_torque", "spring_torque")
    text = suggestion(tmp_path, swings(f"elbow_{name}" for name in names), arm_of(["elbow"]))
    assert "# or elbow_link_pos, elbow_spring_torque? Of a spring or a gear" in text


@pytest.mark.parametrize(("largest", "unit"), [((13.5, 1.2), "rad"), ((13.5, 70.0), "deg"), ((1.0, 1.2), "rad")])
def test_a_joint_that_turns_on_may_have_any_angle(largest: tuple[float, float], unit: str, tmp_path: Path) -> None:
    """A slew that turned by 13.5 rad made degrees of all angles, and the forces wrong by 24 N without a word."""
    parts = [link("base"), link("tower", 5.0, "0 0 1", 3 * [1.0]), link("boom", 2.0, "1 0 0", 3 * [0.5])]
    parts += [joint("slew", "continuous", "base", "tower", axis="0 0 1"), joint("luff", "revolute", "tower", "boom")]
    swing = np.sin(0.01 * np.arange(400.0))
    columns = {f"{name}_pos": size * swing for name, size in zip(("slew", "luff"), largest, strict=True)}
    columns |= {f"{name}_torque": swing for name in ("slew", "luff")}
    text = suggestion(tmp_path, {"t": 0.01 * np.arange(400.0), **columns}, *parts)
    assert tomllib.loads(text)["joints"]["position"]["unit"] == unit
    assert ("slew: radians, or degrees?" in text) == (max(largest) > 7.0)


@pytest.mark.parametrize(
    ("place", "attitude", "free"),
    [
        ("nav.{} [m]", "nav.q{}", True),
        ("odom_{}", "odom_q{}", True),
        ("rov_p{}", "rov_quat_{}", True),
        ("vicon_p{} [mm]", "vicon_q{}", True),
        ("tcp_{}", "tcp_q{}", False),
        ("tcp_pos_{} [m]", "tcp_quat_{}", False),
        ("pos_{}_ref", "q{}_ref", False),
        ("none_{}", "imu_q{}", False),
    ],
)
def test_a_pose_is_found_by_what_its_columns_share(place: str, attitude: str, free: bool, tmp_path: Path) -> None:
    """Whatever the robot is called; a tool's pose or goal is none, nor an attitude's. It was suggested to be fixed."""
    time = 0.01 * np.arange(50.0)
    columns = {place.format(axis): np.sin(time) for axis in "xyz"}
    columns |= {attitude.format(axis): np.full(50, 0.5) for axis in "xyzw"} | {f"v_{axis}_body": time for axis in "xyz"}
    suggested = tomllib.loads(suggestion(tmp_path, {"t": time, **columns}, urdf()))
    assert suggested["robot"]["root"] == ("free_flyer" if free else "fixed")
    if free:
        base = suggested["base"]
        assert base["position"]["columns"] == [place.format(axis) for axis in "xyz"]
        assert base["position"]["unit"] == ("mm" if "[mm]" in place else "m")
        assert base["quaternion"]["columns"] == [attitude.format(axis) for axis in "xyzw"]
        assert base["velocity"]["axes"] == "body"


def test_numbered_columns_are_those_of_joints_of_that_number(tmp_path: Path) -> None:
    """Pinocchio sorts limbs by their names: of a hand with a thumb of joints 12 to 15, 12 got others' columns."""
    time = 0.01 * np.arange(50.0)
    columns = {f"{part}_{k}": np.sin(time + k) for part in ("pos", "tau") for k in range(16)}
    links = "".join(
        link(f"l{k}", 0.1, moments=[1e-4] * 3)
        + joint(f"joint_{k}.0", "revolute", f"l{k - 1}" if k % 4 else "palm", f"l{k}")
        for k in range(16)
    )
    joints = tomllib.loads(suggestion(tmp_path, {"t": time, **columns}, link("palm"), links))["joints"]
    for part, word in (("position", "pos"), ("effort", "tau")):
        assert joints[part]["columns"] == [f"{word}_{name[6:-2]}" for name in joints["names"]]
    assert joints["names"][4] == "joint_12.0"


@pytest.mark.parametrize(
    ("rate", "felt"),
    [
        ("angular_velocity_{}", "linear_acceleration_{}"),
        ("imu_w{}", "imu_a{}"),
        ("omega_{}", "none_{}"),
        ("gyro{}_w", "acc{}_w"),
        ("omega_{}", "force_w_{}"),
    ],
)
def test_an_attitude_and_a_gyro_ask_whether_the_base_moves(rate: str, felt: str, tmp_path: Path) -> None:
    """The y of `velocity_x` was taken for an axis; without an accelerometer, or with `imu_ax`, nothing was asked."""
    time = 0.01 * np.arange(50.0)
    columns = {f"imu_q{axis}": np.full(50, 0.5) for axis in "xyzw"}
    columns |= {way.format(axis): np.sin(time) for way in (rate, felt) for axis in "xyz"}
    text = suggestion(tmp_path, {"t": time, **columns}, urdf())
    base = tomllib.loads(re.sub("^# ", "", text[text.index("# [base]") : text.index("[joints]")], flags=re.MULTILINE))
    assert base["base"]["rate"]["columns"] == [rate.format(axis) for axis in "xyz"]
    assert base["base"]["from"] == ("joints" if felt in ("none_{}", "force_w_{}") else "imu")


@pytest.mark.parametrize("name", ["log.csv", "LOG.NC"])
def test_units_behind_names_are_those_of_suggestions(name: str, tmp_path: Path) -> None:
    """A force in kN, a rate in mm/s, a turn in degrees were taken as SI; of NetCDF, too; another unit is refused."""
    (tmp_path / "arm.urdf").write_text(arm_of(1))
    time = 0.01 * np.arange(50.0)
    groups = (("pos", "mm"), ("vel", "mm/s"), ("F", "kN"))
    columns = {f"{name}_{axis} [{unit}]": time for name, unit in groups for axis in "xyz"}
    columns |= {"q_x": 0.0, "q_y": 0.0, "q_z": 0.0, "q_w": 1.0, "joint1_pos [rev]": time, "joint1_torque [N mm]": time}
    if name == "log.csv":
        pd.DataFrame({"t": time, **columns}).to_csv(tmp_path / name, index=False)
    else:
        cells = {cell: cell.rstrip("]").split(" [") for cell in columns}
        data = {
            said[0]: ("time", columns[cell] + 0.0 * time, {"units": said[-1].replace("N mm", "mN m")})
            for cell, said in cells.items()
        }
        xr.Dataset(data, {"time": time}).to_netcdf(tmp_path / name, engine="h5netcdf")
    found = tomllib.loads(suggested_map(tmp_path / name, tmp_path / "arm.urdf"))
    assert (found["base"]["velocity"]["unit"], found["check"]["wrench"]["unit"]) == ("mm/s", "kN")
    read = read_columns(tmp_path / name, LogTable(), ["F_x", "q_x"])
    with pytest.raises(LogError, match=r"column 'F_x \[kN\]': N was expected"):
        channel_of(Request("check.wrench", ("F_x",), units=("N",)), read, 0.1)
    assert len(read.values["q_x"]) == 50
    assert [found["joints"][key]["unit"] for key in ("position", "effort")] == ["rev", "mN m"]
    if name == "LOG.NC":  # a unit of an array is not that of its columns of another kind
        pose = {"pose": (("time", "k"), np.ones((50, 7)), {"units": "mm"})}
        xr.Dataset(pose, {"time": time}).to_netcdf(tmp_path / "pose.nc", engine="h5netcdf")
        names = [f"pose.{k}" for k in range(7)]
        columns_of = read_columns(tmp_path / "pose.nc", LogTable(), names)
        turns = channel_of(Request("extra.turns", tuple(names[3:]), units=("-",) * 4), columns_of, 0.1)
        assert turns is not None
        for unit in ("m", "rad/s"):
            with pytest.raises(LogError, match=rf"column 'pose.0 \[mm\]': {unit} was expected"):
                channel_of(Request("base.position", tuple(names[:3]), units=(unit,) * 3), columns_of, 0.1)
    parse_map({**found, "robot": {**found["robot"], "points": ["l1"]}}, "that is suggested")


def arm_of(joints: int | Sequence[str]) -> str:
    """Return an arm of joints in a row, by their names or so many: joint1 and so on."""
    names = [f"joint{k + 1}" for k in range(joints)] if isinstance(joints, int) else joints
    links = [link(f"l{k}", float(k > 0), moments=3 * (1.0,)) for k in range(len(names) + 1)]
    parts = [joint(name, "revolute", f"l{k}", f"l{k + 1}") for k, name in enumerate(names)]
    return f'<robot name="arm">{"".join(links + parts)}</robot>'


def swings(columns: Iterable[str]) -> dict[str, Array]:
    """Return a table of half a second, of which each column swings at a pace of its own."""
    time = 0.01 * np.arange(50.0)
    return {"t": time} | {column: np.sin((k + 1) * time) for k, column in enumerate(columns)}


def test_numbered_columns_of_all_joints_come_before_a_tools_position(tmp_path: Path) -> None:
    """Its three columns, which stand first, were the positions of the first three joints."""
    names = [f"q{k} [rad]" for k in range(1, 7)]
    text = suggestion(tmp_path, swings([*(f"tcp_pos_{k} [mm]" for k in range(3)), *names]), arm_of(6))
    assert tomllib.loads(text)["joints"]["position"]["columns"] == names


@pytest.mark.parametrize("joints", [3, 5])  # the log's, or a gripper's beside them
@pytest.mark.parametrize(
    ("position", "velocity", "effort", "units"),
    [
        ("A{}_deg", "A{}_vel_deg_s", "A{}_current_A", ["deg", "deg/s", "A"]),
        ("axis {} (rad)", "axis {} (rad/s)", "axis {} (mNm)", ["rad", "rad/s", "mN m"]),
        ("q{}", "qdot_{}", "tau_{}", ["rad", "rad/s", "N m"]),
        ("j{}_pos_deg", "j{}_vel_dps", "j{}_trq_Nm", ["deg", "deg/s", "N m"]),
        ("J{} [deg]", "J{} [deg/s]", "J{} [N m]", ["deg", "deg/s", "N m"]),
        ("q{} [rad]", "dq{} [rad/s]", "tau{} [mN m]", ["rad", "rad/s", "mN m"]),
        ("m{}_actual_pos_rad", "m{}_actual_rad_per_s", "m{}_mA", ["rad", "rad/s", "mA"]),
        ("angles.{}", "rates.{}", "torques.{}", ["rad", "rad/s", "N m"]),
        ("positions[{}]", "speeds[{}]", "motor_currents[{}]", ["rad", "rad/s", "A"]),
    ],
)
def test_numbers_and_units_within_names_say_whose_columns_these_are(
    position: str, velocity: str, effort: str, units: list[str], joints: int, tmp_path: Path
) -> None:
    """Whatever their order; what was asked of a joint, its voltage and its external torque are not what it did."""
    stem = position.split("_")[0].split("}")[0] + "}"
    more = [f"{stem}{tail}" for tail in ("_target_deg", "_voltage_V", "_ext_torque_Nm", "_tcp_x")]
    wave = np.sin(np.arange(50) / 10.0)
    columns = {name.format(k): k * wave for name in (*more, effort, velocity, position) for k in (3, 1, 2)}
    text = suggestion(tmp_path, {"t": np.arange(50) / 100.0, **columns}, arm_of(joints))
    table = tomllib.loads(text)["joints"]
    assert table["names"] == ["joint1", "joint2", "joint3"]
    for part, name, unit in zip(("position", "velocity", "effort"), (position, velocity, effort), units, strict=True):
        assert table[part] == {"columns": [name.format(k) for k in (1, 2, 3)], "unit": unit}
    assert "# friction = {" in text
    torques = "# effort.torque_per_unit = {joint1 = ..., joint2 = ..., joint3 = ...}"
    assert (torques in text) == (units[2] in ("A", "mA"))


def test_numbers_behind_words_leave_the_words_as_they_are(tmp_path: Path) -> None:
    """As `tau_ext1`: what was measured is taken before what was asked for or is said of something else."""
    kinds = ["pos_des", "tau_ext", "tau_con", "pos", "pos_meas", "vel_des", "vel_meas", "tau_meas"]
    columns = {f"{kind}{k}": 10.0 * k * np.sin(np.arange(50) / 10.0) for kind in kinds for k in (1, 2, 3)}
    text = suggestion(tmp_path, {"t": np.arange(50) / 100.0, **columns}, arm_of(3))
    table = tomllib.loads(text)["joints"]
    for part, stem in (("position", "pos"), ("velocity", "vel"), ("effort", "tau")):
        assert table[part]["columns"] == [f"{stem}_meas{k}" for k in (1, 2, 3)]
    assert "the largest is 30; joint1, joint2, joint3: radians, or degrees?" in text


def test_columns_of_a_single_joint_need_no_name(tmp_path: Path) -> None:
    """As of a pendulum's log: t, position, velocity, torque; what is measured comes before what was wanted."""
    names = ("position", "velocity", "torque_meas")
    table = tomllib.loads(suggestion(tmp_path, swings(("torque_cmd", *names)), arm_of(1)))["joints"]
    assert [table[part]["columns"] for part in ("position", "velocity", "effort")] == [[name] for name in names]


def test_a_sensor_that_shows_nothing_for_long_is_not_held(tmp_path: Path) -> None:
    """Half of its samples repeat a force of exactly zero, and no check calls the channel held."""
    (tmp_path / "quadruped.urdf").write_text(urdf())
    frame = table(walk(1.4))
    frame.loc[frame.t < 0.8, ["fl_fx", "fl_fy", "fl_fz"]] = 0.0
    found = estimate(recorded(tmp_path / "walk.csv", table_map(Path("quadruped.urdf")), table=frame))
    assert not any(one.check == "held channel" for one in found.findings)


@pytest.mark.parametrize("rest", [0.6, 1.4])
def test_an_arm_that_rests_between_its_moves_is_not_held(rest: float) -> None:
    """A still encoder is a note; one read at 100 Hz into a log of 500 Hz is held, or still in motion, with a jump."""
    time = np.arange(0.0, 16.0, 0.002)
    angle = np.round(np.cumsum(np.where(time % 4.0 < rest, 0.0, np.sin(time))) * 0.002 * 2**17) / 2**17
    spool = Spool()
    every_fifth = angle[np.arange(len(time)) // 5 * 5]
    frozen = np.where((time > 10.0) & (time < 11.5), angle[5000], angle)
    speed = np.sin(np.pi * np.maximum(time % 4.0 - rest, 0.0) / (4.0 - rest)) ** 2
    coarse = np.round(np.cumsum(speed) * 0.002 * 2000.0) / 2000.0  # it begins by one count, and the next comes later
    for shown, said in ((angle, "note"), (coarse, "note"), (every_fifth, "warning"), (frozen, "warning")):
        values = series_of(spool, shown[:, None])
        channel = Channel("joints.position", ("q",), series_of(spool, time), values)
        found = channel_findings(channel, [(0.0, float(time[-1]))], alone=False, start=0.0)
        assert [one.verdict for one in found if one.check == "held channel"] == [said]


def test_columns_that_a_suggestion_does_not_use_are_listed(tmp_path: Path) -> None:
    """A time called ms is in ms, efforts may be called eff, and a thrust is not dropped without a word."""
    wave = np.sin(np.arange(50) / 10.0)
    table = pd.DataFrame({"ms": 10.0 * np.arange(50), "pos_joint1": wave, "eff_joint1": wave, "thrust": wave})
    text = suggestion(tmp_path, table, arm_of(1))
    suggested = tomllib.loads(text)
    assert suggested["log"]["time"] == {"column": "ms", "unit": "ms"}
    assert suggested["joints"]["effort"]["columns"] == ["eff_joint1"]
    assert text.rstrip().endswith("# Columns that are not used here: thrust")


@pytest.mark.parametrize(
    ("names", "said"),
    [
        ("rpm{}", {"law": "polynomial 2", "fit": {"to": "check.specific_force"}}),
        ("motor_omega[{}]", {"law": "polynomial 2", "fit": {"to": "check.specific_force"}}),
        ("rotor_{}_thrust_N", {"law": "polynomial 1", "coefficients": [1.0]}),
        ("pwm_{}", {"law": "polynomial 1 2", "full_scale": 2.0, "fit": {"to": "check.specific_force"}}),
        ("motor_temperature_{}", None),
    ],
)
def test_rotors_are_suggested_with_their_frames(names: str, said: dict[str, object] | None, tmp_path: Path) -> None:
    """By thrust, speed or command; what only has a motor's name is none, nor is a rotor that an arm has."""
    links = [link(f"prop{k}") + joint(f"at{k}", "fixed", "hub", f"prop{k}") for k in range(1, 5)]
    hub = link("hub", 1.0, moments=(1.0, 1.0, 1.0))
    wave = 1.0 + np.sin(np.arange(50) / 10.0)
    rotors = {names.format(k): 2.0 * wave / wave.max() for k in range(4)}
    table = pd.DataFrame({"t": 0.01 * np.arange(50), "q1": wave, **rotors})
    assert "known" not in tomllib.loads(suggestion(tmp_path, table, arm_of(1)))
    table = table.assign(**dict.fromkeys(["x", "y", "z", "acc_x", "acc_y", "acc_z"], wave))
    known = tomllib.loads(suggestion(tmp_path, table, hub, *links)).get("known", {})
    expected = {
        f"rotor_{k}": {"columns": [names.format(k)], "frame": f"prop{k + 1}", "direction": [0, 0, 1], **(said or {})}
        for k in range(4)
    }
    assert known == (expected if said else {})
    measured = dict.fromkeys([f"rotor_{kind}{axis}" for kind in "fm" for axis in "xyz"], wave)
    suggested = tomllib.loads(suggestion(tmp_path, table.assign(**measured), hub, *links))
    assert suggested["known"] == {"rotors": {"columns": [*measured]}}, "their force is not sought, nor compared with"
    assert "wrench" not in suggested["check"]


def test_angles_that_begin_anew_tell_the_unit_of_their_rates(tmp_path: Path) -> None:
    """A jump from 360 deg to 0 was taken for motion of the joint, and its rate for one in rad/s."""
    (tmp_path / "arm.urdf").write_text(arm_of(1))
    time = 0.01 * np.arange(500.0)
    table = pd.DataFrame({"t": time, "pos_joint1": 30.0 * np.sin(time) % 360.0, "vel_joint1": 30.0 * np.cos(time)})
    table.to_csv(tmp_path / "log.csv", index=False)
    data = {name: ("time", table[name]) for name in table.columns[1:]}
    xr.Dataset(data, {"time": time}).to_netcdf(tmp_path / "log.nc", engine="h5netcdf")  # whose step was not used
    for log in ("log.csv", "log.nc"):
        suggested = tomllib.loads(suggested_map(tmp_path / log, tmp_path / "arm.urdf"))
        assert suggested["joints"]["velocity"]["unit"] == "deg/s"


def test_a_time_since_1970_is_one_so_is_what_rises_evenly_and_a_column_of_whole_seconds_is_not(tmp_path: Path) -> None:
    """A map reads one column of time; steps of 0 were suggested."""
    for columns, said in (
        ({"t_epoch_ms": 1.7e12 + 10.0 * np.arange(50), "x": 0.0}, 'time = {column = "t_epoch_ms", unit = "ms"}'),
        ({"row": np.arange(50), "Zeit [ms]": 7.0 + 4.0 * np.arange(50)}, 'time = {column = "Zeit [ms]", unit = "ms"}'),
        ({"lidar": 1.7e9 + 0.01 * np.arange(50), "x": 0.0}, 'time = {column = "lidar", unit = "s"}'),
        ({"row": np.arange(50), "x": np.arange(50.0) ** 3}, "# MISSING: no column looks like a time"),
        (
            {"time": ["11/03/2026 11:59:55 PM"] * 50, "x": 0.0},
            "# MISSING: time holds no numbers, nor dates as ISO 8601",
        ),
        (
            {"clk": 0.01 * np.arange(50.0), "actual_angle": 0.02 * np.arange(50.0)},
            'time = {column = "clk", unit = "s"}',
        ),
        (
            {"des_time": 1e-3 * np.arange(50.0), "x": 0.0, "meas_time": 0.0144 * np.arange(50.0)},
            'time = {column = "meas_time", unit = "s"}',
        ),
        ({"stamp_sec": np.ones(50), "stamp_nsec": 1e7 * np.arange(50)}, "# MISSING: stamp_sec repeats from row to row"),
    ):
        assert f"\n{said}" in suggestion(tmp_path, columns)


def test_the_suggested_gain_suits_the_joints_where_others_have_rows_of_their_own(tmp_path: Path) -> None:
    """Rows of joints at 100 Hz among those of a sensor at 1 kHz: it was that of 1 kHz."""
    (tmp_path / "arm.urdf").write_text(arm_of(1))
    time = 0.001 * np.arange(2000.0)
    angle = np.where(np.arange(2000) % 10 == 3, np.sin(time), np.nan)
    pd.DataFrame({"t": time, "pos_joint1": angle, "fx": time}).to_csv(tmp_path / "log.csv", index=False)
    suggested = suggested_map(tmp_path / "log.csv", tmp_path / "arm.urdf")
    assert tomllib.loads(suggested)["observer"]["gain"] == 20.0
    assert 'unit = "s"}  # steps of 0.01:' in suggested


def test_packed_numbers_of_a_netcdf_log_are_unpacked(tmp_path: Path) -> None:
    """As xarray packs them, a hole too; one packed variable that no map reads refused the whole log."""
    x = np.array([0.0, 0.25, np.nan, 0.75, 1.0])
    data = xr.Dataset({"x": ("time", x)}, {"time": 0.1 * np.arange(5.0)})
    packing = {"dtype": "i2", "scale_factor": 0.01, "add_offset": 0.5, "_FillValue": -9}
    data.to_netcdf(tmp_path / "log.nc", engine="h5netcdf", encoding={"x": packing})
    np.testing.assert_allclose(read_columns(tmp_path / "log.nc", LogTable()).values["x"][:], x)
    with h5py.File(tmp_path / "log.nc", "a") as file:
        file["x"].attrs["add_offset"] = "half"
    with pytest.raises(LogError, match=r"log\.nc: 'x' has the attribute add_offset: plain numbers were expected"):
        read_columns(tmp_path / "log.nc", LogTable())


def test_empty_cells_of_a_netcdf_log_have_either_of_two_marks(tmp_path: Path) -> None:
    """-999 beside a fill value was a sample, as was 1e20 in single precision where the mark is a double."""
    data = xr.Dataset({name: ("time", np.array([1.0, -999.0, 1e20])) for name in "ab"}, {"time": [0.0, 0.1, 0.2]})
    data["a"].attrs["missing_value"] = data["b"].attrs["missing_value"] = [-999.0, 1e20]
    data.to_netcdf(tmp_path / "log.nc", engine="h5netcdf", encoding={"b": {"dtype": "f4", "_FillValue": None}})
    columns = read_columns(tmp_path / "log.nc", LogTable())
    for name in "ab":
        np.testing.assert_array_equal(columns.values[name][:], [1.0, np.nan, np.nan])


def test_the_time_of_a_netcdf_log_need_not_be_the_coordinate_of_its_dimension(tmp_path: Path) -> None:
    """As xarray writes variables over `sample`: such a file had no time."""
    stamp, turn = 1e3 * np.arange(5.0), np.arange(10.0).reshape(5, 2)
    data = xr.Dataset({"stamp": ("sample", stamp), "q": (("sample", "joint"), turn)}, {"joint": ["hip", "knee"]})
    data.to_netcdf(tmp_path / "log.nc", engine="h5netcdf")
    with pytest.raises(LogError, match=r"no time or interval .* log\.time\.column of the map \(it has stamp\)"):
        read_columns(tmp_path / "log.nc", LogTable())
    columns = read_columns(tmp_path / "log.nc", LogTable.model_validate({"time": {"column": "stamp", "unit": "ms"}}))
    assert columns.names == ("q.hip", "q.knee")
    np.testing.assert_allclose(columns.clocks["stamp"].time, 1e-3 * stamp)


def test_variables_of_a_netcdf_log_are_read_whichever_dimension_is_the_time(tmp_path: Path) -> None:
    """MATLAB writes the last one first: such a file had no columns, and the error said "there are" and nothing."""
    turn = np.arange(30.0).reshape(3, 5, 2)
    labels = {"time": 0.1 * np.arange(5.0), "leg": ["a", "b", "c"], "joint": ["hip", "knee"]}
    data = xr.Dataset({"q": (("leg", "time", "joint"), turn, {"units": "rad"})}, labels)
    data.to_netcdf(tmp_path / "log.nc", engine="h5netcdf")
    values = read_columns(tmp_path / "log.nc", LogTable()).values
    assert len(values) == 6
    np.testing.assert_array_equal(values["q.b.knee [rad]"][:], turn[1, :, 1])


@pytest.mark.parametrize(
    ("spelt", "unit"),
    [("degrees", "deg"), ("radian s-1", "rad/s"), ("degree s^-1", "deg/s"), ("m s-2", "m/s2"), ("mN.m", "mN m")],
)
def test_units_may_be_spelt_as_conventions_of_netcdf_do(spelt: str, unit: str, tmp_path: Path) -> None:
    """They passed for no unit: degrees were taken as rad, and mN m as N m, for 3,500 N in place of 3 N."""
    data = xr.Dataset({"x": ("time", np.zeros(5), {"units": spelt})}, {"time": 0.1 * np.arange(5.0)})
    data.to_netcdf(tmp_path / "log.nc", engine="h5netcdf")
    assert read_columns(tmp_path / "log.nc", LogTable(), ["x"]).units == {"x": unit}


def test_the_unit_of_a_netcdf_log_s_time_is_the_file_s(tmp_path: Path) -> None:
    """Dates are whole milliseconds there: they passed for seconds, and a gain 1,000 times too small was suggested."""
    dates = np.datetime64("2026-11-03T12:00:00") + np.arange(0, 1000, 2).astype("timedelta64[ms]")
    data = xr.Dataset({"q": (("time", "joint"), np.zeros((500, 1)))}, {"time": dates, "joint": ["hip"]})
    data.to_netcdf(tmp_path / "log.nc", engine="h5netcdf")
    (clock,) = read_columns(tmp_path / "log.nc", LogTable()).clocks.values()
    np.testing.assert_allclose(np.diff(clock.time), 2e-3, rtol=1e-6)
    assert tomllib.loads(suggested_map(tmp_path / "log.nc", None))["observer"]["gain"] == pytest.approx(100.0)


@pytest.mark.parametrize(
    ("units", "said", "step"),
    [("days since 2026-01-01", {}, 86400.0), ("ms", {}, 1e-3), ("", {}, 1.0), ("ticks", {"unit": "us"}, 1e-6)],
)
def test_units_of_a_netcdf_log_s_time(units: str, said: dict[str, str], step: float, tmp_path: Path) -> None:
    """The map's counts first; one that nobody knows is refused."""
    data = xr.Dataset({"q": ("time", np.zeros(5))}, {"time": ("time", np.arange(5.0), {"units": units})})
    data.to_netcdf(tmp_path / "log.nc", engine="h5netcdf")
    (clock,) = read_columns(tmp_path / "log.nc", LogTable.model_validate({"time": said})).clocks.values()
    np.testing.assert_allclose(np.diff(clock.time), step)
    if units == "ticks":
        with pytest.raises(LogError, match=r"'time' has the unit 'ticks': log\.time\.unit of the map was expected"):
            read_columns(tmp_path / "log.nc", LogTable())


def test_of_two_times_over_one_dimension_the_map_s_counts(tmp_path: Path) -> None:
    """Beside the dimension's own, or a step that is called `interval`, it was ignored."""
    time = 0.01 * np.arange(5.0)
    variables = {"q": ("time", time), "interval": ("time", 0.0 * time + 0.01), "stamp": ("time", 7.0 + 2.0 * time)}
    xr.Dataset(variables, {"time": time}).to_netcdf(tmp_path / "log.nc", engine="h5netcdf")
    for said, first in (({}, 0.0), ({"column": "stamp"}, 7.0)):
        columns = read_columns(tmp_path / "log.nc", LogTable.model_validate({"time": said}))
        (clock,) = columns.clocks.values()
        assert (clock.time[0], len(clock.time)) == (first, 5)
        assert set(columns.clock_of.values()) == {said.get("column", "time")}


def test_a_table_whose_rows_are_shuffled_is_refused(tmp_path: Path) -> None:
    """Of 5,000 rows 11 were estimated, 350 N off, beside warnings."""
    order = np.random.default_rng(1).permutation(600)
    table(walk(3.0)).iloc[order].to_csv(tmp_path / "walk.csv", index=False)
    (tmp_path / "quadruped.urdf").write_text(urdf())
    chosen = edited(table_map(Path("quadruped.urdf")), {"log.longest_gap": 10.0})
    with pytest.raises(LogError, match=r"time goes back: .* samples have no stamp, or one that does not fit"):
        estimate(recorded(tmp_path / "walk.csv", chosen))
