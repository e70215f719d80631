"""The unknown force is the paper's signal, on its own clock, along the direction asked for."""

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from aerobat_pin.aerobat import load_aerobat
from aerobat_pin.flight import Plant
from aerobat_pin.scenario import load_scenario
from aerobat_pin.scenario.unknown_forces import PaperForce, tick_means

SIGNAL = PaperForce(frame="left_force_point")


def clock(duration: float, dt: float = 1e-3) -> np.ndarray:
    """Return the edges of equal intervals from 0 [s]."""
    return np.arange(round(duration / dt) + 1) * dt


def test_the_step_is_on_for_more_than_1_s_up_to_1_6_s() -> None:
    """Section III-A: plus 0.15 N while 1 s < t <= 1.6 s; sampled on the 1 ms clock that means ticks 1001 to 1600."""
    _, step = SIGNAL.interval_means(clock(2.0), np.random.default_rng(1))
    tick = np.arange(2000)
    assert step == pytest.approx(np.where((tick > 1000) & (tick <= 1600), 0.15, 0.0), abs=1e-12)


def test_the_noise_is_a_hundredth_of_a_newton_and_the_seeds_alone() -> None:
    """Section III-A: N(0, 0.01^2), white, within five standard errors; equal seeds give equal noise, two forces not."""
    edges = clock(20.0)
    one, again = (SIGNAL.interval_means(edges, np.random.default_rng([1, 0]))[0] for _ in range(2))
    other_force = SIGNAL.interval_means(edges, np.random.default_rng([1, 1]))[0]
    other_seed = SIGNAL.interval_means(edges, np.random.default_rng([2, 0]))[0]
    assert np.array_equal(one, again)
    assert one.std() == pytest.approx(0.01, rel=5.0 / np.sqrt(2.0 * len(one)))
    for stranger in (other_force, other_seed, np.roll(one, 1)):
        assert abs(np.corrcoef(one, stranger)[0, 1]) < 5.0 / np.sqrt(len(one))


@pytest.mark.parametrize("dt", [1e-4, 2.5e-4, 5e-4, 2e-3, 5e-3])
def test_the_signal_does_not_depend_on_the_step_of_the_integrator(dt: float) -> None:
    """Finer intervals see the held value of their tick, coarser ones the mean of theirs; same seed, same force."""
    fine, held = (SIGNAL.interval_means(clock(2.0, step), np.random.default_rng(3)) for step in (5e-5, dt))
    for finest, mean in zip(fine, held, strict=True):
        assert finest.reshape(len(mean), -1).mean(axis=1) == pytest.approx(mean, abs=1e-9)


def test_a_signal_that_is_not_sampled_on_its_ticks_still_covers_the_run() -> None:
    """A run that ends between two ticks draws the last tick as well; an interval across an edge mixes both values."""
    signal = PaperForce(frame="left_force_point", noise=1.0, tick=0.1)
    noise, _ = signal.interval_means(np.array([0.0, 0.05, 0.15, 0.25]), np.random.default_rng(2))
    a, b, c = np.random.default_rng(2).standard_normal(3)
    assert noise == pytest.approx([a, (a + b) / 2.0, (b + c) / 2.0], abs=1e-12)


@settings(max_examples=100, derandomize=True)
@given(st.lists(st.floats(1e-5, 0.02), min_size=1, max_size=60), st.integers(0, 2**32 - 1))
def test_averaging_conserves_the_impulse(intervals: list[float], seed: int) -> None:
    """Means times lengths add up to the integral of the held series, on any intervals; no mean leaves its range."""
    edges = np.concatenate([[0.0], np.cumsum(intervals)])
    ticks = int(np.ceil(edges[-1] / 1e-3))
    values = np.random.default_rng(seed).normal(size=ticks)
    means = tick_means(values, 1e-3, edges)
    whole = int(edges[-1] / 1e-3 + 1e-9)
    integral = values[:whole].sum() * 1e-3
    if whole < ticks:
        integral += values[whole] * (edges[-1] - whole * 1e-3)
    assert means @ np.diff(edges) == pytest.approx(integral, abs=1e-12)
    assert values.min() - 1e-9 < means.min()
    assert means.max() < values.max() + 1e-9


@pytest.mark.parametrize("axes", ["link", "body", "world"])
@pytest.mark.parametrize("elbow", [-1.9, 0.5])
def test_the_force_is_a_fifth_of_a_newton_times_the_elbows_sine_along_its_direction(axes: str, elbow: float) -> None:
    """Section III-A: f_t = 0.2 sin(q_e) + noise + step, along a direction fixed in the link, the body or the world."""
    settings = [f"unknown_force.0.axes={axes}", "unknown_force.0.direction=[0.6, 0.0, 0.8]", "air.warm_up_cycles=0"]
    robot = load_aerobat("aerobat_guard")
    plant = Plant(robot, load_scenario("paper_left", settings))
    placement = pin.SE3ToXYZQUAT(pin.SE3(pin.exp3(np.array([0.4, -0.3, 0.9])), np.zeros(3)))
    q, v = robot.configuration(placement, 0.2, elbow), np.zeros(10)
    joints = np.array([[0.2, elbow], [0.0, 0.0], [0.0, 0.0]])
    forces = plant.rates(q, v, joints, np.zeros(plant.air.state_size), np.array([[0.007], [0.15]]))[2]
    data = robot.model.createData()
    pin.framesForwardKinematics(robot.model, data, q)
    link, body = (data.oMf[robot.model.getFrameId(name)].rotation for name in ("left_distal", "base_link"))
    direction = {"link": link, "body": body, "world": np.eye(3)}[axes] @ np.array([0.6, 0.0, 0.8])
    clean = 0.2 * np.sin(elbow) + 0.15
    np.testing.assert_allclose(forces.force_noise_free_W[0, 0], clean * direction, atol=1e-14)
    np.testing.assert_allclose(forces.force_W[0, 0], (clean + 0.007) * direction, atol=1e-14)


def test_a_later_window_draws_its_own_noise_only() -> None:
    """Ten minutes into a flight, 50 intervals take 50 random numbers, and the signal is that of the whole record."""
    late = SIGNAL.model_copy(update={"step_start": 600.01, "step_end": 600.03})
    edges = clock(600.05)
    rng, same = np.random.default_rng(1), np.random.default_rng(1)
    _, step = late.interval_means(edges[-51:], rng)
    same.standard_normal(50)
    assert rng.random() == same.random()
    np.testing.assert_allclose(step, late.interval_means(edges, rng)[1][-50:], rtol=0.0, atol=1e-9)
    assert step.max() == pytest.approx(SIGNAL.step)
