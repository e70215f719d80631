"""Flights that several test files look at, flown once."""

from __future__ import annotations

import pytest

from aerobat_pin.experiment import Experiment, run
from aerobat_pin.scenario import load_scenario


@pytest.fixture(scope="session")
def paper() -> Experiment:
    """Return the paper's experiment, two seconds, seed 1."""
    return run(load_scenario("paper"))
