"""Robots without motion capture: a base by its IMU or by the joints alone, contacts; a base that moves; an orbit."""

import io
import itertools
import json
import re
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pandas as pd
import pinocchio as pin
import pytest
import tomli_w
from scipy.spatial.transform import Rotation
from support.commands import call
from support.drone import MAP as DRONE
from support.drone import flight
from support.further import further
from support.recorded import edited, recorded
from support.robot_parts import by_axis, free_map, joint, joint_table, link, sines
from support.six_joints import SIX, six_joints, six_map
from support.walking_log import FEET, bag, bag_map, table, table_map, urdf, walk

from aerobat_pin.errors import AerobatError
from aerobat_pin.estimation import Result, estimate
from aerobat_pin.forces import StoredEstimate, change_of_axes, given_forces, inputs_between, lifted_errors, with_tilt
from aerobat_pin.forces.balance import factors_by_balance, motion_of
from aerobat_pin.forces.contacts import contact_probability, stances_of, stances_on_ground, touching
from aerobat_pin.observers import low_passed
from aerobat_pin.records import Spool, base_requests, parse_map
from aerobat_pin.visualization.figures import lines
from aerobat_pin.visualization.figures.estimation import draw_estimation
from aerobat_pin.visualization.figures.record import draw_contacts, draw_motion, draw_unexplained

