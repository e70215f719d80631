"""Kalman filter and smoother: equal to the textbook, honest about their own error, also of blows nobody expects."""

import copy
from functools import cache
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from scipy.stats import chi2
from support.further import further
from support.kalman_twins import KalmanTwin
from support.kernel_cases import MODELS, assert_equal, record, streamed
from support.observer_twins import point_jacobian
from support.rails import Rails

from aerobat_pin.aerobat import FORCE_POINTS, load_aerobat
from aerobat_pin.errors import ObserverError
from aerobat_pin.experiments import run
from aerobat_pin.flight import simulate
from aerobat_pin.observers import Application, Expected, KalmanObserver, SensorNoise, SmootherObserver, tie_joints
from aerobat_pin.scenario import load_scenario

ROBOT = load_aerobat("aerobat_light")
SENSORS = (0.02, 0.01, 0.05)
CASES: dict[str, dict[str, Any]] = {
    "forces alone": {},
    "known force in doubt": {"known_error": {"air": 0.2}, "error_time": 0.05, "misfit": 0.3},
    "mass and two forces in doubt": {"known_error": {"other": 0.1, "air": 0.3}, "mass_error": 0.05},
    "harmonics": {"frequency": 40.0},
    "harmonics, all in doubt": {"frequency": 40.0, "known_error": {"air": 0.2}, "mass_error": 0.05},
    "no torque": {"rows": "base"},
    "no torque, harmonics, mass in doubt": {"rows": "base", "frequency": 40.0, "mass_error": 0.05},
}
ALL = [(name, case) for name in MODELS for case in CASES]
MOST = [one for one in ALL if one[0] == "aerobat" or one == ("arm", "harmonics, all in doubt")]


