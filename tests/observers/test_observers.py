"""All observers on any Pinocchio model: sign, gain, lag and noise, start, frames by name, and clear refusals."""

from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from support.arm import arm, push, rest
from support.without_coriolis import links

from aerobat_pin import observers
from aerobat_pin.aerobat import FORCE_POINTS, known_inputs, load_aerobat
from aerobat_pin.errors import ArgumentError, FrameNotFoundError, ObserverError, ShapeError
from aerobat_pin.experiments import Experiment
from aerobat_pin.numerics import frame_id
from aerobat_pin.observers.analysis.noise_and_lag import lag_of, noise_gain

KINDS = [kind for kind in observers.OBSERVERS.values() if kind is not observers.SmootherObserver]  # of whole records


def by_gain(kind: type[observers.Observer]) -> dict[str, Any]:
    """Return the setting with which an observer follows its gain; the Kalman filter does not as it comes."""
    return {"force_walk": "gain"} if issubclass(kind, observers.KalmanObserver) else {}


@pytest.mark.parametrize("kind", KINDS)
def test_a_step_has_risen_by_63_percent_at_one_over_the_gain(kind: type[observers.Observer]) -> None:
    """The gain means the same to every observer: 1 - 1/e of a step of 1 N at t = 1/K, and all of it ten times later."""
    model, frame = arm()
    q, v = np.random.default_rng(1).uniform(-1.0, 1.0, model.nq), np.zeros(model.nv)
    observer = kind(model, [frame], gain=50.0, **by_gain(kind))
    observer.reset(q, v)
    tau = rest(model, q) - push(model, frame, q, np.array([0.0, 0.0, 1.0]))
    rise = np.array([observer.update((k + 1) * 1e-4, q, v, tau).force[0, 2] for k in range(2000)])
    assert rise[199] == pytest.approx(1.0 - np.exp(-1.0), abs=0.05)
    assert rise[-1] == pytest.approx(1.0, abs=2e-3)


@pytest.mark.parametrize("kind", KINDS)
def test_a_gain_far_beyond_the_sample_rate_is_stable(kind: type[observers.Observer]) -> None:
    """K dt = 50, where an explicit filter explodes: a noisy force is followed, within its own size."""
    model, frame = arm()
    q, v, rng = np.random.default_rng(1).uniform(-1.0, 1.0, model.nq), np.zeros(model.nv), np.random.default_rng(2)
    observer = kind(model, [frame], gain=50_000.0, **by_gain(kind))
    observer.reset(q, v)
    for k in range(200):
        force = rng.uniform(-1.0, 1.0, 3)
        sample = observer.update((k + 1) * 1e-3, q, v, rest(model, q) - push(model, frame, q, force))
        assert np.abs(sample.force[0] - force).max() < 0.1


@pytest.mark.parametrize("kind", KINDS)
def test_no_force_and_a_reset_in_flight_give_zero_without_a_spike(kind: type[observers.Observer]) -> None:
    """p0 is the momentum of the first sample: a tumbling robot without forces reads zero from the first interval."""
    robot = load_aerobat("aerobat_light")
    model = robot.model.copy()
    model.gravity.linear = np.zeros(3)
    data = model.createData()
    rng = np.random.default_rng(3)
    q, v = robot.q0, rng.normal(size=model.nv)
    observer = kind(model, ["left_force_point", "right_force_point"], gain=1000.0)
    observer.reset(q, v)
    largest = 0.0
    for k in range(50):
        middle = v + 0.5e-4 * pin.aba(model, data, q, v, np.zeros(model.nv))
        a = pin.aba(model, data, pin.integrate(model, q, 0.5e-4 * v), middle, np.zeros(model.nv))
        q, v = pin.integrate(model, q, 1e-4 * middle), v + 1e-4 * a
        sample = observer.update((k + 1) * 1e-4, q, v, np.zeros(model.nv))
        largest = max(largest, float(np.abs(sample.force).max()))
        if k == 25:
            observer.reset(q, v, time=(k + 1) * 1e-4)
            assert observer.update((k + 1) * 1e-4, q, v, np.zeros(model.nv)).force.max() == 0.0
    spike = np.abs(pin.crba(model, data, q) @ v).max() / 1e-4  # what a missing p0 would show first
    assert spike > 100.0
    assert largest < 1e-6


