"""What is said of a result: one sentence first, scores, deviations, how far it can be trusted, and metrics.json."""

import json
import math
import re
from dataclasses import asdict, replace
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import numpy as np
import pinocchio as pin
import pytest
from scipy.signal import lfilter
from support.recorded import edited, recorded
from support.swinging_arm import arm, arm_map, recording
from support.walking_log import table, table_map, urdf, walk

from aerobat_pin.aerobat import FlightLog, true_events, true_force
from aerobat_pin.estimation import Finding, Result, estimate
from aerobat_pin.estimation.findings import quantity
from aerobat_pin.experiments import Experiment, run, write
from aerobat_pin.flight import simulate
from aerobat_pin.forces import (
    CalibrationUse,
    Contact,
    Moments,
    ObserverScores,
    PairedEstimate,
    StoredEstimate,
    along_itself,
    deviations,
    largest_of,
)
from aerobat_pin.forces.deviations import warnings_about
from aerobat_pin.forces.observer_scores import MEDIAN_DEVIATION, score_table
from aerobat_pin.forces.scores import lag, r_squared
from aerobat_pin.observers import OBSERVERS, Estimate, Expected, force_size
from aerobat_pin.observers.frames import euler_angles, world_velocity
from aerobat_pin.records import TrueEvent, load_robot, series_of
from aerobat_pin.scenario import load_scenario, parse_scenario
from aerobat_pin.visualization import draw_estimation, report_html

SEEN = "every direction of these forces can be seen."


def judged(paper: Experiment, made: Estimate) -> Result:
    """Return the result of an estimate that nothing is compared with."""
    return replace(paper.scores, stored={"momentum": StoredEstimate.of(made)}, references=(), events=())


def noisy(paper: Experiment, deviation: float = 0.01, *, stated: bool = True) -> Estimate:
    """Return an estimate of nothing but white noise."""
    made = paper.estimates["momentum"]
    noise = np.random.default_rng(1).normal(0.0, deviation, made.components.shape)
    sure = np.full_like(noise, deviation) if stated else None
    return replace(made, components=noise, standard_deviation=sure)


def test_the_verdict_comes_first_everywhere(paper: Experiment) -> None:
    """On the terminal, in the report, in a notebook and in `metrics.json`; its numbers are those of the table."""
    verdict = paper.scores.verdict
    force = np.linalg.norm(paper.estimates["momentum"].force, axis=2)
    left, right = (quantity(float(size), "N") for size in force.max(axis=0))
    told = f"momentum finds a push at left (up to {left} upward, at 1.11 s) and right (up to {right}"
    assert verdict.startswith(told)
    scores = [one.rmse for axes in paper.scores.observers["momentum"].points.values() for one in axes.values()]
    error = quantity(float(np.linalg.norm(scores)) / 2**0.5, "N")
    assert f"it is off the true force by {error} rms, 1.4 % of it; {SEEN}" in verdict
    assert repr(paper.scores).splitlines()[0] == verdict
    assert paper.metrics["verdict"] == verdict
    assert f"<b>{verdict}</b>" in paper._repr_html_()
    page = report_html(paper, {})
    assert page.index(verdict) < page.index("<h2") < page.index("<table")
    assert paper.metrics["warnings"] == []
    assert "warning" not in repr(paper.scores)
    assert "contradicts itself" not in page


def test_it_is_the_first_observers_not_the_best_ones(paper: Experiment) -> None:
    """Who is nearest to the truth is known in a simulation alone."""
    first = paper.scores.verdict
    turned = replace(paper.scores, stored=dict(reversed(paper.scores.stored.items())))
    assert first.startswith("momentum ")
    assert turned.verdict.startswith("force_level ")


@pytest.mark.parametrize("stated", [True, False])
def test_noise_is_no_push_and_a_push_in_noise_is_one(paper: Experiment, stated: bool) -> None:
    """Ten errors high for one sample, or two errors for all the time; the place, the time and the way are named."""
    made = noisy(paper, stated=stated)
    sure = "its standard deviation, as stated, is 17.3 mN" if stated else "how sure that is cannot be said"
    quiet = judged(paper, made).verdict
    assert quiet.startswith(f"momentum finds no push that stands out from its errors; {sure}")
    for where, size, words in ((slice(700, 701), -0.2, "downward"), (slice(None), -0.06, "")):
        components = made.components.copy()
        components[where, 5] += size
        found = judged(paper, replace(made, components=components)).verdict
        assert found.startswith("momentum finds a push at right (up to ")
        assert (" +-10 mN" in found) == ("+- is one standard deviation" in found) == stated
        assert "; nothing at left stands out from its errors; " in found
        assert f"{words}, at " in found
        if words:
            assert f", at {made.time[700]:.2f} s)" in found


