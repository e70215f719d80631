"""Misread limbs of a walking robot, and forces that a map knows wrongly: each is named with how to read it."""

import importlib
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pandas as pd
import pinocchio as pin
import pytest
from scipy.spatial.transform import Rotation
from support.further import further
from support.pushed_robots import RATE, STEPS, log_of, map_of
from support.recorded import edited, recorded
from support.robot_parts import by_axis, efforts, free_map, joint, joint_map, joint_table, link, sines
from support.six_joints import SIX, six_joints
from support.walking_log import LEGS, table, table_map, urdf, walk

from aerobat_pin.errors import LogError
from aerobat_pin.estimation import Finding, estimate
from aerobat_pin.estimation.checks.readings import JointReading, possible_readings
from aerobat_pin.records import Record, load_robot

CHECKS = {"order": "swapped joints", "sense": "joint sense", "zero": "joint zero"}
PLACES = ("HAA", "HFE", "KFE")
JOINTS = [f"{leg}_{place}" for leg in LEGS for place in PLACES]
COLUMNS = ("pos", "vel", "tau")


@pytest.fixture(scope="module")
def noisy() -> pd.DataFrame:
    """Return a walk with friction of 20 % of the efforts and noise of all channels."""
    log, rng = table(walk(2.0)), np.random.default_rng(3)
    for name in JOINTS:
        q, v, tau = (log[f"{name}_{column}"] for column in COLUMNS)
        size = np.sqrt(np.mean(tau**2))
        log[f"{name}_tau"] = tau + size * (0.2 * np.tanh(v / 0.05) + 0.01 * rng.standard_normal(len(log)))
        log[f"{name}_pos"] = q + 1e-4 * rng.standard_normal(len(log))
        log[f"{name}_vel"] = v + 5e-3 * rng.standard_normal(len(log))
    return log


def legs(*order: str) -> dict[str, str]:
    """Return whose columns each joint has, of legs in another order."""
    return dict(zip(JOINTS, (f"{leg}_{place}" for leg in order for place in PLACES), strict=True))


def of_legs(place: str) -> list[str]:
    """Return the joints at a place, of all legs."""
    return [f"{leg}_{place}" for leg in LEGS]


RIGHT = [f"{leg}_{place}" for leg in ("FR", "RR") for place in ("HFE", "KFE")]
WITHIN = {name: name.replace("HAA", "x").replace("HFE", "HAA").replace("x", "HFE") for name in JOINTS}
LAST_FIRST = dict(zip(JOINTS, (f"{leg}_{place}" for leg in LEGS for place in PLACES[::-1]), strict=True))
BY_PLACE = dict(zip(JOINTS, (f"{leg}_{place}" for place in PLACES for leg in LEGS), strict=True))
ORDERS = [BY_PLACE, WITHIN, {one: WITHIN[one] for one in JOINTS[:3]}, LAST_FIRST]
ORDERS += [
    legs(*order.split()) for order in ("FR FL RL RR", "RL RR FL FR", "FR RR FL RL", "RR FR RL FL", "FL FR RR RL")
]
SENSES = [["RR_HFE"], ["FL_KFE"], ["RR_HAA"], ["FR_HAA", "RR_HAA"], *map(of_legs, PLACES), JOINTS]
ZEROS = [{"RR_HFE": 10.0}, {"FL_HFE": 45.0}, {"FL_HAA": 20.0}, {"FL_HAA": 10.0}, {"RL_KFE": -90.0}]
ZEROS += [dict.fromkeys(of_legs("HFE"), angle) for angle in (45.0, -10.0, 180.0)]
MISTAKES = [  # whose columns joints have; joints that turn the other way; where joints stand, when they say 0 [deg]
    ("order", legs("FR", "FL", "RR", "RL"), [], {}),
    ("sense", {}, RIGHT, {}),
    ("zero", {}, [], dict.fromkeys(of_legs("KFE"), 90.0)),
    ("sense", {}, ["RL_HAA", "RR_HAA"], {}),  # one effort that is reversed leaves nearly as little
    ("zero", {}, [], {"RL_KFE": -10.0}),  # that leaves 6 %
    *further(*(("order", order, [], {}) for order in ORDERS)),
    *further(*(("sense", {}, senses, {}) for senses in SENSES)),
    *further(*(("zero", {}, [], zeros) for zeros in ZEROS)),
]


