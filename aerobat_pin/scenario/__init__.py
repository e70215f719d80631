"""Read and check scenario files: their keys, units and defaults, and the messages that explain a wrong value."""

from aerobat_pin.scenario.csv_rows import TextTable
from aerobat_pin.scenario.describe import describe_scenario
from aerobat_pin.scenario.dotted_keys import assign, with_settings
from aerobat_pin.scenario.messages import explain_plainly
from aerobat_pin.scenario.scenario import Scenario, load_scenario, parse_scenario, shipped_scenarios
from aerobat_pin.scenario.size import MOST_SECONDS, SECONDS_PER_STEP
from aerobat_pin.scenario.tables import AirSection, Number, Positive, RobotSection, SensorSection, SensorsSection, Whole
from aerobat_pin.scenario.toml import read_toml, scenario_toml, shipped_names
from aerobat_pin.scenario.unknown_forces import Axes, RecordedForce, UnknownForce

__all__ = [
    "MOST_SECONDS",
    "SECONDS_PER_STEP",
    "AirSection",
    "Axes",
    "Number",
    "Positive",
    "RecordedForce",
    "RobotSection",
    "Scenario",
    "SensorSection",
    "SensorsSection",
    "TextTable",
    "UnknownForce",
    "Whole",
    "assign",
    "describe_scenario",
    "explain_plainly",
    "load_scenario",
    "parse_scenario",
    "read_toml",
    "scenario_toml",
    "shipped_names",
    "shipped_scenarios",
    "with_settings",
]