@pytest.mark.parametrize(("name", "case"), [*MOST, *further(*(one for one in ALL if one not in MOST))])
def test_filter_and_smoother_equal_the_textbook(name: str, case: str) -> None:
    """Estimate and standard deviation against dense Joseph-form Kalman and Rauch-Tung-Striebel, one stamp repeated."""
    model, frames = MODELS[name]
    if "rows" in CASES[case] and name in ("arm", "humanoid"):
        pytest.skip("a fixed base has no base rows; unknown torques at 28 joints leave six digits, here and there")
    near = 1e-7 if "rows" in CASES[case] else 1e-9  # unknown torques of 1e8 times the noise leave few digits
    time, q, v, tau, known = record(model)
    size = float(pin.computeTotalMass(model))  # so that the walk is neither slow nor fast beside the sensors
    settings = {"force_walk": 40.0 * size, "prior": 10.0 * size, **CASES[case]}
    twin = KalmanTwin(model, frames, SensorNoise(*SENSORS).deviations(model), **settings)
    for kind in (KalmanObserver, SmootherObserver):
        force, deviation = twin.run(time, q, v, tau, known, smooth=kind is SmootherObserver)
        estimate = kind(model, frames, sensor_noise=SENSORS, **settings).run(time, q, v, tau, known)
        if "rows" in CASES[case]:  # how few, a velocity that is another in its last digit shows; ours does not notice
            nudged = v * (1.0 + 1e-15)
            other, _ = twin.run(time, q, nudged, tau, known, smooth=kind is SmootherObserver)
            near = max(near, 10.0 * float(np.max(np.abs(other - force)) / np.max(np.abs(force))))
            same = kind(model, frames, sensor_noise=SENSORS, **settings).run(time, q, nudged, tau, known)
            assert_equal(same.components, estimate.components, 1e-13)
        assert_equal(estimate.components, force, near)
        np.testing.assert_array_equal(np.isinf(estimate.standard_deviation), np.isinf(deviation))
        assert_equal(*(np.where(np.isinf(one), 0.0, one) for one in (estimate.standard_deviation, deviation)), near)
        J = np.array([point_jacobian(model, frames, one) for one in q])
        J[len(tau) // 2 + 1] = J[len(tau) // 2]
        mean = 0.5 * (J[1:] + J[:-1])
        residual = np.einsum("kci,kc->ki", mean, force)
        residual[len(tau) // 2] = residual[len(tau) // 2 - 1]
        assert_equal(estimate.residual, residual, near)


@pytest.mark.parametrize("case", CASES)
def test_a_stream_is_a_batch_with_its_standard_deviation(case: str) -> None:
    """The same numbers to the last bit, and a record in between leaves the stream alone."""
    model, frames = MODELS["aerobat"]
    time, q, v, tau, known = record(model)
    observer = KalmanObserver(model, frames, force_walk=1.0, **CASES[case])
    observer.trust_model(0.2)
    batch = observer.run(time, q, v, tau, known)
    observer = copy.deepcopy(observer)
    for k, sample in enumerate(streamed(observer, time, q, v, tau, known)):
        if k == 7:
            observer.run(time, q, v, tau, known)
        np.testing.assert_array_equal(sample.components, batch.components[k])
        np.testing.assert_array_equal(sample.force, batch.force[k])
        np.testing.assert_array_equal(sample.residual, batch.residual[k])
        np.testing.assert_array_equal(sample.standard_deviation, batch.standard_deviation[k])


WALK, PRIOR, DOUBT, RUNS = 0.5, 0.1, 0.2, 30


def resting_flight(seed: int, steps: int = 60) -> tuple[Any, ...]:
    """Draw a record and the true forces (steps, 6) from the filter's own statistics: forces, air, model, sensors."""
    # A robot on rails: posed anew at every sample, its true momentum stays zero, and tau is what keeps it so.
    model, dt, rng = ROBOT.model, 1e-3, np.random.default_rng(seed)
    data, nv = model.createData(), model.nv
    q = [pin.integrate(model, ROBOT.q0, 0.3 * np.sin(0.05 * k) * np.linspace(-1.0, 1.0, nv)) for k in range(steps + 1)]
    v = rng.normal(size=(steps + 1, nv)) * SensorNoise(*SENSORS).deviations(model)
    air = np.sin(0.1 * np.arange(steps))[:, None] * np.repeat([0.5, 0.01], [3, nv - 3])
    start = PRIOR * rng.normal(size=6)
    force = start + np.cumsum(WALK * np.sqrt(dt) * rng.normal(size=(steps, 6)), axis=0)
    J = np.array([point_jacobian(model, FORCE_POINTS, one) for one in q])
    weight = np.array([pin.computeGeneralizedGravity(model, data, one) for one in q])
    pushed = np.einsum("kci,kc->ki", 0.5 * (J[1:] + J[:-1]), force)
    tau = 0.5 * (weight[1:] + weight[:-1]) - pushed - (1.0 + DOUBT * rng.normal()) * air
    arms = np.where(np.arange(nv) < 3, 1.0, 0.05)  # what the filter thinks the rows to be wrong by, at least
    least = 0.004 * 9.81 * pin.computeTotalMass(model) * np.sqrt(0.01 / dt) * arms
    tau += least * np.random.default_rng(1000 + seed).normal(size=tau.shape)
    return (dt * np.arange(steps + 1), np.array(q), v, tau, {"air": air}), force


@pytest.mark.parametrize("kind", [KalmanObserver, SmootherObserver])
def test_the_error_is_as_large_as_the_standard_deviation_says(kind: type[KalmanObserver]) -> None:
    """Over 30 draws the squared error in standard deviations is chi-square for every component, never more early on."""
    # Told a third of the sensors' noise, or nothing of the doubt about the air, it is not.
    settings = {"force_walk": WALK, "prior": PRIOR, "known_error": {"air": DOUBT}, "error_time": 1e9, "misfit": 1e-9}
    low, high = chi2.ppf([1e-4, 1.0 - 1e-4], RUNS)
    observers = [
        kind(ROBOT.model, FORCE_POINTS, **settings),
        kind(ROBOT.model, FORCE_POINTS, **settings, sensor_noise=tuple(np.array(SENSORS) / 3.0)),
        kind(ROBOT.model, FORCE_POINTS, **{**settings, "known_error": None}),
    ]
    squares = np.zeros((3, 2, 6))
    for seed in range(RUNS):
        flight, force = resting_flight(seed)
        for total, observer in zip(squares, observers, strict=True):
            estimate = observer.run(*flight)
            total += ((estimate.components - force) / estimate.standard_deviation)[[8, 50]] ** 2
    assert np.all(squares[0] < high), squares[0]
    assert np.all(squares[0, 1] > low), squares[0]
    assert squares[1].max() > high
    assert squares[2].max() > high


def test_the_deviations_are_true_where_noise_of_the_velocity_passes_through_the_coriolis_product() -> None:
    """On draws from an exact model, with no floor of the misfit; with C^T v of the measured velocity 1.3 to 1.7."""
    log = simulate(load_scenario("observer_benchmark", ["simulation.duration=0.4"]))
    q, v = (np.asarray(log.measured[key].values, float) for key in ("q", "v"))
    model = load_aerobat("aerobat_light").model
    rails = Rails(model, log.time, q, v, FORCE_POINTS, misfit=False)
    for kind in (KalmanObserver, SmootherObserver):
        ratios = []
        for seed in range(2):
            measured, tau, force = rails.draw(seed)
            observer = kind(model, FORCE_POINTS, sensor_noise=SENSORS)
            observer._kalman.filter.doubtful[1] = 0.0
            found = observer.run(log.time, q, measured, tau)
            ratios.append((found.components - force)[20:] / found.standard_deviation[20:])
        assert np.mean(np.square(ratios)) == pytest.approx(1.0, abs=0.15)
        assert np.mean(np.abs(ratios) < 1.96) == pytest.approx(0.95, abs=0.025)


@pytest.mark.parametrize("settings", [{}, {"force_walk": WALK, "prior": 10.0}, {"force_walk": "gain", "gain": 100.0}])
def test_what_base_rows_cannot_tell_is_zero_with_an_infinite_deviation(settings: dict[str, Any]) -> None:
    """Equal and opposite forces along y, the line of points, leave no trace; all else becomes known to tens of mN."""
    (time, q, v, tau, _), _ = resting_flight(1)
    q[:] = ROBOT.q0
    for kind in (KalmanObserver, SmootherObserver):
        pair = (kind(ROBOT.model, FORCE_POINTS, rows=rows, **settings) for rows in ("base", "all"))
        blind, seeing = (one.run(time, q, v, tau) for one in pair)
        np.testing.assert_allclose(blind.force[:, 0, 1], blind.force[:, 1, 1], atol=1e-6 * np.abs(blind.force).max())
        deviation = blind.standard_deviation.reshape(-1, 2, 3)
        assert np.all(np.isinf(deviation[:, :, 1]))
        assert deviation[-1, :, [0, 2]].max() < 0.5
        assert seeing.standard_deviation[-1].max() < 0.5


def test_a_gain_means_the_same_wherever_the_wings_are() -> None:
    """The walk follows the configuration: kept from the start, Fx of a flapping robot was 10 mN wrong without noise."""
    settings = [f'observers.{name}.force_walk="gain"' for name in ("kalman", "smoother")]
    names = 'observers.names=["force_level", "kalman", "smoother"]'
    found = run(load_scenario("paper", ["simulation.duration=0.5", "observers.gain=2000", names, *settings])).estimates
    for name in ("kalman", "smoother"):
        wrong = np.sqrt(np.mean((found[name].force - found["force_level"].force) ** 2, axis=(0, 1)))
        assert np.all(wrong < 0.003), name


def test_a_covariance_stays_symmetric() -> None:
    """Where all torques but their power are unknown, entries differ by eight orders; rounding must not pile up."""
    model, robot_q = ROBOT.model, ROBOT.q0
    observer = KalmanObserver(model, FORCE_POINTS, force_walk=0.7, rows="base+power")
    speeds = np.random.default_rng(0).normal(size=(400, model.nv)) * SensorNoise(*SENSORS).deviations(model)
    observer.reset(robot_q, speeds[0])
    for k, v in enumerate(speeds[1:]):
        observer.update(1e-3 * (k + 1), robot_q, v, np.zeros(model.nv))
    P = observer._kalman.filter.P
    np.testing.assert_array_equal(P, P.T)
    assert np.linalg.eigvalsh(P / np.sqrt(np.outer(np.diag(P), np.diag(P))))[0] > 0.0


@pytest.mark.parametrize("kind", [KalmanObserver, SmootherObserver])
def test_wrong_torques_do_not_matter_where_they_are_not_believed(kind: type[KalmanObserver]) -> None:
    """Base rows alone: any joint torque. With the power: any that leaves it. Tied wings: any against the tie."""
    model = ROBOT.model
    time, q, v, tau, known = record(model)
    v[:, 6:] += 10.0 * np.array([1.0, -0.5, 0.8, 0.3])
    joints = 0.5 * (v[1:, 6:] + v[:-1, 6:])
    wrong = 0.1 * np.random.default_rng(6).normal(size=joints.shape)
    across = wrong - joints * (np.sum(joints * wrong, axis=1) / np.sum(joints**2, axis=1))[:, None]
    tie = tie_joints(model, {"left_shoulder": "right_shoulder", "left_elbow": "right_elbow"})
    free = np.linalg.svd(tie.map[6:])[0][:, 2:]
    against = wrong @ free @ free.T
    # The power's direction is only as well known as the joint rates are measured: hence the looser bound.
    for rows, extra, near in (("base", wrong, 1e-6), ("base+power", across, 2e-2), (tie, against, 1e-6)):
        told = tau.copy()
        told[:, 6:] += extra
        one, other, naive = (
            kind(model, FORCE_POINTS[:1], rows=which, force_walk=5.0).run(time, q, v, torque, known).components
            for which, torque in ((rows, tau), (rows, told), ("all", told))
        )
        scale = np.abs(one).max()
        assert np.abs(one - other).max() < near * scale
        assert np.abs(naive - one).max() > 10.0 * near * scale


def test_moments_and_directions_have_standard_deviations_of_their_own() -> None:
    """A wrench at one frame and a force along a line at another: seven components, each with its unit's uncertainty."""
    model, frames = MODELS["aerobat, turned frame"]
    flight = record(model)
    where = [Application(frames[0], kind="wrench", axes="frame"), Application(frames[1], direction=(0.0, 1.0, 1.0))]
    estimate = KalmanObserver(model, where, force_walk=1.0, prior=2.0).run(*flight)
    assert estimate.standard_deviation.shape == estimate.components.shape == (len(flight[3]), 7)
    assert np.all(estimate.standard_deviation > 0.0)
    first = estimate.standard_deviation[0]
    assert np.all(first[3:6] < 0.05 * 2.0 * 1.01)  # 50 mm times the prior of a force
    assert np.all(first[[0, 1, 2, 6]] < 2.0 * 1.01)


def test_settings_that_make_no_sense_are_refused() -> None:
    model, frames = MODELS["aerobat"]
    for settings, words in (
        ({"gain": np.ones(6)}, "takes one number"),
        ({"force_walk": "fast"}, "force_walk = 'fast': a number in N/sqrt"),
        ({"force_walk": 0.0}, "force_walk = 0.0: one finite positive number or 6"),
        ({"sensor_noise": (0.1, 0.1, 0.0)}, "sensor_noise = 0.0"),
        ({"error_time": 0.0, "mass_error": 0.1}, "error_time"),
        ({"misfit": 0.0}, "misfit"),
        ({"frequency": 0.0}, "frequency"),
    ):
        with pytest.raises(ObserverError, match=words):
            KalmanObserver(model, frames, **settings)
    time, q, v, tau, known = record(model)
    observer = KalmanObserver(model, frames, known_error={"wind": 0.1})
    with pytest.raises(ObserverError, match="'wind': the known forces are air, other"):
        observer.run(time, q, v, tau, known)
    observer.reset(q[0], v[0])
    with pytest.raises(ObserverError, match="known forces are none"):
        observer.update(1e-3, q[1], v[1], tau[0])
    smoother = SmootherObserver(model, frames)
    smoother.reset(q[0], v[0])
    with pytest.raises(ObserverError, match="use run, or the observer kalman"):
        smoother.update(1e-3, q[1], v[1], tau[0])


def lasting(model: pin.Model, doubt: float = 1.0) -> Expected:
    """Return what is expected of two forces, and of rows that differ."""
    size = float(pin.computeTotalMass(model))
    errors = size * np.linspace(0.5, 1.5, model.nv)
    return Expected(np.full(3, 5.0 * size), errors, 0.7 * errors, np.full(model.nv, 0.3), doubt)


@pytest.mark.parametrize("kind", [KalmanObserver, SmootherObserver])
def test_a_lasting_error_of_a_row_is_a_known_force_of_an_unknown_factor(kind: type[KalmanObserver]) -> None:
    """Forces of one deviation on each row, of factors 0 +- 1 in doubt: the same filter, with a walk and k = 1."""
    model, frames = MODELS["arm"]
    time, q, v, tau, known = record(model)
    rows = lasting(model).row_deviation(0.5 * (v[1:] + v[:-1]))
    factors = {f"row {k}": np.where(np.arange(model.nv) == k, rows, 0.0) for k in range(model.nv)}
    settings: dict[str, Any] = {"sensor_noise": SENSORS, "force_walk": 40.0, "error_time": 0.2}
    found = kind(model, frames[:1], expected=lasting(model), **settings).run(time, q, v, tau, known)
    doubted = kind(model, frames[:1], known_error=dict.fromkeys(factors, 1.0), **settings)
    other = doubted.run(time, q, v, tau - rows, {**known, **factors})
    assert_equal(found.components, other.components, 1e-8)
    assert_equal(found.standard_deviation, other.standard_deviation, 1e-8)


def test_where_errors_last_as_long_as_forces_the_filter_is_the_posterior() -> None:
    """At rest with exact sensors: all samples say the same as one, as if it were known without noise."""
    model, frames = MODELS["arm"]
    q, rest, push = record(model)[1][0], np.zeros(model.nv), np.linspace(1.0, 2.0, model.nv)
    count, expected = 400, lasting(model, 2.0)
    gravity = pin.rnea(model, model.createData(), q, rest, rest)
    record_ = (0.01 * np.arange(count + 1), np.tile(q, (count + 1, 1)), np.zeros((count + 1, model.nv)))
    observer = KalmanObserver(model, frames[:1], sensor_noise=(1e-6,) * 3, misfit=1e-6, expected=expected)
    found = observer.run(*record_, np.tile(gravity - push, (count, 1)))
    J = point_jacobian(model, frames[:1], q)
    P = np.linalg.inv(J @ np.diag(0.5 / expected.row_deviation(rest) ** 2) @ J.T + np.diag(expected.force**-2.0))
    mean = P @ J @ (0.5 / expected.row_deviation(rest) ** 2 * push)
    assert_equal(found.components[-1], mean, 1e-2)
    assert_equal(found.standard_deviation[-1], np.sqrt(np.diag(P)), 1e-2)


def test_a_stated_prior_holds_beside_what_is_expected() -> None:
    """As in a map: at rest the first force is as small as it says, later ones become as large as is expected."""
    model, frames = MODELS["arm"]
    q, rest = record(model)[1][0], np.zeros((41, model.nv))
    tau = np.tile(pin.rnea(model, model.createData(), q, rest[0], rest[0]), (40, 1))
    stated, free = (
        KalmanObserver(model, frames[:1], prior=prior, expected=lasting(model)).run(
            0.01 * np.arange(41), np.tile(q, (41, 1)), rest, tau
        )
        for prior in (0.1, None)
    )
    assert np.all(stated.standard_deviation[0] < 0.5 * free.standard_deviation[0])
    assert np.all(stated.standard_deviation[-1] > stated.standard_deviation[0])


DT, COUNT, HIT = 1e-3, 1000, slice(500, 510)
BLOW = np.array([300.0, -200.0, 1000.0, 0.0, 0.0, 0.0])  # at the centre of mass, world axes


@cache
def hit_box() -> tuple[pin.Model, np.ndarray, np.ndarray, np.ndarray]:
    """Return a box of 3 kg that spins as it falls, and times, q, v of its flight; it is hit for ten milliseconds."""
    model = pin.Model()
    joint = model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "root")
    model.appendBodyToJoint(joint, pin.Inertia(3.0, np.zeros(3), np.diag([0.03, 0.05, 0.06])), pin.SE3.Identity())
    model.addFrame(pin.Frame("box", joint, 0, pin.SE3.Identity(), pin.FrameType.BODY))
    data, q, v = model.createData(), [pin.neutral(model)], [np.array([0.3, 0.0, 0.0, 1.0, 20.0, 5.0])]
    for k in range(10 * COUNT):
        turn = pin.Quaternion(q[-1][3:]).matrix().T
        push = turn @ BLOW[:3] if HIT.start <= k // 10 < HIT.stop else np.zeros(3)
        a = pin.aba(model, data, q[-1], v[-1], np.concatenate([push, np.zeros(3)]))
        v.append(v[-1] + 0.1 * DT * a)
        q.append(pin.integrate(model, q[-1], 0.1 * DT * v[-1]))
    return model, DT * np.arange(COUNT + 1), np.array(q[::10]), np.array(v[::10])


@pytest.mark.parametrize("kind", [KalmanObserver, SmootherObserver])
def test_errors_of_rows_do_not_keep_a_share_of_a_blow(kind: type[KalmanObserver]) -> None:
    """Before and after it nothing pushes, and within two deviations nothing is said to; the blow itself is found."""
    model, time, q, v = hit_box()
    v = v + 2e-3 * np.random.default_rng(1).standard_normal(v.shape)
    rows = np.array([2.0, 4.0, 1.0, 0.1, 0.2, 0.1])
    expected = Expected(np.array([10.0] * 3 + [2.0] * 3), rows, np.zeros(6), np.ones(6))
    observer = kind(model, [Application("box", "wrench")], 100.0, expected=expected)
    found = observer.run(time, q, v, np.zeros((COUNT, 6)))
    truth = np.zeros((COUNT, 6))
    truth[HIT] = BLOW
    within = np.abs(found.components - truth) < 2.0 * found.standard_deviation
    assert np.all(within[100:].mean(axis=0) > 0.95)
    assert np.max(np.abs(found.components[HIT.stop + 20 :])) < 10.0
    assert found.components[HIT, 2].mean() == pytest.approx(1000.0, rel=0.1)


def test_rates_of_usual_noise_hide_no_blow() -> None:
    """300 N on a slide of 1 kg for 20 ms, 0.03 m/s of noise: what says little of a component is relative to others."""
    model = pin.Model()
    slide = model.addJoint(0, pin.JointModelPX(), pin.SE3.Identity(), "slide")
    model.appendBodyToJoint(slide, pin.Inertia(1.0, np.zeros(3), 1e-3 * np.eye(3)), pin.SE3.Identity())
    model.addFrame(pin.Frame("tool", slide, 0, pin.SE3.Identity(), pin.FrameType.OP_FRAME))
    at = np.arange(2 * COUNT + 1)
    v = DT * np.cumsum(np.where((at > COUNT) & (at <= COUNT + 20), 300.0, 0.0))[:, None]
    seen = v + 0.03 * np.random.default_rng(1).standard_normal(v.shape)
    expected = Expected(np.full(3, 3.3), np.array([0.05]), np.zeros(1), np.ones(1))
    observer = KalmanObserver(model, ["tool"], 100.0, expected=expected)
    found = observer.run(DT * at, DT * np.cumsum(v, axis=0), seen, np.zeros((2 * COUNT, 1)))
    assert found.components[COUNT + 10 : COUNT + 20, 0].mean() == pytest.approx(300.0, abs=30.0)


def test_what_leaves_no_trace_does_not_jump() -> None:
    """A glitch of an upright pendulum's rate was 4e6 N across it; in a log, forces grew beyond all numbers."""
    model = pin.Model()
    arm = model.addJoint(0, pin.JointModelRZ(), pin.SE3.Identity(), "arm")
    upright = model.addJoint(arm, pin.JointModelRX(), pin.SE3(np.eye(3), np.array([0.2, 0.0, 0.0])), "pendulum")
    for joint, centre in ((arm, [0.1, 0.0, 0.0]), (upright, [0.0, 0.0, 0.15])):
        model.appendBodyToJoint(joint, pin.Inertia(0.2, np.array(centre), 1e-3 * np.eye(3)), pin.SE3.Identity())
    tip = pin.SE3(np.eye(3), np.array([0.0, 0.0, 0.3]))
    model.addFrame(pin.Frame("tip", upright, 0, tip, pin.FrameType.OP_FRAME))
    q, v = np.tile([0.0, 1e-7], (COUNT + 1, 1)), 1e-4 * np.random.default_rng(1).standard_normal((COUNT + 1, 2))
    v[600, 1] += 0.05
    expected = Expected(np.full(3, 1.0), np.array([0.01, 0.002]), np.zeros(2), np.ones(2))
    observer = KalmanObserver(model, ["tip"], 100.0, expected=expected)
    found = observer.run(DT * np.arange(COUNT + 1), q, v, np.zeros((COUNT, 2)))
    assert np.max(np.abs(found.components)) < 100.0


@pytest.mark.parametrize(("q0", "tip", "blow"), [(0.015, [1.0, 0.0, 0.0], 200.0), (0.3, [0.0, 0.0, 0.2], 0.0)])
def test_a_door_that_is_hit_says_across_it_alone(q0: float, tip: list[float], blow: float) -> None:
    """One row explains each component: -12 kN came along the door, and 4e19 N at a point on its axis."""
    model = pin.Model()
    place = pin.SE3(pin.rpy.rpyToMatrix(1.3 if not blow else 0.0, 0.4 if not blow else 0.0, 0.0), np.zeros(3))
    hinge = model.addJoint(0, pin.JointModelRZ(), place, "hinge")
    inertia = pin.Inertia(5.0, np.array([0.5, 0.0, 0.0]), np.diag([0.1, 0.5, 0.5]))
    model.appendBodyToJoint(hinge, inertia, pin.SE3.Identity())
    model.addFrame(pin.Frame("tip", hinge, 0, pin.SE3(np.eye(3), np.array(tip)), pin.FrameType.OP_FRAME))
    model.gravity.linear = np.zeros(3)
    q, v, hit = [q0], [0.0], range(COUNT, COUNT + 10)
    for k in range(3 * COUNT // 2):
        v.append(v[-1] + DT * (200.0 * np.cos(q[-1]) / 1.75 if k in hit else 0.0))
        q.append(q[-1] + 0.5 * DT * (v[-1] + v[-2]))
    seen = np.array(v)[:, None] + 1e-3 * np.random.default_rng(1).standard_normal((len(v), 1))
    expected = Expected(np.full(3, 10.0), np.array([0.3]), np.zeros(1), np.ones(1))
    observer = KalmanObserver(model, ["tip"], 100.0, expected=expected)
    found = observer.run(DT * np.arange(len(q)), np.array(q)[:, None], seen, np.zeros((len(q) - 1, 1))).components
    assert found[COUNT + 2 : hit.stop, 1].mean() == pytest.approx(blow, abs=5.0)
    assert np.max(np.abs(found[:, [0, 2]])) < 20.0
