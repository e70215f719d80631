"""Sensors do to a channel what their tables say, in closed form; what was true stays in the log's truth."""

from typing import Any

import numpy as np
import pinocchio as pin
import pytest
import xarray as xr

from aerobat_pin.aerobat import FlightLog
from aerobat_pin.errors import LogError
from aerobat_pin.experiments import flight_summary, run
from aerobat_pin.flight import simulate
from aerobat_pin.flight.sensors import sensed
from aerobat_pin.scenario import SensorSection, load_scenario
from aerobat_pin.scenario.feedback_tables import AXES_OF_SENSOR

DT = 1e-3
SHORT = ["simulation.duration=0.1", "air.warm_up_cycles=1"]


def shown(true: np.ndarray, seed: int = 1, dt: float = DT, **sensor: Any) -> np.ndarray:
    """Return a channel (n, c), or (n,), as a sensor shows it every `dt`."""
    table = true.reshape(len(true), -1)
    rng = np.random.default_rng(seed)
    return sensed(table, np.arange(len(true)) * dt, SensorSection(**sensor), rng).reshape(true.shape)


def test_white_noise_has_its_deviation_per_sample_and_axis() -> None:
    """100 000 samples: deviations, and correlations over time and axes, within five standard errors."""
    count = 100_000
    error = shown(np.zeros((count, 3)), noise=[0.1, 0.2, 0.0])
    assert error.std(axis=0) == pytest.approx([0.1, 0.2, 0.0], rel=5.0 / np.sqrt(2.0 * count))
    limit = 5.0 / np.sqrt(count)
    assert abs(np.corrcoef(error[1:, 0], error[:-1, 0])[0, 1]) < limit
    assert abs(np.corrcoef(error[:, 0], error[:, 1])[0, 1]) < limit


@pytest.mark.parametrize("dt", [1e-3, 4e-3])
@pytest.mark.parametrize("rate", [None, 50.0])
def test_a_random_walk_spreads_with_the_root_of_time_at_any_rate(dt: float, rate: float | None) -> None:
    """Deviation walk sqrt(t): 2000 walks of 1 s, within five standard errors; it starts at zero."""
    walks = shown(np.zeros((round(1.0 / dt) + 1, 2000)), dt=dt, walk=0.3, rate=rate)
    assert np.all(walks[0] == 0.0)
    for share in (0.25, 1.0):
        at = round(share / dt)
        assert walks[at].std() == pytest.approx(0.3 * np.sqrt(share), rel=5.0 / np.sqrt(4000.0))


def test_quantisation_rounds_to_whole_steps() -> None:
    """Every value is a multiple, off by half a step at most, and evenly: deviation step / sqrt(12)."""
    true = np.cumsum(np.random.default_rng(1).normal(size=50_000))
    error = shown(true, quantum=0.25) - true
    np.testing.assert_allclose(shown(true, quantum=0.25) / 0.25 % 1.0, 0.0, atol=1e-12)
    assert np.max(np.abs(error)) <= 0.125 + 1e-12
    assert error.std() == pytest.approx(0.25 / np.sqrt(12.0), rel=0.02)


def test_a_delay_shows_what_was_true_before() -> None:
    """A ramp arrives late by the delay, rounded up to the log's times; the first sample is shown until then."""
    true = np.arange(100.0)
    np.testing.assert_array_equal(shown(true, delay=0.007)[7:], true[:-7])
    np.testing.assert_array_equal(shown(true, delay=0.0065)[7:], true[:-7])
    assert np.all(shown(true, delay=0.007)[:8] == 0.0)


