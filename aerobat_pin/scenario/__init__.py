"""What happens, as checked text: the keys of a scenario file, their units, and the messages when one is wrong."""

from aerobat_pin.scenario.csv_rows import TextTable
from aerobat_pin.scenario.describe import describe_scenario
from aerobat_pin.scenario.dotted_keys import assign, with_settings
from aerobat_pin.scenario.messages import not_found_message
from aerobat_pin.scenario.scenario import Scenario, load_scenario, parse_scenario, shipped_scenarios
from aerobat_pin.scenario.tables import AirSection, Number, Positive, RobotSection, SensorSection, SensorsSection, Whole
from aerobat_pin.scenario.toml import scenario_toml
from aerobat_pin.scenario.unknown_forces import Axes, RecordedForce, UnknownForce

__all__ = [
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
    "load_scenario",
    "not_found_message",
    "parse_scenario",
    "scenario_toml",
    "shipped_scenarios",
    "with_settings",
]
