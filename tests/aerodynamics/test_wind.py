"""Wind and gusts: what the air does depends on velocities against it, and on nothing else."""

from __future__ import annotations

import numpy as np
import pytest
from support.kernel_cases import instant

from aerobat_pin.errors import ScenarioError
from aerobat_pin.flight.plant.plant import Plant
from aerobat_pin.flight.simulate import simulate
from aerobat_pin.robot.load import load_robot
from aerobat_pin.scenario.scenario import load_scenario
from aerobat_pin.scenario.toml import scenario_toml

WIND = np.array([-1.3, 0.8, 0.5])


def settings(wind: np.ndarray, start: np.ndarray) -> list[str]:
    """Return settings of a free flight in a wind: no hold, no unknown force."""
    still = [f"unknown_force.{i}.{key}=0.0" for i in range(2) for key in ("amplitude", "noise", "step")]
    return [f"air.wind={list(map(float, wind))}", f"flight.velocity={list(map(float, start))}", *still]


@pytest.mark.parametrize("model", ["lifting_line", "quasi_steady"])
def test_flying_in_moving_air_is_flying_in_still_air_seen_from_a_moving_cart(model: str) -> None:
    """Galilei: wind and start shifted by the same velocity give the same flight, shifted by velocity times time.

    Forces, motor torque and the air's state agree; with added mass, whose wind terms do not cancel one by one.
    """
    start = np.array([5.0, 0.0, 0.0])
    options = [f"air.model={model}", "simulation.duration=0.3", "flight.gravity=2.0"]
    logs = [
        simulate(load_scenario("paper_open_loop", [*settings(wind, start + wind), *options]))
        for wind in (np.zeros(3), WIND)
    ]
    still, windy = (log.measured for log in logs)
    drift = np.outer(still["time"].values, WIND)
    np.testing.assert_allclose(windy["q"].values[:, :3] - drift, still["q"].values[:, :3], atol=1e-9)
    np.testing.assert_allclose(windy["q"].values[:, 3:], still["q"].values[:, 3:], atol=1e-9)
    for name in ("aerodynamic", "added_mass", "motor_torque"):
        side = "measured" if name == "motor_torque" else "truth"
        expected, found = (getattr(log, side)[name].values for log in logs)
        np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-6 * np.abs(expected).max())
    np.testing.assert_allclose(logs[1].truth["circulation"], logs[0].truth["circulation"], atol=1e-7)


@pytest.mark.parametrize("seed", range(3))
def test_a_gust_at_one_instant_is_the_wind_of_its_velocity_but_for_the_added_mass(seed: int) -> None:
    """Quasi-steady loads see v - v_air now; the added mass also sees how fast the air speeds up.

    A uniformly accelerated air pushes on a fixed wing with its added mass times the acceleration along the normal.
    """
    gust = "air.gust={amplitude = [2.0, -1.0, 1.5], start = 0.0, duration = 0.4}"
    time, phase = 0.1, np.pi / 2.0
    now = 0.5 * (1.0 - np.cos(phase)) * np.array([2.0, -1.0, 1.5])
    gusty, steady = (
        Plant(load_robot(scenario), scenario)
        for scenario in (
            load_scenario("paper", ["air.warm_up_cycles=0", gust]),
            load_scenario("paper", ["air.warm_up_cycles=0", f"air.wind={now.tolist()}"]),
        )
    )
    field = gusty.wind(np.array([0.0, time, 0.4, 9.0]))
    np.testing.assert_allclose(field[1, 0], now, atol=1e-15)
    np.testing.assert_allclose(field[1, 1], np.pi / 0.4 * np.array([2.0, -1.0, 1.5]), atol=1e-14)
    np.testing.assert_allclose(field[[0, 2, 3]], 0.0, atol=1e-13)
    q, v, joints, air, held = instant(gusty, seed)
    ours, theirs = (plant.rates(q, v, joints, air, held, time) for plant in (gusty, steady))
    np.testing.assert_allclose(ours[2].aerodynamic, theirs[2].aerodynamic, atol=1e-14)
    np.testing.assert_allclose(ours[1], theirs[1], atol=1e-12)
    assert np.max(np.abs(ours[2].added_mass - theirs[2].added_mass)) > 1e-3


def test_a_gust_lifts_the_robot_and_dies_down() -> None:
    """Upward 1 m/s for half a second: higher than without while it blows; the log's airspeed knows of it."""
    gust = "air.gust={amplitude = [0.0, 0.0, 1.0], start = 0.1, duration = 0.5}"
    calm, blown = (simulate(load_scenario("paper", ["simulation.duration=0.6", *more])) for more in ([], [gust]))
    rise = blown.measured["q"].values[:, 2] - calm.measured["q"].values[:, 2]
    assert np.max(np.abs(rise[:100])) == 0.0
    assert rise[450] > 0.01


def test_wind_and_gust_survive_writing_and_reading(tmp_path) -> None:  # type: ignore[no-untyped-def]
    """A resolved scenario with a gust and a limit reads back; a gust that lasts no time is refused."""
    scenario = load_scenario("paper", ["air.gust.amplitude=[1.0, 0.0, 0.0]", "air.lift_limit=1.4"])
    file = tmp_path / "gust.toml"
    file.write_text(scenario_toml(scenario), encoding="utf-8")
    assert load_scenario(file) == scenario
    with pytest.raises(ScenarioError, match=r"air\.gust\.duration = 0"):
        load_scenario("paper", ["air.gust={amplitude = [1.0, 0.0, 0.0], duration = 0.0}"])