def test_a_slower_sensor_holds_its_last_sample() -> None:
    """100 Hz in a log of 1 kHz: ten times the same. At 300 Hz a sample is the log's first at or after its due time."""
    true = np.arange(100.0)
    np.testing.assert_array_equal(shown(true, rate=100.0), 10.0 * (np.arange(100) // 10))
    due = np.ceil(np.arange(30) / 300.0 / DT - 1e-6)
    expected = due[np.searchsorted(due, np.arange(100), side="right") - 1]
    np.testing.assert_array_equal(shown(true, rate=300.0), expected)
    np.testing.assert_array_equal(shown(true, rate=1000.0), true)
    late = shown(true, rate=100.0, delay=0.004)
    np.testing.assert_array_equal(late[4:], 10.0 * (np.arange(96) // 10))


def test_a_lost_sample_leaves_the_last_one() -> None:
    """A third of 50 000 samples is lost (five standard errors), each shows its forerunner; the first is never lost."""
    count, share = 50_000, 1.0 / 3.0
    true = np.arange(float(count))
    found = shown(true, dropout=share)
    assert found[0] == 0.0
    lost = found != true
    assert lost.mean() == pytest.approx(share, abs=5.0 * np.sqrt(share * (1.0 - share) / count))
    np.testing.assert_array_equal(found[1:][lost[1:]], found[:-1][lost[1:]])


def test_a_fault_leaves_the_other_faults_draws_as_they_are() -> None:
    """With dropouts the samples that arrive carry the same noise as without."""
    true = np.zeros(1000)
    whole, torn = shown(true, noise=0.1), shown(true, noise=0.1, dropout=0.5)
    assert 0.4 < np.mean(whole == torn) < 0.6


def test_attitude_errors_are_small_turns_about_body_axes() -> None:
    """log3 of true inverse times shown has the noise per axis; quaternions stay unit and do not jump to their twins."""
    rng = np.random.default_rng(1)
    steps = [pin.Quaternion(pin.exp3(rng.normal(size=3) * 0.02)) for _ in range(4000)]
    true = [pin.Quaternion(pin.exp3(np.array([0.4, -0.3, 0.9])))]
    for step in steps:
        true.append(true[-1] * step)
    coefficients = np.array([one.coeffs() for one in true])
    sensor = SensorSection(noise=[0.01, 0.02, 0.03], bias=[0.0, 0.1, 0.0])
    time = np.arange(len(true)) * DT
    found = sensed(coefficients, time, sensor, np.random.default_rng(2), attitude=True)
    np.testing.assert_allclose(np.linalg.norm(found, axis=1), 1.0, atol=1e-12)
    assert np.all(np.sum(found * coefficients, axis=1) > 0.9)
    turns = np.array([pin.log3((a.inverse() * pin.Quaternion(b)).matrix()) for a, b in zip(true, found, strict=True)])
    assert turns.std(axis=0) == pytest.approx([0.01, 0.02, 0.03], rel=5.0 / np.sqrt(8000.0))
    assert turns.mean(axis=0) == pytest.approx([0.0, 0.1, 0.0], abs=5.0 * 0.03 / np.sqrt(4000.0))
    rounded = sensed(coefficients, time, SensorSection(quantum=0.1), np.random.default_rng(2), attitude=True)
    angles = np.array([pin.rpy.matrixToRpy(pin.Quaternion(one).matrix()) for one in rounded]) / 0.1
    np.testing.assert_allclose(angles, np.round(angles), atol=1e-6)


FAULTS = {"position": ("q", [0, 1, 2]), "attitude": ("q", [3, 4, 5, 6]), "joint_angle": ("q", [7, 8, 9, 10])}
FAULTS |= {"velocity": ("v", [0, 1, 2]), "gyro": ("v", [3, 4, 5]), "joint_rate": ("v", [6, 7, 8, 9])}
FAULTS |= {"crank_angle": ("crank_angle", None), "airspeed": ("airspeed", None)}
FAULTS["motor_torque"] = ("motor_torque", [6, 7, 8, 9])


@pytest.fixture(scope="module")
def exact() -> FlightLog:
    return simulate(load_scenario("paper", SHORT))


@pytest.mark.parametrize("name", AXES_OF_SENSOR)
def test_a_sensor_changes_its_channel_alone_and_the_truth_keeps_what_was_true(name: str, exact: FlightLog) -> None:
    """Of each channel the columns it measures, at all times; every other number, and the flight, is bit for bit."""
    flight = simulate(load_scenario("paper", [*SHORT, f"sensors.{name}.noise=0.01"]))
    channel, columns = FAULTS[name]
    changed, before = flight.measured[channel].values, exact.measured[channel].values
    where = changed != before
    if columns is None:
        assert np.all(where)
    else:
        assert np.all(where[:, columns])
        assert not np.any(np.delete(where, columns, axis=1))
    error = (changed - before)[where]
    assert 0.004 < error.std() < 0.012
    xr.testing.assert_identical(flight.measured.drop_vars(channel), exact.measured.drop_vars(channel))
    kept = "body_airspeed" if channel == "airspeed" else channel
    np.testing.assert_array_equal(flight.truth[kept].values, before)
    xr.testing.assert_equal(flight.truth[list(exact.truth.data_vars)], exact.truth)
    assert kept not in exact.truth


def test_each_sensor_draws_from_a_stream_of_its_own() -> None:
    """A second sensor leaves the first one's draws; the two are independent; another seed draws anew."""
    settings = [*SHORT, "sensors.gyro.noise=0.01"]
    one = simulate(load_scenario("paper", settings)).measured["v"].values
    two = simulate(load_scenario("paper", [*settings, "sensors.velocity.noise=0.01"])).measured["v"].values
    np.testing.assert_array_equal(one[:, 3:6], two[:, 3:6])
    exact = simulate(load_scenario("paper", SHORT)).measured["v"].values
    linear, angular = (two - exact)[:, :3].ravel(), (two - exact)[:, 3:6].ravel()
    assert abs(np.corrcoef(linear, angular)[0, 1]) < 5.0 / np.sqrt(len(linear))
    other = [*settings, "simulation.seed=2", "unknown_force.0.noise=0", "unknown_force.1.noise=0"]
    calm = [*SHORT, "unknown_force.0.noise=0", "unknown_force.1.noise=0"]
    drawn = simulate(load_scenario("paper", other)).measured["v"] - simulate(load_scenario("paper", calm)).measured["v"]
    assert abs(np.corrcoef(drawn.values[:, 3:6].ravel(), angular)[0, 1]) < 5.0 / np.sqrt(len(linear))


def test_the_flight_is_judged_by_what_was_true() -> None:
    """A position sensor that is off by ten metres moves no flight."""
    flight = run(load_scenario("paper", [*SHORT, "sensors.position.bias=10.0"]))
    end = flight.metrics["flight"]["position_end"]
    assert end[0] == pytest.approx(0.3, abs=0.05)
    assert flight.log.measured["q"].values[-1, 0] == pytest.approx(end[0] + 10.0)
    assert list(flight_summary(flight.log, flight.robot.mass).position_end) == end
    assert flight.metrics["note"].endswith("; imperfect sensors: position")


@pytest.mark.parametrize(("sensor", "axis"), [("accelerometer", "accelerometer_time"), ("motor_torque", "torque_time")])
def test_a_raw_flight_that_is_shorter_than_a_mean_of_its_sensor_is_refused(sensor: str, axis: str) -> None:
    """50 ms at 10 Hz: there is no sample, which is said in a line."""
    short = load_scenario("raw_sensors", ["simulation.duration=0.05", "air.strips=4", f"sensors.{sensor}.rate=10"])
    with pytest.raises(LogError, match=f"0 samples along {axis}: two or more were expected"):
        simulate(short)
