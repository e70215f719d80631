"""Predicted noise and lag against the observers themselves, and the gain for what is wanted."""

import numpy as np
import pinocchio as pin
import pytest
from support.arm import arm, push, rest

from aerobat_pin import observers
from aerobat_pin.aerobat import FORCE_POINTS, known_inputs, load_aerobat
from aerobat_pin.errors import ObserverError, ShapeError
from aerobat_pin.experiments import Experiment
from aerobat_pin.observers.analysis.noise_and_lag import lag_of, noise_gain

KINDS = [observers.MomentumObserver, observers.ForceLevelObserver, observers.SecondOrderObserver]
NOISE = observers.SensorNoise(linear_velocity=0.02, gyro=0.01, joint_rate=0.05)
DT = 1e-3


def scene(name: str) -> tuple[pin.Model, list[str | observers.Application], np.ndarray]:
    if name == "arm":
        model, frame = arm()
        q = np.random.default_rng(1).uniform(-1.0, 1.0, model.nq)
        return model, [observers.Application(frame, "wrench", "frame")], q
    robot = load_aerobat("aerobat_light")
    return robot.model, ["left_force_point", "right_force_point"], robot.q0


@pytest.mark.parametrize("kind", KINDS)
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


@pytest.mark.parametrize("kind", KINDS)
def test_the_prediction_holds_in_flapping_flight(paper: Experiment, kind: type[observers.Observer]) -> None:
    """The paper's flight with the benchmark's velocity noise, K = 200 1/s: within 15 %, averaged over the flight."""
    inputs, model = known_inputs(paper.log, paper.robot), paper.robot.model
    noisy = inputs.v + np.random.default_rng(4).normal(size=inputs.v.shape) * NOISE.deviations(model)
    observer = kind(model, list(FORCE_POINTS), 200.0)
    runs = [observer.run(inputs.time, inputs.q, v, inputs.tau, inputs.known).components for v in (inputs.v, noisy)]
    predicted = [observers.predict(observer, q, DT, NOISE).deviation for q in inputs.q[::50]]
    expected = np.sqrt(np.mean(np.square(predicted), axis=0))
    np.testing.assert_allclose(np.std(runs[1] - runs[0], axis=0), expected, rtol=0.15)


@pytest.mark.parametrize("kind", KINDS)
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


@pytest.mark.parametrize("kind", KINDS)
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


@pytest.mark.parametrize("kind", KINDS)
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