def test_what_an_observer_states_before_it_knows_anything_counts_nowhere(paper: Experiment) -> None:
    """Neither in the deviation, which is a median, nor as a push."""
    made = noisy(paper)
    made.standard_deviation[:50] = 10.0
    made.components[:50] = 500.0
    stored = StoredEstimate.of(made)
    assert stored.risen == made.time[50]
    assert stored.deviation == pytest.approx(np.full(6, 0.01))
    assert "no push" in judged(paper, made).verdict
    filtered = StoredEstimate.of(paper.estimates["momentum"])
    assert filtered.deviation is None
    assert filtered.risen == pytest.approx(5.0 / float(np.min(filtered.head.gain)), abs=1.1e-3)


def test_a_push_is_judged_by_the_deviation_at_its_time(paper: Experiment) -> None:
    """What is large where little is known is no push; a smaller one where much is known is."""
    made = noisy(paper)
    made.standard_deviation[600:650, 3:] = 1.0  # fifty samples, of which the median knows nothing
    made.components[600:650, 5] += 1.0
    assert "no push" in judged(paper, made).verdict
    made.components[700, 3:5] += 0.2
    found = judged(paper, made).verdict
    assert re.search(r"right \(up to \d+ \+-10 mN along \(0\.\d\d, 0\.\d\d, -?0\.0\d\)", found)
    assert f", at {made.time[700]:.2f} s)" in found


def test_a_push_that_nearly_stands_out_is_told_with_what_would(paper: Experiment) -> None:
    """Of 8.4 deviations nothing was said, and 8.7 would have been a push; of half as many there is nothing to say."""
    made = noisy(paper)
    made.components[700, 3:] = [0.0, 0.0, 0.084]
    near = f"; right (up to 84 +-10 mN upward, at {made.time[700]:.2f} s) is 8.4 deviations, of which 8.66 would; "
    assert f"no push that stands out from its errors{near}" in judged(paper, made).verdict
    made.components[700, 5] = 0.042
    assert "deviations, of which" not in judged(paper, made).verdict


def test_contacts_are_the_pushes_where_they_are_sought(paper: Experiment) -> None:
    """Each with its times, size, deviation and direction, on the record's clock; without one there is no push."""
    made = noisy(paper)
    made.components[600:650, 5] -= 0.5
    made.components[700:720, 2] += 0.25
    ends = [(float(made.time[begin]), float(made.time[end])) for begin, end in ((600, 650), (700, 720))]
    places = made.frames[::-1]
    contacts = [Contact(place, begin, begin, end) for place, (begin, end) in zip(places, ends, strict=True)]
    use = CalibrationUse("calibration: of the test", tuple(contacts))
    found = replace(judged(paper, made), calibration=use)
    first, second = (f"from {begin:.2f} s to {end:.2f} s)" for begin, end in ends)
    assert found.verdict.startswith("momentum finds 2 pushes, at right (up to 5")
    assert f" +-10 mN downward, {first} and left (up to 2" in found.verdict
    assert f" +-10 mN upward, {second}; +- is one standard deviation at that time" in found.verdict
    assert "no push" in replace(found, calibration=CalibrationUse("calibration: of the test", ())).verdict
    told, (begin, end) = contacts[0].told(0.25), ends[0]
    assert f"from {begin - 0.25:.3f} s to {end - 0.25:.3f} s (by the log's stamps from {begin:.3f} s" in told


def test_what_cannot_be_seen_is_said(paper: Experiment) -> None:
    """Of a pose that hides a force, the component and for how long; of a wrong belief, what is not to be trusted."""
    made = noisy(paper)
    made.components[:, 0] += 1.0
    made.standard_deviation[:, 4] = 1.0
    made.standard_deviation[::4, 3] = 1.0
    hidden = judged(paper, replace(made, expected_force=np.ones(6), seen=1.0 - made.standard_deviation**2))
    assert hidden.verdict.endswith("it cannot see right.Fy; it sees only at times right.Fx (75 % of the time).")
    off = replace(noisy(paper), unexplained=np.full((len(made.components), 18), 0.1), standard_deviation=None)
    assert "belief off by about" in judged(paper, off).verdict


