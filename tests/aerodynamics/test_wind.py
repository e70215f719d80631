"""Gust, waves and turbulence against their closed forms."""

import numpy as np
import pytest

from aerobat_pin.aerobat import wind_of
from aerobat_pin.aerodynamics import Wind, dryden
from aerobat_pin.aerodynamics.wind import HIGHEST_TONE
from aerobat_pin.flight import simulate
from aerobat_pin.scenario import load_scenario

LENGTH, SPEED, DEVIATION = 1.2, 3.0, (0.5, 0.4, 0.3)
TABLES = ("air.wave=[{amplitude = [0.0, 0.3, 0.1], frequency = 2.0, phase_deg = 30.0}]",)


def wind(*settings: str) -> Wind:
    return wind_of(load_scenario("paper", settings).air)


def test_a_gust_is_one_minus_cosine_and_its_impulse_half_of_its_amplitude() -> None:
    """Zero at both ends, the amplitude in the middle, half of it at the quarters."""
    gust = wind("air.gust={amplitude = [0.0, 2.0, -1.0], start = 0.2, duration = 0.8}")
    found = gust.field(np.array([0.1, 0.2, 0.4, 0.6, 0.8, 1.0, 1.5]))[:, 0]
    np.testing.assert_allclose(found, np.outer([0.0, 0.0, 0.5, 1.0, 0.5, 0.0, 0.0], [0.0, 2.0, -1.0]), atol=1e-12)
    np.testing.assert_allclose(gust.drift(np.array([2.0])), [[0.0, 0.8, -0.4]], atol=1e-12)


def test_a_wave_is_a_sine() -> None:
    """Two of them add up."""
    one = "{amplitude = [0.0, 0.3, 0.1], frequency = 2.0, phase_deg = 30.0}"
    time, waves = np.linspace(0.0, 1.0, 40), wind(f"air.wave=[{one}, {{amplitude = [1.0, 0.0, 0.0], frequency = 5.0}}]")
    expected = np.stack([np.sin(10.0 * np.pi * time), *np.outer([0.3, 0.1], np.sin(4.0 * np.pi * time + np.pi / 6.0))])
    np.testing.assert_allclose(waves.field(time)[:, 0], expected.T, atol=1e-12)


@pytest.mark.parametrize("settings", [TABLES, ("air.turbulence={deviation = [0.5, 0.4, 0.3], seed = 3}",)])
def test_rate_and_drift_are_derivative_and_integral_of_the_velocity(settings: tuple[str, ...]) -> None:
    """By differences of small steps; beyond one block of times."""
    time, air = np.arange(1201) * 1e-4, wind(*settings)
    field, drift = air.field(time), air.drift(time)
    np.testing.assert_allclose((field[2:, 0] - field[:-2, 0]) / 2e-4, field[1:-1, 1], atol=2e-2)
    np.testing.assert_allclose((drift[2:] - drift[:-2]) / 2e-4, field[1:-1, 0], atol=2e-4)
    np.testing.assert_allclose(drift[0], 0.0, atol=1e-15)


def test_turbulence_has_drydens_variance_and_autocorrelation() -> None:
    """R(t) is s^2 exp(-t / T) along the flight and s^2 exp(-t / T) (1 - t / 2T) across, T = L / V (Dryden's model)."""
    # Over 120 seeds; above `HIGHEST_TONE` the spectrum has 0.8 % of the variance along, and 1.3 % across.
    lags, T = np.array([0.0, 0.1, 0.3, 0.6, 1.0, 1.6]), LENGTH / SPEED
    begins = np.arange(40) * 0.9
    found = np.zeros((len(lags), 3))
    for seed in range(120):
        air = Wind(tones=(dryden(DEVIATION, LENGTH, SPEED, seed),))
        velocity = air.field(np.add.outer(begins, lags).ravel())[:, 0].reshape(len(begins), len(lags), 3)
        found += np.mean(velocity[:, :1] * velocity, axis=0) / 120
    shape = np.exp(-lags / T)
    beyond = T * 2.0 * np.pi * HIGHEST_TONE
    lost = np.array([2.0, 3.0, 3.0]) / np.pi / beyond
    expected = np.stack([shape, *[shape * (1.0 - 0.5 * lags / T)] * 2], axis=1) * np.square(DEVIATION)
    np.testing.assert_allclose(found, expected, atol=0.03 * 0.25)
    tones = dryden(DEVIATION, LENGTH, SPEED, 1)
    np.testing.assert_allclose(0.5 * np.sum(tones.amplitude**2, axis=0), (1.0 - lost) * np.square(DEVIATION), rtol=1e-3)


def test_turbulence_reproduces_by_its_seed_and_flies() -> None:
    """Another seed is other turbulence; a believed deviation of 0 takes it from the belief."""
    short = ["simulation.duration=0.05", "air.turbulence.deviation=[0.3, 0.3, 0.3]"]
    same, again, other = (
        simulate(load_scenario("paper", [*short, f"air.turbulence.seed={seed}"])).measured["q"].values
        for seed in (1, 1, 2)
    )
    np.testing.assert_array_equal(same, again)
    assert np.max(np.abs(same - other)) > 1e-5
    assert not load_scenario("paper", short).believed_air.is_steady
    assert load_scenario("paper", [*short, "believed.air.turbulence.deviation=[0, 0, 0]"]).believed_air.is_steady
