"""Maps: values that cannot be, joints as logs have them, and what a robot's file says beyond its model."""

import itertools
import re
import tomllib
from contextlib import nullcontext
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pandas as pd
import pinocchio as pin
import pytest
import tomli_w
from support import swinging_arm
from support.bad_maps import keys
from support.commands import call
from support.further import further
from support.recorded import edited, recorded
from support.robot_parts import ALIGNED, channels, joint, joint_map, joint_table, link, sines
from support.swinging_arm import CONSTANT, JOINTS, arm, arm_map, recording
from support.walking_log import bag, table, table_map, urdf, walk
from support.without_coriolis import LEG

from aerobat_pin import load_robot, open_record
from aerobat_pin.errors import AerobatError, CalibrationError, LogError, MapError
from aerobat_pin.estimation import OnlineEstimator, calibrate, estimate, record_findings, stream_of
from aerobat_pin.estimation.checks.readings import joint_pairs
from aerobat_pin.experiments import check_record
from aerobat_pin.forces.run_observers import rows_of
from aerobat_pin.observers import AllBut
from aerobat_pin.records import Columns, PlainRobot, RobotTable, parse_map, robot_of_map, suggested_map
from aerobat_pin.records.joint_channels import effort_matrix, encoder_matrix
from aerobat_pin.records.robot_files import FIXED, FREE, option_of_robot
from aerobat_pin.records.suggest import _suggest_base
from aerobat_pin.records.suggest_joints import suggest_joints

SENSOR = {"columns": ["fl_fx", "fl_fy", "fl_fz"], "point": "FL_FOOT"}


