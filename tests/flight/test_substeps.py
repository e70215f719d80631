"""Many strips with a long step: the flight takes as many integration steps in an interval as its air needs."""

from __future__ import annotations

import numpy as np
import pytest

from aerobat_pin.aerobat.flight_log import FlightLog
from aerobat_pin.flight.plant.plant import Plant
from aerobat_pin.flight.simulate import simulate
from aerobat_pin.robot.load import load_robot
from aerobat_pin.scenario.scenario import load_scenario


def free(strips: int, dt: float, duration: float) -> FlightLog:
    """Fly `paper_open_loop` without unknown forces."""
    settings = [f"air.strips={strips}", f"simulation.dt={dt}", f"simulation.duration={duration}"]
    return simulate(load_scenario("paper_open_loop", settings).model_copy(update={"unknown_force": []}))


def test_number_of_steps_follows_the_fastest_mode_of_the_air() -> None:
    """Eigenvalues of A times the airspeed of the fastest strip: one step of 1 ms with 16 strips, several with 64."""
    counts = []
    for strips in (16, 64):
        scenario = load_scenario("paper_open_loop", [f"air.strips={strips}"])
        plant = Plant(load_robot(scenario), scenario)
        counts.append(plant.substeps(1e-3))
        modes = np.linalg.eigvals(plant.air.line.state_space(1.0).A)
        assert plant.air.line.fastest_mode == pytest.approx(np.abs(modes).max(), rel=1e-9)
    assert counts[0] == 1
    assert counts[1] >= 6


def test_a_divided_step_is_two_steps_of_half_the_length() -> None:
    """32 strips: two steps of 0.5 ms in an interval of 1 ms; same states, forces are means over both."""
    whole, halves = free(32, 1e-3, 0.1), free(32, 5e-4, 0.1)
    for name in ("q", "v"):
        np.testing.assert_allclose(whole.measured[name].values, halves.measured[name].values[::2], atol=1e-9)
    assert whole.truth is not None
    assert halves.truth is not None
    for name in ("aerodynamic", "added_mass"):
        pairs = halves.truth[name].values.reshape(-1, 2, whole.truth[name].shape[1])
        np.testing.assert_allclose(whole.truth[name].values, pairs.mean(axis=1), atol=1e-9)


def test_a_free_flight_hardly_depends_on_the_number_of_strips() -> None:
    """Distance in 2 s: 16 and 32 strips within 1 %; docs/lifting_line.md has 16 to 64, which span 1.3 %."""
    ends = [free(strips, 1e-3, 2.0).measured["q"].values[-1, 0] for strips in (16, 32)]
    assert ends[1] == pytest.approx(ends[0], rel=0.01)
