"""What a robot's file says and its model does not have is named: joints that mimic others, springs, equalities."""

import tomllib
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from support.recorded import recorded
from support.robot_parts import joint, link
from support.walking_log import bag, urdf, walk

from aerobat_pin import estimate, open_record
from aerobat_pin.errors import MapError
from aerobat_pin.records import suggested_map

LINK = '<inertial><mass value="0.1"/><inertia ixx="1e-4" iyy="1e-4" izz="1e-4" ixy="0" ixz="0" iyz="0"/></inertial>'
GRIPPER = f"""<robot name="gripper"><link name="hand"/><link name="left">{LINK}</link><link name="right">{LINK}</link>
<joint name="one" type="prismatic"><parent link="hand"/><child link="left"/><axis xyz="0 1 0"/>
<limit lower="0" upper="0.04" effort="20" velocity="1"/></joint>
<joint name="two" type="prismatic"><parent link="hand"/><child link="right"/><axis xyz="0 -1 0"/>
<limit lower="0" upper="0.04" effort="20" velocity="1"/><mimic joint="one"/></joint></robot>"""
LEG = """<mujoco><option gravity="0 0 -9.8"/><worldbody><body name="shank" gravcomp="1"><joint name="knee" axis="0 1 0"
stiffness="2"/><geom type="sphere" size="0.1" mass="1" pos="0 0 -0.2"/></body></worldbody></mujoco>"""


def opened(folder: Path, robot: dict[str, str], point: str, joint: str, **joints: dict[str, float]):
    """Return a record of one joint that swings."""
    time = np.arange(400) * 0.005
    log = pd.DataFrame({"t": time, "q": 0.02 + 0.01 * np.sin(6.0 * time), "v": 0.06 * np.cos(6.0 * time), "i": 0.0})
    log.to_csv(folder / "log.csv", index=False)
    channels = {"position": {"columns": ["q"]}, "velocity": {"columns": ["v"]}, "effort": {"columns": ["i"]}}
    table = {"names": [joint], **channels, **joints}
    values = {"robot": {**robot, "root": "fixed", "points": [point]}, "log": {"time": {"column": "t"}}, "joints": table}
    return recorded(folder / "log.csv", values)


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
    (tmp_path / "leg.xml").write_text(LEG)
    notes = opened(tmp_path, {"mjcf": "leg.xml"}, "shank", "knee").notes
    assert "not read from the robot's file: body gravcomp, joint stiffness, option gravity" in notes
    suggested = tomllib.loads(suggested_map(tmp_path / "log.csv", tmp_path / "leg.xml"))["robot"]
    assert suggested == {"mjcf": str(tmp_path / "leg.xml"), "root": "fixed", "points": ["shank"]}
    trunk = '<worldbody><body name="trunk"><freejoint/><geom type="sphere" size="0.1" mass="5"/>'
    (tmp_path / "leg.xml").write_text(LEG.replace("<worldbody>", trunk).replace("</body>", "</body></body>"))
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
