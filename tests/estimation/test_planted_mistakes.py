"""Every mistake that is planted in a log is found and named with its figure, and good logs cause no warning."""

import json
import re
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from support.arm import arm
from support.bad_logs import CONTRADICTIONS, height_in_millimetres
from support.commands import call
from support.further import further
from support.recorded import recorded
from support.robot_parts import efforts, joint_map, joint_table, sines
from support.walking_log import bag, bag_map, urdf, walk

from aerobat_pin.aerobat import (
    JOINTS,
    Aerobat,
    AerobatRobot,
    FlightLog,
    believed_robot,
    flight_record,
    flown_robot,
    write_csv,
)
from aerobat_pin.control import Controller
from aerobat_pin.estimation import effort_findings, record_findings
from aerobat_pin.estimation.checks import free_efforts
from aerobat_pin.estimation.checks.agreement import agreement_findings
from aerobat_pin.estimation.checks.changes import _load
from aerobat_pin.experiments.experiment import NO_MAP, Experiment, run_recorded
from aerobat_pin.flight import simulate
from aerobat_pin.forces import Explanation, FittedValues, KnownForces, inputs_between
from aerobat_pin.records import Agreement, PlainRobot, Record, Spool, load_robot, series_of
from aerobat_pin.scenario import AirSection, load_scenario, shipped_scenarios

Columns = dict[str, np.ndarray]  # key of a channel -> its samples (n, k), and `time of` key -> its stamps
Change = Callable[[Columns], None]
Mistakes = dict[str, tuple[Change, str]]
DEGREES = 180.0 / np.pi
PLACE, TURN, SPEED, GYRO = "base.position", "base.quaternion", "base.velocity", "base.rate"
ANGLES, RATES, EFFORTS, CRANK = "joints.position", "joints.velocity", "joints.effort", "extra.crank_angle"


def planted(record: Record, change: Change) -> Record:
    """Return a copy of a record with a mistake."""
    columns = {key: np.array(channel.values) for key, channel in record.channels.items()}
    change(columns | {f"time of {key}": np.array(channel.time) for key, channel in record.channels.items()})
    spool = Spool()
    channels = {key: replace(one, values=series_of(spool, columns[key])) for key, one in record.channels.items()}
    return replace(record, channels=channels)


def slip(change: Callable[..., None]) -> Callable[..., Change]:
    """Let a function of a log's columns and of something else return, for that, the change of the columns."""
    return lambda *given, **named: lambda data: change(data, *given, **named)


@slip
def times(data: Columns, key: str, factor: float, *columns: int) -> None:
    """Multiply some columns, or all."""
    data[key][:, list(columns) or slice(None)] *= factor


def in_degrees(data: Columns) -> None:
    """Write angles and rates in degrees, which agree with each other."""
    for key in (ANGLES, RATES):
        data[key] *= DEGREES


@slip
def swapped(data: Columns, key: str, first: int, second: int, count: int = 1) -> None:
    """Let two columns change places, or two groups of some columns side by side."""
    one, other = (np.arange(begin, begin + count) for begin in (first, second))
    data[key][:, [*one, *other]] = data[key][:, [*other, *one]]


@slip
def late(data: Columns, by: float, *keys: str) -> None:
    """Let channels be late [s], by whole samples."""
    for key in keys:
        rows = round(by / float(np.median(np.diff(data[f"time of {key}"]))))
        data[key][:] = data[key][np.maximum(np.arange(len(data[key])) - rows, 0)]


