"""The scores: R2, lag and what counts as no signal."""

import math
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from scipy.signal import lfilter

from aerobat_pin.aerobat import FlightLog, true_events, true_force
from aerobat_pin.flight.simulate import simulate
from aerobat_pin.forces.scores import lag, r_squared
from aerobat_pin.observers.frames import euler_angles, world_velocity
from aerobat_pin.records import TrueEvent
from aerobat_pin.scenario.scenario import load_scenario, parse_scenario


def test_r_squared_is_one_for_the_truth_and_zero_for_its_mean() -> None:
    """Definition: 1 - SSE / SST."""
    truth = np.sin(np.linspace(0.0, 9.0, 400))
    assert r_squared(truth, truth) == 1.0
    assert r_squared(np.full_like(truth, truth.mean()), truth) == pytest.approx(0.0, abs=1e-12)


def test_a_truth_that_hardly_varies_has_no_r_squared() -> None:
    """Below 1 mN of standard deviation the ratio says nothing, so it is None and not a number."""
    truth = 0.9e-3 * np.sqrt(2.0) * np.sin(np.linspace(0.0, 60.0, 4000)) + 5.0
    assert r_squared(truth, truth) is None
    assert lag(truth, truth, 1e-3) is None


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
