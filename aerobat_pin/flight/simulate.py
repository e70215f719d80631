"""Simulation: from a scenario to a flight log."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from aerobat_pin.errors import SimulationError
from aerobat_pin.flight.crank import CrankDrive, RateControlledMotor
from aerobat_pin.flight.flight_log import FlightLog
from aerobat_pin.flight.log_channels import flight_log_of
from aerobat_pin.flight.plant.kernels import advance_stage
from aerobat_pin.flight.plant.plant import Flown, Plant
from aerobat_pin.flight.point_forces import interval_means
from aerobat_pin.flight.sensors import recorded
from aerobat_pin.numerics import announce_compilation, guarded
from aerobat_pin.robot import Aerobat, load_robot
from aerobat_pin.scenario import Scenario


@guarded()
def simulate(
    scenario: Scenario,
    progress: Callable[[float], None] | None = None,
    drive: CrankDrive | RateControlledMotor | None = None,
    robot: Aerobat | None = None,
) -> FlightLog:
    """Simulate the flight of a scenario and return its log.

    Args:
        scenario: robot, start, air, crank, forces and sensors.
        progress: called about a hundred times with the completed share, 0..1.
        drive: crank drive or motor that replaces the scenario's.
        robot: the scenario's robot, if it is already loaded by `load_robot`.

    Raises:
        ScenarioError, MorphologyFileError, LinkageError: the scenario does not fit its robot, or is too large.
        CrankError: the drive's angle, rate and acceleration do not agree.
        SimulationError: the flight diverged; its attribute `kept` is the log until then, with an attribute
            `diverged_at` [s], or None if nothing was flown.
    """
    scenario.check_size()  # a copy with other values has not been checked
    settings = scenario.simulation
    announce_compilation(advance_stage)
    plant = Plant(load_robot(scenario) if robot is None else robot, scenario, drive)
    count, dt = settings.count, settings.dt
    time = np.arange(count + 1) * dt

    def log_of(flown: Flown) -> FlightLog:
        log = flight_log_of(plant, time[: len(flown.q)], flown)
        return recorded(log, plant.robot, scenario.sensors, settings.seed)

    try:
        return log_of(plant.fly(count, dt, interval_means(plant.forces, time, settings.seed), progress))
    except SimulationError as error:
        if isinstance(error.kept, Flown):
            error.kept = log_of(error.kept)
            error.kept.measured.attrs["diverged_at"] = error.diverged_at
        raise