PLACE, TURN = np.array([0.12, -0.05, 0.08]), np.array([10.0, -20.0, 90.0])  # [m], [deg]
HEAVIER = {"mass", "effort unit", "effort unit or mass"}  # what a push down may be taken for


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with the quadruped's file and table, and an IMU that is turned and off the base's origin."""
    path = tmp_path_factory.mktemp("legs")
    (path / "quadruped.urdf").write_text(urdf())
    walked, log = walk(), table(walk())
    rate = walked.v[:, 3:6]
    change = np.gradient(rate, walked.time, axis=0)
    felt = walked.specific_force + np.cross(change, PLACE) + np.cross(rate, np.cross(rate, PLACE))
    turn = pin.rpy.rpyToMatrix(*np.radians(TURN))  # from the IMU's axes to the base's
    for name, values in (("imu_a", felt @ turn), ("imu_w", rate @ turn)):
        log[[f"{name}{axis}" for axis in "xyz"]] = values
    attitude = [pin.Quaternion(pin.Quaternion(q[3:7]).matrix() @ turn).coeffs() for q in walked.q]
    log[[f"imu_q{axis}" for axis in "xyzw"]] = np.array(attitude)
    log.to_csv(path / "log.csv", index=False)
    return path


def mapped(folder: Path, source: str, **more: Any) -> dict[str, Any]:
    """Return a map whose base is known by the IMU or by the joints."""
    imu = {"place": PLACE.tolist(), "turn": TURN.tolist(), "tilt": 0.0}
    base = by_axis(quaternion="imu_q{}", rate="imu_w{}", acceleration="imu_a{}")
    base |= {"from": source, "imu": imu, **more}
    return edited(table_map(Path("quadruped.urdf")), {"check": None, "log.time.column": "t", "base": base})


@pytest.fixture(scope="module")
def by_imu(folder: Path) -> Result:
    """Return the estimate by the IMU."""
    return estimate(recorded(folder / "log.csv", mapped(folder, "imu")))


@pytest.mark.parametrize(("source", "least"), [("imu", 0.995), ("joints", 0.9)])
def test_a_base_without_position_gives_forces_of_feet(folder: Path, by_imu: Result, source: str, least: float) -> None:
    """By an IMU that is turned and off the origin, and by the joints' rows with the base's velocity taken for 0."""
    found = by_imu if source == "imu" else estimate(recorded(folder / "log.csv", mapped(folder, source)))
    record = found.record
    assert "base.position" not in record.channels
    assert not [one for one in found.findings if one.warns]
    force, true = found.estimates["force_level"].force[200:], walk().force[201 : 201 + 1300]
    force = force[:1300]
    r2 = 1.0 - np.sum((force - true) ** 2, axis=0) / np.sum((true - true.mean(axis=0)) ** 2, axis=0)
    assert r2[:, 2].min() > least
    stances = found.stances["force_level"]
    assert [one.point for one in stances] == list(FEET)
    for foot, one in enumerate(stances):  # a foot carries 3 % of the weight for a moment
        assert one.share == pytest.approx(touching(walk().force[:, foot, 2], record.robot.weight).mean(), abs=0.02)
    assert found.metrics()["contacts"]["force_level"]["FL_FOOT"]["contacts"][-1][1] is None


def walked_while_pushed(folder: Path, errors: np.ndarray, force: np.ndarray) -> Result:
    """Return the estimate of the walk with errors (n, 12) of efforts, and a push (3,) or (n, 3) that its feet bear."""
    walked, log, tau = walk(), table(walk()), walk().tau + errors
    model = pin.buildModelFromUrdf(str(folder / "quadruped.urdf"), pin.JointModelFreeFlyer())
    data, axes = model.createData(), pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
    for q, effort, push in zip(walked.q, tau, np.broadcast_to(force, (len(tau), 3)), strict=True):
        J = np.vstack([pin.computeFrameJacobian(model, data, q, model.getFrameId(foot), axes)[:3] for foot in FEET])
        trunk = pin.Quaternion(q[3:7]).matrix().T @ push  # in its axes
        effort += (J.T @ np.linalg.pinv(J[:, :6].T) @ [*trunk, 0.0, 0.0, 0.0])[6:]
    log[[f"{joint}_tau" for joint in walked.joints]] = tau
    values = edited(table_map(Path("quadruped.urdf")), {"log.time.column": "t"})
    return estimate(recorded(folder / "pushed.csv", values, table=log))


def test_a_push_at_the_trunk_is_said_and_factors_are_none(folder: Path) -> None:
    """12 N up or 20 to the left for 0.3 s in a walk with errors of 3 %, friction and noise; without it, nothing."""
    walked, rng = walk(), np.random.default_rng(17)
    error = walked.tau * 0.03 * rng.standard_normal(12) + 0.1 * rng.standard_normal(walked.tau.shape)
    error += 0.15 * np.tanh(walked.v[:, 6:] / 0.02)
    for push in ([0.0, 0.0, 0.0], [0.0, 0.0, 12.0], [0.0, 20.0, 0.0]):
        during = (walked.time > 1.5) & (walked.time < 1.8)
        found = walked_while_pushed(folder, error, during[:, None] * push)
        assert any(one.check == "push elsewhere" for one in found.findings) == any(push), found.warnings
        assert not [one for one in found.findings if one.warns and one.check in HEAVIER]
    assert any(re.search("from 1.[56].*forces elsewhere, a moment, or a wrong model", one) for one in found.warnings)


def test_a_lasting_push_at_the_trunk_is_no_certain_error_of_mass_or_units(folder: Path) -> None:
    """20 N downward as long as it walks: lighter efforts and a heavier trunk explain it alike, and that is said."""
    tau, rng = walk().tau, np.random.default_rng(17)
    error = tau * 0.03 * rng.standard_normal(12) + 0.1 * rng.standard_normal(tau.shape)
    findings = walked_while_pushed(folder, error, np.array([0.0, 0.0, -20.0])).findings
    [said] = [one for one in findings if one.warns and one.check in HEAVIER]
    assert said.check == "effort unit or mass"
    assert "a load on the base link: the record does not tell which" in said.text


def test_a_change_of_axes_is_no_force(by_imu: Result) -> None:
    """Where the velocity begins at zero again, nothing is seen of it; with the IMU elsewhere than said, much is."""
    right, model = by_imu.estimates["force_level"].force, by_imu.record.robot.model
    steps = np.abs(np.diff(right, axis=0)).max(axis=(1, 2))
    assert steps[249:1400:250].max() < 1.5 * np.median(steps[200:])  # each half second
    q, v = pin.randomConfiguration(model, -np.ones(model.nq), np.ones(model.nq)), np.linspace(-1.0, 1.0, model.nv)
    assert not np.any(change_of_axes(model, model.createData(), q, v, v, 1e-3))


@pytest.mark.parametrize("turn", [[0.0, 0.0, 90.0], [180.0, 0.0, 0.0]])
def test_an_imu_that_is_mounted_otherwise_is_named(turn: list[float], folder: Path) -> None:
    """By a quarter about the vertical no word was said of feet 30 deviations off; upside down efforts were reversed."""
    mounted = pin.rpy.rpyToMatrix(*np.radians(turn)) @ pin.rpy.rpyToMatrix(*np.radians(TURN))
    wrong = np.degrees(pin.rpy.matrixToRpy(mounted)).tolist()
    chosen = mapped(folder, "imu", imu={"place": PLACE.tolist(), "turn": wrong, "tilt": 0.0})
    told = [one for one in estimate(recorded(folder / "log.csv", chosen), trust=True).findings if one.warns]
    assert "base.imu.turn = [10, -20, 90] leave" in next(one.text for one in told if one.check == "axes of the base")
    assert not [one for one in told if one.check == "effort sign"]


def test_a_tilt_turns_forces_in_world_axes() -> None:
    """10 mrad: 1 N along x and y of 100 N upward; upward 1 N, as an offset of so much of gravity, and .05 of 5 N."""
    force = np.array([[0.0, 0.0, 100.0, 3.0, 4.0, 0.0]])
    np.testing.assert_allclose(with_tilt(force, np.zeros((1, 6)), 0.01), [[1.0, 1.0, 1.0, 0.0, 0.0, 0.05]], atol=1e-12)
    np.testing.assert_allclose(with_tilt(force, np.ones((1, 6)), 0.0), np.ones((1, 6)))


def test_a_leg_in_the_air_shows_the_errors_of_its_rows() -> None:
    """Of known sizes, within 3 %; the trunk's rows show none, and a leg that always stands errs as the worst row."""
    rng, sizes = np.random.default_rng(3), np.array([0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.3, 0.3, 0.3])
    count = 4000
    jacobians = np.zeros((count, 9, 15))
    for foot in range(3):
        rows = slice(6 + 3 * foot, 9 + 3 * foot)
        jacobians[:, 3 * foot : 3 * foot + 3, :6] = rng.standard_normal((count, 3, 6))
        jacobians[:, 3 * foot : 3 * foot + 3, rows] = 0.5 * np.eye(3) + 0.05 * rng.standard_normal((count, 3, 3))
    force = rng.uniform(20.0, 100.0, (count, 9))
    force[: count // 2, :3] = force[count // 4 :, 3:6] = 0.0
    rows = np.einsum("mcv,mc->mv", jacobians, force)
    rows[:, 6:] += sizes * rng.standard_normal((count, 9))
    found = lifted_errors(SimpleNamespace(effortLimit=np.zeros(15)), rows, jacobians, 150.0)
    np.testing.assert_allclose(found[6:12], sizes[:6], rtol=0.03)
    assert not found[:6].any()
    np.testing.assert_array_equal(found[12:], found[6:12].max())


def test_a_base_slower_than_the_joints_shows_as_much_noise(folder: Path) -> None:
    """Between its samples it is interpolated, and looked far less noisy: k was 9.5 of a right log."""
    walked, rng, sizes = walk(), np.random.default_rng(5), []
    log, channels = table(walked), [f"{name}{axis}" for name in ("v", "gyro_") for axis in "xyz"]
    log[channels] += 0.01 * rng.standard_normal((len(log), 6))
    for every in (1, 5):
        slow = log.copy()
        slow.loc[np.arange(len(log)) % every != 0, channels] = np.nan
        slow.to_csv(folder / "slow.csv", index=False)
        record = recorded(folder / "slow.csv", edited(table_map(Path("quadruped.urdf")), {"log.time.column": "t"}))
        motion = motion_of(record, inputs_between(record, given_forces(record)))
        assert motion is not None
        sizes.append(motion.noise[:6])
    assert np.all(sizes[1] > 0.5 * sizes[0])


@pytest.mark.parametrize(("noise", "within"), [(0.01, 0.02), *further((0.003, 0.01), (0.03, 0.05))])
def test_noise_of_the_base_makes_no_feet_lighter(noise: float, within: float, folder: Path, tmp_path: Path) -> None:
    """A right log with noise [m/s] of its base: feet carry the weight; 13 % were missed at 10 mm/s, 30 % at 30 mm/s."""
    walked, rng = walk(), np.random.default_rng(4)
    model = pin.buildModelFromXML(urdf(), pin.JointModelFreeFlyer())
    data, axes, feet = model.createData(), pin.LOCAL_WORLD_ALIGNED, [model.getFrameId(foot) for foot in FEET]
    lifts = np.clip(4.8 - 6.0 * np.sin(2.0 * np.pi * (1.6 * walked.time[:, None] + np.arange(4) / 4.0)), 0.0, 1.0)
    tau, force = walked.tau.copy(), np.empty_like(walked.force)
    for k, share in enumerate(lifts):
        J = np.concatenate([pin.computeFrameJacobian(model, data, walked.q[k], foot, axes)[:3] for foot in feet])
        bears = np.repeat(share**2, 3)[:, None] * J[:, :6]
        force[k] = (bears @ np.linalg.solve(J[:, :6].T @ bears, J[:, :6].T @ walked.force[k].ravel())).reshape(4, 3)
        tau[k] += J[:, 6:].T @ (walked.force[k] - force[k]).ravel()
    log = table(replace(walked, tau=tau + 0.1 * rng.standard_normal(tau.shape), force=force))
    for name, size in (("v{}", noise), ("gyro_{}", 0.01)):
        log[[name.format(axis) for axis in "xyz"]] += size * rng.standard_normal((len(log), 3))
    values = edited(table_map(folder / "quadruped.urdf"), {"check": None, "observer.gain": 100.0})
    found = estimate(recorded(tmp_path / "log.csv", values, table=log)).estimates["force_level"]
    true, late = 0.5 * (force[1:] + force[:-1]), 250
    behind = low_passed(true.reshape(-1, 12), -np.expm1(-100.0 / 500.0))[late:, 2::3]
    up, sure = found.components[late:, 2::3], found.standard_deviation[late:, 2::3]
    assert up.sum(axis=1).mean() == pytest.approx(behind.sum(axis=1).mean(), rel=within)
    assert np.mean(np.abs(up - true.reshape(-1, 12)[late:, 2::3]) < 2.0 * sure) > 0.9


def test_the_weight_tells_factors_of_efforts() -> None:
    """Two sliding legs carry 100 N in turn, one shows 4 % too much: so much of its factor; standing together, 2 %."""
    attitude, G = np.broadcast_to(np.eye(3), (400, 3, 3)), np.broadcast_to(np.eye(2), (400, 2, 2))
    for together, errors in ((False, [0.0, 0.04]), (True, [0.02, 0.02])):
        arm = np.array([0.0, 0.0] if together else [0.2, -0.2])  # left and right of the base [m]
        force = np.full((400, 2), 50.0) if together else 100.0 * np.eye(2)[np.arange(400) // 10 % 2]
        J, y = np.zeros((400, 2, 8)), np.zeros((400, 8))
        J[:, :, 2], J[:, :, 3], J[:, :, 6:] = 1.0, arm, np.eye(2)
        y[:, 2], y[:, 3], y[:, 6:] = force.sum(axis=1), force @ arm, force + force * [0.0, 0.04]
        d, sure = factors_by_balance(y, J, G, [6, 7], force, attitude, np.full(6, 1e-3), 0.1)
        np.testing.assert_allclose(d, errors, atol=1e-3)
        assert sure.max() < 3e-3 if not together else sure.min() > 0.03


def test_contacts_begin_and_end_where_the_weight_says(by_imu: Result) -> None:
    """Above 4 % of 100 N, if it reaches 8 %; a contact goes on over the edge of a block."""
    up = np.array([0.0, 5.0, 9.0, 5.0, 4.5, 3.0, 5.0, 7.9, 8.1, 50.0])
    np.testing.assert_array_equal(touching(up, 100.0), [0, 1, 1, 1, 1, 0, 1, 1, 1, 1])
    assert contact_probability(np.array([3.0, 6.0]), np.ones(2), 100.0) == pytest.approx([0.5, 0.99865], abs=1e-5)
    whole = by_imu.stored["force_level"]
    for weight, least in ((by_imu.record.robot.weight, 1), (1e9, 0)):
        edges = [0, *range(395, 470, 5), 1400]  # some lie between 4 % and 8 %
        blocks = [whole.between(*pair) for pair in itertools.pairwise(edges)]
        once, cut = (stances_of(one, weight) for one in ([whole.between(0, 1400)], blocks))
        for one, other in zip(once, cut, strict=True):
            assert len(one.onset) >= least
            np.testing.assert_array_equal(one.onset, other.onset)
            np.testing.assert_array_equal(one.end, other.end)
            assert one.share == pytest.approx(other.share)


def test_no_contact_goes_on_over_a_hole(by_imu: Result) -> None:
    """Whether a foot stood where nothing was recorded nobody knows."""
    whole, holed = by_imu.stored["force_level"], StoredEstimate(Spool())
    for first, last in ((0, 300), (500, 1400)):
        holed.append(whole.between(first, last))
    hole = float(holed.start[300])
    [stances] = stances_on_ground(by_imu.record, {"force_level": holed}).values()
    for one in stances:
        assert not np.any((one.onset < hole) & ~(one.end < hole))
    assert sum(hole in one.onset for one in stances) >= 3


def test_a_base_by_its_imu_is_one_topic(folder: Path) -> None:
    """A bag with /imu and /joint_states alone; the report has a gait diagram."""
    values = bag_map(folder / "quadruped.urdf")
    values["base"] = {"from": "imu", "topic": "/imu", "acceleration": {"topic": "/imu"}}
    chosen = parse_map(values, "-")
    assert [request.names[0] for request in base_requests(chosen)] == [
        "/imu.orientation.x",
        "/imu.angular_velocity.x",
        "/imu.linear_acceleration.x",
    ]
    bag(walk(), folder / "bag")
    found = estimate(recorded(folder / "bag", chosen))
    [side] = found.compared["force_level"]
    assert side.scores()["Fz"].r2 > 0.99


@pytest.mark.usefixtures("unrendered")
def test_the_results_show_the_gait(folder: Path, by_imu: Result, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(folder)
    Path("map.toml").write_text(tomli_w.dumps(mapped(folder, "joints")))
    assert call("estimate", "log.csv", "--map", "map.toml", "--out", "out") == 0
    assert json.loads(Path("out/metrics.json").read_text())["contacts"]["force_level"]["RR_FOOT"]["share"] > 0.95
    assert {path.name for path in Path("out/figures").iterdir()} >= {"contacts.png", "estimation.png", "motion.pdf"}
    assert "its six rows are not believed" in Path("out/report.html").read_text()
    for figure, kind in ((draw_contacts(by_imu), "png"), (draw_motion(by_imu.record), "pdf")):
        figure.savefig(rendered := io.BytesIO(), format=kind)
        assert rendered.tell() > 1000


def test_figures_say_which_joints_they_leave_out(folder: Path) -> None:
    """All twelve residuals stand below each other; of the motion the first eight joints are drawn."""
    result = estimate(recorded(folder / "log.csv", edited(mapped(folder, "joints"), {"robot.points": []})))
    named = [axis.get_ylabel().partition(".")[0] for axis in draw_estimation(result).axes[:-1]]
    assert named == list(result.record.joints)
    assert "of the first 8 joints, " in draw_motion(result.record).get_suptitle()


def test_a_long_unexplained_part_does_not_begin_again_at_zero(by_imu: Result, monkeypatch: pytest.MonkeyPatch) -> None:
    """Where the next samples of a long estimate are read, its low-passes began anew."""
    monkeypatch.setattr(lines, "MOST_DRAWN", 200)
    [whole, *_] = draw_unexplained(by_imu).axes[0].lines
    monkeypatch.setattr(lines, "READ", 100)
    [again, *_] = draw_unexplained(by_imu).axes[0].lines
    assert len(whole.get_ydata()) < len(by_imu.stored["force_level"])
    assert np.allclose(again.get_ydata(), whole.get_ydata(), rtol=1e-3)


def test_what_needs_more_than_an_imu_is_refused_with_its_reason(folder: Path) -> None:
    """No attitude, no accelerometer, a body without joints."""
    bare = mapped(folder, "imu")
    for part, reason in (("quaternion", "gravity is known in its axes alone"), ("acceleration", "gives the velocity")):
        with pytest.raises(AerobatError, match=reason):
            recorded(folder / "log.csv", edited(bare, {f"base.{part}": None}))
    drone = edited(DRONE, {"known": None, "check": None, "base.from": "joints"})
    flight(1.5).to_csv(folder / "drone.csv", index=False)
    with pytest.raises(AerobatError, match="believes the rows of joints alone, and the robot has none"):
        recorded(folder / "drone.csv", drone)


AXES = "xyz"


def on_a_ship(folder: Path) -> None:
    """Write six seconds of an arm that nothing touches, on a deck that accelerates by up to 1 m/s2, and its URDF."""
    (folder / "six.urdf").write_text(six_joints())
    model, rng, time = pin.buildModelFromXML(six_joints()), np.random.default_rng(1), np.arange(1200) / 200.0
    data, size, middle = model.createData(), [0.5, 0.3, 0.35, 0.4, 0.5, 0.6], [0.0, 0.6, 0.9, -0.5, 0.4, 0.0]
    q, v, a = sines(time, size, rng.uniform(1.0, 2.8, 6), 0.0, middle)
    deck = np.stack([np.sin(0.9 * time), 0.8 * np.cos(0.7 * time), 0.8 * np.sin(1.1 * time)], axis=1)
    torque = np.empty_like(q)
    for k, moved in enumerate(deck):
        model.gravity.linear = np.array([0.0, 0.0, -9.81]) - moved
        torque[k] = pin.rnea(model, data, q[k], v[k], a[k])
    columns = {"qx": 0.0, "qy": 0.0, "qz": 0.0, "qw": 1.0}
    columns |= {f"w{axis}": 1e-3 * rng.standard_normal(len(time)) for axis in AXES}
    felt = deck + [0.0, 0.0, 9.81] + 0.02 * rng.standard_normal(deck.shape)
    columns |= {f"a{axis}": felt[:, k] for k, axis in enumerate(AXES)}
    v, torque = (one + size * rng.standard_normal(v.shape) for one, size in ((v, 1e-3), (torque, 0.05)))
    joint_table(time, SIX, q=q, v=v, i=torque).assign(**columns).to_csv(folder / "ship.csv", index=False)


def test_an_arm_on_a_ship_needs_its_imu(tmp_path: Path) -> None:
    """Fixed, it is wrong by newtons; by the IMU it is not, and no weight is asked for. A map without is told so."""
    on_a_ship(tmp_path)
    fixed = edited(six_map(), {"log.time.column": "t", "observer.gain": 50.0, "joints.friction": None})
    names = {"quaternion": ("qx", "qy", "qz", "qw"), "rate": ("wx", "wy", "wz"), "acceleration": ("ax", "ay", "az")}
    base = {"from": "imu", **{name: {"columns": list(columns)} for name, columns in names.items()}}
    free = edited(fixed, {"robot.root": "free_flyer", "robot.rows.ignore": ["base"], "base": base})
    errors = []
    for chosen in (fixed, free):
        result = estimate(recorded(tmp_path / "ship.csv", chosen))
        found = result.estimates["force_level"]
        errors.append(np.sqrt(np.mean(found.components[100:] ** 2)))
    assert errors[0] > 1.0
    assert errors[1] < 0.3 * errors[0]
    assert np.mean(np.abs(found.components[100:]) < 2.0 * found.standard_deviation[100:]) > 0.95
    assert not any(finding.check == "mean force" for finding in result.findings)
    result = estimate(recorded(tmp_path / "ship.csv", edited(free, {"robot.rows": None})), trust=True)
    (finding,) = (one for one in result.findings if one.check == "mean force")
    assert 'robot.rows = {ignore = ["base"]}' in finding.text


@pytest.mark.parametrize("gravity", [0.0, 1e-3])
def test_nothing_is_compared_with_gravity_in_an_orbit(gravity: float, tmp_path: Path) -> None:
    """A body with an accelerometer tumbles head down and is pushed for half of the time: no word of its weight."""
    rng, time, mass, push = np.random.default_rng(2), np.arange(800) / 100.0, 10.0, np.array([0.6, 0.0, -0.9])
    turns = Rotation.from_rotvec([2.6, 0.0, 0.0]) * Rotation.from_rotvec(0.1 * time[:, None] * [1.0, -2.0, 0.5])
    force = push * (time > 4.0)[:, None]
    place = 0.5 * push / mass * np.maximum(time - 4.0, 0.0)[:, None] ** 2
    felt = turns.inv().apply(force / mass)
    columns = {"t": time} | {f"q{axis}": turns.as_quat()[:, k] for k, axis in enumerate("xyzw")}
    for name, values, noise in (("p", place, 1e-5), ("w", 0.0 * place + [0.1, -0.2, 0.05], 1e-4), ("a", felt, 0.01)):
        noisy = values + noise * rng.standard_normal(values.shape)
        columns |= {f"{name}{axis}": noisy[:, k] for k, axis in enumerate(AXES)}
    pd.DataFrame(columns).to_csv(tmp_path / "orbit.csv", index=False)
    values = {
        "robot": {"body": {"mass": mass, "inertia": [0.4, 0.4, 0.4]}, "points": ["body"], "gravity": gravity},
        "log": {"time": {"column": "t"}},
        "base": by_axis(position="p{}", rate="w{}", quaternion="q{}") | {"velocity": {"from": "pose", "window": 0.2}},
        "check": {"specific_force": {"columns": ["ax", "ay", "az"]}},
        "observer": {"names": ["force_level"], "gain": 10.0},
    }
    result = estimate(recorded(tmp_path / "orbit.csv", values))
    assert not any(finding.warns for finding in result.findings)
    np.testing.assert_allclose(result.estimates["force_level"].force[600:, 0].mean(axis=0), push, atol=0.05)


def ball_in_orbit(tumbles: bool = True, jets: float = 1.0) -> tuple[pd.DataFrame, dict[str, Any]]:
    """Return table and map of a ball that tumbles or spins, nobody knows why, moved by jets, logged in its axes."""
    time, mass, rates, spin = np.arange(800) / 100.0, 10.0, np.array([1.3, 0.9, 1.7]), np.array([0.3, -0.6, 0.2])
    other = spin[::-1] * tumbles
    first, then = (Rotation.from_rotvec(time[:, None] * axis) for axis in (spin, other))
    turns, size = first * then, jets * np.array([6.0, 5.0, 8.0])
    felt = size * np.sin(rates * time[:, None])
    columns = {"t": time} | {f"q{axis}": turns.as_quat()[:, k] for k, axis in enumerate("xyzw")}
    for name, values in (
        ("p", -felt / (mass * rates**2)),
        ("v", -size * np.cos(rates * time[:, None]) / (mass * rates)),
        ("w", then.inv().apply(spin) + other),
        ("f", turns.inv().apply(felt)),
    ):
        columns |= {f"{name}{axis}": values[:, k] for k, axis in enumerate(AXES)}
    return pd.DataFrame(columns), {
        "robot": {"body": {"mass": mass, "inertia": [0.4, 0.4, 0.4]}, "points": ["body"], "gravity": 0.0},
        "log": {"time": {"column": "t"}},
        "base": by_axis(position="p{}", quaternion="q{}", velocity="v{}", rate="w{}"),
        "known": {"jets": {"columns": ["fx", "fy", "fz"], "law": "wrench", "frame": "body", "axes": "frame"}},
        "observer": {"names": ["force_level"], "gain": 10.0},
    }


@pytest.mark.parametrize(
    ("key", "value", "told"),
    [
        ("known.jets.sign", 1, []),
        ("known.jets.sign", -1, [r"known forces against motion: known forces of the other sign .*known.NAME.sign"]),
        ("base.velocity.axes", "body", [r"position against velocity: velocity seems .*base\.velocity\.axes"]),
        ("base.rate.axes", "world", [r"gyro against attitude: gyro seems .*base\.rate\.axes"]),
    ],
)
def test_forces_of_another_sign_and_rates_in_other_axes(key: str, value: Any, told: list[str], tmp_path: Path) -> None:
    table, values = ball_in_orbit()
    found = estimate(recorded(tmp_path / "orbit.csv", edited(values, {key: value}), table=table), trust=True).findings
    warned = [str(finding) for finding in found if finding.warns]
    assert len(warned) == len(told)
    assert all(re.match(*pair) for pair in zip(told, warned, strict=True)), warned


def test_a_push_of_a_fiftieth_of_what_a_ball_weighs_on_earth_is_found_in_an_orbit(tmp_path: Path) -> None:
    """2 N for a second beside jets of 0.8 N: none stood out; what errors there are, the record itself shows."""
    table, values = ball_in_orbit(tumbles=False, jets=0.1)
    time, rng, mass = table["t"].to_numpy(), np.random.default_rng(4), 10.0
    force = 2.0 * ((time > 3.0) & (time < 4.0))
    gained = np.concatenate([[0.0], np.cumsum(force[:-1])]) * 0.01 / mass
    table["vz"] += gained
    table["pz"] += np.concatenate([[0.0], np.cumsum(0.5 * (gained[1:] + gained[:-1]))]) * 0.01
    for axis in AXES:
        table[f"v{axis}"] += 1e-3 * rng.standard_normal(len(time))
        table[f"w{axis}"] += 1e-3 * rng.standard_normal(len(time))
    result = estimate(recorded(tmp_path / "orbit.csv", edited(values, {"observer.names": ["smoother"]}), table=table))
    found = result.estimates["smoother"]
    error = found.force[:, 0] - np.outer(force[:-1], [0.0, 0.0, 1.0])
    assert np.sqrt(np.mean(error**2)) < 0.25, "0.96 N before"
    assert np.mean(np.abs(error) < 2.0 * found.standard_deviation) > 0.93
    assert re.search(r"finds a push at body \(up to .* N upward, at 3\.\d+ s\)", result.verdict), result.verdict


def test_a_weight_whose_parts_are_not_seen_is_not_missed(tmp_path: Path) -> None:
    """A head above two wheels may carry it as well: what is not seen counted as 0, and the weight was expected."""
    wheels, time, rng = ("left_j", "right_j"), np.arange(400) / 100.0, np.random.default_rng(3)
    parts = [link("body", 6.0, "0 0 0.3", (0.2, 0.2, 0.05)), link("head"), joint("neck", "fixed", "body", "head")]
    for name, y in (("left", 0.2), ("right", -0.2)):
        parts += [link(name, 0.5, "0 0 0", 3 * [2e-3]), joint(f"{name}_j", "revolute", "body", name, f"0 {y} 0")]
    (tmp_path / "cart.urdf").write_text(f'<robot name="cart">{"".join(parts)}</robot>')
    columns = {"x": 0.1 * np.sin(time), "vx": 0.1 * np.cos(time), "qw": np.ones(len(time))}
    columns |= dict.fromkeys(("y", "z", "qx", "qy", "qz", "vy", "vz", "wx", "wy", "wz"), 0.0)
    q, v, a = sines(time, [1.0, 1.0], 1.0, 0.0)
    table = joint_table(time, wheels, q=q, v=v, tau=2e-3 * a + 0.01 * rng.standard_normal(q.shape)).assign(**columns)
    chosen = free_map(tmp_path / "cart.urdf", ["left", "right", "head"], wheels, observer={"gain": 20.0})
    result = estimate(recorded(tmp_path / "log.csv", chosen, table=table), trust=True)
    assert [each.verdict for each in result.findings if each.check == "mean force"] == ["good"]