@slip
def held(data: Columns, key: str) -> None:
    """Let a channel keep each value for three samples."""
    data[key][:] = data[key][np.arange(len(data[key])) // 3 * 3]


@slip
def cut_off(data: Columns, share: float) -> None:
    """Cut the efforts off where their size is reached for a share of the time."""
    limit = np.quantile(np.abs(data[EFFORTS]), 1.0 - share, axis=0)
    data[EFFORTS][:] = np.clip(data[EFFORTS], -limit, limit)


@slip
def off(data: Columns, key: str, by: float, column: int) -> None:
    """Add a constant to a column."""
    data[key][:, column] += by


@slip
def noisy(data: Columns, share: float) -> None:
    """Add white noise to the efforts, a share of their rms."""
    size = share * np.sqrt(np.mean(data[EFFORTS] ** 2))
    data[EFFORTS][:] += size * np.random.default_rng(1).standard_normal(data[EFFORTS].shape)


@slip
def rubbing(data: Columns, share: float) -> None:
    """Add Coulomb friction to the efforts, a share of each joint's rms."""
    data[EFFORTS][:] += share * np.sqrt(np.mean(data[EFFORTS] ** 2, axis=0)) * np.tanh(data[RATES] / 0.02)


@slip
def together(data: Columns, *changes: Change) -> None:
    """Make several changes, one after the other."""
    for change in changes:
        change(data)


def wxyz(data: Columns) -> None:
    """Write quaternions with w first."""
    data[TURN][:] = np.roll(data[TURN], 1, axis=1)


def inverse(data: Columns) -> None:
    """Write quaternions that turn the world to the body."""
    data[TURN][:, :3] *= -1.0


FREE_BASE: Mistakes = {
    "position x in mm": (times(PLACE, 1e3, 0), r"position against velocity: .*along x.*\(mm\)"),
    "position y in mm": (times(PLACE, 1e3, 1), r"position against velocity: .*along y"),
    "position z in mm": (times(PLACE, 1e3, 2), r"position against velocity: .*along z.*\(mm\)"),
    "position in cm": (times(PLACE, 100.0), r"position against velocity: .*\(cm\)"),
    "sign of the velocity x": (times(SPEED, -1.0, 0), r"position against velocity: .*along x"),
    "sign of the velocity z": (times(SPEED, -1.0, 2), r"position against velocity: .*along z"),
    "velocity in mm/s": (times(SPEED, 1e3), r"position against velocity: .*thousandths"),
    "velocity z in mm/s": (times(SPEED, 1e3, 2), r"position against velocity: .*along z"),
    "velocity x and z swapped": (swapped(SPEED, 0, 2), r"position against velocity: .*along [xz]"),
    "gyro in deg/s": (times(GYRO, DEGREES), r"gyro against attitude: .*degrees are read as radians"),
    "gyro y in deg/s": (times(GYRO, DEGREES, 1), r"gyro against attitude: .*about y.*degrees are read as radians"),
    "sign of the gyro y": (times(GYRO, -1.0, 1), r"gyro against attitude: .*about y.*its sign is wrong"),
    "gyro x and y swapped": (swapped(GYRO, 0, 1), r"gyro against attitude: .*about [xy]"),
    "gyro y and z swapped": (swapped(GYRO, 1, 2), r"gyro against attitude: .*about [yz]"),
    "quaternion with w first": (wxyz, r"quaternion order: .*seem to be w, x, y, z, body to world"),
    "quaternion inverse": (inverse, r"quaternion order: .*seem to be x, y, z, w, world to body"),
    "pose late": (late(6e-3, PLACE, TURN), r"late channel: attitude comes \d\.\d ms after gyro"),
    "position late": (late(6e-3, PLACE), r"late channel: position comes \d\.\d ms after velocity"),
    "gyro late": (late(6e-3, GYRO), r"late channel: gyro comes \d\.\d ms after attitude"),
    "gyro held": (held(GYRO), r"held channel: gyro changes only"),
    "position held": (held(PLACE), r"held channel: position changes only"),
    "velocity held": (held(SPEED), r"held channel: velocity changes only"),
}
LINKAGE: Mistakes = {
    "zero of a joint off": (off(ANGLES, 0.03, 1), r"joints off the linkage: left_elbow is 1\.7\d deg"),
    "crank angle late": (late(6e-3, CRANK), r"late channel: crank angle comes \d\.\d ms after joint positions"),
    "crank angle off, as if it were late": (off(CRANK, 0.1, 0), r"late channel: joint positions|joints off"),
}
OR_KNOWN = r"all efforts .* 0\.7\d* .*or the forces that the robot knows itself"
KNOWN_AIR: Mistakes = {"efforts 1.3 times": (times(EFFORTS, 1.3), OR_KNOWN)}
EFFORTS_APART: Mistakes = {
    "efforts late": (late(20e-3, EFFORTS), r"late efforts: joints\.effort comes (19|20|21) ms after the motion"),
    "an effort of noise alone": (
        together(rubbing(0.1), noisy(0.02), times(EFFORTS, 1e-3, 1)),
        r"effort unit: the effort of shoulder2_joint shows nothing of what motion and weight need",
    ),
    "efforts all zero": (times(EFFORTS, 0.0), r"effort unit: all efforts show nothing"),
    "zero of a shoulder off": (off(ANGLES, 0.05, 1), r"joint zero: shoulder2_joint seems .* -2\.[89] deg"),
    "zero of a light joint off": (off(ANGLES, 0.05, 5), r"joint zero: wrist2_joint seems .* -2\.[89] deg"),
    "angles and rates late": (late(20e-3, ANGLES, RATES), r"late efforts: the motion comes (19|20|21) ms after"),
}


def of_joints(names: tuple[str, ...], one: int, other: int) -> Mistakes:
    """Return mistakes in the channels of joints; those of single joints in two of them."""
    first, pair = names[one], rf"{names[one]} and {names[other]}"
    rates = rf"joint velocities against positions: .*at {first}"
    return {
        "joint rates in deg/s": (times(RATES, DEGREES), r"joint velocities against positions: .*degrees are read"),
        "one joint rate in deg/s": (times(RATES, DEGREES, one), rf"{rates}.*degrees are read as radians"),
        "sign of a joint rate": (times(RATES, -1.0, one), rf"{rates}.*its sign is wrong"),
        "joint angles in deg": (times(ANGLES, DEGREES), r"joint velocities against positions: .*degrees of the pos"),
        "one joint angle in deg": (times(ANGLES, DEGREES, one), rf"{rates}.*degrees of the position"),
        "two joint angles swapped": (swapped(ANGLES, one, other), rf"swapped joints: joint velocities of {pair} fit"),
        "two joint rates swapped": (swapped(RATES, one, other), rf"swapped joints: joint velocities of {pair} fit"),
        "joint angles and rates in deg": (in_degrees, r'joint limits: .* rad, its limits are .*unit = "deg" for j'),
        "joint rates late": (late(6e-3, RATES), r"late channel: joint velocities come \d\.\d ms after joint positions"),
        "joint angles late": (late(6e-3, ANGLES), r"late channel: joint positions come \d\.\d ms after joint vel"),
        "joint rates held": (held(RATES), r"held channel: joint velocities change only"),
        "joint angles held": (held(ANGLES), r"held channel: joint positions change only"),
        "efforts held": (held(EFFORTS), r"held channel: joint efforts change only"),
        "efforts cut off": (cut_off(0.1), rf"effort at its limit: efforts stay .*{first} \(\d+ % of the time\)"),
        "sign of an effort": (times(EFFORTS, -1.0, one), rf"effort sign: the effort of {first}"),
        "efforts in mN m": (times(EFFORTS, 1e3), r"effort unit or mass: all efforts .* 0\.00(1|09)"),
        "one effort in mN m": (times(EFFORTS, 1e3, one), rf"effort unit: the effort of {first}"),
        "two efforts swapped": (swapped(EFFORTS, one, other), rf"swapped joints: efforts of {pair} in exchanged"),
    }


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
    time, order = np.arange(1500) / 500.0, np.arange(model.nq)
    pace, size = 2.0 * np.pi * (0.5 + 0.13 * order) * (0.3 if known else 1.0), swing * (0.3 + 0.05 * order)
    q, v, a = sines(time, size, pace, order)
    push = pushed * np.stack([2.0 * np.sin(3.0 * time), np.ones_like(time), 3.0 * np.cos(2.0 * time)], axis=1)
    table = joint_table(time, names, q=q, v=v, tau=efforts(model, tool, q, v, a, push))
    given = joint_map("", [tool], names, use={} if pushed else {"free": [0, 3]}) | {"robot": {"points": [tool]}}
    return recorded(folder / "arm.csv", given, PlainRobot(model, False, names, "arm"), table)


def quadruped_bag(folder: Path) -> Record:
    """Return the record of a bag: topics at rates of their own."""
    (folder / "quadruped.urdf").write_text(urdf())
    bag(walk(2.0), folder / "walk")
    return recorded(folder / "walk", bag_map(folder / "quadruped.urdf"))


@pytest.fixture(scope="module")
def records(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Record]:
    """Return the good record of each robot."""
    folder = tmp_path_factory.mktemp("planted")
    for name in ("rest", "held"):
        (folder / name).mkdir()
    found = {"aerobat": flight(), "arm": arm_table(folder), "quadruped": quadruped_bag(folder)}
    found["arm almost at rest"] = arm_table(folder / "rest", 0.003, pushed=False)
    return found | {"arm almost at rest, pushed": arm_table(folder / "held", 0.003)}


def said(record: Record) -> Iterator[str]:
    """Yield what the checks warn of before an observer runs: those of the efforts, which take longest, come last."""
    found = list(record_findings(record))
    yield from (str(one) for one in found if one.warns)
    told = effort_findings(record, inputs_between(record, KnownForces(record)), found)
    yield from (str(one) for one in told if one.warns)


def warned(record: Record) -> list[str]:
    """Return all of it."""
    return list(said(record))


MISTAKES: dict[str, Mistakes] = {
    "aerobat": FREE_BASE | of_joints(JOINTS, 0, 1) | LINKAGE | KNOWN_AIR,
    "arm": of_joints(ARM_JOINTS, 1, 3) | EFFORTS_APART,
    "quadruped": FREE_BASE | of_joints(LEGS, 1, 2) | {"efforts late": EFFORTS_APART["efforts late"]},
}


@pytest.mark.parametrize("robot", [*MISTAKES, "arm almost at rest", "arm almost at rest, pushed"])
def test_a_good_log_causes_no_warning(robot: str, records: dict[str, Record]) -> None:
    assert warned(records[robot]) == []


@pytest.mark.parametrize(("robot", "name"), [(robot, name) for robot, all_of in MISTAKES.items() for name in all_of])
def test_a_planted_mistake_is_named(robot: str, name: str, records: dict[str, Record]) -> None:
    """By the check that sees it, with the column that is wrong."""
    change, expected = MISTAKES[robot][name]
    record = planted(records[robot], change)
    assert any(re.search(expected, one) for one in said(record)), warned(record)


def test_late_efforts_are_named_also_where_their_factors_are_known(records: dict[str, Record]) -> None:
    """Efforts in a unit of half a newton metre, of which a calibration knows the factor, 20 ms late."""
    record = planted(records["arm"], together(times(EFFORTS, 0.5), EFFORTS_APART["efforts late"][0]))
    values = FittedValues(joints=record.driven, scale=np.full(len(record.driven), 2.0))
    found = effort_findings(record, inputs_between(record, KnownForces(record, values)), [])
    assert [one.check for one in found if one.warns] == ["late efforts"]


# Noise and friction of the efforts, shares of their rms.
LOUD = ((0.02, 0.1), (0.1, 0.0), *further((0.0, 0.0), (0.02, 0.0)))


@pytest.mark.parametrize("noise", [0.1, 2.0, *further(0.02, 0.5)])
@pytest.mark.parametrize("robot", ["arm almost at rest", "arm almost at rest, pushed", "arm", "quadruped"])
def test_noise_of_the_efforts_is_no_mistake(robot: str, noise: float, records: dict[str, Record]) -> None:
    """Also where joints carry less than their noise, as those of an arm that stands upright, almost at rest."""
    assert warned(planted(records[robot], noisy(noise))) == []


def test_what_noise_leaves_is_no_other_reading_of_joints(
    records: dict[str, Record], monkeypatch: pytest.MonkeyPatch
) -> None:
    """A gyro's 0.2 rad/s leave 17 %, which no other joints explain: of a standing hexapod a knee 82 deg off did."""

    @slip
    def shaken(data: Columns) -> None:
        data["base.rate"][:] += 0.2 * np.random.default_rng(0).standard_normal(data["base.rate"].shape)

    monkeypatch.setattr(free_efforts, "reading_of", lambda *_: pytest.fail("joints are read otherwise"))
    assert warned(planted(records["quadruped"], shaken())) == []


@pytest.mark.parametrize(("noise", "friction"), LOUD)
@pytest.mark.parametrize("robot", ["arm almost at rest", "arm", "quadruped"])
def test_reversed_efforts_are_named(robot: str, noise: float, friction: float, records: dict[str, Record]) -> None:
    record, loud = records[robot], together(rubbing(friction), noisy(noise))
    for columns in ((1,), (0, 1)):
        found = warned(planted(record, together(loud, times(EFFORTS, -1.0, *columns))))
        told = [re.findall(r"effort sign: the effort of (\w+) is reversed", one) for one in found]
        assert told == [[record.driven[k]] for k in columns]
    found = warned(planted(record, together(loud, times(EFFORTS, -1.0))))
    assert len(found) == 1
    assert f"effort sign: all efforts are reversed ({', '.join(record.driven)})" in found[0]


@pytest.mark.parametrize("joint", [1, *further(0, 2, 4, 7)])
def test_one_effort_of_a_walking_robot_is_named_alone(joint: int, records: dict[str, Record]) -> None:
    """It is 2.86 times as large; a base link of nearly no mass and other efforts, up to five wrong ones, left less."""
    record = records["quadruped"]
    [found] = warned(planted(record, together(rubbing(0.1), noisy(0.02), times(EFFORTS, 1.0 / 0.35, joint))))
    told = re.match(r"effort unit: the effort of (\w+) would have to be ([.\d]+) times as large", found)
    assert told is not None
    assert told[1] == record.driven[joint]
    assert float(told[2]) == pytest.approx(0.35, abs=0.1)


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
        (0, 0.02, 0.1, 0),
        (6, 0.0, 0.0, 0.02),
        (90, 0.02, 0.1, 0.15),
        *further((0, 0.1, 0.0, 0), (20, 0.0, 0.0, 0.02), (180, 0.02, 0.1, 0.15)),
    ],
)
def test_an_arm_mounted_otherwise(angle: float, noise: float, friction: float, within: float, tmp_path: Path) -> None:
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