def test_results_stay_as_they_are_where_a_caller_uses_arrays_again() -> None:
    """The times of an estimate, the wrench of a line of action."""
    model, frame = arm()
    time, q, wrench = np.array([5.0, 5.1]), pin.neutral(model), np.array([0.0, 0.0, 1.0, 0.0, 0.1, 0.0])
    tau = rest(model, q)[None]
    estimate = observers.MomentumObserver(model, [frame]).run(time, np.array([q, q]), np.zeros((2, model.nv)), tau)
    line = observers.locate(wrench, 1e-6 * np.eye(6))
    time -= 5.0
    wrench *= [0.0, 0.0, 1.0, 0.0, 5.0, 0.0]
    np.testing.assert_array_equal(estimate.time, [5.0, 5.1])
    np.testing.assert_allclose(line.point, [-0.1, 0.0, 0.0])


@pytest.mark.parametrize("kind", KINDS)
def test_what_does_not_fit_is_refused_by_name(kind: type[observers.Observer]) -> None:
    """Bad frames, gains, shapes, NaN and time each raise their own error."""
    model, frame = arm()
    q, v, tau = pin.neutral(model), np.zeros(model.nv), np.zeros(model.nv)
    with pytest.raises(FrameNotFoundError, match=r"no frame named 'tol'.*tool"):
        kind(model, ["tol"])
    with pytest.raises(ObserverError, match="different names"):
        kind(model, [frame, frame])
    for gain in (-1.0, 0.0, np.nan, np.inf):
        with pytest.raises(ObserverError, match="positive gain"):
            kind(model, [frame], gain=gain)
    with pytest.raises(ObserverError, match=r"one number, \d numbers or a matrix"):
        kind(model, [frame], gain=np.ones(17))
    observer = kind(model, [frame])
    with pytest.raises(ObserverError, match="reset"):
        observer.update(0.1, q, v, tau)
    observer.reset(q, v, time=1.0)
    with pytest.raises(ObserverError, match="must not decrease"):
        observer.update(0.9, q, v, tau)
    with pytest.raises(ObserverError, match="must not decrease"):
        observer.update(float("nan"), q, v, tau)
    with pytest.raises(ShapeError, match="tau holds NaN"):
        observer.update(1.1, q, v, np.full(model.nv, np.nan))
    with pytest.raises(ShapeError, match=r"wind has shape \(2,\)"):
        observer.update(1.1, q, v, tau, {"wind": np.zeros(2)})
    for wind in ([0.1], 0.1):
        with pytest.raises(ShapeError, match="wind has shape"):
            observer.update(1.1, q, v, tau, {"wind": np.array(wind)})
    with pytest.raises(ShapeError, match="q has shape"):
        observer.update(1.1, q[:-1], v, tau)
    with pytest.raises(ShapeError, match="q has 1 rows"):
        observer.run([0.0, 1.0], q[None], np.zeros((2, model.nv)), tau[None])
    with pytest.raises(ShapeError, match=r"tau holds NaN, infinity or a number beyond 1e\+15"):
        observer.update(1.1, q, v, np.full(model.nv, 1e307))
    strict = observer.update(1.1, q, v, rest(model, q))
    np.testing.assert_allclose(strict.force, 0.0, atol=1e-9)
    loose = observer.update(1.2, list(q), v.astype(np.float32), rest(model, q).tolist())
    np.testing.assert_allclose(loose.force, 0.0, atol=1e-9)


