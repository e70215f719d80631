"""Events in an estimate: false alarms at the rate asked for, known latency, the paper's step; bias of a free run."""

import numpy as np
import pytest
from scipy.signal import lfilter
from support.further import further

from aerobat_pin.aerobat import known_inputs
from aerobat_pin.errors import ObserverError, ShapeError
from aerobat_pin.experiments import Experiment
from aerobat_pin.observers import Application, ForceLevelObserver, bias_of, calibrate_cusum, calibrate_level

DT, GAIN = 1e-3, 200.0  # [s], [1/s]


def noise(seconds: float, seed: int, columns: int = 1, differenced: bool = False) -> tuple[np.ndarray, np.ndarray]:
    """Return edges and what an observer makes of white force noise, or of white velocity noise, of 1 N per sample."""
    count, settling = round(seconds / DT), 1000
    white = np.random.default_rng(seed).normal(size=(count + settling, columns))
    if differenced:
        white = np.diff(white, axis=0, prepend=white[:1])
    a = np.exp(-GAIN * DT)
    return np.arange(count + 1) * DT, lfilter([1.0 - a], [1.0, -a], white, axis=0)[settling:].squeeze()


def step(edges: np.ndarray, start: float, end: float, size: float) -> np.ndarray:
    """Return what a first-order observer makes of a force that is on for a while."""
    rise = -np.expm1(-GAIN * np.maximum(edges[1:] - start, 0.0))
    fall = -np.expm1(-GAIN * np.maximum(edges[1:] - end, 0.0))
    return size * (rise - fall)


@pytest.mark.parametrize(
    ("kind", "rate", "differenced"),
    [
        ("level", 0.05, True),
        ("norm", 0.05, False),
        ("cusum", 1.0, False),
        *further(("level", 0.05, False), ("norm", 0.05, True), ("level", 1.0, False)),
        *further(("cusum", 0.05, False), ("cusum", 0.05, True)),
    ],
)
def test_fresh_noise_raises_false_alarms_at_the_rate_asked_for(kind: str, rate: float, differenced: bool) -> None:
    """Calibrated on a minute, flown for 500 s: of three, a third to twice the rate, also beyond what a minute shows."""
    # A CUSUM of differenced noise down to a tenth: it gathers little, and its tail is shorter than an exponential.
    columns = 3 if kind == "norm" else 1
    edges, fresh = noise(500.0, 100, columns, differenced)
    rates = []
    for seed in range(3):
        time, free = noise(60.0, seed, columns, differenced)
        detector = (
            calibrate_cusum(time, free, rate, 0.5 * float(np.std(free)))
            if kind == "cusum"
            else calibrate_level(time, free, rate)
        )
        rates.append(len(detector.detect(edges, fresh)) / 500.0)
    lowest = 0.1 if kind == "cusum" and differenced else 1.0 / 3.0
    assert lowest * rate <= np.mean(rates) <= 2.0 * rate


def test_a_level_knows_its_latency_and_marks_a_steps_onset_and_end() -> None:
    """A step of 3 N from 2 s to 4 s in noise of 0.3 N rms: latency as predicted, onset within the filter's delay."""
    detector = calibrate_level(*noise(60.0, 1), false_alarms=0.01, delay=1.0 / GAIN)
    assert 1.0 < detector.threshold < 2.0
    late = []
    for seed in range(20):
        edges, series = noise(6.0, 200 + seed)
        events = detector.detect(edges, series + step(edges, 2.0, 4.0, 3.0))
        [event] = [one for one in events if one.peak > 2.5]
        late.append(event.alarm - 2.0)
        assert -detector.delay <= event.onset - 2.0 <= detector.delay
        assert 0.0 <= event.end - 4.0 <= detector.delay + 5e-3
        assert event.peak == pytest.approx(4.0, abs=0.7)  # and the largest of the noise
    assert np.mean(late) == pytest.approx(detector.latency(3.0), abs=1.5e-3)
    assert detector.latency(1e9) == pytest.approx(0.0, abs=1e-9)
    assert detector.latency(0.9 * detector.threshold) == np.inf


def test_a_cusum_finds_a_step_that_a_level_cannot_see_within_its_latency() -> None:
    """0.7 N in noise of 0.3 N rms, below the level's threshold: found to either side, onset within 10 ms."""
    time, free = noise(60.0, 1)
    level = calibrate_level(time, free, 0.01)
    detector = calibrate_cusum(time, free, 0.001, drift=0.35, delay=1.0 / GAIN)
    assert level.latency(0.7) == np.inf
    late, early = [], []
    for seed in range(20):
        side = 1.0 if seed % 2 else -1.0
        edges, series = noise(4.0, 300 + seed)
        events = detector.detect(edges, series + side * step(edges, 2.0, 3.0, 0.7))  # two where noise hides it briefly
        late.append(events[0].alarm - 2.0)
        early.append(events[0].onset - 2.0)
        assert events[-1].end == pytest.approx(3.0, abs=0.05)
    assert np.mean(late) == pytest.approx(detector.latency(0.7), rel=0.2)
    [clean] = detector.detect(edges, step(edges, 2.0, 3.0, 0.7))
    assert 0.8 * detector.latency(0.7) < clean.alarm - 2.0 <= detector.latency(0.7)
    assert abs(float(np.mean(early))) < 0.01
    assert detector.latency(0.35) == np.inf