@pytest.mark.parametrize(("noise", "friction"), [(0.02, 0.2), *further((0.0, 0.0))])
def test_efforts_to_which_a_controller_adds_weight_are_told_so(noise: float, friction: float, tmp_path: Path) -> None:
    """As of a command without gravity compensation, of a UR5 that swings, pushed; told so, it is good."""
    ur5 = load_robot("ur5")
    model = ur5.model.copy()
    model.gravity.linear = np.zeros(3)
    log = arm_table(tmp_path, known=replace(ur5, model=model))
    record = planted(log, together(rubbing(friction), noisy(noise)))
    (found,) = warned(replace(record, robot=PlainRobot(ur5.model, False, record.robot.joints, "ur5")))
    assert found.startswith("efforts without weight: efforts that bear no weight leave"), found
    assert warned(record) == []


@pytest.mark.parametrize(
    ("kilograms", "place"), [(1.0, (0.15, 0.1, 0.0)), (4.0, (0.0, 0.0, 0.2)), *further((2.0, (0.1, 0.0, 0.1)))]
)
def test_a_load_beside_the_point_is_a_load(kilograms: float, place: tuple[float, float, float], tmp_path: Path) -> None:
    """Of 1 to 4 kg that the robot's file lacks: a push and a moment, once wrong units; less its moments of inertia."""
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
    ("kilograms", "away", "told"), [(1.0, 0.1, True), (-0.1, 1.0, True), (-1.0, 0.1, False), (1.0, 30.0, False)]
)
def test_no_load_is_negative_nor_heavier_than_the_robot(kilograms: float, away: float, told: bool) -> None:
    """Of a real SO-101 that logs its efforts without their signs -0.3 kg at 7 m were a load it carries."""
    ur5, errors = load_robot("ur5"), np.ones((9, 6))
    place = ur5.model.frames[ur5.model.getFrameId("tool0")].placement.translation + np.array([away, 0.0, 0.0])
    size, rows = -kilograms * np.array([1.0, *place]), np.ones((9, 6, 6))
    found = _load(ur5, "tool0", Explanation(0.0, size, np.full(4, 1e-3), errors, errors, rows, errors[0]), "little")
    assert found is None if not told else len(found) == 1