def test_what_a_check_doubts_and_what_nothing_tests_is_said(paper: Experiment, tmp_path: Path) -> None:
    """A wrong sign is a sure push where no row is to spare: three joints, three components."""
    for check in ("effort sign", "held channel", "gyro against attitude", "late channel", "swapped thrusts", "gap"):
        doubted = replace(judged(paper, noisy(paper)), findings=(Finding(check, "warning", "is wrong"),))
        assert (f"a check doubts the record: {check}" in doubted.verdict) == (check != "gap")
    (tmp_path / "arm.urdf").write_text(arm())
    recording(tmp_path, "pushed", pushed=True, seed=2, seconds=2.0)
    values = edited(arm_map(), {"joints.friction": None})
    found = estimate(recorded(tmp_path / "pushed.csv", values), trust=True)
    assert "no row is to spare: a wrong sign, order, mass, mounting or friction would look like" in found.verdict


@pytest.mark.parametrize(("size", "unit"), [(0.01, "mN"), (20.0, "N")])
def test_a_table_is_in_one_unit(size: float, unit: str, paper: Experiment) -> None:
    """Of errors and their deviations, of mean, least and largest; what no force explains is in N from 1 N on."""
    large = {"momentum": StoredEstimate.of(noisy(paper, size))}
    header, rows = score_table(replace(paper.scores, stored=large).observers)
    cells = [row[header.index(name)] for row in rows for name in ("error rms", MEDIAN_DEVIATION)]
    assert {cell.split()[1] for cell in cells} == {unit}
    sizes = judged(paper, noisy(paper, size)).sizes
    assert {cell.split()[1] for row in sizes[1:] for cell in row[2:-1]} == {"N"}
    assert [force_size(force) for force in (0.0046, 0.238, 3.671, 30140.0)] == ["4.6 mN", "238 mN", "3.67 N", "30140 N"]
    [axis] = {axis.get_ylabel() for axis in draw_estimation(replace(paper.scores, stored=large)).axes[2:3]}
    assert axis == f"error [{unit}]"


def test_every_observer_is_drawn(paper: Experiment) -> None:
    """Also the fifth and the sixth, each in a line of its own."""
    stored = {f"observer {k}": StoredEstimate.of(paper.estimates["momentum"]) for k in range(6)}
    figure = draw_estimation(replace(paper.scores, stored=stored))
    lines = [line for line in figure.axes[0].lines if str(line.get_label()).startswith("estimated: ")]
    assert [line.get_label() for line in lines] == [f"estimated: {name}" for name in stored]
    assert len({(line.get_color(), line.get_linestyle()) for line in lines}) == 6
    assert {f"estimated: {name}" for name in stored} <= {text.get_text() for text in figure.legends[0].get_texts()}


def test_what_is_not_shown_adds_nothing_to_a_deviation_along_a_force() -> None:
    """It is 0, +- infinity: the product was no number, and a warning."""
    assert along_itself(np.array([3.0, 0.0]), np.array([0.5, np.inf])) == 0.5


def test_the_largest_error_of_a_contact_is_not_its_size() -> None:
    """10 N +-7 is an error's size beside 6 N +-0.7; without deviations, or with like ones, the largest force is."""
    force = np.array([[5.8, 0.0], [10.0, 0.0], [6.0, 0.0]])
    deviation = np.array([[0.6, 0.6], [7.0, 0.1], [0.7, np.inf]])
    assert [largest_of(force, each) for each in (deviation, None, np.ones((3, 2)))] == [2, 1, 1]


def test_sizes_are_read_at_a_glance() -> None:
    """Three digits, and a unit that needs no power of ten."""
    told = [quantity(size, "N") for size in (0.0, 4.04e-4, 0.2384, 0.9997, 12.34, 999.7, 12340.0)]
    assert told == ["0 mN", "0.404 mN", "238 mN", "1 N", "12.3 N", "1 kN", "12.3 kN"]


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
    lag = deviations.lag_of_filter(found, np.full(len(t), dt), gain, noise)
    behind = np.zeros((deviations.LAGS + 2, force.shape[1]))  # it has risen
    within = np.abs(found - force)[100:] <= 2.0 * np.hypot(lag, noise)[100:]
    assert np.all(within.mean(axis=0) > 0.95)
    assert np.all(lag[100:].mean(axis=0) < 2.0 * np.abs(found - force)[100:].mean(axis=0))
    for components, sure in zip(found, lag, strict=True):
        deviation = noise[0].copy()
        deviations.add_lag_of_filter(components, kept, behind, deviation)
        np.testing.assert_allclose(deviation, np.hypot(noise[0], sure), atol=1e-12)


