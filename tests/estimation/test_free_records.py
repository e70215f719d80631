"""A record to calibrate by is taken as free: what pushed in it all the same is found, or said to be untellable."""

import re
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import tomli_w
from support.recorded import edited, recorded
from support.six_joints import six_map, swing
from support.strange_arm import JOINTS, URDF, arm_map, nothing, pushed, write_log
from support.swinging_arm import arm, recording
from support.swinging_arm import arm_map as short_arm_map

from aerobat_pin import open_record
from aerobat_pin.errors import CalibrationError
from aerobat_pin.estimation import calibrate, estimate
from aerobat_pin.records import parse_map

HOSE = np.array([0.0, 0.0, -20.0])
PULLED = r"something pushed at tool0.* (19|2[012])(\.\d)? N"


def lasting(time: np.ndarray) -> np.ndarray:
    """Return the pull (n, 3) of a hose [N]."""
    return np.tile(HOSE, (len(time), 1))


def for_a_while(time: np.ndarray) -> np.ndarray:
    """Return the same pull (n, 3) [N], from 12 to 17 s."""
    return np.where(((time > 12.0) & (time < 17.0))[:, None], HOSE, 0.0)


@pytest.mark.skipif(not URDF.is_file(), reason="pip install 'aerobat-pinocchio[robots]' brings the UR5")
def test_a_pull_is_not_learnt_as_friction(tmp_path: Path) -> None:
    """A hose of 20 N at the tool, all the time or for 5 s: offsets of the joints explain it worse; free it is taken."""
    chosen = arm_map(["tool0"], friction=True)
    for name, force in (("free", nothing), ("always", lasting), ("hose", for_a_while)):
        write_log(tmp_path / f"{name}.csv", 211, force, pace=1.6)
    assert not any("pushed" in line for line in calibrate([recorded(tmp_path / "free.csv", chosen)]).warnings)
    with pytest.raises(CalibrationError, match=rf"{PULLED} .*--trust"):
        calibrate([recorded(tmp_path / "always.csv", chosen)])
    trusted = calibrate([recorded(tmp_path / "hose.csv", chosen)], trust=True)
    assert any(re.search(PULLED, line) for line in trusted.warnings)


@pytest.mark.skipif(not URDF.is_file(), reason="pip install 'aerobat-pinocchio[robots]' brings the UR5")
def test_a_pull_is_not_normal_where_no_joint_rubs(tmp_path: Path) -> None:
    """Without friction to learn it was taken for what rows err by: 19 N at a hand for one second in eight."""
    write_log(tmp_path / "free.csv", 211, nothing, pace=1.6, rubs=0.0)
    write_log(tmp_path / "hose.csv", 211, for_a_while, pace=1.6, rubs=0.0)
    chosen = edited(arm_map(["tool0"]), {"check": None})
    free, hose = (recorded(tmp_path / f"{name}.csv", chosen) for name in ("free", "hose"))
    assert calibrate([free]).warnings == ()
    unsought = recorded(tmp_path / "free.csv", edited(chosen, {"robot.points": []}))
    assert not any("learnt as friction" in line for line in calibrate([unsought]).warnings)
    with pytest.raises(CalibrationError, match=rf"{PULLED} .*--trust"):
        calibrate([hose])


@pytest.mark.skipif(not URDF.is_file(), reason="pip install 'aerobat-pinocchio[robots]' brings the UR5")
def test_noise_of_velocities_is_no_push(tmp_path: Path) -> None:
    """It is in all rows at once, through the inertia, as a force is: of 12 free swings 7 were refused."""
    write_log(tmp_path / "free.csv", 213, nothing, pace=1.6, rubs=0.2)
    table, rng = pd.read_csv(tmp_path / "free.csv"), np.random.default_rng(1)
    table[[f"v{k}" for k in range(6)]] += 0.02 * rng.standard_normal((len(table), 6))
    table.to_csv(tmp_path / "free.csv", index=False)
    chosen = edited(arm_map(["tool0"], friction=True), {"observer.gain": 100.0})
    assert not any("pushed" in line for line in calibrate([recorded(tmp_path / "free.csv", chosen)]).warnings)


def test_what_turns_rotors_is_no_push(tmp_path: Path) -> None:
    """Rotors that no file knows need torques of their own: of an arm that nobody touched they were a push of 36 N."""
    swing(tmp_path / "free.csv", 1, rotors=0.3)
    chosen = six_map(log={"time": {"column": "t"}}, observer={"gain": 20.0})
    free = recorded(tmp_path / "free.csv", edited(chosen, {"joints.friction": None}))
    assert not any("pushed" in line for line in calibrate([free]).warnings)


def test_an_arm_without_a_row_to_spare_says_that_it_cannot_tell(tmp_path: Path) -> None:
    """Three joints, and a force of three components: friction with offsets explains any pull that lasts."""
    (tmp_path / "arm.urdf").write_text(arm())
    (tmp_path / "map.toml").write_text(tomli_w.dumps(short_arm_map()))
    recording(tmp_path, "free", pushed=False, seed=1)
    warnings = calibrate([open_record(tmp_path / "free.csv", tmp_path / "map.toml")]).warnings
    assert [line for line in warnings if "no row is to spare" in line and "make sure that nothing pushed" in line]


@pytest.mark.skipif(not URDF.is_file(), reason="pip install 'aerobat-pinocchio[robots]' brings the UR5")
def test_friction_that_a_calibration_did_not_see_is_found_as_without_one(tmp_path: Path) -> None:
    """Only the wrist moved: as zero, friction of the others made Fy of a pushed record 8 N wrong, with +-2 N."""
    write_log(tmp_path / "wrist.csv", 221, nothing, pace=1.6, still=3)
    moved = write_log(tmp_path / "push.csv", 222, pushed, pace=1.6)
    chosen = parse_map(arm_map(["tool0"], friction=True), "of the test")
    learnt = calibrate([recorded(tmp_path / "wrist.csv", chosen)])
    assert learnt.fitted.joints == tuple(JOINTS[3:])
    result = estimate(recorded(tmp_path / "push.csv", chosen), calibration=learnt)
    found, truth = result.estimates["force_level"], 0.5 * (moved[1:] + moved[:-1])
    inside = np.abs(found.components - truth) < 2.0 * found.standard_deviation
    assert inside[found.shown].mean() > 0.95
    assert result.model.verdict == "unverified"
    assert any("did not show friction of shoulder_pan_joint" in line for line in result.warnings)