@pytest.mark.parametrize("kind", KINDS)
def test_a_configuration_that_is_none_is_refused_and_the_stream_stays_as_it_was(kind: type[observers.Observer]) -> None:
    """Pinocchio would take any quaternion for some attitude; one of float32 is good enough."""
    robot = load_aerobat()
    model, q, v = robot.model, robot.q0, np.zeros(robot.model.nv)
    observer, other = (kind(model, ["left_force_point"], 200.0) for _ in range(2))
    for one in (observer, other):
        one.reset(q.astype(np.float32), v)
    far, wrong = q.copy(), {rf"q\[3:7\] of sample {{}} has length {length}": q.copy() for length in (0, 2, 3)}
    far[2] = -1e9
    for length, turned in zip((0, 2, 3), wrong.values(), strict=True):
        turned[3:7] *= length
    for message, refused in {**wrong, r"q\[2\] of sample {} = -1e\+09: at most 1e\+06 m or rad": far}.items():
        with pytest.raises(ShapeError, match=message.format(0)):
            observer.update(1e-3, refused, v, v)
        with pytest.raises(ShapeError, match=message.format(1)):
            observer.run([0.0, 1.0], np.array([q, refused]), np.zeros((2, model.nv)), np.zeros((1, model.nv)))
    np.testing.assert_array_equal(observer.update(1e-3, q, v, v).force, other.update(1e-3, q, v, v).force)
    for refused in (*wrong.values(), far):
        with pytest.raises(ShapeError, match="of sample 0"):
            observer.reset(refused, v)


@pytest.mark.parametrize(("joint", "pair"), [(pin.JointModelPlanar(), "2:4"), (pin.JointModelRUBZ(), "0:2")])
def test_wheels_and_planar_joints_stream_too(joint: pin.JointModel, pair: str) -> None:
    """Their pairs of cosine and sine are unit vectors as well."""
    model = links(joint)
    observer, q, v = observers.MomentumObserver(model), pin.neutral(model), np.zeros(model.nv)
    observer.reset(q, v)
    observer.update(1e-3, q, v, v)
    for size in (0.0, 2.0):
        with pytest.raises(ShapeError, match=rf"q\[{pair}\] of sample 0 has length {size:g}"):
            observer.update(2e-3, q * size, v, v)


def test_without_frames_momentum_gives_the_residual_alone_and_force_level_refuses() -> None:
    """The generalised residual needs no point of application; a force does."""
    model, frame = arm()
    q, v = np.random.default_rng(1).uniform(-1.0, 1.0, model.nq), np.zeros(model.nv)
    bare, full = observers.MomentumObserver(model, gain=50.0), observers.MomentumObserver(model, [frame], gain=50.0)
    for observer in (bare, full):
        observer.reset(q, v)
    stream = [observer.update(1e-3, q, v, np.zeros(model.nv)) for observer in (bare, full)]
    batch = [one.run([0.0, 1e-3], np.array([q, q]), np.array([v, v]), np.zeros((1, model.nv))) for one in (bare, full)]
    for without, points in (stream, batch):
        assert without.force.shape[-2:] == (0, 3)
        np.testing.assert_array_equal(without.residual, points.residual)
    with pytest.raises(ObserverError, match="one frame or more"):
        observers.ForceLevelObserver(model)


URDF = """<robot name="arm"><link name="base"/><link name="tip"/><joint name="tip" type="fixed">
<parent link="base"/><child link="tip"/><origin xyz="0 0 0.3"/></joint></robot>"""


def test_a_joint_and_a_link_of_one_name_are_one_frame() -> None:
    """Pinocchio gives both a frame, at the same place, and refuses the name alone."""
    model = pin.buildModelFromXML(URDF)
    with pytest.raises(ValueError, match="Several frames"):
        model.getFrameId("tip")
    assert model.frames[frame_id(model, "tip")].placement.translation[2] == 0.3


def test_frames_of_one_name_at_different_places_are_refused() -> None:
    """Nobody can say which is meant."""
    model = pin.buildModelFromXML(URDF)
    model.addFrame(pin.Frame("tip", 0, pin.SE3.Identity(), pin.FrameType.OP_FRAME))
    with pytest.raises(ArgumentError, match="frame 'tip': 3 frames have this name, at different places"):
        frame_id(model, "tip")


CLOSED_FORMS = [observers.MomentumObserver, observers.ForceLevelObserver, observers.SecondOrderObserver]
NOISE = observers.SensorNoise(linear_velocity=0.02, gyro=0.01, joint_rate=0.05)
DT = 1e-3


