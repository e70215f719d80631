"""What may be wrong with a force that the map knows: a sensor in the wrist of an arm, a load cell."""

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pinocchio as pin
import pytest
from support.further import further
from support.pushed_robots import RATE, STEPS, log_of, map_of
from support.recorded import recorded
from support.robot_parts import channels, efforts
from support.six_joints import SIX, six_joints

from aerobat_pin.errors import LogError
from aerobat_pin.estimation import Finding, estimate
from aerobat_pin.records import load_robot

CLEAR = np.array([5.0, -4.0, 12.0, 0.5, 0.3, 0.1])  # [N, N m] that a sensor shows of nothing
SOLES = ("l_sole", "r_sole")
TIMES, SHIFT = "known.wrist would have to be", "known.wrist seems to show"


def told(
    folder: Path, seed: int, factor: float = 1.0, shift: float = 0.0, order: str = "012345", **section: Any
) -> list[Finding]:
    """Return what is warned of an arm whose wrist's sensor shows multiples of the wrench, in an order, plus offset."""
    # It holds 1 kg beside the wrist, something pushes it, and for two seconds its elbow; all joints rub.
    (folder / "six.urdf").write_text(six_joints())
    model, rng, time = pin.buildModelFromXML(six_joints()), np.random.default_rng(seed), np.arange(2000) / 100.0
    pace, phase = rng.uniform(0.6, 2.2, (2, 6)), rng.uniform(0.0, 6.0, (2, 6))
    angle, size = pace[:, None] * time[:, None] + phase[:, None], 0.5
    q = np.array([0.0, 0.6, 0.9, -0.5, 0.4, 0.0]) + np.sum(size * np.sin(angle), axis=0)
    v = np.sum(size * pace[:, None] * np.cos(angle), axis=0)
    a = np.sum(-size * pace[:, None] ** 2 * np.sin(angle), axis=0)
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
    columns = {"t": time} | {f"w{k}": shown[:, k] for k in range(6)}
    for k, name in enumerate(SIX):
        columns |= {f"{name}_q": q[:, k], f"{name}_v": v[:, k], f"{name}_tau": tau[:, k]}
    pd.DataFrame(columns).to_csv(folder / "log.csv", index=False)
    chosen: dict[str, Any] = {
        "robot": {"urdf": str(folder / "six.urdf"), "root": "fixed", "points": ["elbow_link"]},
        "log": {"time": {"column": "t", "unit": "s"}, "world": "ned" if section.pop("down", False) else "z_up"},
        "joints": {"names": list(SIX), **channels(SIX, position="{}_q", velocity="{}_v", effort="{}_tau")},
        "known": {"wrist": {"columns": [f"w{k}" for k in order], "unit": "N", "frame": "tool", **section}},
    }
    found = estimate(recorded(folder / "log.csv", chosen), ["force_level"]).findings
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
    pd.DataFrame(columns).to_csv(tmp_path / "log.csv", index=False)
    chosen: dict[str, Any] = {
        "robot": {"body": {"mass": 1.0, "inertia": [0.01, 0.01, 0.01]}, "points": ["body"]},
        "log": {"time": {"column": "t", "unit": "s"}},
        "base": {
            "position": {"columns": ["x", "y", "z"], "unit": "m"},
            "quaternion": {"columns": ["qx", "qy", "qz", "qw"]},
            "velocity": {"from": "pose", "window": 0.2},
            "rate": {"from": "pose", "window": 0.2},
        },
        "known": {"cell": {"columns": ["fx", "fy", "fz"], "unit": "N", "frame": "body", "axes": "world"}},
    }
    with pytest.raises(LogError, match=r"counts the other way \(its sign\)"):
        estimate(recorded(tmp_path / "log.csv", chosen), ["force_level"])


@pytest.mark.parametrize("axes", ["frame", "world"])
def test_a_known_force_in_its_other_axes_is_told_so(axes: str, tmp_path: Path) -> None:
    """Thrust that carries a body explains most of its motion in either axes: 15 N were told where nothing pushed."""
    time, rng = np.arange(2000) / 100.0, np.random.default_rng(1)
    paces, sizes = np.array([1.7, 2.1, 1.3]), np.array([1.0, 0.8, 0.5])
    angle = np.outer(time, paces)
    turns = [pin.rpy.rpyToMatrix(0.2 * np.sin(0.6 * t), 0.15 * np.sin(0.8 * t), 2.8 * np.sin(0.3 * t)) for t in time]
    thrust = 1.5 * (np.array([0.0, 0.0, 9.81]) - sizes * paces**2 * np.sin(angle))
    if axes == "frame":
        thrust = np.einsum("mji,mj->mi", turns, thrust)
    noise = rng.standard_normal((2000, 9)) * np.repeat([1e-3, 5e-3, 0.03], 3)
    parts = [sizes * np.sin(angle), sizes * paces * np.cos(angle), thrust]
    table = np.column_stack([time, np.hstack(parts) + noise, [pin.Quaternion(turn).coeffs() for turn in turns]])
    names = ["t", *(f"{part}{axis}" for part in "pvf" for axis in "xyz"), "qx", "qy", "qz", "qw"]
    pd.DataFrame(table, columns=names).to_csv(tmp_path / "log.csv", index=False)
    body = {"mass": 1.5, "inertia": [0.012, 0.012, 0.02]}
    chosen: dict[str, Any] = {
        "robot": {"body": body, "points": ["body"], "rows": {"ignore": ["base.Mx", "base.My", "base.Mz"]}},
        "base": {
            **{key: {"columns": [f"{key[0]}{axis}" for axis in "xyz"]} for key in ("position", "velocity")},
            "quaternion": {"columns": ["qx", "qy", "qz", "qw"]},
            "rate": {"from": "pose", "window": 0.1},
        },
    }
    for mapped in ("frame", "world"):
        thrust_of = {"columns": ["fx", "fy", "fz"], "unit": "N", "frame": "body", "axes": mapped}
        told = estimate(recorded(tmp_path / "log.csv", {**chosen, "known": {"thrust": thrust_of}}), ["force_level"])
        named = f'known.thrust in axes = "{axes}" leaves'
        assert any(named in one.text for one in told.findings if one.warns) == (mapped != axes)