@pytest.mark.parametrize("factors", [(0.7, 0.7, 1.0, 0.7, 0.7, 0.7), (0.3, 1.0, 0.3, 0.5, 1.0, 1.0)])
def test_wrong_factors_are_no_other_mounting_nor_other_places(factors: tuple[float, ...], tmp_path: Path) -> None:
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
def test_noise_of_an_arm_whose_tool_bears_all_weight_is_no_mistake(tmp_path: Path) -> None:
    """Of a SCARA only the last axis is left beside the tool's force: its own inertia, and no gravity."""
    record = planted(arm_table(tmp_path, known=chain("zzsz")), noisy(0.5))
    (one,) = effort_findings(record, inputs_between(record, KnownForces(record)), [])
    assert one.verdict == "note", one


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


@pytest.fixture(scope="module")
def demo() -> FlightLog:
    """Fly `real_log_demo`, with the noise and rounding of its sensors, for 0.6 s."""
    return simulate(load_scenario("real_log_demo", ["simulation.duration=0.6"]))


def contradicted(log: FlightLog, robot: Aerobat) -> list[str]:
    """Return what the checks of a log warn of; its torques are not compared."""
    found = record_findings(flight_record(log, AerobatRobot.of(robot, AirSection())))
    return [str(one) for one in found if one.verdict in ("warning", "refused")]