@pytest.fixture(scope="module")
def short_walk(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with a robot and the table of its walk, 0.3 s at 200 Hz."""
    folder = tmp_path_factory.mktemp("walk")
    (folder / "robot.urdf").write_text(urdf())
    table(walk(0.3, 200.0)).to_csv(folder / "log.csv", index=False)
    return folder


RIGHT = table_map(Path("robot.urdf"))


@pytest.mark.parametrize(
    ("key", "value", "said"),
    [
        ("use.free", [0.2, 0.1], r"use\.free = \[0\.2, 0\.1\]: from and to were expected, the smaller one first"),
        ("check.wrench.tare", [0.2, 0.1], r"check\.wrench\.tare = .*the smaller one first"),
        ("log.delimiter", "\\s+", r"log\.delimiter = .*at most 1 character"),
        ("use.when", {"above": 1.0}, r"missing key 'use\.when\.column'"),
        ("use.when", {"column": "px"}, r"use\.when: above or below was expected"),
        ("use.when", {"column": "px", "above": 1.0, "below": -1.0}, r"use\.when: above or below was expected"),
        ("use.when", {"column": "px", "above": 0.0, "trim": [-1.0, 0.0]}, r"use\.when\.trim\.0 = -1\.0"),
        ("known.t", {"columns": ["px"], "law": "polynomial 1 1"}, 'law = "polynomial 1 1": .*once each'),
        ("known.t", {"columns": ["px"], "law": "polynomial 1", "fit": {"part": [0.5, 1.5]}}, r"fit\.part\.1 = 1\.5"),
        ("known.t", {"columns": ["px"], "law": "polynomial 1", "fit": {"part": [0.5, 0.1]}}, r"fit\.part = .*smaller"),
        ("payload", {"frame": "trunk", "mass": 1.0, "inertia": [-1.0, 0.0, 0.0]}, r"payload\.inertia\.0 = -1\.0"),
        ("payload", {"frame": "trunk", "mass": 1, "com": [0.1, 0.2]}, r"payload\.com = \[0\.1, 0\.2\]: 3 numbers were"),
        ("payload", {"frame": "trunk", "mass": 1.0, "com": [0.1, 0.2, 0.3, 0.4]}, r"payload\.com = .*3 numbers were"),
        ("robot.down", [0.0, 1.0], r"robot\.down"),
        ("joints.effort.torque_per_unit", {"*": 0.0}, "another number than 0 was expected"),
        ("joints.effort.torque_per_unit", [6.1, 5.2], r"\[6\.1, 5\.2\]: a table \{joint = 6\.1, \.\.\.\} was expected"),
        ("joints.friction", "coulomb+viscous", r"joints\.friction = .*: a table of law, fit, to, scale was expected"),
        ("joints.coupling", {"knee": [1, 2]}, r"joints\.coupling\.knee = \[1, 2\]: a table \{name = 1, \.\.\.\} was"),
    ],
)
def test_a_value_that_cannot_be_is_refused_by_its_key(key: str, value: Any, said: str) -> None:
    """Before a log is read."""
    with pytest.raises(MapError, match=said):
        parse_map(edited(RIGHT, {key: value}), "map.toml")


@pytest.mark.parametrize(
    ("key", "value", "said"),
    [
        ("use.free", [50.0, 60.0], r"use\.free = \[50\.0, 60\.0\]: a stretch within the record's 0\.3 s"),
        ("use.free", [-2.0, -1.0], r"use\.free = .*a stretch within the record's 0\.3 s"),
        ("payload", {"frame": "trunk", "fit": [5.0, 6.0]}, r"payload\.fit = .*within the record's"),
        ("check.wrench", {**SENSOR, "part": [5.0, 6.0]}, r"check\.wrench\.part = .*within the record's"),
        ("check.wrench", {**SENSOR, "filter": 1e-300}, r"check\.wrench\.filter = 1e-300 Hz: a period within"),
        ("check.wrench", {**SENSOR, "filter": 100.0}, r"filter = 100 Hz: .*less than half its rate of 200 Hz"),
        ("robot.points", [], r"check\.wrench: .*robot\.points = \[\].* leave one of the two out"),
        ("observer.names", ["momentum", "momentum"], "different ones were expected"),
    ],
)
def test_a_value_outside_the_record_is_refused(key: str, value: Any, said: str, short_walk: Path) -> None:
    """Its length and rate are known once it is read."""
    with pytest.raises((MapError, LogError, ValueError), match=said):
        estimate(recorded(short_walk / "log.csv", edited(RIGHT, {key: value})))


def test_the_schema_reaches_every_table() -> None:
    """From which `make reliability` draws: keys in tables of tables and of names, too."""
    found = dict(keys())
    some = {"robot.body.mass", "use.when.trim", "known.thrust.fit.part", "joints.friction.fit", "log.time.unit"}
    assert some <= set(found)
    assert len(found) > 100


PAGE = Path(__file__).resolve().parents[2] / "docs" / "recordings.md"
FACTOR, OFFSET = np.array([-0.02, 0.01, 0.03]), np.array([0.0, 0.3, -1.2])
COUPLING = np.array([[1.0, 0.0, 0.0], [0.0, 0.5, 0.5], [0.0, 0.5, -0.5]])  # two motors move lift and bend
AT_MOTORS: dict[str, Any] = {
    "factor": {"turn": -0.02, "bend": 0.03, "*": 0.01},
    "offset": {"lift": 0.3, "bend": -1.2},
    "coupling": {"lift": {"lift": 0.5, "bend": 0.5}, "bend": {"lift": 0.5, "bend": -0.5}},
}


def changed(**joints: Any) -> dict[str, Any]:
    """Return the map of the arm without a fit, with changed entries of its joints."""
    return edited(arm_map(), {"joints.friction": None, **{f"joints.{key}": value for key, value in joints.items()}})


def test_every_joint_that_is_not_named_is_held_in_a_stream_too(folder: Path) -> None:
    """A star for it; the stream took it for a joint of that name."""
    columns = {
        f"joints.{key}.columns": [f"turn_{part}", f"lift_{part}"]
        for key, part in zip(("position", "velocity", "effort"), "qvi", strict=True)
    }
    parts, values = [], edited(changed(names=["turn", "lift"]), columns)
    rows = pd.read_csv(folder / "joints.csv").head(100).to_dict("records")
    for held in ({"bend": 0.0}, {"*": 0.0}):
        stream = OnlineEstimator(parse_map(edited(values, {"joints.held": held}), "of the test"), folder)
        parts.append([list(one.components.values()) for row in rows for one in stream.push(row["t"], row)])
    assert len(parts[1]) == 99
    np.testing.assert_array_equal(*parts)


@pytest.mark.parametrize("name", ["hip_yaw", "base_yaw"])
def test_a_held_base_is_not_believed_whatever_its_joints_are_called(name: str, tmp_path: Path) -> None:
    """Nothing measures what holds it; a held joint whose name begins with `base` was taken for its rows."""
    parts = [link("trunk", 6.0), link("hip", 0.5), link("shank", 0.4, "0 0 -0.1"), link("foot")]
    parts += [joint(name, "revolute", "trunk", "hip", "0 0 0", "0 0 1"), joint("knee", "revolute", "hip", "shank")]
    parts.append(joint("sole", "fixed", "shank", "foot", "0 0 -0.2"))
    (tmp_path / "leg.urdf").write_text(f'<robot name="leg">{"".join(parts)}</robot>')
    robot = {"urdf": "leg.urdf", "root": "free_flyer", "points": ["foot"]}
    chosen = parse_map({"robot": robot, "base": {"held": True}, "joints": {"held": {name: 0.0}}}, "of the test")
    rows, _ = rows_of(chosen, robot_of_map(chosen.robot, tmp_path), ("knee",), ["joints.effort"])
    assert rows == AllBut(name, "base")


def test_a_window_that_differentiates_ends_within_the_margin_of_a_block() -> None:
    """Beyond it rates at a block's border were those of a cut window, 0.24 rad/s off."""
    with pytest.raises(MapError, match=r"joints\.velocity\.window = 1\.6: input should be less than or equal to 1"):
        parse_map(changed(velocity={"from": "position", "window": 1.6}), "of the test")


def test_a_known_force_may_not_have_the_name_of_what_is_learnt(folder: Path) -> None:
    """Fitted friction took its place without a word."""
    known = {"friction": {"columns": ["fx", "fy", "fz"], "frame": "tool", "axes": "world"}}
    with pytest.raises(MapError, match=r"known\.friction: another name was expected"):
        estimate(recorded(folder / "joints.csv", edited(changed(), {"known": known})))


def test_a_known_force_acts_in_the_middle_of_its_interval(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Some 60 N at a tool that moves, seen by a sensor at 50 Hz: at its beginning 0.2 N m of them were left."""
    for name in ("COULOMB", "VISCOUS", "OFFSET", "ROTOR"):
        monkeypatch.setattr(swinging_arm, name, np.zeros(3))
    monkeypatch.setattr(swinging_arm, "HEAVIER", 1.0)
    (tmp_path / "arm.urdf").write_text(arm())
    recording(tmp_path, "known", pushed=True, seed=2, seconds=6.0)
    log, model = pd.read_csv(tmp_path / "known.csv").iloc[::10], pin.buildModelFromXML(arm())
    data, tool = model.createData(), model.getFrameId("tool")
    angles = log[[f"{joint}_q" for joint in JOINTS]].to_numpy()
    levers = [pin.computeFrameJacobian(model, data, q, tool, ALIGNED)[2] for q in angles]
    log[[f"{j}_i" for j in JOINTS]] += 60.0 / CONSTANT * np.array(levers)
    log["fz"] -= 60.0
    log.to_csv(tmp_path / "known.csv", index=False)
    known = {"sensor": {"columns": ["fx", "fy", "fz"], "frame": "tool", "axes": "world"}}
    values = edited(changed(), {"robot.points": [], "known": known})
    left = next(iter(estimate(recorded(tmp_path / "known.csv", values), trust=True).estimates.values())).components
    assert np.all(np.sqrt(np.mean(left[20:] ** 2, axis=0)) < 0.03)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with the arm, a table written at its joints and the same one written at its motors."""
    folder = tmp_path_factory.mktemp("joints")
    (folder / "arm.urdf").write_text(arm())
    recording(folder, "joints", pushed=True, seed=2, seconds=3.0)
    table, A = pd.read_csv(folder / "joints.csv"), COUPLING * FACTOR
    q, v, tau = ([f"{joint}_{part}" for joint in JOINTS] for part in "qvi")
    table[q] = np.linalg.solve(A, (table[q].to_numpy() - OFFSET).T).T
    table[v] = np.linalg.solve(A, table[v].to_numpy().T).T
    table[tau] = table[tau].to_numpy() @ A
    table.to_csv(folder / "motors.csv", index=False)
    return folder


def test_a_log_written_at_the_motors_gives_the_forces_of_the_joints(folder: Path) -> None:
    """Gears, zeros and two coupled joints, to 1e-9 of the force; as a stream, too."""
    written = {"joints": changed(), "motors": changed(**AT_MOTORS)}
    at_joints, at_motors = (
        estimate(recorded(folder / f"{name}.csv", values)).estimates["force_level"].components
        for name, values in written.items()
    )
    assert np.abs(at_joints).max() > 5.0
    np.testing.assert_allclose(at_motors, at_joints, rtol=0.0, atol=1e-9 * np.abs(at_joints).max())
    heard = []
    for name, values in written.items():
        online, found = OnlineEstimator(parse_map(values, "of the test"), folder), []
        for row in pd.read_csv(folder / f"{name}.csv").head(50).to_dict("records"):
            found += online.push(row["t"], row)
        heard.append([list(one.components.values()) for one in found])
    assert len(heard[0]) > 40
    np.testing.assert_allclose(heard[1], heard[0], rtol=0.0, atol=1e-9 * np.abs(heard[0]).max())


def test_a_stream_takes_its_first_readings_as_they_are(folder: Path) -> None:
    """Of coupled motors, too: near a full turn it was taken out, as if they had been at zero before."""
    table = pd.read_csv(folder / "joints.csv", nrows=20)
    q, v, tau = (table[[f"{joint}_{part}" for joint in JOINTS]].to_numpy() for part in "qvi")
    first = np.array([0.1, 2.0 * np.pi, 3.0])  # readings
    zero = q[0] - COUPLING @ first
    readings = np.linalg.solve(COUPLING, (q - zero).T).T, np.linalg.solve(COUPLING, v.T).T, tau @ COUPLING
    coupling = AT_MOTORS["coupling"]
    chosen = parse_map(changed(coupling=coupling, offset=dict(zip(JOINTS, zero.tolist(), strict=True))), "of the test")
    stream = OnlineEstimator(chosen, folder)
    names = [f"{joint}_{part}" for part in "qvi" for joint in JOINTS]
    for turned in np.array([[0.0, 0.0, 0.0], [0.0, 2.0 * np.pi, 0.0]]):  # after a reset a full turn further
        for t, row in zip(table.t, np.hstack([readings[0] + turned, *readings[1:]]).tolist(), strict=True):
            stream.push(t, dict(zip(names, row, strict=True)))
        np.testing.assert_allclose(stream.configuration, q[-1] + COUPLING @ turned, atol=1e-9)
        stream.reset()


def test_the_wrist_of_the_documents_moves_as_they_say() -> None:
    """The page's map: 90 and 30 deg of its motors, and 1 N m of one of them."""
    [block] = re.findall(r"```toml\n(\[joints\]\nnames = \[\"pitch.*?)```", PAGE.read_text(), re.DOTALL)
    table = parse_map({"robot": {}, **tomllib.loads(block)}, "of the page").joints
    q = encoder_matrix(table, table.names) @ [90.0, 30.0]
    np.testing.assert_allclose(q, [1.2, 0.6])
    np.testing.assert_allclose(effort_matrix(table, table.names, table.names) @ [1.0, 0.0], [50.0, 50.0])


def test_a_slide_behind_a_spindle_moves_by_its_encoders_angle(tmp_path: Path) -> None:
    """5 mm a turn, in degrees: a factor in m per rad; the effort in N is the motor's torque over it."""
    table = robot_table(tmp_path, "prismatic")
    factor = 5e-3 / (2.0 * np.pi)
    table["q"], table["v"] = (np.degrees(table[name] / factor) for name in "qv")
    table["tau"] *= factor
    units = {"joints.position.unit": "deg", "joints.velocity.unit": "deg/s"}
    values = edited(robot_map(), {**units, "joints.factor.slide": factor})
    found = estimate(recorded(tmp_path / "log.csv", values, table=table)).estimates["force_level"].components[200:, 2]
    np.testing.assert_allclose(found, 3.0, atol=0.05)


@pytest.mark.parametrize(
    ("kinds", "of_x"),
    [(["revolute"], "hardly turns a joint"), (["prismatic", "revolute"], "the rows that show it err too much there")],
)
def test_a_component_is_hidden_only_where_no_joint_feels_it(kinds: list[str], of_x: str, tmp_path: Path) -> None:
    """A hinge hides two directions, Fy and another: of one it was said that rows err. On a slide it hides Fy alone."""
    robot_table(tmp_path, *kinds, motors=len(kinds)).to_csv(tmp_path / "log.csv", index=False)
    found = estimate(recorded(tmp_path / "log.csv", robot_map(len(kinds)))).findings
    told = {one.text[:6]: one.text for one in found if one.check == "what the pose shows"}
    assert told["tip.Fy"].endswith("a force along (0.00, 1.00, 0.00) at tip hardly turns a joint")
    assert of_x in told["tip.Fx"]


def test_a_point_may_be_called_like_the_joint_that_carries_it(tmp_path: Path) -> None:
    """As `right_hand` of Rethink's Sawyer: the same estimate as of a joint with a name of its own."""
    recording(tmp_path, "log", True, 1, seconds=2.0)
    section = {"columns": ["fx", "fy", "fz"], "unit": "N", "axes": "frame"}
    chosen = edited(arm_map(), {"check.wrench": section, "known.hand": section | {"frame": "tool"}})
    found = []
    for name in ("end", "tool"):
        (tmp_path / "arm.urdf").write_text(arm().replace('joint name="end"', f'joint name="{name}"'))
        found.append(estimate(recorded(tmp_path / "log.csv", edited(chosen, {"joints.friction": None}))))
    first, second = (result.estimates["force_level"].components for result in found)
    np.testing.assert_array_equal(first, second)
    assert list(map(str, found[0].findings)) == list(map(str, found[1].findings))


@pytest.mark.parametrize(
    ("kind", "part", "unit", "said"),
    [
        ("prismatic", "position", "rad", "but slide slides: m or mm was expected"),
        ("prismatic", "velocity", "deg/s", "but slide slides: m/s or mm/s was expected"),
        ("prismatic", "effort", "N m", "but slide slides: N was expected"),
        ("revolute", "position", "mm", "but hinge turns: rad or deg or rev was expected"),
        ("revolute", "effort", "N", "but hinge turns: N m or mN m was expected"),
    ],
)
def test_a_unit_that_no_joint_can_have_is_refused(kind: str, part: str, unit: str, said: str, tmp_path: Path) -> None:
    """An angle of a slide was taken for its place."""
    robot_table(tmp_path, kind).to_csv(tmp_path / "log.csv", index=False)
    values = edited(robot_map(), {f"joints.{part}.unit": unit})
    with pytest.raises(AerobatError, match=rf"joints\.{part}\.unit = '{unit}', {said}"):
        recorded(tmp_path / "log.csv", values)


def test_a_unit_is_that_of_the_joints_that_can_have_it(tmp_path: Path) -> None:
    """Of a hinge on a slide: mm or degrees, and the other joint in SI."""
    table = robot_table(tmp_path, "prismatic", "revolute", motors=2)
    for unit, column, factor in (("mm", "q", 1e3), ("deg", "q1", 180.0 / np.pi)):
        table.assign(**{column: factor * table[column]}).to_csv(tmp_path / "log.csv", index=False)
        record = recorded(tmp_path / "log.csv", edited(robot_map(2), {"joints.position.unit": unit}))
        np.testing.assert_allclose(record.block(0, 500).q, table[["q", "q1"]].to_numpy()[:501], atol=1e-6)


def test_efforts_and_headers_beside_a_slide_are_in_their_units(tmp_path: Path) -> None:
    """A slide's 40 N were 40 mN beside a hinge in mN m; `q [mm]` and `q1 [deg]` were read as m and rad."""
    table = robot_table(tmp_path, "prismatic", "revolute", motors=2)
    table.assign(tau1=1e3 * table.tau1).to_csv(tmp_path / "log.csv", index=False)
    record = recorded(tmp_path / "log.csv", edited(robot_map(2), {"joints.effort.unit": "mN m"}))
    np.testing.assert_allclose(record.channels["joints.effort"].values[:], table[["tau", "tau1"]], rtol=1e-12)
    for header, changes, expected in (
        ({"q": "q [mm]"}, {}, r"'q \[mm\]': m was expected"),
        ({"q1": "q1 [deg]"}, {}, r"'q1 \[deg\]': rad was expected"),
        ({"q": "q [m]", "q1": "q1 [rad]", "tau": "tau [N]", "tau1": "tau1 [Nm]"}, {}, ""),
        ({"q": "q [mm]", "q1": "q1 [deg]"}, {"joints.position.unit": "deg", "joints.position.slide_unit": "mm"}, ""),
        ({"q": "q [rad]"}, {"joints.factor": {"slide": 0.01}}, ""),  # of a motor
    ):
        table.rename(columns=header).to_csv(tmp_path / "log.csv", index=False)
        with pytest.raises(LogError, match=expected) if expected else nullcontext():
            recorded(tmp_path / "log.csv", edited(robot_map(2), changes))


def test_slides_and_hinges_can_each_have_a_unit(tmp_path: Path) -> None:
    """In mm beside deg no map could say it: each of two refusals named the other's unit. `--suggest` writes both."""
    table = robot_table(tmp_path, "prismatic", "revolute", motors=2)
    names = {"q": "slide_pos_mm", "v": "slide_vel_mm_s", "tau": "slide_force_N"}
    names |= {"q1": "hinge1_pos_deg", "v1": "hinge1_vel_deg_s", "tau1": "hinge1_torque_Nm"}
    factors = {"q": 1e3, "v": 1e3, "q1": 180.0 / np.pi, "v1": 180.0 / np.pi}
    for name, factor in factors.items():
        table[name] *= factor
    table = table.rename(columns=names)
    table.to_csv(tmp_path / "log.csv", index=False)
    values = tomllib.loads(suggested_map(tmp_path / "log.csv", tmp_path / "few.urdf"))
    assert (values["joints"]["position"]["unit"], values["joints"]["position"]["slide_unit"]) == ("deg", "mm")
    values["robot"]["points"] = ["tip"]
    record = recorded(tmp_path / "log.csv", values)
    for part, columns in (("position", ("q", "q1")), ("velocity", ("v", "v1")), ("effort", ("tau", "tau1"))):
        expected = table[[names[name] for name in columns]] / [factors.get(name, 1.0) for name in columns]
        np.testing.assert_allclose(record.channels[f"joints.{part}"].values[:], expected, rtol=1e-12, atol=1e-15)
    del values["joints"]["position"]["slide_unit"]
    with pytest.raises(LogError, match=r'slide_unit = "mm" for joints\.position would leave all within them'):
        estimate(recorded(tmp_path / "log.csv", values))


@pytest.mark.parametrize(
    ("kinds", "expected"),
    [
        (["prismatic"], ("m", "m/s", "N")),
        (["revolute"], ("rad", "rad/s", "N m")),
        (["prismatic", "revolute"], (None, None, None)),
    ],
)
def test_a_suggestion_knows_what_slides(kinds: list[str], expected: tuple[str | None, ...], tmp_path: Path) -> None:
    """A slide is in m, m/s and N; efforts that no column's name suggests are marked as missing, with their joint."""
    table = robot_table(tmp_path, *kinds, motors=len(kinds))
    names = {}
    for k, kind in enumerate(kinds):
        for short, word in (("q", "pos"), ("v", "vel"), ("tau", "effort")):
            names[f"{short}{k or ''}"] = f"{'slide' if kind == 'prismatic' else 'hinge'}{k or ''}_{word}"
    table = table.rename(columns=names)
    table.to_csv(tmp_path / "log.csv", index=False)
    text = suggested_map(tmp_path / "log.csv", tmp_path / "few.urdf")
    joints = tomllib.loads(text)["joints"]
    assert tuple(joints[part].get("unit") for part in ("position", "velocity", "effort")) == expected
    values = tomllib.loads(text)
    values["robot"]["points"] = ["tip"]
    assert recorded(tmp_path / "log.csv", values).channels.keys() >= {"joints.position", "joints.effort"}
    last = names[list(names)[-1]]
    table.drop(columns=last).to_csv(tmp_path / "log.csv", index=False)
    lines = suggested_map(tmp_path / "log.csv", tmp_path / "few.urdf").splitlines()
    assert any(line.startswith(f"# MISSING: what drives {last.removesuffix('_effort')}?") for line in lines)
    assert f'# passive = ["{last.removesuffix("_effort")}"]  # or nothing at all?' in lines
    robot = robot_of_map(parse_map(values, "of the test").robot, tmp_path)
    assert len(joint_pairs(robot, robot.joints)) == 0  # a hinge and a slide are not mixed up
    assert len(joint_pairs(robot, 3 * robot.joints)) == 3 * len(robot.joints)


def test_a_topic_without_efforts_is_marked() -> None:
    """It was asked whether its efforts are in N m."""
    stands = SimpleNamespace(kinds={"/arm": "sensor_msgs/msg/JointState"}, names=("/arm.position.lift",))
    assert "# MISSING: what drives the joints?" in "\n".join(suggest_joints(cast(Columns, stands), None))
    stands.names += ("/arm.effort.lift",)
    assert "MISSING" not in "\n".join(suggest_joints(cast(Columns, stands), None))
    stands.kinds = {"/gripper": "sensor_msgs/msg/JointState", **stands.kinds}
    stands.names = ("/gripper.position.jaw", *stands.names)
    lines = [*suggest_joints(cast(Columns, stands), None)]
    assert lines[1].startswith('topic = "/arm"')  # the first was read, whatever it told
    assert lines[2].startswith("# or /gripper?")
    stands.kinds["/silent"] = stands.kinds["/arm"]
    assert "/silent" not in "\n".join(suggest_joints(cast(Columns, stands), None))
    robot = cast(PlainRobot, SimpleNamespace(joints=("lift", "finger"), mimics={}))
    assert any(line.startswith("held = {finger = 0.0}") for line in suggest_joints(cast(Columns, stands), robot))
    stands.names = stands.names[:0]
    assert [*suggest_joints(cast(Columns, stands), None)] == []
    stands.values = {}
    assert "# MISSING: [joints]" in "\n".join(suggest_joints(cast(Columns, stands), robot))


def test_a_folder_called_like_a_robot_does_not_hide_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """`--urdf panda` beside a folder of its recordings was refused: "a file was expected"."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "panda").mkdir()
    (tmp_path / "mine").touch()
    assert (option_of_robot("panda"), [*option_of_robot("mine")]) == ({"name": "panda"}, ["urdf"])


def test_a_goal_is_no_pose_of_the_base() -> None:
    """The base was suggested to be where it was to go, by the first topic of a pose; of several no other was told."""
    kinds = dict.fromkeys(("/goal_pose", "/tcp/pose", "/ekf/pose", "/mocap/pose"), "geometry_msgs/msg/PoseStamped")
    kinds |= dict.fromkeys(("/imu/raw", "/imu/data"), "sensor_msgs/msg/Imu")
    columns = cast(Columns, SimpleNamespace(kinds=kinds, values=dict.fromkeys(f"{one}.position.x" for one in kinds)))
    _, pose, rate, _ = _suggest_base(columns, {})
    assert pose.startswith('topic = "/ekf/pose"')
    assert pose.endswith("Or /mocap/pose?")
    assert rate.startswith('rate = {topic = "/imu/raw"}')
    assert rate.endswith("Or /imu/data?")


WRONG: dict[str, tuple[dict[str, Any], str]] = {
    "a stranger": ({"factor": {"elbow": 0.1}}, r"joints\.factor: no joint 'elbow' with a channel: turn, lift, bend"),
    "no gear": ({"factor": {"lift": 0.0}}, r"joints\.factor of lift = 0: another number was expected"),
    "one motor": ({"coupling": {"lift": {"lift": 1.0}, "bend": {"lift": 2.0}}}, r"do not tell lift, bend apart"),
    "half an effort": (
        {"coupling": AT_MOTORS["coupling"], "passive": ["bend"], "effort": {"columns": ["turn_i", "lift_i"]}},
        r"lift and bend are coupled: efforts of both were expected",
    ),
    "held and passive": ({"held": {"lift": 0.0}, "passive": ["lift"]}, r"lift is in held.* and in passive"),
    "a passive stranger": ({"passive": ["rail"]}, r"no joint 'rail' in the robot; there are turn, lift, bend"),
    "too few efforts": ({"effort": {"columns": ["turn_i"]}}, r"3 were expected; joints\.passive names those without"),
    "a passive joint's effort": ({"passive": ["lift"]}, r"joints\.effort has 3 columns .*: 2 were expected"),
}


@pytest.mark.parametrize("name", WRONG)
def test_a_map_that_cannot_be_meant_is_refused(name: str, folder: Path) -> None:
    change, expected = WRONG[name]
    with pytest.raises(AerobatError, match=expected):
        recorded(folder / "joints.csv", changed(**change))


def test_a_calibration_belongs_to_its_encoders(folder: Path) -> None:
    """What was learnt at the joints is refused for a map of the motors."""
    learnt = calibrate([recorded(folder / "joints.csv", changed(friction={"law": "coulomb+viscous"}))])
    with pytest.raises(CalibrationError, match=r"the encoder of turn = 1 turn, but -0\.02 turn is believed"):
        estimate(recorded(folder / "motors.csv", changed(**AT_MOTORS)), calibration=learnt)


def limits(folder: Path, urdf: str, change: float = 1.0, shift: float = 0.0, unit: str = "rad") -> list[str]:
    """Return what is found about limits of an arm whose positions and velocities are written times a factor."""
    table = pd.read_csv(folder / "joints.csv")
    table[[f"{joint}_{what}" for joint in JOINTS for what in "qv"]] *= change
    table["lift_q"] += shift
    table.to_csv(folder / "limits.csv", index=False)
    (folder / "limited.urdf").write_text(urdf)
    units = {"joints.position.unit": unit, "joints.velocity.unit": f"{unit}/s"}
    values = edited(changed(), {"robot.urdf": "limited.urdf", **units})
    found = record_findings(recorded(folder / "limits.csv", values))
    return [f"{one.verdict} {one}" for one in found if one.check == "joint limits"]


def test_joints_far_beyond_their_limits_are_refused_by_name(folder: Path) -> None:
    """Degrees in position and velocity alike, which agree with each other; a joint at 40 rad; another zero is told."""
    close = arm().replace('lower="-99" upper="99"', 'lower="-2" upper="2"')
    [degrees] = limits(folder, close, np.degrees(1.0))
    assert re.search(r'refused joint limits: \w+ is at .* rad, its limits are -2 to 2 rad; .*unit = "deg"', degrees)
    assert all(joint in degrees for joint in JOINTS)
    with pytest.raises(LogError, match=r"limits\.csv: joint limits: .*--trust estimates nevertheless"):
        estimate(recorded(folder / "limits.csv", edited(changed(), {"robot.urdf": "limited.urdf"})))
    [far] = limits(folder, close, shift=40.0)
    assert re.search(r"refused joint limits: lift is at 4\d.* to 4\d.* rad", far)
    [zero] = limits(folder, close, shift=3.0)
    assert re.search(r"warning joint limits: lift is at .*", zero)
    assert "factor = {" not in zero


def test_what_is_in_force_is_not_proposed_and_a_sign_that_would_do_is(folder: Path) -> None:
    """-3 rad, limits 0 to 6, by a map in degrees; a slide at -0.2 m, limits 0 to 0.3, was told to be in mm."""
    before, lift, after = arm().partition('<joint name="lift"')
    high = before + lift + after.replace('lower="-99" upper="99"', 'lower="-0.2" upper="6"', 1)
    [found] = limits(folder, high, np.degrees(1.0), np.degrees(-3.0), "deg")
    assert found.startswith("warning joint limits: lift is at -")
    assert 'unit = "deg"' not in found
    assert "factor = {lift = -1} under [joints] would leave all within them" in found
    low = before + lift + after.replace('lower="-99" upper="99"', 'lower="-0.1" upper="6"', 1)
    [found] = limits(folder, low, 1.0, -2.2)
    assert "; factor = {lift = -1} under [joints] would leave all within them" in found


def test_slight_overshoots_and_joints_without_limits_do_not_alarm(folder: Path) -> None:
    """Limits a little inside of the motion, none stated, joints that turn on and on."""
    stated = 'lower="-99" upper="99"'
    for name in JOINTS:
        lowest = pd.read_csv(folder / "joints.csv")[f"{name}_q"].min()
        before, here, rest = arm().partition(f'<joint name="{name}"')
        inside = before + here + rest.replace(stated, f'lower="{lowest + 0.1}" upper="2"', 1)
        assert limits(folder, inside) == []
    for text in (arm().replace(stated, ""), arm().replace('type="revolute"', 'type="continuous"')):
        assert limits(folder, text, np.degrees(1.0)) == []


WHEEL, PLANAR_ARM, HINGE, SLIDE = ("continuous",), ("revolute", "revolute"), ("revolute",), ("prismatic",)
AXES = {"revolute": "0 1 0", "prismatic": "0 0 1", "continuous": "0 1 0"}


def robot_urdf(*kinds: str) -> str:
    """Return links in a row, from below: `slide` or `hinge` and a number; the tip is 0.5 m ahead of the last."""
    parts, below = [link("ground")], "ground"
    for k, kind in enumerate(kinds):
        name = f"{'slide' if kind == 'prismatic' else 'hinge'}{k or ''}"
        parts.append(link(f"{name}_link", 1.0, "0.2 0 0", (0.02, 0.02, 0.02)))
        parts.append(joint(name, kind, below, f"{name}_link", axis=AXES[kind], limit=3))
        below = f"{name}_link"
    parts += [link("tip"), joint("end", "fixed", below, "tip", "0.5 0 0")]
    return f'<robot name="few">{"".join(parts)}</robot>'


def robot_table(folder: Path, *kinds: str, motors: int = 1) -> pd.DataFrame:
    """Write links in a row; return a table of their swing; 3 N push upwards at the tip; the last `motors` have one."""
    (folder / "few.urdf").write_text(robot_urdf(*kinds))
    model = pin.buildModelFromXML(robot_urdf(*[kind.replace("continuous", "revolute") for kind in kinds]))
    data, time, order = model.createData(), np.arange(1000) / 500.0, np.arange(model.nv)
    q, v, a = sines(time, 0.4, 5.0 + 2.0 * order, order)
    force, tau = np.tile([0.0, 0.0, 3.0], (len(time), 1)), np.empty_like(q)
    for k in range(len(time)):
        J = pin.computeFrameJacobian(model, data, q[k], model.getFrameId("tip"), pin.LOCAL_WORLD_ALIGNED)
        J, needed = J.reshape(6, -1)[:3], pin.rnea(model, data, q[k], v[k], a[k])
        free = model.nv - motors
        force[k] += np.linalg.pinv(J[:, :free].T) @ (needed - J.T @ force[k])[:free]
        tau[k] = needed - J.T @ force[k]
    table = {"t": time}
    for k in order:
        table |= {f"q{k or ''}": q[:, k], f"v{k or ''}": v[:, k]}
    table |= {f"tau{k or ''}": tau[:, k] for k in order[model.nv - motors :]}
    return pd.DataFrame(table | {f"f{axis}": force[:, k] for k, axis in enumerate("xyz")})


def robot_map(count: int = 1, **joints: Any) -> dict[str, Any]:
    """Return the map of one joint or of several."""
    columns = channels([k or "" for k in range(count)], position="q{}", velocity="v{}", effort="tau{}")
    return {
        "robot": {"urdf": "few.urdf", "root": "fixed", "points": ["tip"]},
        "joints": {**columns, **joints},
        "check": {"wrench": {"columns": ["fx", "fy", "fz"], "unit": "N"}},
    }


def test_a_passive_joint_needs_no_effort_and_its_row_is_believed(tmp_path: Path) -> None:
    """A pole on a slide without a motor: both components in their plane are found."""
    table = robot_table(tmp_path, "prismatic", "revolute")
    record = recorded(tmp_path / "log.csv", robot_map(2, effort={"columns": ["tau1"]}, passive=["slide"]), table=table)
    result = estimate(record)
    assert any("without a motor, efforts known to be 0: slide" in note for note in result.notes)
    assert not any("not believed" in note for note in result.notes)
    found, true = result.estimates["force_level"], table[["fx", "fy", "fz"]].to_numpy()
    assert found.identifiability.rank == 2
    errors = np.abs(found.components - 0.5 * (true[1:] + true[:-1]))[100:]
    assert errors[:, [0, 2]].max() < 0.03 * np.abs(true).max()


@pytest.mark.usefixtures("unrendered")
@pytest.mark.parametrize("kinds", [WHEEL, PLANAR_ARM, *further((HINGE,), (SLIDE,), (2 * SLIDE,))])
def test_small_robots_pass_every_door(kinds: tuple[str, ...], here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Estimate by all observers with checks, friction, a known force and pages; self-check; calibrate; stream."""
    table, few = robot_table(here, *kinds, motors=len(kinds)), robot_map(len(kinds))
    table.to_csv("log.csv", index=False)
    values = robot_map(len(kinds), friction={"fit": [0.0, 1.0], "to": "check.wrench", "scale": True})
    values["observer"] = {"names": ["momentum", "force_level", "kalman", "smoother", "second_order", "super_twisting"]}
    Path("map.toml").write_text(tomli_w.dumps(values))
    assert call("estimate", "log.csv", "--map", "map.toml", "--out", "out") == 0, capsys.readouterr()
    assert (here / "out" / "replay.html").stat().st_size > 1000
    cell = {**few.pop("check")["wrench"], "frame": "tip", "axes": "world"}
    record = recorded(here / "log.csv", few | {"known": {"cell": cell}})
    assert np.abs(estimate(record).estimates["force_level"].components[100:]).max() < 0.05
    check_record(record)
    calibrate([record], parameters=["mass"])
    record = recorded(here / "log.csv", few)
    online, found = stream_of(record), []
    for row in table.head(500).to_dict("records"):
        found += online.push(row["t"], row)
    whole = estimate(record).estimates["force_level"].components[len(found) - 1]
    np.testing.assert_allclose(list(found[-1].components.values()), whole, atol=1e-6)


def test_a_file_gets_a_free_base_or_keeps_its_own(tmp_path: Path) -> None:
    """MJCF and URDF, with and without a free joint of their own; a ball joint is refused by name."""
    single = re.sub(r'<joint name="(hip_x|hip_z|ankle)"[^>]*/>|<joint name="pad"[^>]*/>', "", LEG)
    own = '<link name="world"/><joint name="own" type="floating"><parent link="world"/><child link="ground"/></joint>'
    hinge, leg = robot_urdf("revolute"), ("sole", ("hip_y", "knee"))
    files: tuple[tuple[str, str, tuple[str, tuple[str, ...]]], ...] = (
        ("mjcf", single, leg),
        ("mjcf", single.replace('<freejoint name="root"/>', ""), leg),
        ("urdf", hinge, ("tip", ("hinge",))),
        ("urdf", hinge.replace("<link", f"{own}<link", 1), ("tip", ("hinge",))),
    )
    for (kind, text, (point, joints)), root in itertools.product(files, ("free_flyer", None)):
        (tmp_path / f"robot.{kind}").write_text(text)
        table = RobotTable.model_validate({kind: f"robot.{kind}", "root": root, "points": (point,)})
        robot = robot_of_map(table, tmp_path)
        assert (robot.free, robot.joints) == (True, joints)
    (tmp_path / "leg.xml").write_text(LEG)
    with pytest.raises(LogError, match=r"joint '\w+' stands for several joints of one body: joints of one angle"):
        robot_of_map(RobotTable(mjcf="leg.xml", points=("sole",)), tmp_path)


@pytest.mark.parametrize("name", sorted(FREE | FIXED))
def test_a_robot_is_loaded_by_its_name(name: str) -> None:
    """Free or fixed as it is, with masses, and as the robot of a map."""
    robot = load_robot(name)
    assert robot.free == (name in FREE)
    assert robot.title == name
    assert robot.mass > 0.05
    point = robot.model.frames[-1].name
    assert robot_of_map(RobotTable(name=name, points=(point,)), Path()).fingerprint() == robot.fingerprint()


def test_a_name_that_is_none_is_told_the_nearest(monkeypatch: pytest.MonkeyPatch) -> None:
    """And all that there are; where they are not installed, the extra. A base that moves can be fixed."""
    with pytest.raises(LogError, match=r"robot 'UR-5': did you mean 'ur5'\? There are a1, .*solo12, .*z1; any other"):
        load_robot("UR-5")
    assert not robot_of_map(RobotTable(name="solo12", root="fixed", points=("FL_FOOT",)), Path()).free
    monkeypatch.setattr("sys.path", [])
    with pytest.raises(LogError, match=r"robot 'ur5': its file is not installed: pip install '.*\[robots\]'"):
        load_robot("ur5")


SLIDES = joint("x", "prismatic", "base", "sled", axis="1 0 0") + joint("y", "prismatic", "sled", "sledge", axis="0 1 0")


IN_STEPS = f"{link('sled')}{link('sledge')}{SLIDES}{joint('yaw', 'revolute', 'sledge', 'cart', axis='0 0 1')}"


CART = f'<robot name="cart">{link("base", 1.0, moments=3 * (0.1,))}{link("cart", 1.0, moments=3 * (0.1,))}'
BODY = '<mujoco><worldbody><body name="one"><joint name="a" axis="0 1 0"/>{0}<body name="two">{1}{0}</body></body>'
WEIGHT = '<geom type="sphere" size="0.1" mass="1" pos="0 0 0.2"/>'


@pytest.mark.parametrize(
    ("kind", "said", "instead"),
    [
        ("planar", "is planar", "as two slides and a hinge"),
        ("floating", 'root = "fixed", but by its file robot robot floats', '"free_flyer" was expected'),
        ("spherical", "is of a type that URDF does not have, 'spherical'", "a ball joint as three hinges"),
        ('<joint name="odd" type="ball"/>', "is a ball joint", "a ball joint as three hinges"),
        ('<freejoint name="odd"/>', "floats freely", "Leave what floats beside the base out"),
        ('<joint name="odd"/><joint name="b" axis="1 0 0"/>', "stands for several joints", "one after the other"),
    ],
)
def test_joints_that_are_not_read_are_named_with_what_to_do(kind: str, said: str, instead: str, tmp_path: Path) -> None:
    """What was said was a number of coordinates, or nothing of what to write instead."""
    text, name = f"{CART}{joint('odd', kind, 'base', 'cart')}</robot>", "urdf"
    if kind.startswith("<"):
        text, name = f"{BODY.format(WEIGHT, kind)}</worldbody></mujoco>", "mjcf"
    (tmp_path / "robot").write_text(text)
    with pytest.raises(LogError, match=re.escape(said)) as refused:
        robot_of_map(RobotTable.model_validate({name: "robot", "root": "fixed", "points": ("cart",)}), tmp_path)
    assert "odd'" in str(refused.value)
    assert instead in str(refused.value)


def test_a_planar_joint_in_steps_is_read(tmp_path: Path) -> None:
    """As the message says: two slides and a hinge, with links without mass between them."""
    (tmp_path / "robot").write_text(f"{CART}{IN_STEPS}</robot>")
    robot = robot_of_map(RobotTable(urdf="robot", root="fixed", points=("cart",)), tmp_path)
    assert robot.joints == ("x", "y", "yaw")


LINK = '<inertial><mass value="0.1"/><inertia ixx="1e-4" iyy="1e-4" izz="1e-4" ixy="0" ixz="0" iyz="0"/></inertial>'
GRIPPER = f"""<robot name="gripper"><link name="hand"/><link name="left">{LINK}</link><link name="right">{LINK}</link>
<joint name="one" type="prismatic"><parent link="hand"/><child link="left"/><axis xyz="0 1 0"/>
<limit lower="0" upper="0.04" effort="20" velocity="1"/></joint>
<joint name="two" type="prismatic"><parent link="hand"/><child link="right"/><axis xyz="0 -1 0"/>
<limit lower="0" upper="0.04" effort="20" velocity="1"/><mimic joint="one"/></joint></robot>"""
SPRINGY_LEG = """<mujoco><option gravity="0 0 -9.8"/><worldbody><body name="shank" gravcomp="1">
<joint name="knee" axis="0 1 0" stiffness="2"/>
<geom type="sphere" size="0.1" mass="1" pos="0 0 -0.2"/></body></worldbody></mujoco>"""


def opened(folder: Path, robot: dict[str, str], point: str, joint: str, **joints: dict[str, float]):
    """Return a record of one joint that swings."""
    time = np.arange(400) * 0.005
    q, v, _ = sines(time, [0.01], 6.0, 0.0, 0.02)
    values = joint_map("", [], [joint]) | {"robot": {**robot, "root": "fixed", "points": [point]}}
    values["joints"] |= joints
    return recorded(folder / "log.csv", values, table=joint_table(time, [joint], q=q, v=v, tau=0.0 * v))


def test_a_joint_that_mimics_a_moving_one_is_not_held(tmp_path: Path) -> None:
    """A gripper whose one motor drives both fingers: with one of them held the other's force was twice the true one."""
    (tmp_path / "gripper.urdf").write_text(GRIPPER)
    with pytest.raises(MapError, match="two mimics one, and moves with it"):
        opened(tmp_path, {"urdf": "gripper.urdf"}, "left", "one")
    with pytest.raises(MapError, match=r"two is in held, .* mimics one, which moves"):
        opened(tmp_path, {"urdf": "gripper.urdf"}, "left", "one", held={"two": 0.02})


@pytest.mark.parametrize("names", ["one {}", "two {}"])
def test_a_suggested_map_gives_a_follower_its_leaders_columns(names: str, tmp_path: Path) -> None:
    """By the multiplier and offset of the robot's file, its row left out: the map opens and estimates as it is."""
    urdf = GRIPPER.replace('<mimic joint="one"/>', '<mimic joint="one" multiplier="-0.5" offset="0.01"/>')
    if names.startswith("two"):  # of two files, in which the follower comes first, and last
        urdf = urdf.replace('"one"', '"zwei"').replace('"two"', '"one"').replace('"zwei"', '"two"')
    (tmp_path / "gripper.urdf").write_text(urdf)
    time = np.arange(400) * 0.005
    q, v = 0.02 + 0.01 * np.sin(6.0 * time), 0.06 * np.cos(6.0 * time)
    columns = {"t": time} | {names.format(part): values for part, values in (("q", q), ("qd", v), ("tau", 0.1 * q))}
    pd.DataFrame(columns).to_csv(tmp_path / "log.csv", index=False)
    (tmp_path / "map.toml").write_text(suggested_map(tmp_path / "log.csv", tmp_path / "gripper.urdf", ["left"]))
    record = open_record(tmp_path / "log.csv", tmp_path / "map.toml")
    block = record.block(0, 100)
    leader, follower = ("two", "one") if names.startswith("two") else ("one", "two")
    np.testing.assert_allclose(block.q[:, record.robot.q_index(leader)], q[:101], atol=1e-9)
    np.testing.assert_allclose(block.q[:, record.robot.q_index(follower)], 0.01 - 0.5 * q[:101], atol=1e-9)
    np.testing.assert_allclose(block.v[:, record.robot.v_index(follower)], -0.5 * v[:101], atol=1e-9)
    assert record.map.robot.rows.ignore == (follower,)
    assert estimate(record).estimates


def test_so_does_that_of_a_bag_whose_topic_leaves_it_out(tmp_path: Path) -> None:
    tail = link("tail", 0.1, "0 0 -0.1", 3 * (1e-4,)) + joint("wag", "revolute", "trunk", "tail", "-0.3 0 0", limit=3)
    tail = tail.replace("</joint>", '<mimic joint="FL_HAA" multiplier="2"/></joint>')
    (tmp_path / "robot.urdf").write_text(urdf().replace("</robot>", f"{tail}</robot>"))
    bag(walk(), tmp_path / "bag")
    (tmp_path / "map.toml").write_text(suggested_map(tmp_path / "bag", tmp_path / "robot.urdf"))
    record = open_record(tmp_path / "bag", tmp_path / "map.toml")
    block = record.block(0, 100)
    leader, follower = (record.robot.q_index(name) for name in ("FL_HAA", "wag"))
    np.testing.assert_allclose(block.q[:, follower], 2.0 * block.q[:, leader], atol=1e-9)
    assert record.map.robot.rows.ignore == ("wag",)


def test_what_an_mjcf_file_says_beyond_the_model_is_noted(tmp_path: Path) -> None:
    """Springs, weight that is taken off and another gravity are ignored; they were without a word."""
    (tmp_path / "leg.xml").write_text(SPRINGY_LEG)
    notes = opened(tmp_path, {"mjcf": "leg.xml"}, "shank", "knee").notes
    assert "not read from the robot's file: body gravcomp, joint stiffness, option gravity" in notes
    suggested = tomllib.loads(suggested_map(tmp_path / "log.csv", tmp_path / "leg.xml"))["robot"]
    assert suggested == {"mjcf": str(tmp_path / "leg.xml"), "root": "fixed", "points": ["shank"]}
    trunk = '<worldbody><body name="trunk"><freejoint/><geom type="sphere" size="0.1" mass="5"/>'
    (tmp_path / "leg.xml").write_text(SPRINGY_LEG.replace("<worldbody>", trunk).replace("</body>", "</body></body>"))
    text = suggested_map(tmp_path / "log.csv", tmp_path / "leg.xml")
    assert tomllib.loads(text)["robot"]["root"] == "free_flyer"  # "fixed" was suggested, and refused
    assert "MISSING: [base]" in text


@pytest.mark.parametrize(
    ("moments", "told"), [((1e-4, 1e-4, 2e-4), False), ((1e-4, 1e-4, 3e-4), True), ((0.0,) * 3, True)]
)
def test_moments_of_inertia_that_no_body_has_are_noted(moments: tuple[float, ...], told: bool, tmp_path: Path) -> None:
    """A plate's are at the limit. iCub's file has none for legs of kilograms: nothing was said."""
    links = link("base", 1.0, "0 0 0", 3 * (1e-2,)) + link("arm", 0.5, "0 0 -0.1", moments)
    swing = joint("swing", "revolute", "base", "arm", "0 0 0", limit=3)
    (tmp_path / "arm.urdf").write_text(f'<robot name="arm">{links}{swing}</robot>')
    noted = opened(tmp_path, {"urdf": "arm.urdf"}, "arm", "swing").notes
    assert ("no body has the moments of inertia of swing" in noted) == told