def misread(log: pd.DataFrame, order: dict[str, str], senses: list[str], zeros: dict[str, float]) -> pd.DataFrame:
    """Return a log with these mistakes."""
    wrong = log.copy()
    for name, other in order.items():
        wrong[[f"{name}_{column}" for column in COLUMNS]] = log[[f"{other}_{column}" for column in COLUMNS]]
    for name in senses:
        wrong[[f"{name}_{column}" for column in COLUMNS]] *= -1.0
    for name, zero in zeros.items():
        wrong[f"{name}_pos"] -= np.radians(zero)
    return wrong


def warned(log: pd.DataFrame, values: dict[str, Any], folder: Path) -> list[Finding]:
    """Return what the estimate of a log warns of, but for a mean force, which wrong forces may show besides."""
    found = estimate(recorded(folder / "log.csv", values, table=log), ["force_level"]).findings
    return [one for one in found if one.warns and one.check != "mean force"]


def of_walk(folder: Path) -> dict[str, Any]:
    """Return the map of the walk, without sensors of its forces."""
    (folder / "quadruped.urdf").write_text(urdf())
    values = table_map(folder / "quadruped.urdf")
    del values["check"]
    return values


def test_a_walk_that_is_read_right_warns_of_nothing(noisy: pd.DataFrame, tmp_path: Path) -> None:
    """Friction of a fifth of the efforts is no misread joint."""
    assert warned(noisy, of_walk(tmp_path), tmp_path) == []


@pytest.mark.parametrize(("kind", "order", "senses", "zeros"), MISTAKES)
def test_a_misread_walk_says_how_to_read_it(
    noisy: pd.DataFrame, tmp_path: Path, kind: str, order: dict[str, str], senses: list[str], zeros: dict[str, float]
) -> None:
    """It names each joint that is misread, no other, and the key that mends it."""
    [said] = warned(misread(noisy, order, senses, zeros), of_walk(tmp_path), tmp_path)
    assert said.check == CHECKS[kind]
    assert "so much that it may be" not in said.text
    named = {name for name in JOINTS if name in said.text.partition(", which leaves")[0]}
    assert named == {name for name, other in order.items() if name != other} | {*senses, *zeros}
    keys = {"sense": dict.fromkeys(senses, -1.0), "zero": {name: np.radians(zero) for name, zero in zeros.items()}}
    for name, value in keys.get(kind, {}).items():
        told = float(said.text.partition(f"{name} = ")[2].partition(",")[0].rstrip("}"))
        assert told == pytest.approx(value, abs=0.03)


def test_a_reading_that_leaves_much_says_so(noisy: pd.DataFrame, tmp_path: Path) -> None:
    """Of knees whose zero is off and one whose effort is, too, the zero was told 11 deg wrong, without a doubt."""
    log = misread(noisy, {}, [], dict.fromkeys(of_legs("KFE"), 90.0))
    log["RL_KFE_tau"] *= 1.6
    [said] = warned(log, of_walk(tmp_path), tmp_path)
    assert "(so much that it may be other joints, or a push)" in said.text


@pytest.mark.parametrize("factor", [2.0, *further(0.5)])
def test_efforts_of_a_walk_that_rubs_are_wrong_by_a_factor(noisy: pd.DataFrame, tmp_path: Path, factor: float) -> None:
    """Not the base, which would have to weigh less than nothing: most of what is needed is its weight."""
    log = noisy.copy()
    log[[f"{name}_tau" for name in JOINTS]] *= factor
    [said] = warned(log, of_walk(tmp_path), tmp_path)
    assert said.check == "effort unit or mass"
    assert said.value == pytest.approx(1.0 / factor, rel=0.05)


