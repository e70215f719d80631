"""The robots that a scenario names: the one that flies, and the one that its observers believe in."""

from __future__ import annotations

from aerobat_pin.robot.aerobat import Aerobat, load_aerobat
from aerobat_pin.scenario import Scenario


def load_robot(scenario: Scenario) -> Aerobat:
    """Load a scenario's robot, with its changes and its gravity. Raises as `load_aerobat`."""
    chosen = scenario.robot
    return load_aerobat(chosen.morphology, chosen.changes, gravity=scenario.flight.gravity)


def believed_robot(scenario: Scenario) -> Aerobat:
    """Load the robot that a scenario's observers believe in. Raises as `load_aerobat`."""
    chosen = scenario.believed_robot
    return load_aerobat(chosen.morphology, chosen.changes, gravity=scenario.flight.gravity)