def test_an_event_that_goes_on_has_no_end_and_a_bias_is_no_event() -> None:
    """The series stops while the force is on; a constant offset of the free run is taken off."""
    time, free = noise(60.0, 1)
    for detector in (calibrate_level(time, free + 5.0, 0.01), calibrate_cusum(time, free + 5.0, 0.01, drift=0.5)):
        edges, series = noise(3.0, 400)
        assert detector.detect(edges, series + 5.0) == []
        [event] = detector.detect(edges, series + 5.0 + step(edges, 2.0, 9.0, 3.0))
        assert event.end is None
        assert event.alarm - 2.0 < 0.02


def test_the_norm_of_three_components_finds_a_force_of_any_direction() -> None:
    """One detector for the force at a point, with a bias per component."""
    time, free = noise(60.0, 1, columns=3)
    offset = np.array([1.0, -2.0, 3.0])
    detector = calibrate_level(time, free + offset, 0.01)
    edges, series = noise(3.0, 401, columns=3)
    for along in np.vstack([np.eye(3), -np.eye(3)]):
        [event] = detector.detect(edges, series + offset + np.outer(step(edges, 1.0, 2.0, 4.0), along))
        assert event.onset == pytest.approx(1.0, abs=0.01)
    with pytest.raises(ShapeError, match="the detector was calibrated with 3 components"):
        detector.detect(edges, series[:, 0])


def test_the_papers_step_is_found_in_the_papers_flight(paper: Experiment) -> None:
    """On at ticks with 1 s < t <= 1.6 s, 0.15 N along the wings' normals; 0.2 sin(elbow), fitted before, is usual."""
    inputs = known_inputs(paper.log, paper.robot)
    normals = [Application(f"{side}_force_point", axes="frame", direction=(0, 0, 1)) for side in ("left", "right")]
    observer = ForceLevelObserver(paper.robot.model, normals, gain=2000.0)
    estimate = observer.run(inputs.time, inputs.q, inputs.v, inputs.tau, inputs.known)
    elbow = inputs.q[:, paper.robot.idx_q[1]]
    usual = np.column_stack([np.ones(len(elbow) - 1), np.sin(0.5 * (elbow[1:] + elbow[:-1]))])
    for label in estimate.identifiability.components:
        series = estimate.component(label)
        fit = np.linalg.lstsq(usual[:900], series[:900], rcond=None)[0]
        assert fit[1] == pytest.approx(0.2, rel=0.02)
        unusual, time = series - usual @ fit, inputs.time
        delay = 1.0 / 2000.0
        for detector, early in (
            (calibrate_level(time[:901], unusual[:900], 0.01, delay), 1e-3),
            (calibrate_cusum(time[:901], unusual[:900], 0.01, 0.005, delay), 20e-3),
        ):
            [event] = detector.detect(time, unusual)
            assert 1.001 - early <= event.onset <= 1.002
            assert event.alarm == pytest.approx(1.001, abs=4e-3)
            assert event.end == pytest.approx(1.601, abs=4e-3)
            assert event.peak == pytest.approx(0.15, abs=0.05)


def test_the_standard_error_of_a_bias_is_that_of_many_free_runs() -> None:
    """Effective samples: filtered noise has fewer than samples, by its correlation length."""
    runs = [noise(5.0, 500 + seed, columns=2)[1] for seed in range(200)]
    found = [bias_of(run + np.array([1.0, -2.0])) for run in runs]
    means = np.array([one.mean for one in found])
    np.testing.assert_allclose(means.mean(axis=0), [1.0, -2.0], atol=0.02)
    errors = np.mean([one.standard_error for one in found], axis=0)
    np.testing.assert_allclose(errors, means.std(axis=0), rtol=0.15)
    a = np.exp(-GAIN * DT)
    np.testing.assert_allclose(np.mean([one.effective_samples for one in found]), 5000 * (1 - a) / (1 + a), rtol=0.1)
    np.testing.assert_allclose(found[0].remove(runs[0] + np.array([1.0, -2.0])).mean(axis=0), 0.0, atol=1e-12)
    single = bias_of(runs[0][:, 0])
    assert np.shape(single.standard_error) == ()


def calibrated(time: np.ndarray, free: np.ndarray, drift: float) -> bool:
    try:
        calibrate_cusum(time, free, 0.001, drift)
    except ObserverError:
        return False
    return True


def test_the_advice_on_a_drift_leads_to_one_that_can_be_calibrated() -> None:
    """A drift far above the noise is to shrink, one far below it to grow; steps of the former a level sees as well."""
    time, free = noise(5.0, 1)
    spread = float(np.std(free))
    calibrate_cusum(time, free, 0.001, spread)
    for factor, advice, towards in ((10.0, "a smaller drift, or calibrate_level", 0.7), (0.01, "a larger drift", 1.4)):
        drifts = factor * spread * towards ** np.arange(20)
        with pytest.raises(ObserverError, match=advice):
            calibrate_cusum(time, free, 0.001, drifts[0])
        assert any(calibrated(time, free, drift) for drift in drifts)
    assert calibrate_level(time, free, 0.001).latency(20.0 * spread) < np.inf


def test_free_runs_that_do_not_tell_are_refused() -> None:
    """Too short, too many false alarms, arrays that do not fit."""
    time, free = noise(60.0, 1)
    with pytest.raises(ObserverError, match="take a longer run"):
        calibrate_level(time[:101], free[:100], 0.1)
    with pytest.raises(ObserverError, match="a lower rate"):
        calibrate_level(time, free, 1000.0)
    with pytest.raises(ShapeError, match="one component"):
        calibrate_cusum(*noise(1.0, 1, columns=2), 0.1, 0.1)
    with pytest.raises(ShapeError, match=r"\(m,\) or \(m, c\) on \(m \+ 1,\)"):
        calibrate_level(time[1:], free, 0.1)
    assert calibrate_level(time, free, 0.1).threshold > calibrate_level(time, free, 0.2).threshold