@pytest.mark.parametrize("name", ["momentum", "force_level", "second_order", "super_twisting", "kalman"])
def test_deviations_say_what_a_filter_lacks_at_its_start(name: str) -> None:
    """A force of 50 N from the first sample on; 45 N were missing, with a deviation of 11 N; a stream says the same."""
    model, force, dt = load_robot("ur5").model, np.array([30.0, -20.0, 50.0]), 0.002
    q, data = np.array([0.0, -1.2, 1.4, -0.8, 0.9, 0.4]), model.createData()
    J = pin.computeFrameJacobian(model, data, q, model.getFrameId("tool0"), pin.LOCAL_WORLD_ALIGNED)[:3]
    tau = pin.computeGeneralizedGravity(model, data, q) - J.T @ force
    expected = Expected(np.full(3, 60.0), np.full(6, 0.3), np.zeros(6), np.ones(6))
    observer = OBSERVERS[name](model, ("tool0",), 50.0, "all", expected=expected)
    time = dt * np.arange(400)
    at_rest = np.tile(q, (400, 1)), np.zeros((400, 6))
    found = observer.run(time, *at_rest, np.tile(tau, (399, 1)), {})
    whole = deviations.with_expected(found, observer, expected)
    error = np.abs(whole.components - force)
    assert np.all(error < 2.0 * whole.standard_deviation)
    assert np.all(whole.standard_deviation[-1] < 1.5 * found.standard_deviation[-1])
    behind, recent = deviations.filters_at_start(observer)
    for row, sure, stated in zip(found.components, found.standard_deviation, whole.standard_deviation, strict=True):
        deviation = sure.copy()
        deviations.raise_to_noise(row, recent, deviation)
        deviations.add_lag_of_filter(row, np.exp(-50.0 * dt), behind, deviation)
        np.testing.assert_allclose(deviation, stated, rtol=1e-9)


def test_deviations_of_rows_say_what_their_filter_lacks() -> None:
    """Of a robot without points: moments from the first sample on, a step, and a swing at twice the filter's rate."""
    model, dt, gain = load_robot("ur5").model, 0.002, 50.0
    time = dt * np.arange(801)
    now = time[1:, None]
    moment = np.hstack([0.0 * now + 40.0, np.where(now > 0.8, 20.0, 0.0), 10.0 * np.sin(2.0 * gain * now)])
    tau = -np.pad(moment, [(0, 0), (0, 3)])
    model.gravity.linear[:] = 0.0
    expected = Expected(np.zeros(0), np.full(6, 0.3), np.zeros(6), np.ones(6))
    observer = OBSERVERS["momentum"](model, (), gain, "all")
    found = observer.run(time, *np.zeros((2, 801, 6)), tau, {})
    rows = deviations.rows_as_components(found, observer, np.zeros((801, 6)), expected)
    sure = rows.standard_deviation
    assert sure is not None
    assert np.all(np.mean(np.abs(rows.components[:, :3] - moment) < 2.0 * sure[:, :3], axis=0) > [0.99, 0.99, 0.85])
    np.testing.assert_allclose(sure[:, 3:], 0.3)
    without = deviations.without_lag(rows, sure)
    step = 400 + int(np.argmax(sure[400:, 1]))
    assert without[step, 1] < 0.1 * sure[step, 1]


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


EVERYWHERE = {
    *"contacts version verdict scenario seed changed versions warnings notes inputs calibration model".split(),
    *"log robot mass rate used_s parts checks fits observers".split(),
}
OBSERVER = {
    *"rank condition null_direction redundancy deviation events components unseen".split(),
    *"innovation warnings notes gain rows mean".split(),
}
TRUTH = {"r2", "r2_noise_free", "rmse", "lag_s"}


