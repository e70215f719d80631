"""What metrics, terminal and report say about how far an estimate can be trusted."""

import json

import numpy as np
import pytest

from aerobat_pin.experiments.experiment import Experiment, run
from aerobat_pin.forces import ObserverScores, deviations
from aerobat_pin.observers import OBSERVERS
from aerobat_pin.records import load_robot
from aerobat_pin.scenario.scenario import load_scenario
from aerobat_pin.visualization.result_pages import report_html

NAMES = 'observers.names=["momentum", "force_level", "kalman"]'
SHORT = ("simulation.duration=0.2", "air.warm_up_cycles=1", NAMES)


def flown(*settings: str) -> Experiment:
    """Fly the first 0.2 s of `paper`."""
    return run(load_scenario("paper", [*SHORT, *settings]))


def test_unseen_forces_have_an_infinite_deviation_in_every_table() -> None:
    """Without joint torques, Fy of either wing: `null` in metrics, `infinite` in terminal and report."""
    experiment = flown("observers.torque=none")
    observers = experiment.metrics["observers"]
    assert "deviation" in observers["kalman"]
    for wing in ("left", "right"):
        x, y, z = observers["kalman"]["deviation"][wing]
        assert y is None
        assert 0.0 < x < 1.0
        assert 0.0 < z < 1.0
    assert observers["force_level"]["deviation"] is None
    for row in experiment.scores.rows():
        assert (row[-1] == "infinite") == (row[2] == "Fy")
    assert "infinite" in repr(experiment.scores)
    assert "infinite" in report_html(experiment, {})


def test_the_belief_is_judged_in_words_and_numbers() -> None:
    """Consistent, or off by so much; the same for all observers, and a warning where it is off."""
    right, wrong = flown(), flown('believed.air.model="quasi_steady"')
    for experiment, verdict in ((right, "consistent"), (wrong, "inconsistent")):
        for entry in experiment.metrics["observers"].values():
            assert entry["redundancy"]["verdict"] == verdict
            assert (entry["redundancy"]["rows"], entry["redundancy"]["redundant"]) == (10, 4)
        assert len(experiment.scores.judgements) == 1
    assert right.metrics["warnings"] == []
    assert right.metrics["observers"]["force_level"]["redundancy"]["rms"] < 1e-3
    assert wrong.metrics["observers"]["force_level"]["redundancy"]["rms"] > 0.02
    *_, warning = wrong.metrics["warnings"]  # behind what the checks of the efforts say of the air
    assert warning.startswith("momentum, force_level, kalman: belief off by about")
    assert "not to be trusted; blind to errors that look like forces at left_force_point" in warning
    for text in (repr(wrong.scores), report_html(wrong, {})):
        assert "not to be trusted" in text
    assert "innovations" in repr(right.scores)
    assert set(right.metrics["observers"]["kalman"]["innovation"]) == {"nis", "whiteness"}


def test_momentum_says_what_it_loses_when_the_motors_torque_alone_is_known() -> None:
    """It alone; a file of metrics gives the scores back."""
    experiment = flown("observers.torque=motor_only")
    (warning,) = experiment.metrics["warnings"]
    assert warning.startswith("momentum: filters the rows before it combines them")
    assert warning in repr(experiment.scores)
    for name, found in experiment.scores.observers.items():
        assert ObserverScores.from_json(json.loads(json.dumps(experiment.metrics["observers"][name]))) == found


@pytest.mark.parametrize("seed", range(3))
def test_noise_is_told_from_a_force_that_swings_and_steps(seed: int) -> None:
    """White noise of 3 mN on a wave of 6 Hz and 100 mN with a step and a push: found within a tenth."""
    # The variance of the n-th difference of white noise is the sum of squared binomial coefficients, comb(2 n, n).
    time = 1e-3 * np.arange(2000)
    force = 0.1 * np.sin(2.0 * np.pi * 6.0 * time) + 0.1 * (time > 1.0) + 1.0 * (np.abs(time - 1.5) < 5e-4)
    noisy = force + np.random.default_rng(seed).normal(0.0, 3e-3, len(time))
    assert deviations.sample_noise(np.column_stack([noisy, force])) == pytest.approx([3e-3, 0.0], rel=0.1, abs=1e-5)
    assert deviations.sample_noise(noisy[:8, None]).tolist() == [0.0]


