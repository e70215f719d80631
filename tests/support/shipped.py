"""The shipped scenarios, each flown once in a process for all tests that look at it."""

from functools import cache

from aerobat_pin.experiments import Experiment, run
from aerobat_pin.scenario import load_scenario


@cache
def flown(name: str) -> Experiment:
    """Run a shipped scenario as it is; of `raw_sensors`, whose smoother has tests of its own, the first 0.6 s."""
    return run(load_scenario(name, ["simulation.duration=0.6"] if name == "raw_sensors" else []))