@pytest.mark.parametrize("name", ["momentum", "force_level"])
def test_a_sensor_that_shows_the_truth_gives_the_scores_of_the_truth(paper: Experiment, name: str) -> None:
    """To 1e-14, block by block from a file on disk; what only a sensor has is there and right."""
    stored = StoredEstimate.of(paper.estimates[name])
    for truth in paper.scores.references:
        rows = np.asarray(truth.noise_free)
        sensor = replace(truth, kind="sensor", values=series_of(stored.start.spool, rows), noise_free=None)
        own, other = (PairedEstimate.of(stored, one, paper.scores.dt) for one in (truth, sensor))
        shown = other.scores()
        for axis, score in own.scores().items():
            assert shown[axis].r2 == pytest.approx(score.r2_noise_free, abs=1e-14)
            assert shown[axis].lag_s == pytest.approx(score.lag_s, abs=1e-14)
            assert score.factor is None
            assert shown[axis].factor == pytest.approx(1.0, abs=0.02)
        noisy = PairedEstimate.of(stored, replace(truth, kind="sensor", noise_free=None), paper.scores.dt)
        for axis, score in noisy.scores().items():
            assert score.rmse == pytest.approx(own.scores()[axis].rmse, abs=1e-14)
            assert score.r2 == pytest.approx(own.scores()[axis].r2, abs=1e-14)


def test_moments_of_pieces_are_those_of_the_whole() -> None:
    """Far from zero, where sums of squares would lose what the scores are made of."""
    rng = np.random.default_rng(0)
    truth = 1e4 + rng.normal(0.0, 1.0, (5000, 2))
    found = truth + rng.normal(0.0, 0.1, truth.shape)
    whole, pieces = Moments(2), Moments(2)
    whole.add(found, truth)
    for first in range(0, 5000, 777):
        pieces.add(found[first : first + 777], truth[first : first + 777])
    expected = 1.0 - np.sum((found - truth) ** 2, axis=0) / np.sum((truth - truth.mean(axis=0)) ** 2, axis=0)
    slope = [np.polyfit(found[:, k] - 1e4, truth[:, k], 1)[0] for k in range(2)]
    for one in (whole, pieces):
        assert one.r2 == pytest.approx(expected, abs=1e-14)
        assert one.rmse == pytest.approx(np.sqrt(np.mean((found - truth) ** 2, axis=0)), rel=1e-13)
        assert one.factor == pytest.approx(slope, rel=1e-9)
        assert one.offset == pytest.approx(np.mean(found - truth, axis=0), abs=1e-11)


def test_metrics_have_the_same_keys_for_every_source(paper: Experiment, tmp_path: Path) -> None:
    """Of a flight with its truth and of a recording with a sensor; the file is what Python gives."""
    (tmp_path / "quadruped.urdf").write_text(urdf())
    result = estimate(recorded(tmp_path / "walk.csv", table_map(Path("quadruped.urdf")), table=table(walk())))
    (tmp_path / "out").mkdir()
    write(result, tmp_path / "out")
    metrics = json.loads((tmp_path / "out" / "metrics.json").read_text())
    assert metrics == json.loads(json.dumps(result.metrics()))
    assert " and 2 more; it is off the force sensor at FL_FOOT by " in result.verdict  # of four feet
    assert metrics["verdict"] == result.verdict
    for found, point in ((metrics, "FL_FOOT"), (paper.metrics, "left")):
        assert set(found) >= EVERYWHERE
        assert found["version"] == 2
        for entry in found["observers"].values():
            assert set(entry) >= OBSERVER | {point}
            for score in entry[point].values():
                assert set(score) >= TRUTH
    assert set(paper.metrics) - EVERYWHERE == {"flight", "torque", "note"}
    assert paper.metrics["observers"]["momentum"]["left"]["Fx"].keys() == TRUTH
    sensed = metrics["observers"]["force_level"]["FL_FOOT"]["Fz"]
    assert sensed == asdict(result.observers["force_level"].points["FL_FOOT"]["Fz"])
    assert metrics["used_s"] == pytest.approx(3.0)


def test_the_table_has_a_column_for_what_these_references_mean(paper: Experiment) -> None:
    """Noise for a truth; and no column without any meaning."""
    assert paper.scores.header == (*("observer", "point", "axis", "R2", "R2 noise-free", "error rms", "lag"),)
    assert len(list(paper.scores.rows())) == 12
    assert "factor" not in repr(paper.scores)
    hint = "R2 noise-free is lower where the estimate follows the noise of the true force, which is no error of it"
    assert paper.scores.hints == [hint]


def test_r_squared_is_one_for_the_truth_and_zero_for_its_mean() -> None:
    """Definition: 1 - SSE / SST; below 1 mN of standard deviation the ratio says nothing, and is None."""
    truth = np.sin(np.linspace(0.0, 9.0, 400))
    assert r_squared(truth, truth) == 1.0
    assert r_squared(np.full_like(truth, truth.mean()), truth) == pytest.approx(0.0, abs=1e-12)
    still = 0.9e-3 * np.sqrt(2.0) * np.sin(np.linspace(0.0, 60.0, 4000)) + 5.0
    assert (r_squared(still, still), lag(still, still, 1e-3)) == (None, None)