def kinds(found: list[str]) -> list[str]:
    """Return the kind of each contradiction."""
    return [one.partition(": ")[0] for one in found]


def number(text: str) -> float:
    """Return the first number that stands alone in a text."""
    return float(next(word for word in text.split() if re.fullmatch(r"[\d.]+", word)))


def changed(log: FlightLog, name: str, columns: slice | list[int], values: object) -> FlightLog:
    """Return the log with columns of a channel replaced."""
    measured = log.measured.copy(deep=True)
    measured[name].values[:, columns] = values
    return FlightLog(measured)


@pytest.mark.parametrize("name", sorted(shipped_scenarios()))
def test_no_shipped_flight_contradicts_itself_but_the_one_with_slow_and_late_sensors(name: str) -> None:
    """`noisy_sensors` has a pose of 200 Hz that is 5 ms late, which holding makes 7 ms, and an airspeed of 50 Hz."""
    scenario = load_scenario(name, [] if name == "noisy_sensors" else ["simulation.duration=1.0"])
    pilot = Controller(scenario) if scenario.control is not None else None
    found = contradicted(simulate(scenario, pilot=pilot), believed_robot(scenario))
    if name != "noisy_sensors":
        assert found == []
        return
    assert [one.split()[2] for one in found] == ["position", "attitude", "airspeed", "attitude", "position"]
    assert kinds(found) == 3 * ["held channel"] + 2 * ["late channel"]
    assert [number(one) for one in found[:3]] == pytest.approx([200.0, 200.0, 50.0], rel=0.03)  # 2 % are lost
    assert [number(one) for one in found[3:]] == pytest.approx([7.1, 7.1], abs=0.6)  # ms