@pytest.mark.evidence
@pytest.mark.parametrize(
    ("gait", "base", "least"), [("TROT", "imu", 27), ("WALK", "measured", 27), ("FAST_TROT", "measured", 26)]
)
def test_a_go2_is_read_right(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, gait: str, base: str, least: int) -> None:
    """Another writer, robot and friction: how many of the same mistakes are named; of the good log nothing is said."""
    monkeypatch.syspath_prepend(Path(__file__).parents[2] / "benchmarks")
    legs, trot = (importlib.import_module(name) for name in ("legs", "trot"))
    values, log = legs.mapped(base, 200.0), legs.sensed(trot.walked(getattr(trot, gait), 9.0), 5)
    places = dict(zip(PLACES, ("hip_joint", "thigh_joint", "calf_joint"), strict=True))
    names = dict(zip(JOINTS, values["joints"]["names"], strict=True))
    assert [f"{name[:2]}_{places[name[3:]]}" for name in JOINTS] == list(names.values())
    for part, old, column in zip(("position", "velocity", "effort"), ("q", "dq", "tau"), COLUMNS, strict=True):
        log = log.rename(columns={f"{old}{k}": f"{joint}_{column}" for k, joint in enumerate(JOINTS)})
        values["joints"][part]["columns"] = [f"{joint}_{column}" for joint in JOINTS]
    assert warned(log, values, tmp_path) == []
    right = 0
    for kind, order, senses, zeros in (getattr(one, "values", one) for one in MISTAKES):
        said = {one.check: one for one in warned(misread(log, order, senses, zeros), values, tmp_path)}
        said.pop("joint limits", None)
        assert not {"effort unit", "effort sign", "effort unit or mass"} & set(said), (kind, order, senses, zeros)
        wrong = {joint for joint, other in order.items() if joint != other} | {*senses, *zeros}
        text = said[CHECKS[kind]].text.partition(", which leaves")[0] if CHECKS[kind] in said else ""
        right += {joint for joint in JOINTS if names[joint] in text} == wrong
    assert right >= least


