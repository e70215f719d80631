"""A walking robot whose legs are misread: in another order, the other way round, or from another zero."""

import importlib
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pandas as pd
import pinocchio as pin
import pytest
from scipy.spatial.transform import Rotation
from support import robot_parts as made
from support.further import further
from support.recorded import recorded
from support.walking_log import LEGS, table, table_map, urdf, walk

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
    for joint in JOINTS:
        q, v, tau = (log[f"{joint}_{column}"] for column in COLUMNS)
        size = np.sqrt(np.mean(tau**2))
        log[f"{joint}_tau"] = tau + size * (0.2 * np.tanh(v / 0.05) + 0.01 * rng.standard_normal(len(log)))
        log[f"{joint}_pos"] = q + 1e-4 * rng.standard_normal(len(log))
        log[f"{joint}_vel"] = v + 5e-3 * rng.standard_normal(len(log))
    return log


def legs(*order: str) -> dict[str, str]:
    """Return whose columns each joint has, of legs in another order."""
    return dict(zip(JOINTS, (f"{leg}_{place}" for leg in order for place in PLACES), strict=True))


def of_legs(place: str) -> list[str]:
    """Return the joints at a place, of all legs."""
    return [f"{leg}_{place}" for leg in LEGS]


RIGHT = [f"{leg}_{place}" for leg in ("FR", "RR") for place in ("HFE", "KFE")]
WITHIN = {joint: joint.replace("HAA", "x").replace("HFE", "HAA").replace("x", "HFE") for joint in JOINTS}
LAST_FIRST = dict(zip(JOINTS, (f"{leg}_{place}" for leg in LEGS for place in PLACES[::-1]), strict=True))
BY_PLACE = dict(zip(JOINTS, (f"{leg}_{place}" for place in PLACES for leg in LEGS), strict=True))
ORDERS = ("FR FL RL RR", "RL RR FL FR", "FR RR FL RL", "RR FR RL FL", "FL FR RR RL")
ZEROS = (("RR_HFE", 10.0), ("FL_HFE", 45.0), ("FL_HAA", 20.0), ("FL_HAA", 10.0), ("RL_KFE", -90.0))
MISTAKES = [  # whose columns joints have; joints that turn the other way; where joints stand, when they say 0 [deg]
    ("order", legs("FR", "FL", "RR", "RL"), [], {}),
    ("sense", {}, RIGHT, {}),
    ("zero", {}, [], dict.fromkeys(of_legs("KFE"), 90.0)),
    ("sense", {}, ["RL_HAA", "RR_HAA"], {}),  # one effort that is reversed leaves nearly as little
    ("zero", {}, [], {"RL_KFE": -10.0}),  # that leaves 6 %
    *further(
        *(("order", legs(*order.split()), [], {}) for order in ORDERS),
        *(
            ("order", order, [], {})
            for order in (BY_PLACE, WITHIN, {one: WITHIN[one] for one in JOINTS[:3]}, LAST_FIRST)
        ),
        *(("sense", {}, [joint], {}) for joint in ("RR_HFE", "FL_KFE", "RR_HAA")),
        ("sense", {}, ["FR_HAA", "RR_HAA"], {}),
        *(("sense", {}, of_legs(place), {}) for place in PLACES),
        ("sense", {}, JOINTS, {}),
        *(("zero", {}, [], {joint: angle}) for joint, angle in ZEROS),
        *(("zero", {}, [], dict.fromkeys(of_legs("HFE"), angle)) for angle in (45.0, -10.0, 180.0)),
    ),
]


def misread(log: pd.DataFrame, order: dict[str, str], senses: list[str], zeros: dict[str, float]) -> pd.DataFrame:
    """Return a log with these mistakes."""
    wrong = log.copy()
    for joint, other in order.items():
        wrong[[f"{joint}_{column}" for column in COLUMNS]] = log[[f"{other}_{column}" for column in COLUMNS]]
    for joint in senses:
        wrong[[f"{joint}_{column}" for column in COLUMNS]] *= -1.0
    for joint, zero in zeros.items():
        wrong[f"{joint}_pos"] -= np.radians(zero)
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
    named = {joint for joint in JOINTS if joint in said.text.partition(", which leaves")[0]}
    assert named == {joint for joint, other in order.items() if joint != other} | {*senses, *zeros}
    keys = {"sense": dict.fromkeys(senses, -1.0), "zero": {joint: np.radians(zero) for joint, zero in zeros.items()}}
    for joint, value in keys.get(kind, {}).items():
        told = float(said.text.partition(f"{joint} = ")[2].partition(",")[0].rstrip("}"))
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
    log[[f"{joint}_tau" for joint in JOINTS]] *= factor
    [said] = warned(log, of_walk(tmp_path), tmp_path)
    assert said.check == "effort unit or mass"
    assert said.value == pytest.approx(1.0 / factor, rel=0.05)