def test_an_estimate_that_is_mostly_noise_says_so() -> None:
    """Noisy sensors and a gain: the components whose error is as large as they are, and only of that observer."""
    experiment = run(load_scenario("noisy_sensors", ["simulation.duration=0.5", "air.warm_up_cycles=1"]))
    noisy, smooth = (deviations.warnings_about(experiment.estimates[name]) for name in ("force_level", "smoother"))
    [warning] = [text for text in noisy if "noise" in text]
    assert "left_force_point.Fx 2" in warning
    assert "Fy" in warning  # in bursts: an octant of the crank has ten times the noise of the rest
    assert not [text for text in smooth if "noise" in text]
    error = experiment.scores.observers["force_level"].points["left"]["Fx"].rmse
    found = deviations.sample_noise(experiment.estimates["force_level"].components)[0]
    assert found == pytest.approx(error, rel=0.25)


def test_the_worst_second_is_found_with_its_time() -> None:
    """A k of 20 for half a second in ten makes 10 + 1/2 of a second that begins there; what is shorter has none."""
    time = np.linspace(0.0, 10.0, 1001)
    k = np.where((time[:-1] > 3.995) & (time[:-1] < 4.495), 20.0, 1.0)
    largest, begin = deviations.worst_stretch(time, k)
    assert largest == pytest.approx(10.5)
    assert 3.45 < begin < 4.05
    assert deviations.worst_stretch(time[:51], k[:50]) == (0.0, 0.0)


def test_noise_of_large_forces_is_said_in_their_unit() -> None:
    """1.2e+08 of 6.6e+07 mN was said of a crane."""
    rng = np.random.default_rng(5)
    model = load_robot("ur5").model
    time, still = np.arange(401) * 1e-3, np.zeros((401, 6))
    tau = 1e8 * rng.standard_normal((400, 6))
    estimate = OBSERVERS["force_level"](model, ("tool0",), 1000.0, "all").run(time, still, still, tau, {})
    assert any("kN beside" in line for line in deviations.warnings_about(estimate))


def test_deviations_contain_what_a_filter_lags_behind() -> None:
    """A push that swings at up to twice the filter's rate, a step and a ramp; a stream says the same as a record."""
    dt, gain = 2e-3, 100.0
    t = dt * np.arange(2000)
    swings = [np.sin(rate * gain * t) for rate in (0.1, 0.3, 1.0, 1.9)]
    force = np.column_stack([*swings, np.where(t > 2.0, 1.0, 0.0), t])
    kept, found = np.exp(-gain * dt), np.zeros_like(force)
    for k in range(1, len(t)):
        found[k] = force[k] + kept * (found[k - 1] - force[k])
    noise = np.full(found.shape, 0.01)
    lag, behind = (
        deviations.lag_of_filter(found, np.full(len(t), dt), gain, noise),
        np.zeros((deviations.LAGS, force.shape[1])),
    )
    within = np.abs(found - force)[100:] <= 2.0 * np.hypot(lag, noise)[100:]
    assert np.all(within.mean(axis=0) > 0.95)
    assert np.all(lag[100:].mean(axis=0) < 2.0 * np.abs(found - force)[100:].mean(axis=0))
    for components, sure in zip(found, lag, strict=True):
        deviation = noise[0].copy()
        deviations.add_lag_of_filter(components, kept, behind, deviation)
        np.testing.assert_allclose(deviation, np.hypot(noise[0], sure), atol=1e-12)


def test_noise_of_late_is_that_of_the_samples_and_of_no_step() -> None:
    """White noise that becomes ten times as large half way, and a step of a thousand; a stream says the same."""
    rng, half = np.random.default_rng(3), 2000
    found = rng.standard_normal((2 * half, 2)) * np.repeat([[1.0, 0.1], [10.0, 0.1]], half, axis=0)
    found[half:, 1] += 1e3
    noise, recent = deviations.recent_noise(found), np.zeros((deviations.RECENT, 2))
    assert np.mean(noise[100:half, 0]) == pytest.approx(1.0, rel=0.1)
    assert np.mean(noise[half + 100 :, 0]) == pytest.approx(10.0, rel=0.1)
    assert np.max(noise[half : half + 200, 1]) < 30.0  # of the step
    assert np.mean(noise[half + 200 :, 1]) == pytest.approx(0.1, rel=0.1)
    for components, sure in zip(found, noise, strict=True):
        deviation = np.zeros(2)
        deviations.raise_to_noise(components, recent, deviation)
        np.testing.assert_allclose(deviation, sure, rtol=1e-9)