@pytest.mark.parametrize("seed", [1, *further(2, 3)])
def test_noise_of_a_flapping_robot_is_no_joint_of_another_zero(seed: int, tmp_path: Path) -> None:
    """Its rows need no more than their noise: a wing 40 deg off needs twenty times as much, and left twice as much."""
    parts = [
        link("torso", 0.42, "0.01 0 -0.01", (9e-4, 2.2e-3, 2.4e-3)),
        link("stand"),
        joint("s", "fixed", "torso", "stand"),
    ]
    for name, side in (("left", 1), ("right", -1)):
        parts += [link(name, 0.035, f"-0.02 {0.16 * side} 0", (4.2e-4, 6e-5, 4.7e-4)), link(f"{name}_tip")]
        parts += [joint(f"{name}_root", "revolute", "torso", name, f"0.03 {0.03 * side} 0.02", "1 0 0")]
        parts += [joint(f"{name}_end", "fixed", name, f"{name}_tip", f"-0.02 {0.25 * side} 0")]
    parts += [
        link("tail", 0.02, "-0.06 0 0", (2e-5, 4e-5, 5e-5)),
        joint("tail_root", "revolute", "torso", "tail", "-0.15 0 0"),
    ]
    (tmp_path / "bird.urdf").write_text(f'<robot name="bird">{"".join(parts)}</robot>')
    model = pin.buildModelFromXML((tmp_path / "bird.urdf").read_text(), pin.JointModelFreeFlyer())
    data, rng, time = model.createData(), np.random.default_rng(seed), np.arange(4000) / 1000.0
    pitch, flap = 0.1 * np.sin(0.7 * time)[:, None] * [0.0, 1.0, 0.0], 0.6 * np.sin(8.0 * np.pi * time)
    place = np.stack([0.3 * np.sin(time), 0.2 * np.sin(0.8 * time), 1.5 + 0.2 * np.sin(1.2 * time)], axis=1)
    turns, angles = Rotation.from_rotvec(pitch), np.stack([flap, -flap, 0.3 * np.sin(2.0 * time)], axis=1)
    q = np.column_stack([place, turns.as_quat(), angles])
    ahead, *rates = (np.gradient(values, time, axis=0) for values in (place, pitch, angles))
    v = np.column_stack([turns.inv().apply(ahead), *rates])
    tau = np.array([pin.rnea(model, data, *each) for each in zip(q, v, np.gradient(v, time, axis=0), strict=True)])
    v += rng.standard_normal(v.shape) * [*3 * [2e-3], *3 * [5e-3], *3 * [0.02]]
    tau += 0.01 * rng.standard_normal(tau.shape)
    joints = ["left_root", "right_root", "tail_root"]
    names = "x y z qx qy qz qw vx vy vz wx wy wz fx fy fz mx my mz"
    columns = dict(zip(names.split(), np.hstack([q[:, :7], v[:, :6], tau[:, :6]]).T, strict=True))
    chosen = free_map(tmp_path / "bird.urdf", ["left_tip", "right_tip"], joints, observer={"gain": 200})
    stand = {"columns": ["fx", "fy", "fz", "mx", "my", "mz"], "frame": "stand", "axes": "frame"}
    chosen = edited(chosen, {"base.velocity.axes": "body", "known.stand": stand})
    log = joint_table(time, joints, q=angles, v=v[:, 6:], tau=tau[:, 6:]).assign(**columns)
    assert warned(log, chosen, tmp_path) == []


def test_a_reading_by_which_a_joint_would_be_beyond_its_limits_is_none() -> None:
    """A waist that turns by 1 rad was told to stand 62 deg farther, where a knee beside it did by 17."""
    robot = load_robot("panda")
    table = SimpleNamespace(joints=SimpleNamespace(effort=None))
    record = cast(Record, SimpleNamespace(robot=robot, driven=robot.joints, map=table))
    mapped, q = JointReading.as_mapped(record), np.array([[0.0, 0.0, 0.0, -1.5, 0.0, 1.5, 0.0, 0.02, 0.02]])
    elbow = robot.joints.index("panda_joint4")  # from -3.07 to -0.07 rad
    turned = [mapped.otherwise([elbow], turn) for turn in (1.4, 1.45, 1.6, -1.6, 4.0)]
    assert possible_readings(record, q, turned) == [True, True, False, True, False]
    on = q - 2.0 * np.pi * np.eye(robot.model.nq)[3]  # its columns are a whole turn off
    assert possible_readings(record, on, turned) == [True, True, False, True, False]
    assert possible_readings(record, q, [mapped.otherwise([7], sense=-1.0)]) == [False], "a finger opens by 40 mm"
    away = q + np.eye(robot.model.nq)[3] * 2.0  # it is beyond them as mapped
    assert possible_readings(record, away, [mapped, mapped.otherwise([elbow], 1.0)]) == [True, False]


CLEAR = np.array([5.0, -4.0, 12.0, 0.5, 0.3, 0.1])  # [N, N m] that a sensor shows of nothing
SOLES = ("l_sole", "r_sole")
TIMES, SHIFT = "known.wrist would have to be", "known.wrist seems to show"


