"""What may be wrong with a force that the map knows: a sensor in the wrist of an arm, a load cell."""

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pinocchio as pin
import pytest
from support.recorded import recorded
from support.robot_parts import channels, efforts
from support.six_joints import SIX, six_joints

from aerobat_pin.errors import LogError
from aerobat_pin.estimation import Finding, estimate

CLEAR = np.array([5.0, -4.0, 12.0, 0.5, 0.3, 0.1])  # [N, N m] that a sensor shows of nothing
TIMES, SHIFT = "known.wrist would have to be", "known.wrist seems to show"


def told(folder: Path, seed: int, factor: float = 1.0, shift: float = 0.0) -> list[Finding]:
    """Return what is warned of an arm whose wrist's sensor shows so many times the wrench there, and a constant.

    It holds 1 kg beside the wrist, something pushes it, and for two seconds its elbow; all joints rub.
    """
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
        "log": {"time": {"column": "t", "unit": "s"}},
        "joints": {"names": list(SIX), **channels(SIX, position="{}_q", velocity="{}_v", effort="{}_tau")},
        "known": {"wrist": {"columns": [f"w{k}" for k in range(6)], "unit": "N", "frame": "tool"}},
    }
    found = estimate(recorded(folder / "log.csv", chosen), ["force_level"]).findings
    return [one for one in found if one.warns and one.check != "push elsewhere"]


@pytest.mark.parametrize("seed", [1, 2])
@pytest.mark.parametrize("factor", [-1.0, 0.7])
def test_a_sensor_that_shows_a_force_reversed_or_too_small_is_named(seed: int, factor: float, tmp_path: Path) -> None:
    """Of the efforts of single joints it was said that they are reversed, or that their unit is wrong."""
    [one] = told(tmp_path, seed, factor)
    assert one.text.startswith(TIMES)
    assert one.value == pytest.approx(1.0 / factor, rel=0.1)


@pytest.mark.parametrize("seed", [1, 2])
def test_a_sensor_that_shows_a_constant_is_named_with_it(seed: int, tmp_path: Path) -> None:
    """It passed for forces, and nothing but k spoke of it."""
    [one] = told(tmp_path, seed, shift=1.0)
    assert one.text.startswith(SHIFT)
    assert "known.wrist.tare" in one.text
    assert one.value == pytest.approx(float(np.linalg.norm(CLEAR[:3])), rel=0.1)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_of_a_sensor_that_is_right_nothing_is_said(seed: int, tmp_path: Path) -> None:
    assert told(tmp_path, seed) == []


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
