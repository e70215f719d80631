"""Robots by their names: a push at the last link is found as exactly as the estimate says."""

from pathlib import Path

import numpy as np
import pytest
from support.further import further
from support.pushed_robots import EDGES, GAIN, RATE, pushed_robot

from aerobat_pin import estimate
from aerobat_pin.estimation.checks.result import _reason


@pytest.mark.parametrize(
    "name", ["kinova", "bolt", "hector", *further("ur10", "finger_edu", "borinot", "solo12", "b1_z1", "baxter")]
)
def test_a_push_is_found_as_exactly_as_is_said(name: str, tmp_path: Path) -> None:
    """Wrong factors, friction and noise, none of them told: nine tenths within two deviations, where it is shown."""
    log = pushed_robot(name, seed=1)
    found = estimate(log.record(tmp_path)).estimates["force_level"]
    middle = 0.5 * (found.time[1:] + found.time[:-1])
    good = (middle > 0.15) & (np.abs(middle[:, None] - EDGES).min(axis=1) > 6.0 / GAIN)
    error, shown = (found.components - log.true(middle))[good], found.shown[good]
    assert shown.any()
    assert np.mean((np.abs(error) < 2.0 * found.standard_deviation[good])[shown]) > 0.9
    assert np.sqrt(np.mean(error[shown] ** 2)) < 0.05 * log.weight


@pytest.mark.parametrize("seed", [11, *further(12, 13, 14, 15)])
def test_nothing_carries_a_robot_that_falls(seed: int, tmp_path: Path) -> None:
    """Its weight was expected, which doubted the record; still, if its height does not say that it falls."""
    log = pushed_robot("bolt", seed)
    (told,) = (one for one in estimate(log.record(tmp_path)).findings if one.check == "mean force")
    assert told.verdict == "note"
    assert ": it falls, by 2" in told.text  # 9.81 m/s2 for 2.4 s are 28 m, but it was thrown, too
    log.table["z"] = 1.0
    assert any("the weight was expected" in one.text for one in estimate(log.record(tmp_path), trust=True).findings)


@pytest.mark.parametrize("name", ["xarm7", *further("panda")])
def test_what_a_fast_filter_lets_through_is_part_of_the_deviation(name: str, tmp_path: Path) -> None:
    """K dt = 2: noise of one rate errs in the rows of all that its joint loads, as forces do; 46 % were within two."""
    log = pushed_robot(name)
    log.chosen["observer"] = {"gain": 2.0 * RATE}
    found = estimate(log.record(tmp_path)).estimates["force_level"]
    middle = 0.5 * (found.time[1:] + found.time[:-1])
    good = found.shown & (middle > 0.15)[:, None]
    assert np.mean((np.abs(found.components - log.true(middle)) < 2.0 * found.standard_deviation)[good]) > 0.95


@pytest.mark.parametrize(("name", "seed"), [("ur5", 49), *further(("z1", 43), ("talos_arm", 46), ("tiago", 57))])
def test_what_motors_differ_by_is_no_wrong_unit(name: str, seed: int, tmp_path: Path) -> None:
    """Efforts 2 % off and friction of 3 % were told as a unit of one, which would be 1.11 to 1.2 times as large."""
    found = estimate(pushed_robot(name, seed).record(tmp_path))
    assert [one.text for one in found.findings if one.warns and one.check.startswith("effort")] == []


def test_no_pose_of_a_flying_body_hides_a_force(tmp_path: Path) -> None:
    """A drone without a joint was told that a force along an axis hardly turns a joint."""
    log = pushed_robot("iris")
    record = log.record(tmp_path)
    stored = estimate(record).stored["force_level"]
    said = {_reason(record, stored, len(stored) // 2, component) for component in range(3)}
    assert said == {"the rows that show it err too much there"}


def test_a_push_that_lasts_where_no_force_is_sought_is_said(tmp_path: Path) -> None:
    """A third of the time 0.27 weights at the trunk of a falling quadruped, of which one foot is listed."""
    log = pushed_robot("go2", seed=1)
    log.chosen["robot"]["points"] = ["FL_foot"]
    found = estimate(log.record(tmp_path))
    assert any(one.check == "push elsewhere" for one in found.findings), found.warnings
    assert "doubts the record" in found.verdict
    assert "push elsewhere" in found.verdict
