"""Read and check scenario files: their keys, units and defaults, and the messages that explain a wrong value."""

from aerobat_pin.scenario.changes import (
    changed_keys,
    changes_text,
    described,
    differing_keys,
    keys_text,
    shipped_description,
)
from aerobat_pin.scenario.control_tables import ControlSection, ThrustersSection
from aerobat_pin.scenario.csv_rows import TextTable
from aerobat_pin.scenario.describe import describe_scenario, describe_tables
from aerobat_pin.scenario.dotted_keys import assign, with_settings
from aerobat_pin.scenario.messages import explain, explain_plainly
from aerobat_pin.scenario.raw_tables import RawSection
from aerobat_pin.scenario.scenario import Scenario, load_scenario, parse_scenario, shipped_scenarios
from aerobat_pin.scenario.section import Number, Positive, Section, Whole
from aerobat_pin.scenario.sensor_tables import (
    InertialSection,
    MotionCaptureSection,
    SampledSection,
    SensorSection,
    SensorsSection,
)
from aerobat_pin.scenario.size import MOST_SECONDS, SECONDS_PER_STEP
from aerobat_pin.scenario.tables import AirSection, RobotSection
from aerobat_pin.scenario.toml import read_toml, scenario_toml, shipped_names
from aerobat_pin.scenario.unknown_forces import Axes, RecordedForce, UnknownForce

__all__ = [
    "MOST_SECONDS",
    "SECONDS_PER_STEP",
    "AirSection",
    "Axes",
    "ControlSection",
    "InertialSection",
    "MotionCaptureSection",
    "Number",
    "Positive",
    "RawSection",
    "RecordedForce",
    "RobotSection",
    "SampledSection",
    "Scenario",
    "Section",
    "SensorSection",
    "SensorsSection",
    "TextTable",
    "ThrustersSection",
    "UnknownForce",
    "Whole",
    "assign",
    "changed_keys",
    "changes_text",
    "describe_scenario",
    "describe_tables",
    "described",
    "differing_keys",
    "explain",
    "explain_plainly",
    "keys_text",
    "load_scenario",
    "parse_scenario",
    "read_toml",
    "scenario_toml",
    "shipped_description",
    "shipped_names",
    "shipped_scenarios",
    "with_settings",
]