def scene(name: str) -> tuple[pin.Model, list[str | observers.Application], np.ndarray]:
    if name == "arm":
        model, frame = arm()
        q = np.random.default_rng(1).uniform(-1.0, 1.0, model.nq)
        return model, [observers.Application(frame, "wrench", "frame")], q
    robot = load_aerobat("aerobat_light")
    return robot.model, ["left_force_point", "right_force_point"], robot.q0


@pytest.mark.parametrize("kind", CLOSED_FORMS)
@pytest.mark.parametrize(("name", "gain"), [("arm", 50.0), ("aerobat", 1000.0)])
def test_predicted_noise_is_what_the_observer_shows(name: str, gain: float, kind: type[observers.Observer]) -> None:
    """Held still, velocity noise a hundredth of the benchmark's, for what it does to C^T v: all within 5 %."""
    model, acting, q = scene(name)
    noise = observers.SensorNoise(2e-4, 1e-4, 5e-4)
    observer, count = kind(model, acting, gain), 12000
    v = np.random.default_rng(3).normal(size=(count + 1, model.nv)) * noise.deviations(model)
    tau = np.tile(rest(model, q), (count, 1))
    estimate = observer.run(np.arange(count + 1) * DT, np.tile(q, (count + 1, 1)), v, tau)
    predicted, settled = observers.predict(observer, q, DT, noise), round(5.0 / gain / DT)
    assert predicted.labels == estimate.identifiability.components
    np.testing.assert_allclose(np.std(estimate.components[settled:], axis=0), predicted.deviation, rtol=0.05)
    worst = np.corrcoef(estimate.components[settled:].T) - predicted.covariance / np.outer(*2 * [predicted.deviation])
    assert np.abs(worst).max() < 0.1


@pytest.mark.parametrize("kind", CLOSED_FORMS)
def test_the_prediction_holds_in_flapping_flight(paper: Experiment, kind: type[observers.Observer]) -> None:
    """The paper's flight with the benchmark's velocity noise, K = 200 1/s: within 15 %, averaged over the flight."""
    inputs, model = known_inputs(paper.log, paper.robot), paper.robot.model
    noisy = inputs.v + np.random.default_rng(4).normal(size=inputs.v.shape) * NOISE.deviations(model)
    observer = kind(model, list(FORCE_POINTS), 200.0)
    runs = [observer.run(inputs.time, inputs.q, v, inputs.tau, inputs.known).components for v in (inputs.v, noisy)]
    predicted = [observers.predict(observer, q, DT, NOISE).deviation for q in inputs.q[::50]]
    expected = np.sqrt(np.mean(np.square(predicted), axis=0))
    np.testing.assert_allclose(np.std(runs[1] - runs[0], axis=0), expected, rtol=0.15)


@pytest.mark.parametrize("kind", CLOSED_FORMS)
@pytest.mark.parametrize("gain", [20.0, 1000.0, 20000.0])
def test_a_ramp_lags_by_the_predicted_time(kind: type[observers.Observer], gain: float) -> None:
    """A force that grows by 1 N/s, against the mean over the same interval: to a millionth of a second."""
    model, frame = arm()
    q = np.random.default_rng(1).uniform(-1.0, 1.0, model.nq)
    observer, count = kind(model, [frame], gain), max(200, round(40.0 / gain / DT))
    mean = (np.arange(count) + 0.5) * DT
    tau = rest(model, q) - mean[:, None] * push(model, frame, q, np.array([1.0, 0.0, 0.0]))
    still = np.zeros((count + 1, model.nv))
    estimate = observer.run(np.arange(count + 1) * DT, np.tile(q, (count + 1, 1)), still, tau)
    lag = mean[-1] - estimate.component("tool.Fx")[-1]
    assert lag == pytest.approx(lag_of(kind, gain, DT), abs=1e-6)


