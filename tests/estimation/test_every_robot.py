"""Robots of every kind: features on five sources, robots by their names, a humanoid, a robot of one's own."""

import importlib
from dataclasses import replace
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pandas as pd
import pinocchio as pin
import pytest
from support import small_recordings
from support.further import further
from support.pushed_robots import EDGES, GAIN, RATE, pushed_robot
from support.recorded import edited, recorded
from support.robot_parts import free_map

from aerobat_pin import calibrate, estimate, load_scenario, open_record
from aerobat_pin.aerobat import AerobatRobot, believed_robot, table_record
from aerobat_pin.errors import CalibrationError, ObserverError
from aerobat_pin.estimation import Calibration, Result
from aerobat_pin.estimation.checks.result import _reason
from aerobat_pin.estimation.checks.untold_forces import usual_beside
from aerobat_pin.experiments import check_record, run
from aerobat_pin.numerics import Array
from aerobat_pin.observers import MomentumObserver
from aerobat_pin.records import Record, load_robot
from aerobat_pin.visualization import draw_estimation

SOURCES = ("Aerobat simulated", "Aerobat's table", "an arm by map", "a quadruped's bag", "a drone by map")
ONE_CONTACT = "a walk has no stretch without contact, and nothing can be learnt from it"
NO_EFFORT = "it measures no effort, so that there is nothing to balance"
NO_SENSOR = "the table has neither a true force nor a force sensor"
NO_PHASE = "it has no phase"
NO_SPARE_ROW = "3 rows have no redundancy for the forces sought"
FIXED = "its base is fixed and its joints have positions alone: no series is measured twice"
NOT: dict[str, dict[str, str]] = {  # feature -> source -> why it has nothing to show there
    "agreements": {SOURCES[2]: FIXED},
    "balance": {SOURCES[4]: NO_EFFORT},
    "redundancy verdict": {SOURCES[2]: NO_SPARE_ROW, SOURCES[4]: NO_SPARE_ROW},
    "scores": {SOURCES[1]: NO_SENSOR, SOURCES[4]: NO_SENSOR},
    "contacts": {SOURCES[3]: ONE_CONTACT},
    "error bar": {SOURCES[3]: ONE_CONTACT},
    "friction": {SOURCES[3]: ONE_CONTACT, SOURCES[4]: "it has no joints"},
    "thrust": dict.fromkeys(SOURCES[:2], "its thrusters' forces are channels")
    | dict.fromkeys(SOURCES[2:4], "it has no commands of thrust"),
    "parameters": {SOURCES[3]: ONE_CONTACT, SOURCES[4]: "its mass is what its thrust is fitted with"},
    "series over a phase": {SOURCES[2]: NO_PHASE, SOURCES[3]: f"{NO_PHASE}, and {ONE_CONTACT}", SOURCES[4]: NO_PHASE},
}


def has(result: Result, learnt: Calibration | None, found_again: list[bool]) -> dict[str, bool]:
    """Return feature -> whether a source has it filled."""
    checks, observers = [finding.check for finding in result.findings], result.observers.values()
    return {
        "agreements": any(" against " in check and not check.startswith(("effort", "sensor")) for check in checks),
        "balance": "effort against motion" in checks,
        "clocks": any(check.startswith("rate of ") for check in checks),
        "redundancy verdict": all(one.redundancy.verdict != "blind" for one in observers),
        "deviations": any(one.deviation is not None for one in observers),
        "contacts": result.calibration is not None and result.calibration.contacts is not None,
        "error bar": learnt is not None and bool(learnt.error_bar),
        "friction": learnt is not None and learnt.fitted.friction is not None,
        "thrust": learnt is not None and bool(learnt.fitted.coefficients),
        "parameters": learnt is not None and (learnt.identified is not None or learnt.fitted.mass != 1.0),
        "series over a phase": learnt is not None and learnt.series is not None,
        "scores": all(result.compared.values()),
        "self-check": bool(found_again) and all(found_again),
    }


@pytest.fixture(scope="module")
def shown(tmp_path_factory: pytest.TempPathFactory) -> dict[str, dict[str, bool]]:
    """Source -> what it has; where something is free, the other record is estimated with what it taught."""
    folder = tmp_path_factory.mktemp("sources")
    for write in (small_recordings.write_arm, small_recordings.write_walk, small_recordings.write_drone):
        write(folder)
    small_recordings.write_hall(folder)
    names = "observers.names=['momentum','kalman']"
    free = load_scenario("paper", ["unknown_force=[]", "simulation.duration=1.0", names])
    robot, section = AerobatRobot.of(believed_robot(free), free.believed_air, "measured"), free.observers
    taught = {"harmonics": 2, "parameters": ["friction", "com_x"]}
    hall = calibrate([table_record(folder / "hall_free.csv", robot, section)], **taught)
    paper = load_scenario("paper", ["simulation.duration=0.5", names])
    flight = run(paper, calibration=hall)
    table = table_record(folder / "hall.csv", robot, section)
    arm_free = open_record(folder / "arm_free.csv", folder / "arm.toml")
    arm = open_record(folder / "arm.csv", folder / "arm_fit.toml")
    swing = calibrate([arm_free], parameters=["mass"])
    walk = open_record(folder / "walk", folder / "walk_bag.toml")
    wind, calm = (open_record(folder / f"{name}.csv", folder / "drone.toml") for name in ("drone_wind", "drone"))
    still = calibrate([calm])
    records = (table, arm, walk, wind)
    results = [
        flight.scores,
        *(estimate(one, (), learnt) for one, learnt in zip(records, (hall, swing, None, still), strict=True)),
    ]
    found = [[one.ok for one in check_record(record)] for record in (results[0].record, *records)]
    gave = zip(SOURCES, results, (hall, hall, swing, None, still), found, strict=True)
    return {name: has(*each) for name, *each in gave}