def told(folder: Path, seed: int, factor=1.0, shift=0.0, order="012345", **section: Any) -> list[Finding]:
    """Return what is warned of an arm whose wrist's sensor shows multiples of the wrench, in an order, plus offset."""
    # It holds 1 kg beside the wrist, something pushes it, and for two seconds its elbow; all joints rub.
    (folder / "six.urdf").write_text(six_joints())
    model, rng, time = pin.buildModelFromXML(six_joints()), np.random.default_rng(seed), np.arange(2000) / 100.0
    pace, phase = rng.uniform(0.6, 2.2, (2, 6)), rng.uniform(0.0, 6.0, (2, 6))
    q, v, a = sines(time, 0.5, pace, phase, [0.0, 0.6, 0.9, -0.5, 0.4, 0.0])
    data, at, wrench, shown = model.createData(), model.getFrameId("tool"), np.zeros((len(q), 6)), np.zeros((len(q), 6))
    for k, now in enumerate(time):
        pin.framesForwardKinematics(model, data, q[k])
        R = data.oMf[at].rotation
        force = np.array([20.0, -10.0, 15.0]) * (6.0 < now < 8.0) - [0.0, 0.0, 9.81]
        wrench[k] = *force, *np.cross(R @ [0.0, 0.05, 0.0], force)
        shown[k] = factor * np.concatenate([R.T @ wrench[k, :3], R.T @ wrench[k, 3:]]) + shift * CLEAR
    push = np.where((time > 10.0) & (time < 12.0), 30.0, 0.0)[:, None] * [0.0, 0.8, -0.6]
    tau = efforts(model, "tool", q, v, a, wrench)
    tau += efforts(model, "elbow_link", q, v, a, push) - efforts(model, "elbow_link", q, v, a, 0.0 * push)
    tau += 0.8 * np.tanh(v / 0.01) + 0.5 * v + 0.1 * rng.standard_normal(v.shape)
    shown += rng.standard_normal(shown.shape) * [0.2, 0.2, 0.2, 0.01, 0.01, 0.01]
    table = joint_table(time, SIX, q=q, v=v, tau=tau)
    table[[f"w{k}" for k in range(6)]] = shown
    world = "ned" if section.pop("down", False) else "z_up"
    wrist = {"columns": [f"w{k}" for k in order], "unit": "N", "frame": "tool", **section}
    chosen = edited(joint_map(folder / "six.urdf", ["elbow_link"], SIX, known={"wrist": wrist}), {"log.world": world})
    found = estimate(recorded(folder / "log.csv", chosen, table=table), ["force_level"]).findings
    return [one for one in found if one.warns and one.check != "push elsewhere"]


@pytest.mark.parametrize("seed", [1, *further(2)])
@pytest.mark.parametrize("factor", [-1.0, 0.7])
def test_a_sensor_that_shows_a_force_reversed_or_too_small_is_named(seed: int, factor: float, tmp_path: Path) -> None:
    """Of the efforts of single joints it was said that they are reversed, or that their unit is wrong."""
    [one] = told(tmp_path, seed, factor)
    assert one.text.startswith(TIMES)
    assert one.value == pytest.approx(1.0 / factor, rel=0.1)


@pytest.mark.parametrize("seed", [1, *further(2)])
def test_a_sensor_that_shows_a_constant_is_named_with_it(seed: int, tmp_path: Path) -> None:
    """It passed for forces, and nothing but k spoke of it."""
    [one] = told(tmp_path, seed, shift=1.0)
    assert one.text.startswith(SHIFT)
    assert "known.wrist.tare" in one.text
    assert one.value == pytest.approx(float(np.linalg.norm(CLEAR[:3])), rel=0.1)


@pytest.mark.parametrize("seed", [1, *further(2)])
@pytest.mark.parametrize(
    ("order", "axes", "said"),
    [
        ("021354", "frame", "forces and moments (x, z, y)"),
        ("012543", "frame", "wrist with moments (z, "),
        *further(("012345", "world", 'in axes = "frame"'), ("102345", "frame", "forces (y, x, z)")),
    ],
)
def test_sensors_of_other_axes_or_columns_are_told(order: str, axes: str, said: str, seed: int, tmp_path: Path) -> None:
    """Another size of it was named, single efforts that would be reversed, or nothing."""
    [one] = told(tmp_path, seed, order=order, axes=axes)
    assert said in one.text


