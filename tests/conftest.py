"""Flights that several test files look at, flown once."""

from __future__ import annotations

import pytest

from aerobat_pin.experiment import Experiment, run
from aerobat_pin.plant import Plant
from aerobat_pin.robot import load_aerobat
from aerobat_pin.scenario import load_scenario


@pytest.fixture(scope="session")
def paper() -> Experiment:
    """Return the paper's experiment, two seconds, seed 1."""
    return run(load_scenario("paper"))


@pytest.fixture(scope="session")
def paper_plant() -> Plant:
    """Build the paper's plant."""
    scenario = load_scenario("paper")
    return Plant(load_aerobat(scenario.robot.morphology, scenario.robot.changes), scenario)