@pytest.mark.parametrize("gain", [100.0, 300.0])
def test_the_lag_of_a_first_order_filter_is_its_time_constant(gain: float) -> None:
    """Closed form: an exact-exponential low-pass delays slow signals by a/(1-a) steps with a = exp(-K dt)."""
    dt = 1e-3
    t = np.arange(4000) * dt
    truth = np.sin(2 * np.pi * 1.5 * t) + 0.3 * np.sin(2 * np.pi * 0.7 * t + 1.0)
    a = np.exp(-gain * dt)
    estimate = lfilter([1.0 - a], [1.0, -a], truth)
    assert lag(estimate, truth, dt) == pytest.approx(a / (1.0 - a) * dt, rel=0.05)


def test_attitude_and_velocity_are_pinocchios_own() -> None:
    """Random attitudes through `pin.rpy` and `pin.Quaternion`; pitch is positive nose up, so about -y."""
    random = np.random.default_rng(4)
    q, v = random.standard_normal((50, 11)), random.standard_normal((50, 10))
    q[:, 3:7] /= np.linalg.norm(q[:, 3:7], axis=1, keepdims=True)
    R = [pin.Quaternion(one[3:7]).matrix() for one in q]
    rpy = np.array([pin.rpy.matrixToRpy(one) for one in R])
    np.testing.assert_allclose(euler_angles(q), rpy * [1.0, -1.0, 1.0], atol=1e-13)
    np.testing.assert_allclose(world_velocity(q, v), [one @ two[:3] for one, two in zip(R, v, strict=True)], atol=1e-13)


def test_a_true_force_is_found_by_the_name_of_its_point() -> None:
    """Not by its place among the points; a point on which nothing acts has the force zero."""
    log = simulate(load_scenario("paper", ["simulation.duration=0.005", "air.strips=4", "air.warm_up_cycles=0"]))
    values = log.truth["force_W"].copy()
    values.loc[{"point": "left_force_point"}], values.loc[{"point": "right_force_point"}] = 1.0, 2.0
    marked = FlightLog(log.measured, log.truth.assign(force_W=values))
    for frame, size in (("left_force_point", 1.0), ("right_force_point", 2.0), ("left_distal", 0.0)):
        np.testing.assert_array_equal(true_force(marked, frame)[0], np.full((5, 3), size))


def test_a_log_knows_everything_that_comes_and_goes(tmp_path: Path) -> None:
    """Several forces, in order of time, through the file; two wings struck at once are one event, a sine is none."""
    left, right, body = "left_force_point", "right_force_point", "base_link"
    values = load_scenario("paper", ["simulation.duration=0.02"]).model_dump(exclude_none=True)
    values["unknown_force"] = [
        {"frame": body, "signal": "step", "start": 0.01},
        {"frame": left, "signal": "impulse", "start": 0.004, "duration": 0.002},
        {"frame": right, "signal": "impulse", "start": 0.004, "duration": 0.002},
        {"frame": left, "signal": "one_cosine", "start": 0.5, "duration": 0.25},
        {"frame": right, "signal": "sine"},
    ]
    simulate(parse_scenario(values, "several")).save(tmp_path / "flight.nc")
    log = FlightLog.load(tmp_path / "flight.nc")
    assert true_events(log) == [
        TrueEvent("impulse", (left, right), 0.004, 0.006),
        TrueEvent("step", (body,), 0.01, math.inf),
        TrueEvent("push", (left,), 0.5, 0.75),
    ]
    assert true_events(FlightLog(log.measured)) == []
    values["unknown_force"] = values["unknown_force"][-1:]
    assert true_events(simulate(parse_scenario(values, "none"))) == []


def test_rounding_of_a_component_that_no_row_shows_is_not_told_as_its_noise() -> None:
    """A real robot of three parallel joints had "hook_2.Fx 2.86e-10 mN beside 3.19e-10 mN"."""
    noise = np.random.default_rng(1).standard_normal((2000, 2)) * [1.0, 1e-13]
    names, units = ("hook.Fy", "hook.Fx"), ("N", "N")
    shown = SimpleNamespace(innovation=None, frames=(1,), components=noise, units=units, warnings=(), rows="joints")
    shown.identifiability, shown.observer = SimpleNamespace(components=names), "force_level"
    [line] = warnings_about(cast(Estimate, shown))
    assert "hook.Fy" in line
    assert "hook.Fx" not in line