@pytest.mark.parametrize("name", sorted(CONTRADICTIONS))
def test_each_contradiction_is_named(name: str, demo: FlightLog) -> None:
    """Two variants each, with the noise of real sensors; no other kind of warning comes with them."""
    robot = flown_robot(load_scenario("real_log_demo"))
    for seed in range(2):
        wrong = demo.measured.copy(deep=True)
        CONTRADICTIONS[name](np.random.default_rng(seed), wrong)
        found = contradicted(FlightLog(wrong), robot)
        assert name in kinds(found), seed
        # a held channel is also late, by half of its period; wrong joint angles do not follow from their rates either
        joints = {"swapped joints", "joint velocities against positions"} if name == "joints off the linkage" else set()
        assert set(kinds(found)) <= {name, "late channel", *joints}


@pytest.mark.parametrize(
    ("channel", "columns", "pair"),
    [
        ("q", slice(0, 3), "position comes {} ms after velocity"),
        ("q", slice(3, 7), "attitude comes {} ms after gyro"),
        ("v", slice(3, 6), "gyro comes {} ms after attitude"),
        ("v", slice(6, 10), "joint velocities come {} ms after joint positions"),
        ("crank_angle", slice(None), "crank angle comes {} ms after joint positions"),
    ],
)
@pytest.mark.parametrize("late", [1, 12])
def test_a_delay_is_measured_to_a_tenth(channel: str, columns: slice, pair: str, late: int, paper: Experiment) -> None:
    """From one sample of 1 ms on, which costs an R2 of up to 0.1, and with its sign."""
    index = np.maximum(np.arange(len(paper.log.time)) - late, 0)
    measured = paper.log.measured.copy(deep=True)
    values = measured[channel].values
    where = (slice(None), columns) if values.ndim > 1 else slice(None)
    values[where] = values[index][where]
    told = [one for one in contradicted(FlightLog(measured), paper.robot) if one.startswith("late channel")]
    assert told
    assert [number(one) for one in told] == pytest.approx([late] * len(told), abs=0.1)
    assert pair.format(f"{late:.1f}") in " ".join(told)


