"""A humanoid that stands and is pushed at a hand, by inverse dynamics: its soles hold it by forces and moments."""

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pinocchio as pin
import pytest
from support.recorded import recorded
from support.robot_parts import by_axis, channels

from aerobat_pin.estimation import Result, estimate
from aerobat_pin.numerics import Array
from aerobat_pin.records import load_robot
from aerobat_pin.visualization import draw_estimation

HAND, SOLES = "gripper_right_base_link", ("left_sole_link", "right_sole_link")
PUSH = np.array([10.0, -25.0, 15.0])  # [N], world axes, 3 % of the weight
RATE, DURATION, FROM, TO = 250.0, 5.0, 2.0, 3.5  # [1/s], [s]


@pytest.fixture(scope="module")
def log() -> pd.DataFrame:
    """Return a log: straight legs, arms that swing, efforts wrong by 3 % and with noise; the soles hold the rest up."""
    model, rng = load_robot("talos").model, np.random.default_rng(5)
    data, joints = model.createData(), list(model.names)[2:]
    n = len(joints)
    size = np.where(["arm" in joint for joint in joints], 0.12, 0.03)
    phase, omega = rng.uniform(0.0, 6.28, n), 2.0 * np.pi * rng.uniform(0.2, 0.6, n)
    time, rows = np.arange(0.0, DURATION, 1.0 / RATE), []
    for t in time:
        q, v, a = pin.neutral(model), np.zeros(model.nv), np.zeros(model.nv)
        q[7:] += size * (np.sin(omega * t + phase) - np.sin(phase))
        v[6:], a[6:] = size * omega * np.cos(omega * t + phase), -size * omega**2 * np.sin(omega * t + phase)
        need = pin.rnea(model, data, q, v, a)
        pin.computeJointJacobians(model, data, q)
        pin.updateFramePlacements(model, data)
        J = [pin.getFrameJacobian(model, data, model.getFrameId(name), pin.LOCAL_WORLD_ALIGNED) for name in SOLES]
        hand = pin.getFrameJacobian(model, data, model.getFrameId(HAND), pin.LOCAL_WORLD_ALIGNED)[:3]
        need -= hand.T @ PUSH * (FROM < t < TO)
        held = np.vstack(J).T
        tau = need - held @ np.linalg.lstsq(held[:6], need[:6], rcond=None)[0]
        rows.append(np.concatenate([[t], q[:7], v, q[7:], tau[6:]]))
    table = np.array(rows)
    table[:, 1:8] += 2e-4 * rng.standard_normal((len(time), 7))
    table[:, 8 : 14 + n] += 0.003 * rng.standard_normal((len(time), 6 + n))
    table[:, -n:] *= 1.0 + 0.03 * rng.standard_normal(n)
    table[:, -n:] += 0.3 * rng.standard_normal((len(time), n))
    base = [*"t x y z qx qy qz qw vx vy vz wx wy wz".split()]
    names = [f"{what}_{joint}" for what in ("v", "q", "e") for joint in joints]
    return pd.DataFrame(table, columns=[*base, *names])


def estimated(log: pd.DataFrame, folder: Path, robot: dict[str, Any]) -> Result:
    """Return the estimate of a log by a map."""
    joints = list(load_robot("talos").joints)
    base = by_axis(position="{}", quaternion="q{}", velocity="v{}", rate="w{}")
    base["velocity"]["axes"] = "body"
    values = {
        "robot": {"name": "talos", **robot},
        "log": {"time": {"column": "t"}},
        "base": base,
        "joints": {"names": joints, **channels(joints, position="q_{}", velocity="v_{}", effort="e_{}")},
        "observer": {"names": ["force_level"], "gain": 100},
    }
    return estimate(recorded(folder / "log.csv", values, table=log))


def hand_of(found: Result) -> tuple[Array, Array, Array]:
    """Return estimate, deviation and true force (m, 3) [N] at the hand, settled."""
    whole = found.estimates["force_level"]
    middle = 0.5 * (whole.time[1:] + whole.time[:-1])
    true = PUSH * ((middle > FROM + 0.1) & (middle < TO))[:, None]
    good = (middle > 0.2) & ~((middle > FROM - 0.1) & (middle < FROM + 0.1)) & (np.abs(middle - TO) > 0.1)
    return whole.components[good, :3], whole.standard_deviation[good, :3], true[good]


def test_a_push_at_a_hand_is_no_foot_in_the_air(log: pd.DataFrame, tmp_path: Path) -> None:
    """A push smaller than what counts as nothing at a foot stays a push: no factor of the arm's efforts explains it."""
    found = estimated(log, tmp_path, {"points": [HAND], "wrenches": list(SOLES)})
    force, deviation, true = hand_of(found)
    assert np.sqrt(np.mean((force - true) ** 2, axis=0))[:2].max() < 7.0
    assert np.mean(np.abs(force - true) < 2.0 * deviation, axis=0).min() > 0.95
    assert not any("effort times" in fit.values for fit in found.forces.values.fits)
    units = [axis.get_ylabel()[-4:] for axis in draw_estimation(found).axes[:-3] if axis.get_visible()]
    assert units == [" [N]"] * 9 + ["N m]"] * 6  # the hand has no moments


@pytest.mark.evidence  # other tests say so of a walk and of an arm
def test_soles_without_moments_are_wrong_and_straight_legs_show_no_weight(log: pd.DataFrame, tmp_path: Path) -> None:
    """Squared errors of the rows are far larger than stated, which is said; what the legs do not show is not shown."""
    found = estimated(log, tmp_path, {"points": [HAND, *SOLES]})
    force, deviation, true = hand_of(found)
    assert np.mean(np.abs(force - true) < 2.0 * deviation, axis=0).min() > 0.95
    assert "forces elsewhere, a moment, or a wrong model" in found.verdict
    assert np.mean(found.estimates["force_level"].shown[:, [5, 8]], axis=0).max() < 0.1