def test_so_is_one_of_forces_on_the_sensor_and_of_a_world_with_z_down(tmp_path: Path) -> None:
    """Whose sign and turn the map knows."""
    [one] = told(tmp_path, 1, -1.0, order="102345", sign=-1)
    assert "forces (y, x, z)" in one.text
    [one] = told(tmp_path, 1, -1.0, shift=1.0, sign=-1)
    numbers = [float(number) for number in one.text.partition("(")[2].partition(")")[0].split(", ")]
    np.testing.assert_allclose(numbers, CLEAR[:3], rtol=0.2)
    [one] = told(tmp_path, 1, axes="world", down=True)
    assert 'in axes = "frame"' in one.text


@pytest.mark.parametrize("seed", [1, *further(2, 3)])
def test_of_a_sensor_that_is_right_nothing_is_said(seed: int, tmp_path: Path) -> None:
    assert told(tmp_path, seed) == []


def test_what_ankles_sensors_show_of_nothing_is_named(tmp_path: Path) -> None:
    """A humanoid leans from sole to sole, a hand is pulled: no hip counts from another zero, no sensor is wrong."""
    robot, rng, time = load_robot("icub_reduced"), np.random.default_rng(3), np.arange(0.0, 5.0, 1.0 / RATE)
    model, data, n = robot.model, robot.model.createData(), len(robot.joints)
    pace, phase, size = rng.uniform(0.6, 3.0, n), rng.uniform(0.0, 6.0, n), 0.15
    hand, *soles = (model.getFrameId(name) for name in ("r_hand", *SOLES))
    states, efforts, wrenches = [], [], np.zeros((len(time), 2, 6))
    for k, now in enumerate(time):
        q, v, a = pin.neutral(model), np.zeros(model.nv), np.zeros(model.nv)
        angle = pace * now + phase
        q[7:], v[6:], a[6:] = size * np.sin(angle), size * pace * np.cos(angle), -size * pace**2 * np.sin(angle)
        tau = pin.rnea(model, data, q, v, a)
        pin.computeJointJacobians(model, data, q)
        pin.updateFramePlacements(model, data)
        J = [pin.getFrameJacobian(model, data, frame, pin.LOCAL) for frame in (hand, *soles)]
        tau -= J[0][:3].T @ (np.array([30.0, -20.0, 10.0]) * (3.0 < now < 4.5))
        base, left = tau[:6].copy(), 0.5 + 0.3 * np.sin(2.0 * now)
        for sole, share in enumerate((left, 1.0 - left)):
            wrenches[k, sole] = np.linalg.solve(J[1 + sole][:, :6].T, share * base)
            tau -= J[1 + sole].T @ wrenches[k, sole]
        states.append(np.concatenate([q, v]))
        efforts.append(tau)
    table = log_of(robot, time, np.array(states), np.repeat(efforts, STEPS, axis=0), rng)
    chosen = map_of("icub_reduced", robot, "r_hand") | {"known": {}}
    columns = [f"{name}_{k}" for name in SOLES for k in range(6)]
    noise = rng.standard_normal((2, len(time), 6)) * [0.5, 0.5, 1.0, 0.03, 0.03, 0.03]
    table[columns] = np.concatenate([*(wrenches.transpose(1, 0, 2) + noise)], axis=1)
    for name in SOLES:
        chosen["known"][name] = {"columns": [f"{name}_{k}" for k in range(6)], "unit": "N", "frame": name}
    told = []
    for of_nothing in (np.zeros(12), [5.0, 3.0, 15.0, 1.0, 1.0, 0.0, -4.0, 8.0, -2.0, 0.0, -1.0, 0.5]):  # [N, N m]
        table[columns] += of_nothing
        findings = estimate(recorded(tmp_path / "log.csv", chosen, table=table), ["force_level"]).findings
        told.append([one for one in findings if one.warns])
    right, both = told
    assert right == []
    assert [one.text.partition(" ")[0] for one in both] == ["known.l_sole", "known.r_sole"]
    assert [one.value for one in both] == pytest.approx([259.0**0.5, 84.0**0.5], rel=0.2)