def test_the_figures_are_those_of_the_mistake(paper: Experiment) -> None:
    """An elbow 2 deg off is told with 2 deg; a channel of 100 Hz with 100 Hz; z in mm without a velocity with m/s2."""
    log, robot = paper.log, paper.robot
    q = log.measured["q"].values
    (elbow,) = contradicted(changed(log, "q", [8], q[:, [8]] + np.radians(2.0)), robot)
    assert "left_elbow is 2.00 deg (rms) off" in elbow
    held = contradicted(changed(log, "q", slice(0, 3), q[np.arange(len(q)) // 10 * 10, :3]), robot)[0]
    assert number(held) == pytest.approx(100.0)
    short = FlightLog(
        log.measured.isel(time=slice(0, 500), interval=slice(0, 499))
    )  # it begins with a rate of exactly 0
    slow = log.measured["v"].values[np.arange(500) // 17 * 17, 3:6]
    assert "held channel" in kinds(contradicted(changed(short, "v", slice(3, 6), slow), robot))
    poses = log.measured["q"].isel(q_axis=slice(7)).rename(q_axis="pose_axis").copy(deep=True)
    bare = log.measured.drop_vars(["q", "v", "q_axis", "v_axis", "motor_torque", "known_thrusters"]).assign(pose=poses)
    assert contradicted(FlightLog(bare), robot) == []
    bare["pose"].values[:, 2] *= 1e3
    (moved,) = contradicted(FlightLog(bare), robot)
    assert kinds([moved]) == ["position against gravity"]
    assert "m/s2 (rms)" in moved


def test_a_rounded_slow_signal_is_not_held(paper: Experiment) -> None:
    """An encoder of 8 bits repeats its angle irregularly, and a channel that stands still repeats it always."""
    crank = np.round(paper.log.measured["crank_angle"].values / 0.0245) * 0.0245
    measured = paper.log.measured.copy(deep=True)
    measured["crank_angle"].values[:] = crank
    measured["airspeed"].values[:] = 3.0
    assert "held channel" not in kinds(contradicted(FlightLog(measured), paper.robot))


@pytest.mark.usefixtures("unrendered")
def test_warnings_stand_in_all_outputs(demo: FlightLog, here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """`aerobat estimate` on a table whose gyro is in deg/s: three places, one text."""
    wrong = changed(demo, "v", slice(3, 6), demo.measured["v"].values[:, 3:6] * 180.0 / np.pi)
    write_csv(wrong, here / "hall.csv")
    words = ("estimate", "hall.csv", "--observer", "momentum", "--morphology", "aerobat_guard", "--out", "found")
    assert call(*words) == 0
    text, *more = json.loads((here / "found" / "metrics.json").read_text())["warnings"]
    assert text.startswith("gyro against attitude: in 0.1 s they differ by ")
    assert any(line.startswith("momentum: belief off by about ") for line in more)  # a gyro in deg/s is no force
    assert f"warning: {text}\n" in capsys.readouterr().out
    assert "gyro against attitude" in (here / "found" / "report.html").read_text()


def test_who_has_no_map_is_not_left_with_its_keys(demo: FlightLog) -> None:
    """Warnings name keys of maps, such as the order of a quaternion, which Aerobat's own logs do not have."""
    scenario = load_scenario("real_log_demo", ['observers.names=["momentum"]'])
    wrong = changed(demo, "q", slice(3, 6), -demo.measured["q"].values[:, 3:6])
    for log, times in ((demo, 0), (wrong, 1)):
        assert [str(one) for one in run_recorded(log, scenario).scores.findings].count(str(NO_MAP)) == times


def test_a_short_or_uneven_log_is_no_reason_to_fail(demo: FlightLog) -> None:
    """Three samples, repeated stamps, a gap in time, and a height in mm in the rest."""
    robot = flown_robot(load_scenario("real_log_demo"))
    measured = demo.measured.drop_dims("interval")
    for rows in (np.arange(3), np.arange(9), np.sort(np.append(np.arange(300), 10)), np.r_[0:100, 200:300]):
        assert contradicted(FlightLog(measured.isel(time=rows)), robot) == []
    wrong = measured.isel(time=np.r_[0:100, 200:300]).copy(deep=True)
    height_in_millimetres(np.random.default_rng(1), wrong)
    assert kinds(contradicted(FlightLog(wrong), robot)) == ["position against velocity"]


@pytest.mark.parametrize(
    ("seed", "late", "size", "pace", "seconds"),
    [(6, 0.0, 0.05, 0.21, 1), (51, 0.0, 0.05, 0.21, 1), (1, 0.04, 0.5, 1.0, 10)],
)
def test_a_slow_turn_is_no_late_gyro(seed: int, late: float, size: float, pace: float, seconds: int) -> None:
    """It follows from itself at another time about as well: of a second of a quiet flight 105 ms were named."""
    rng, time, alone = np.random.default_rng(seed), np.arange(100 * seconds) / 100.0, np.array([0.0, 0.0, 1.0])
    phase = rng.uniform(0.0, 6.0, 3)[2]
    turned = size / pace * np.sin(pace * time + phase)[:, None] * alone
    turned += 1e-6 * rng.standard_normal((len(time), 3)) * alone
    gyro = size * np.cos(pace * (time - late) + phase)[:, None] * alone + 3e-3 * rng.standard_normal((len(time), 3))
    pair = Agreement("-", ("attitude", "gyro"), time, turned, gyro, "rates", ("x", "y", "z"), "rad", 0.02, "-")
    assert ("late channel" in [one.check for one in agreement_findings(pair)]) == (late > 0.0)