@pytest.mark.parametrize("kind", CLOSED_FORMS)
def test_the_closed_forms_are_the_sums_they_stand_for(kind: type[observers.Observer]) -> None:
    """Impulse answers of the filters by their own recursion, squared and summed, for K dt from 0.001 to 50."""
    for x in (1e-3, 0.1, 1.0, 5.0, 50.0):
        pole = np.exp(-x if kind.name != "second_order" else -2.1461932206205825 * x)
        rate = -np.log(pole)
        state, slope, answers = 0.0, 0.0, []
        for k in range(round(30.0 / rate) + 3):
            value = {0: 1.0, 1: -1.0}.get(k, 0.0)
            gap = state - value
            if kind.name == "second_order":
                drive = slope + rate * gap
                state, slope = value + (gap + drive) * pole, (slope - rate * drive) * pole
            else:
                state = value + pole * gap
            answers.append(state)
        assert noise_gain(kind, x / DT, DT) * DT == pytest.approx(np.linalg.norm(answers), rel=1e-6)


@pytest.mark.parametrize("kind", CLOSED_FORMS)
def test_the_gain_for_a_lag_or_a_noise_gives_it(kind: type[observers.Observer]) -> None:
    """Both ways round; and near K dt = 0 the rules of thumb: lag 1/K, deviation K times that of the momentum."""
    model, acting, q = scene("aerobat")
    for lag in (0.3e-3, 5e-3, 0.1):
        assert lag_of(kind, observers.gain_for_lag(kind, DT, lag), DT) == pytest.approx(lag, rel=1e-9)
    observer, label = kind(model, acting, 500.0), "right_force_point.Fz"
    gain = observers.gain_for_deviation(observer, q, DT, NOISE, label, 0.05)
    found = observers.predict(kind(model, acting, gain), q, DT, NOISE)
    assert found.deviation[found.labels.index(label)] == pytest.approx(0.05, rel=1e-9)
    if kind is not observers.SecondOrderObserver:
        assert observers.gain_for_lag(kind, 1e-5, 0.1) == pytest.approx(10.0, rel=1e-3)
        assert noise_gain(kind, 10.0, 1e-5) == pytest.approx(10.0, rel=1e-3)
    gains = np.geomspace(0.02, 5e3, 200)
    assert np.all(np.diff([noise_gain(kind, one, DT) for one in gains]) > 0.0)
    assert np.all(np.diff([lag_of(kind, one, DT) for one in gains]) < 0.0)


def test_a_free_base_has_its_own_sensors() -> None:
    """Linear velocity, gyro and joint rates on a free-flyer; joint rates alone on a fixed base."""
    expected = [0.02] * 3 + [0.01] * 3 + [0.05] * 4
    np.testing.assert_array_equal(NOISE.deviations(load_aerobat().model), expected)
    np.testing.assert_array_equal(NOISE.deviations(arm()[0]), np.full(6, 0.05))


def test_what_no_gain_can_give_is_refused_with_what_can_be_had() -> None:
    """Impossible lag or noise, unknown or unknowable components, observers without a closed form."""
    model, acting, q = scene("aerobat")
    observer = observers.ForceLevelObserver(model, acting, 500.0)
    with pytest.raises(ObserverError, match=r"lag = -1\.0 s: with samples every 0\.001 s, gains give"):
        observers.gain_for_lag(observer, DT, -1.0)
    with pytest.raises(ObserverError, match=r"deviation = 1000\.0 N: .* gains give .* N$"):
        observers.gain_for_deviation(observer, q, DT, NOISE, "left_force_point.Fx", 1e3)
    with pytest.raises(ObserverError, match=r"no component 'left.Fx'; there are left_force_point.Fx"):
        observers.gain_for_deviation(observer, q, DT, NOISE, "left.Fx", 1.0)
    squeezed = observers.ForceLevelObserver(model, acting, 500.0, "base")
    assert np.isinf(observers.predict(squeezed, q, DT, NOISE).deviation[1])
    with pytest.raises(ObserverError, match="leaves no trace"):
        observers.gain_for_deviation(squeezed, q, DT, NOISE, "left_force_point.Fy", 1.0)
    with pytest.raises(ObserverError, match="super_twisting has no closed form; there is one for momentum"):
        observers.predict(observers.SuperTwistingObserver(model, acting), q, DT, NOISE)
    with pytest.raises(ObserverError, match="one number was expected"):
        observers.predict(observers.ForceLevelObserver(model, acting, np.ones(6)), q, DT, NOISE)
    with pytest.raises(ShapeError, match="q has shape"):
        observers.predict(observer, q[:-1], DT, NOISE)