def test_a_known_force_that_counts_the_other_way_is_told_so(tmp_path: Path) -> None:
    """Of a body on a load cell that shows what presses on it: the attitude was said to be misread."""
    time, rng = np.arange(400) / 100.0, np.random.default_rng(1)
    columns = {"t": time, **{name: 1e-4 * rng.standard_normal(400) for name in ("x", "y", "z", "qx", "qy", "qz", "e")}}
    columns |= {"qw": np.ones(400), "fx": columns["x"], "fy": columns["y"], "fz": -9.81 + columns["z"]}
    rates = {key: {"from": "pose", "window": 0.2} for key in ("velocity", "rate")}
    chosen: dict[str, Any] = {
        "robot": {"body": {"mass": 1.0, "inertia": [0.01, 0.01, 0.01]}, "points": ["body"]},
        "log": {"time": {"column": "t"}},
        "base": by_axis(position="{}", quaternion="q{}") | rates,
        "known": {"cell": {"columns": ["fx", "fy", "fz"], "unit": "N", "frame": "body", "axes": "world"}},
    }
    record = recorded(tmp_path / "log.csv", chosen, table=pd.DataFrame(columns))
    with pytest.raises(LogError, match=r"counts the other way \(its sign\)"):
        estimate(record, ["force_level"])


@pytest.mark.parametrize("axes", ["frame", "world"])
def test_a_known_force_in_its_other_axes_is_told_so(axes: str, tmp_path: Path) -> None:
    """Thrust that carries a body explains most of its motion in either axes: 15 N were told where nothing pushed."""
    time, rng = np.arange(2000) / 100.0, np.random.default_rng(1)
    paces, sizes = np.array([1.7, 2.1, 1.3]), np.array([1.0, 0.8, 0.5])
    place, speed, bends = sines(time, sizes, paces, 0.0)
    turns = [pin.rpy.rpyToMatrix(0.2 * np.sin(0.6 * t), 0.15 * np.sin(0.8 * t), 2.8 * np.sin(0.3 * t)) for t in time]
    thrust = 1.5 * (np.array([0.0, 0.0, 9.81]) + bends)
    if axes == "frame":
        thrust = np.einsum("mji,mj->mi", turns, thrust)
    noise = rng.standard_normal((2000, 9)) * np.repeat([1e-3, 5e-3, 0.03], 3)
    noisy = np.hstack([place, speed, thrust]) + noise
    table = np.column_stack([time, noisy, [pin.Quaternion(turn).coeffs() for turn in turns]])
    names = ["t", *(f"{part}{axis}" for part in "pvf" for axis in "xyz"), "qx", "qy", "qz", "qw"]
    body = {"mass": 1.5, "inertia": [0.012, 0.012, 0.02]}
    robot = {"body": body, "points": ["body"], "rows": {"ignore": ["base.Mx", "base.My", "base.Mz"]}}
    base = by_axis(position="p{}", velocity="v{}", quaternion="q{}") | {"rate": {"from": "pose", "window": 0.1}}
    for mapped in ("frame", "world"):
        thrust_of = {"columns": ["fx", "fy", "fz"], "unit": "N", "frame": "body", "axes": mapped}
        chosen = {"robot": robot, "base": base, "known": {"thrust": thrust_of}}
        record = recorded(tmp_path / "log.csv", chosen, table=pd.DataFrame(table, columns=names))
        told = estimate(record, ["force_level"])
        named = f'known.thrust in axes = "{axes}" leaves'
        assert any(named in one.text for one in told.findings if one.warns) == (mapped != axes)
