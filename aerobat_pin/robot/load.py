"""The robots of a scenario: the robot that flies, and the robot that its observers assume (the believed robot)."""

from __future__ import annotations

from aerobat_pin.numerics import guarded
from aerobat_pin.robot.aerobat import Aerobat, load_aerobat
from aerobat_pin.scenario import Scenario


@guarded()
def flown_robot(scenario: Scenario) -> Aerobat:
    """Load the robot that flies in a scenario, with the scenario's changes and gravity.

    Raises the same errors as `load_aerobat`.
    """
    chosen = scenario.robot
    return load_aerobat(chosen.morphology, chosen.changes, gravity=scenario.flight.gravity)


@guarded()
def believed_robot(scenario: Scenario) -> Aerobat:
    """Load the robot that a scenario's observers assume. Raises the same errors as `load_aerobat`."""
    chosen = scenario.believed_robot
    return load_aerobat(chosen.morphology, chosen.changes, gravity=scenario.flight.gravity)
