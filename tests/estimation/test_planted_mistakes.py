"""Every mistake that is planted in the log of a robot is found and named, and good logs cause no warning."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pinocchio as pin
import pytest
from support.arm import arm
from support.planted_mistakes import (
    ANGLES,
    EFFORTS,
    EFFORTS_APART,
    FREE_BASE,
    LINKAGE,
    RATES,
    Mistakes,
    noisy,
    of_joints,
    planted,
    rubbing,
    swapped,
    times,
    together,
)
from support.walking_log import bag, bag_map, urdf, walk

from aerobat_pin.aerobat import AerobatRobot, flight_record
from aerobat_pin.estimation import effort_findings, record_findings
from aerobat_pin.estimation.known_forces import KnownForces
from aerobat_pin.estimation.run_observers import inputs_between
from aerobat_pin.flight import simulate
from aerobat_pin.records import PlainRobot, Record, load_robot, open_record, parse_map
from aerobat_pin.robot import JOINTS, believed_robot
from aerobat_pin.scenario import load_scenario

ARM_JOINTS = ("shoulder1_joint", "shoulder2_joint", "shoulder3_joint", "elbow_joint", "wrist1_joint", "wrist2_joint")
LEGS = walk().joints


def flight() -> Record:
    """Return the record of `real_log_demo`, with the noise and rounding of its sensors."""
    scenario = load_scenario("real_log_demo", ["simulation.duration=1.2"])
    robot = AerobatRobot.of(believed_robot(scenario), scenario.believed_air)
    return flight_record(simulate(scenario), robot)


def arm_table(folder: Path, swing: float = 1.0, pushed: bool = True, known: PlainRobot | None = None) -> Record:
    """Return the record of a table: an arm that swings, slowly one that is known, and is pushed at its tool."""
    model, tool = arm() if known is None else (known.model, "tool0")
    names = ARM_JOINTS if known is None else known.joints
    data, time, order = model.createData(), np.arange(1500) / 500.0, np.arange(model.nq)
    pace, size = 2.0 * np.pi * (0.5 + 0.13 * order) * (0.3 if known else 1.0), swing * (0.3 + 0.05 * order)
    phase = pace * time[:, None] + order
    q, v, a = size * np.sin(phase), size * pace * np.cos(phase), -size * pace**2 * np.sin(phase)
    efforts = np.empty_like(q)
    for k, t in enumerate(time):
        push = np.array([2.0 * np.sin(3.0 * t), 1.0, 3.0 * np.cos(2.0 * t)])
        J = pin.computeFrameJacobian(model, data, q[k], model.getFrameId(tool), pin.LOCAL_WORLD_ALIGNED)[:3]
        efforts[k] = pin.rnea(model, data, q[k], v[k], a[k]) - pushed * (J.T @ push)
    parts = {"position": q, "velocity": v, "effort": efforts}
    columns = {part: [f"{part}{k}" for k in order] for part in parts}
    table = {columns[part][k]: values[:, k] for part, values in parts.items() for k in order}
    pd.DataFrame({"time": time, **table}).to_csv(folder / "arm.csv", index=False)
    joints = {part: {"columns": names} for part, names in columns.items()}
    use = {} if pushed else {"free": [0, 3]}
    given = {"robot": {"points": [tool]}, "joints": {"names": list(names), **joints}, "use": use}
    robot = PlainRobot(model, False, names, "arm")
    return open_record(folder / "arm.csv", parse_map(given, "of the test"), folder, robot)


def quadruped_bag(folder: Path) -> Record:
    """Return the record of a bag: topics at rates of their own."""
    pytest.importorskip("rosbags")
    (folder / "quadruped.urdf").write_text(urdf())
    bag(walk(), folder / "walk")
    return open_record(folder / "walk", parse_map(bag_map(folder / "quadruped.urdf"), "of the test"), folder)


@pytest.fixture(scope="module")
def records(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Record]:
    """Return the good record of each robot."""
    folder = tmp_path_factory.mktemp("planted")
    for name in ("rest", "held"):
        (folder / name).mkdir()
    found = {"aerobat": flight(), "arm": arm_table(folder), "quadruped": quadruped_bag(folder)}
    found["arm almost at rest"] = arm_table(folder / "rest", 0.003, pushed=False)
    return found | {"arm almost at rest, pushed": arm_table(folder / "held", 0.003)}


def warned(record: Record) -> list[str]:
    """Return what the checks warn of before an observer runs."""
    found = list(record_findings(record))
    found += effort_findings(record, inputs_between(record, KnownForces(record)), found)
    return [str(one) for one in found if one.warns]


MISTAKES: dict[str, Mistakes] = {
    "aerobat": FREE_BASE | of_joints(JOINTS, 0, 1) | LINKAGE,
    "arm": of_joints(ARM_JOINTS, 1, 3) | EFFORTS_APART,
    "quadruped": FREE_BASE | of_joints(LEGS, 1, 2) | {"efforts late": EFFORTS_APART["efforts late"]},
}


@pytest.mark.parametrize("robot", MISTAKES)
def test_a_good_log_causes_no_warning(robot: str, records: dict[str, Record]) -> None:
    """Neither samples nor motion nor efforts."""
    assert warned(records[robot]) == []


@pytest.mark.parametrize(("robot", "name"), [(robot, name) for robot, all_of in MISTAKES.items() for name in all_of])
def test_a_planted_mistake_is_named(robot: str, name: str, records: dict[str, Record]) -> None:
    """By the check that sees it, with the column that is wrong."""
    change, expected = MISTAKES[robot][name]
    found = warned(planted(records[robot], change))
    assert any(re.search(expected, one) for one in found), found


LOUD = ((0.0, 0.0), (0.02, 0.0), (0.1, 0.0), (0.02, 0.1))  # noise and friction of the efforts, shares of their rms


@pytest.mark.parametrize("noise", [0.0, 0.02, 0.1, 0.5, 2.0])
@pytest.mark.parametrize("robot", ["arm almost at rest", "arm almost at rest, pushed", "arm", "quadruped"])
def test_noise_of_the_efforts_is_no_mistake(robot: str, noise: float, records: dict[str, Record]) -> None:
    """Also where joints carry less than their noise, as those of an arm that stands upright, almost at rest."""
    assert warned(planted(records[robot], noisy(noise))) == []


@pytest.mark.parametrize(("noise", "friction"), LOUD)
@pytest.mark.parametrize("robot", ["arm almost at rest", "arm", "quadruped"])
def test_reversed_efforts_are_named(robot: str, noise: float, friction: float, records: dict[str, Record]) -> None:
    """One, two and all of them, and nothing else."""
    record, loud = records[robot], together(rubbing(friction), noisy(noise))
    for columns in ((1,), (0, 1)):
        found = warned(planted(record, together(loud, times(EFFORTS, -1.0, *columns))))
        assert [re.findall(r"effort sign: the effort of (\w+) is reversed", one) for one in found] == [
            [record.driven[k]] for k in columns
        ]
    found = warned(planted(record, together(loud, times(EFFORTS, -1.0))))
    assert len(found) == 1
    assert f"effort sign: all efforts are reversed ({', '.join(record.driven)})" in found[0]


@pytest.mark.parametrize("keys", [(EFFORTS,), (ANGLES, RATES, EFFORTS)])
@pytest.mark.parametrize(("noise", "friction"), LOUD)
@pytest.mark.parametrize("other", [3, 6])
def test_swapped_legs_are_named(
    other: int, noise: float, friction: float, keys: tuple[str, ...], records: dict[str, Record]
) -> None:
    """The left front leg with the right one, or the one behind it: efforts alone, or all that is measured of them."""
    record = records["quadruped"]
    legs = [swapped(key, 0, other, count=3) for key in keys]
    found = warned(planted(record, together(rubbing(friction), noisy(noise), *legs)))
    columns = "efforts" if len(keys) == 1 else "all columns"
    assert len(found) == 1
    first, second = (", ".join(LEGS[k : k + 3]) for k in (0, other))
    assert found[0].startswith(f"swapped joints: {columns} of {first} and {second} in exchanged places")


@pytest.mark.parametrize(
    ("angle", "noise", "friction", "within"),
    [
        (0, 0.1, 0.0, 0),
        (0, 0.02, 0.1, 0),
        (6, 0.0, 0.0, 0.02),
        (20, 0.0, 0.0, 0.02),
        (90, 0.02, 0.1, 0.15),
        (180, 0.02, 0.1, 0.15),
    ],
)
def test_an_arm_that_is_mounted_otherwise_is_told_how(
    angle: float, noise: float, friction: float, within: float, tmp_path: Path
) -> None:
    """A UR5 is believed to be tilted, hung on a wall or from the ceiling: where gravity points is told."""
    record = planted(arm_table(tmp_path, known=load_robot("ur5")), together(rubbing(friction), noisy(noise)))
    believed, model = np.radians(angle), record.robot.model.copy()
    model.gravity.linear = 9.81 * np.array([0.0, np.sin(believed), -np.cos(believed)])
    found = warned(replace(record, robot=PlainRobot(model, False, record.robot.joints, "ur5")))
    assert len(found) == (angle > 0)
    for one in found:
        told = re.match(r"mounting: gravity along \((.*), (.*), (.*)\) leaves", one)
        assert told is not None, found
        np.testing.assert_allclose([float(part) for part in told.groups()], [0.0, 0.0, -1.0], atol=within)


@pytest.mark.parametrize(
    ("kilograms", "place"), [(1.0, (0.15, 0.1, 0.0)), (2.0, (0.1, 0.0, 0.1)), (4.0, (0.0, 0.0, 0.2))]
)
def test_a_load_beside_the_point_is_called_a_load(
    kilograms: float, place: tuple[float, float, float], tmp_path: Path
) -> None:
    """Of 1 to 4 kg that the robot's file lacks: the weight passes for a push at the point, the moment about it is left.

    That moment once passed for wrong units of efforts. Its size errs by what the load's moments of inertia need.
    """
    ur5 = load_robot("ur5")
    model, tool = ur5.model.copy(), ur5.model.frames[ur5.model.getFrameId("tool0")]
    model.inertias[tool.parentJoint] += pin.Inertia(kilograms, np.array(place), 1e-3 * np.eye(3))
    log = arm_table(tmp_path, known=replace(ur5, model=model))
    record = planted(log, together(rubbing(0.1), noisy(0.02)))
    (found,) = warned(replace(record, robot=PlainRobot(ur5.model, False, record.robot.joints, "ur5")))
    told = re.match(r"load: a load beside tool0, mass times distance (.*) kg m", found)
    assert told is not None, found
    away = float(np.linalg.norm(place - tool.placement.translation))
    assert float(told.group(1)) == pytest.approx(kilograms * away, rel=0.12)


@pytest.mark.parametrize(
    "factors", [(0.7, 0.7, 1.0, 0.7, 0.7, 0.7), (0.5, 0.5, 0.7, 1.0, 0.3, 1.0), (0.3, 1.0, 0.3, 0.5, 1.0, 1.0)]
)
def test_wrong_factors_are_neither_another_mounting_nor_other_places(
    factors: tuple[float, ...], tmp_path: Path
) -> None:
    """As of currents whose torque constants are guessed: gravity would seem to be of another size."""
    record = arm_table(tmp_path, known=load_robot("ur5"))
    slips = [times(EFFORTS, factor, joint) for joint, factor in enumerate(factors)]
    found = warned(planted(record, together(*slips, rubbing(0.2), noisy(0.02))))
    assert not [one for one in found if not one.startswith("effort unit: the effort of")], found


def test_without_points_whatever_pushes_is_not_taken_for_a_wrong_effort(records: dict[str, Record]) -> None:
    """Of an arm that is pushed, of which residuals alone are asked for."""
    record = records["arm"]
    robot = record.map.robot.model_copy(update={"points": ()})
    bare = replace(record, map=record.map.model_copy(update={"robot": robot}))
    found = list(effort_findings(bare, inputs_between(bare, KnownForces(bare)), []))
    assert [str(one) for one in found if "leave no row to check efforts by" not in one.text] == []


def chain(kinds: str) -> PlainRobot:
    """Return links of 1 kg in a row, each 0.3 m ahead: joints about z or y, or `s` that slide along z."""
    model, joints = pin.Model(), {"z": pin.JointModelRZ(), "y": pin.JointModelRY(), "s": pin.JointModelPZ()}
    names = tuple(f"joint{k}" for k in range(len(kinds)))
    for k, kind in enumerate(kinds):
        model.addJoint(k, joints[kind], pin.SE3(np.eye(3), np.array([0.3 * (k > 0), 0.0, 0.1])), names[k])
        model.appendBodyToJoint(k + 1, pin.Inertia(1.0, np.zeros(3), 0.01 * np.eye(3)), pin.SE3.Identity())
    model.addFrame(pin.Frame("tool0", len(kinds), 0, pin.SE3.Identity(), pin.FrameType.OP_FRAME))
    return PlainRobot(model, False, names, kinds)


@pytest.mark.filterwarnings("error")
def test_an_arm_whose_tool_bears_all_weight_needs_nothing_and_is_no_percentage(tmp_path: Path) -> None:
    """Of a SCARA only the last axis is left beside the tool's force: its own inertia, and no gravity."""
    record = planted(arm_table(tmp_path, known=chain("zzsz")), noisy(0.5))
    (one,) = effort_findings(record, inputs_between(record, KnownForces(record)), [])
    assert (one.verdict, "%" in one.text) == ("note", False), one


def test_an_exchange_that_leaves_most_does_not_hide_the_mounting(tmp_path: Path) -> None:
    """Gravity is planted along -z and believed along y: exchanged efforts would have left 56 % of what is needed."""
    record = planted(arm_table(tmp_path, known=chain("zyy"), pushed=False), rubbing(0.1))
    model = record.robot.model.copy()
    model.gravity.linear = np.array([0.0, 9.81, 0.0])
    found = warned(replace(record, robot=replace(record.robot, model=model)))
    assert len(found) == 1
    assert re.match(r"mounting: gravity along \(-?0.00, -?0.00, -1.00\)", found[0]), found


def test_masses_that_are_too_small_are_called_too_small(records: dict[str, Record]) -> None:
    """The arm is believed to have five sixths of its masses: 1.2 times as much is planted, beside friction."""
    record = planted(records["arm"], rubbing(0.05))
    (found,) = warned(replace(record, robot=record.robot.heavier(1.0 / 1.2)))
    told = re.search(r"all efforts would have to be (.*) times as large: .* or all masses (.*) times what", found)
    assert told is not None, found
    np.testing.assert_allclose([float(part) for part in told.groups()], [1.0 / 1.2, 1.2], rtol=0.06)