@pytest.mark.parametrize("source", SOURCES)
def test_a_feature_is_shown_or_does_not_apply(shown: dict[str, dict[str, bool]], source: str) -> None:
    """A reason stands only where there is really nothing."""
    lacking = {feature for feature, there in shown[source].items() if not there}
    assert lacking == {feature for feature, reasons in NOT.items() if source in reasons}


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


@pytest.mark.parametrize("name", ["ur10", *further("ur5", "xarm7")])
def test_an_effort_that_is_off_by_a_constant_is_told(name: str, tmp_path: Path) -> None:
    """By the rms of a joint that bears the arm: it was told as 1.28 and 1.33 times as large efforts of two, or not."""
    log = pushed_robot(name)
    effort = f"{log.robot.joints[1]}_tau"
    off = float(np.sqrt(np.mean(log.table[effort] ** 2)))
    log.table[effort] += off
    [told] = [one for one in estimate(log.record(tmp_path)).findings if one.warns and one.check.startswith("effort")]
    assert told.check == "effort zero"
    assert told.value == pytest.approx(off, rel=0.1)


def test_no_pose_of_a_flying_body_hides_a_force(tmp_path: Path) -> None:
    """A drone without a joint was told that a force along an axis hardly turns a joint."""
    log = pushed_robot("iris")
    record = log.record(tmp_path)
    stored = estimate(record).stored["force_level"]
    said = {_reason(record, stored, len(stored) // 2, component) for component in range(3)}
    assert said == {"the rows that show it err too much there"}


@pytest.mark.parametrize(("lasts", "told"), [(0.0, False), (0.1, False), (0.4, True)])
def test_half_of_what_is_stated_is_enough_for_a_push_that_lasts_alone(lasts: float, told: bool) -> None:
    """Errors whose tail is long reach 0.8 of what is stated beside errors that are usually small: they were a push."""
    lean = np.linspace(0.01, 0.07, 500)
    lean[: round(500 * lasts)] += 0.7
    lean[-1] = 0.8
    assert (usual_beside(0.8, lean, 1.0) is not None) == told


def test_a_push_that_lasts_where_no_force_is_sought_is_said(tmp_path: Path) -> None:
    """A third of the time 0.27 weights at the trunk of a falling quadruped, of which one foot is listed."""
    log = pushed_robot("go2", seed=1)
    log.chosen["robot"]["points"] = ["FL_foot"]
    found = estimate(log.record(tmp_path))
    assert any(one.check == "push elsewhere" for one in found.findings), found.warnings
    assert "doubts the record" in found.verdict
    assert "push elsewhere" in found.verdict


HAND, SOLES = "gripper_right_base_link", ("left_sole_link", "right_sole_link")
PUSH = np.array([10.0, -25.0, 15.0])  # [N], world axes, 3 % of the weight
FROM, TO = 2.0, 3.5  # [s]


@pytest.fixture(scope="module")
def log() -> pd.DataFrame:
    """Return a log: straight legs, arms that swing, efforts wrong by 3 % and with noise; the soles hold the rest up."""
    model, rng = load_robot("talos").model, np.random.default_rng(5)
    data, joints = model.createData(), list(model.names)[2:]
    n = len(joints)
    size = np.where(["arm" in joint for joint in joints], 0.12, 0.03)
    phase, omega = rng.uniform(0.0, 6.28, n), 2.0 * np.pi * rng.uniform(0.2, 0.6, n)
    time, rows = np.arange(0.0, 5.0, 4e-3), []
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
    names = [f"{joint}_{what}" for what in ("v", "q", "tau") for joint in joints]
    return pd.DataFrame(table, columns=[*base, *names])


def estimated(log: pd.DataFrame, folder: Path, robot: dict[str, Any]) -> Result:
    """Return the estimate of a log by a map."""
    values = free_map("talos", [HAND], load_robot("talos").joints, observer={"names": ["force_level"], "gain": 100})
    return estimate(recorded(folder / "log.csv", edited(values, {"base.velocity.axes": "body", **robot}), table=log))


def hand_of(found: Result) -> tuple[Array, Array, Array]:
    """Return estimate, deviation and true force (m, 3) [N] at the hand, settled."""
    whole = found.estimates["force_level"]
    middle = 0.5 * (whole.time[1:] + whole.time[:-1])
    true = PUSH * ((middle > FROM + 0.1) & (middle < TO))[:, None]
    good = (middle > 0.2) & ~((middle > FROM - 0.1) & (middle < FROM + 0.1)) & (np.abs(middle - TO) > 0.1)
    return whole.components[good, :3], whole.standard_deviation[good, :3], true[good]


def test_a_push_at_a_hand_is_no_foot_in_the_air(log: pd.DataFrame, tmp_path: Path) -> None:
    """A push smaller than what counts as nothing at a foot stays a push: no factor of the arm's efforts explains it."""
    found = estimated(log, tmp_path, {"robot.wrenches": list(SOLES)})
    force, deviation, true = hand_of(found)
    assert np.sqrt(np.mean((force - true) ** 2, axis=0))[:2].max() < 7.0
    assert np.mean(np.abs(force - true) < 2.0 * deviation, axis=0).min() > 0.95
    assert not any("effort times" in fit.values for fit in found.forces.values.fits)
    units = [axis.get_ylabel()[-4:] for axis in draw_estimation(found).axes[:-3] if axis.get_visible()]
    assert units == [" [N]"] * 9 + ["N m]"] * 6  # the hand has no moments


@pytest.mark.evidence  # other tests say so of a walk and of an arm
def test_soles_without_moments_are_wrong_and_straight_legs_show_no_weight(log: pd.DataFrame, tmp_path: Path) -> None:
    """Squared errors of the rows are far larger than stated, which is said; what the legs do not show is not shown."""
    found = estimated(log, tmp_path, {"robot.points": [HAND, *SOLES]})
    force, deviation, true = hand_of(found)
    assert np.mean(np.abs(force - true) < 2.0 * deviation, axis=0).min() > 0.95
    assert "forces elsewhere, a moment, or a wrong model" in found.verdict
    assert np.mean(found.estimates["force_level"].shown[:, [5, 8]], axis=0).max() < 0.1


EXAMPLES = Path(__file__).resolve().parents[2] / "examples"


@pytest.fixture(scope="module")
def example() -> ModuleType:
    """The example as a module."""
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(EXAMPLES)
        return importlib.import_module("13_a_force_of_your_own")


@pytest.fixture(scope="module")
def flights(example: ModuleType, tmp_path_factory: pytest.TempPathFactory) -> tuple[Record, Record]:
    """The flight of a plain drone, and of one that knows its drag."""
    first, second = example.records(tmp_path_factory.mktemp("drone"))
    return first, second


def test_what_the_robot_knows_is_no_unknown_force(example: ModuleType, flights: tuple[Record, Record]) -> None:
    """By the closed form: m a = thrust + weight + drag + push, whose samples the table holds exactly."""
    plain, dragged = (estimate(record).estimates["force_level"].force[:, 0] for record in flights)
    table = example.flight()
    speed = table[["vx", "vy"]].to_numpy() * table[["r1", "r2"]].sum(axis=1).to_numpy()[:, None]
    drag = -example.DRAG * 0.5 * (speed[1:] + speed[:-1])
    assert np.max(np.abs(dragged[100:580])) < 2e-3
    np.testing.assert_allclose(dragged[640:780].mean(axis=0), example.PUSH, atol=2e-3)
    assert np.max(np.abs((plain - dragged)[100:, :2] - drag[100:])) < 0.2 * np.max(np.abs(drag))  # behind the filter


def test_a_known_force_is_found_again_in_the_flight(flights: tuple[Record, Record]) -> None:
    """At the body, along every axis."""
    checks = check_record(flights[1])
    assert [check.axis for check in checks] == ["x", "y", "z"]
    assert all(check.ok for check in checks), "\n".join(map(str, checks))


def test_observers_by_name_and_of_ones_own_run_side_by_side(flights: tuple[Record, Record]) -> None:
    """Both, each under its name; two of one name are refused."""
    record = flights[1]
    own = MomentumObserver(record.robot.model, ["body"], 40.0)
    assert sorted(estimate(record, ["force_level", own]).estimates) == ["force_level", "momentum"]
    with pytest.raises(ObserverError, match=r"\['momentum', 'momentum'\]: different ones were expected"):
        estimate(record, ["momentum", own])


def test_a_calibration_identifies_what_it_knows(example: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A drag that is believed 30 % too large comes back from a flight without push, and nothing is left."""
    monkeypatch.setattr(example, "PUSH", np.zeros(3))
    _, record = example.records(tmp_path)
    wrong = replace(record, robot=record.robot.changed({"drag": 0.3}))
    found = calibrate([wrong], parameters=["drag"])
    assert found.changes["drag"] == pytest.approx(1.0 / 1.3 - 1.0, abs=2e-3)
    without, bar = found.error_bar["body.Fx"]
    assert bar < 0.05 * without
    with pytest.raises(CalibrationError, match="parameters has 'luck': of drag some were expected"):
        calibrate([wrong], parameters=["luck"])
