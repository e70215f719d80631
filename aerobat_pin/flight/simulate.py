"""From a scenario to a flight log."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from aerobat_pin.flight.crank import CrankDrive
from aerobat_pin.flight.flight_log import FlightLog
from aerobat_pin.flight.log_channels import flight_log_of
from aerobat_pin.flight.plant.kernels import advance_stage
from aerobat_pin.flight.plant.plant import Plant
from aerobat_pin.flight.point_forces import interval_means
from aerobat_pin.flight.sensors import recorded
from aerobat_pin.numerics import announce_compilation
from aerobat_pin.robot import Aerobat, load_robot
from aerobat_pin.scenario import Scenario


def simulate(
    scenario: Scenario,
    progress: Callable[[float], None] | None = None,
    drive: CrankDrive | None = None,
    robot: Aerobat | None = None,
) -> FlightLog:
    """Fly a scenario.

    Args:
        scenario: what happens.
        progress: called with the share done, 0..1, about a hundred times.
        drive: how the crank turns, in place of the scenario's drive.
        robot: the scenario's robot where it is loaded already, as by `load_robot`.

    Raises:
        ScenarioError, MorphologyFileError, LinkageError: the scenario asks for what the robot cannot do.
        CrankError: the drive is not a motion.
        SimulationError: the flight diverged.
    """
    settings = scenario.simulation
    announce_compilation(advance_stage)
    plant = Plant(load_robot(scenario) if robot is None else robot, scenario, drive)
    count, dt = settings.count, settings.dt
    time = np.arange(count + 1) * dt
    flown = plant.fly(count, dt, interval_means(plant.forces, time, settings.seed), progress)
    log = flight_log_of(plant, time, flown)
    return recorded(log, plant.robot, scenario.sensors, settings.seed)