@pytest.mark.evidence
@pytest.mark.parametrize(
    ("gait", "base", "least"), [("TROT", "imu", 27), ("WALK", "measured", 27), ("FAST_TROT", "measured", 26)]
)
def test_a_go2_that_mujoco_moves_is_read_right(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, gait: str, base: str, least: int
) -> None:
    """Another writer, robot and friction: how many of the same mistakes are named; of the good log nothing is said."""
    monkeypatch.syspath_prepend(Path(__file__).parents[2] / "benchmarks")
    legs, trot = (importlib.import_module(name) for name in ("legs", "trot"))
    values, log = legs.mapped(base, 200.0), legs.sensed(trot.walked(getattr(trot, gait), 9.0), 5)
    places = dict(zip(PLACES, ("hip_joint", "thigh_joint", "calf_joint"), strict=True))
    names = dict(zip(JOINTS, values["joints"]["names"], strict=True))
    assert [f"{joint[:2]}_{places[joint[3:]]}" for joint in JOINTS] == list(names.values())
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
        made.link("torso", 0.42, "0.01 0 -0.01", (9e-4, 2.2e-3, 2.4e-3)),
        made.link("stand"),
        made.joint("s", "fixed", "torso", "stand"),
    ]
    for name, side in (("left", 1), ("right", -1)):
        parts += [made.link(name, 0.035, f"-0.02 {0.16 * side} 0", (4.2e-4, 6e-5, 4.7e-4)), made.link(f"{name}_tip")]
        parts += [made.joint(f"{name}_root", "revolute", "torso", name, f"0.03 {0.03 * side} 0.02", "1 0 0")]
        parts += [made.joint(f"{name}_end", "fixed", name, f"{name}_tip", f"-0.02 {0.25 * side} 0")]
    parts += [
        made.link("tail", 0.02, "-0.06 0 0", (2e-5, 4e-5, 5e-5)),
        made.joint("tail_root", "revolute", "torso", "tail", "-0.15 0 0"),
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
    columns = {"t": time} | dict(zip(names.split(), np.hstack([q[:, :7], v[:, :6], tau[:, :6]]).T, strict=True))
    for k, name in enumerate(joints):
        columns |= {f"{name}_q": angles[:, k], f"{name}_v": v[:, 6 + k], f"{name}_e": tau[:, 6 + k]}
    chosen = {
        "robot": {"urdf": "bird.urdf", "root": "free_flyer", "points": ["left_tip", "right_tip"]},
        "log": {"time": {"column": "t"}},
        "base": made.channels("xyz", position="{}", velocity="v{}", rate="w{}")
        | made.channels("xyzw", quaternion="q{}"),
        "joints": {"names": joints, **made.channels(joints, position="{}_q", velocity="{}_v", effort="{}_e")},
        "known": {"stand": {"columns": ["fx", "fy", "fz", "mx", "my", "mz"], "frame": "stand", "axes": "frame"}},
        "observer": {"gain": 200},
    }
    chosen["base"]["velocity"]["axes"] = "body"
    assert warned(pd.DataFrame(columns), chosen, tmp_path) == []


def test_a_reading_by_which_a_joint_would_be_beyond_its_limits_is_none() -> None:
    """A waist that turns by 1 rad was told to stand 62 deg farther, where a knee beside it did by 17."""
    robot = load_robot("panda")
    record = cast(Record, SimpleNamespace(robot=robot, driven=robot.joints))
    mapped, q = JointReading.as_mapped(record), np.array([[0.0, 0.0, 0.0, -1.5, 0.0, 1.5, 0.0, 0.02, 0.02]])
    elbow = robot.joints.index("panda_joint4")  # from -3.07 to -0.07 rad
    turned = [mapped.otherwise([elbow], turn) for turn in (1.4, 1.45, 1.6, -1.6, 4.0)]
    assert possible_readings(record, q, turned) == [True, True, False, True, False]
    on = q - 2.0 * np.pi * np.eye(robot.model.nq)[3]  # its columns are a whole turn off
    assert possible_readings(record, on, turned) == [True, True, False, True, False]
    assert possible_readings(record, q, [mapped.otherwise([7], sense=-1.0)]) == [False], "a finger opens by 40 mm"
    away = q + np.eye(robot.model.nq)[3] * 2.0  # it is beyond them as mapped
    assert possible_readings(record, away, [mapped, mapped.otherwise([elbow], 1.0)]) == [True, False]
