"""The zero of a joint that is off is named, with how far; nothing is said of good logs."""

from pathlib import Path

import numpy as np
import pandas as pd
import pinocchio as pin
import pytest
from support.further import further
from support.recorded import edited, recorded
from support.robot_parts import channels, efforts
from support.strange_arm import JOINTS, arm_map, nothing, pushed, write_log

from aerobat_pin.estimation import Result, estimate
from aerobat_pin.records import load_robot


def found(folder: Path, seed: int, rubs: float, joint: int = 0, turn: float = 0.0) -> Result:
    """Estimate a log of a UR5 of which a joint seems to stand farther by a turn [rad]."""
    write_log(folder / "log.csv", seed, pushed if seed % 2 else nothing, rubs=rubs)
    log = pd.read_csv(folder / "log.csv")
    log[f"q{joint}"] += turn
    log.to_csv(folder / "log.csv", index=False)
    return estimate(recorded(folder / "log.csv", edited(arm_map(["tool0"]), {"check": None})), ["force_level"])


@pytest.mark.parametrize(
    ("seed", "rubs", "joint", "turn"), [(13, 0.3, 1, 0.1), (99, 1.0, 2, -0.15), *further((14, 0.0, 2, -0.1))]
)
def test_a_zero_that_is_off_is_named(tmp_path: Path, seed: int, rubs: float, joint: int, turn: float) -> None:
    """Within a fifth, beside friction that nobody knows and a push of 20 N; the verdict doubts the record."""
    result = found(tmp_path, seed, rubs, joint, turn)
    [told] = [one for one in result.findings if one.check in {"joint zero", "mounting"}]
    assert told.text.startswith(JOINTS[joint])
    assert told.value == pytest.approx(-turn, rel=0.2)
    assert "joint zero" in result.verdict


@pytest.mark.parametrize(("seed", "rubs"), [(3, 1.0), (5, 0.0)])
def test_nothing_is_said_of_a_good_log(tmp_path: Path, seed: int, rubs: float) -> None:
    """Nor of a push elsewhere, as its joints stop all at once and stick; nor of efforts that hold as it stands."""
    told = {one.check for one in found(tmp_path, seed, rubs).findings if one.warns}
    assert not told & {"joint zero", "mounting", "push elsewhere", "held channel"}


def test_what_is_lifted_for_a_while_is_no_zero(tmp_path: Path) -> None:
    """Of the fifth joint it was said that another zero left 1.6 %, as mapped 1.6 %."""
    model, rng, time = load_robot("kinova").model, np.random.default_rng(7), np.arange(3001) / 100.0
    low, high, names = model.lowerPositionLimit, model.upperPositionLimit, list(model.names)[1:]
    centre = np.clip((low + high) / 2.0, -2.0, 2.0) + rng.uniform(-0.3, 0.3, 6)
    omega = 2.0 * np.pi * rng.uniform(0.08, 0.4, (4, 6))
    angle = omega * time[:, None, None] + rng.uniform(0.0, 2.0 * np.pi, (4, 6))
    size = np.minimum(0.7, 0.35 * (high - low)) * rng.uniform(0.3, 1.0, (4, 6)) * 0.4
    q = centre + np.sum(size * np.sin(angle), axis=1)
    v = np.sum(size * omega * np.cos(angle), axis=1)
    a = np.sum(-size * omega**2 * np.sin(angle), axis=1)
    held = model.copy()
    at = held.frames[held.getFrameId("j2s6s200_end_effector")]
    load = pin.Inertia(0.58, at.placement.act(np.array([0.0, 0.0, 0.1])), np.zeros((3, 3)))
    held.appendBodyToJoint(at.parentJoint, load, pin.SE3.Identity())
    free, lifting = (efforts(each, at.name, q, v, a, np.zeros((len(q), 3))) for each in (model, held))
    tau = np.where(((time > 10.0) & (time < 20.0))[:, None], lifting, free)
    rubs = np.array([0.03, 2.04, 0.82, 0.19, 0.19, 0.03])  # [N m], and per rad/s
    tau += rubs * (np.tanh(v / 0.01) + v) + 0.005 * np.abs(tau).max(axis=0) * rng.standard_normal(tau.shape)
    q, v = q + 1e-5 * rng.standard_normal(q.shape), v + 1e-3 * rng.standard_normal(v.shape)
    columns = {f"{part}{k}": values[:, k] for part, values in (("q", q), ("v", v), ("e", tau)) for k in range(6)}
    pd.DataFrame({"t": time} | columns).to_csv(tmp_path / "log.csv", index=False)
    chosen = {
        "robot": {"name": "kinova", "points": [at.name]},
        "log": {"time": {"column": "t", "unit": "s"}},
        "joints": {"names": names, **channels(range(6), position="q{}", velocity="v{}", effort="e{}")},
        "observer": {"gain": 20.0},
    }
    told = estimate(recorded(tmp_path / "log.csv", chosen), ["force_level"]).findings
    assert "joint zero" not in {one.check for one in told if one.warns}
