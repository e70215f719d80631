"""Observers take settings of their own from a scenario, under the names and defaults of their arguments."""

from __future__ import annotations

import inspect

import numpy as np
import pytest

from aerobat_pin.aerobat.estimate import estimate_log
from aerobat_pin.errors import AerobatError
from aerobat_pin.experiments.experiment import Experiment, run
from aerobat_pin.observers import OBSERVERS, KalmanObserver
from aerobat_pin.scenario.scenario import Scenario, load_scenario
from aerobat_pin.scenario.tables import ObserverSection

SHORT = ["simulation.duration=0.05", "air.warm_up_cycles=1"]


@pytest.mark.parametrize("name", ["kalman", "smoother", "super_twisting"])
def test_the_table_of_an_observer_has_its_arguments_and_their_defaults(name: str) -> None:
    """One key per keyword of the constructor; an empty table changes nothing."""
    arguments = inspect.signature(OBSERVERS[name]).parameters.values()
    defaults = {one.name: one.default for one in arguments if one.kind is inspect.Parameter.KEYWORD_ONLY}
    section = getattr(ObserverSection.model_validate({name: {}}), name)
    written = {key: value or None if key == "known_error" else value for key, value in section}
    assert written == defaults


def test_every_observer_that_takes_settings_has_a_table() -> None:
    """And no other."""
    for name, kind in OBSERVERS.items():
        keywords = [
            one for one in inspect.signature(kind).parameters.values() if one.kind is inspect.Parameter.KEYWORD_ONLY
        ]
        assert (name in ObserverSection.model_fields) == bool(keywords), name


def with_kalman(*settings: str) -> Scenario:
    """Return the paper's scenario with the Kalman filter and its settings."""
    given = ["observers.names=['kalman']", *(f"observers.kalman.{one}" for one in settings)]
    return load_scenario("paper", given)


def test_the_settings_of_a_scenario_reach_the_observer(paper: Experiment) -> None:
    """The same estimate as from the observer built by hand with these arguments, and another than without them."""
    settings = {"force_walk": 0.7, "known_error": {"aerodynamic": 0.2}, "mass_error": 0.05}
    scenario = with_kalman("force_walk=0.7", "known_error.aerodynamic=0.2", "mass_error=0.05")
    inputs, found = estimate_log(paper.log, paper.robot, scenario)
    by_hand = KalmanObserver(
        paper.robot.model, scenario.observers.frames, scenario.observers.gain, inputs.rows, **settings
    ).run(inputs.time, inputs.q, inputs.v, inputs.tau, inputs.known)
    np.testing.assert_array_equal(found["kalman"].force, by_hand.force)
    plain = estimate_log(paper.log, paper.robot, with_kalman())[1]["kalman"]
    assert np.max(np.abs(plain.force - by_hand.force)) > 1e-3


def test_a_known_force_that_there_is_not_is_named() -> None:
    """By the observer, which knows what it is fed."""
    settings = [*SHORT, "observers.names=['kalman']", "observers.kalman.known_error.wings=0.1"]
    with pytest.raises(AerobatError, match="names 'wings': the known forces are aerodynamic, added_mass, thrusters"):
        run(load_scenario("paper", settings))
