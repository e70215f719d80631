"""Simulation: from a scenario to a flight log."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from aerobat_pin.aerobat import Aerobat, FlightLog, flown_robot
from aerobat_pin.errors import ScenarioError, SimulationError
from aerobat_pin.flight.crank import CrankDrive, RateControlledMotor
from aerobat_pin.flight.log_channels import flight_log_of
from aerobat_pin.flight.loop import ClosedLoop, Pilot
from aerobat_pin.flight.mujoco_robot import MujocoRobot
from aerobat_pin.flight.plant.kernels import advance_stage
from aerobat_pin.flight.plant.plant import Plant
from aerobat_pin.flight.plant.plant_state import interval_means
from aerobat_pin.flight.plant.simulated_elsewhere import Simulator
from aerobat_pin.flight.plant.tables import Trajectory
from aerobat_pin.flight.sensors import measure
from aerobat_pin.numerics import announce_compilation, guarded
from aerobat_pin.scenario import Scenario


@guarded(pilot="free", simulator="free")
def simulate(
    scenario: Scenario,
    progress: Callable[[float], None] | None = None,
    drive: CrankDrive | RateControlledMotor | None = None,
    robot: Aerobat | None = None,
    pilot: Pilot | None = None,
    simulator: Simulator | None = None,
) -> FlightLog:
    """Simulate the flight of a scenario and return its log.

    Args:
        scenario: robot, start, air, crank, forces and sensors.
        progress: called about a hundred times with the completed share, 0..1.
        drive: crank drive or motor that replaces the scenario's.
        robot: the scenario's robot, if it is already loaded by `flown_robot`.
        pilot: what flies the robot by its thrusters; needed if, and only if, the scenario has a table `control`.
        simulator: what integrates the motion in the plant's place, see `Simulator`; what `plant.simulator` names when
            omitted.

    Raises:
        ScenarioError, MorphologyFileError, LinkageError: the scenario does not fit its robot, or is too large.
        CrankError: the drive's angle, rate and acceleration do not agree.
        SimulationError: the flight diverged; its attribute `kept` is the log until then, with an attribute
            `diverged_at` [s], or None if nothing was flown.
    """
    scenario.check_size()  # a copy with other values has not been checked
    settings = scenario.simulation
    announce_compilation(advance_stage)
    if (pilot is None) != (scenario.control is None):
        given = "no pilot was given" if pilot is None else "a pilot was given"
        table = "no table" if scenario.control is None else "a table"
        raise ScenarioError(
            f"scenario {scenario.name} has {table} control, but {given}: `run` closes the loop by itself, and so does "
            "`simulate(scenario, pilot=aerobat_pin.control.Controller(scenario))`"
        )
    robot = flown_robot(scenario) if robot is None else robot
    if simulator is None and scenario.plant.simulator is not None:
        simulator = MujocoRobot(robot)
    plant = Plant(robot, scenario, drive, simulator)
    count, dt = settings.count, settings.dt
    time = np.arange(count + 1) * dt

    loop: ClosedLoop | None = None

    def log_of(trajectory: Trajectory) -> FlightLog:
        samples = len(trajectory.q)
        record = None if loop is None else loop.record(samples - 1)
        log = flight_log_of(plant, time[:samples], trajectory, record)
        plant.flight = None  # the two know each other, so its tables would stay until the garbage collector comes
        return measure(log, plant.robot, scenario.sensors, settings.seed)

    step_means = interval_means(plant.forces, time, settings.seed)
    try:
        if pilot is None:
            return log_of(plant.fly(count, dt, step_means, progress))
        loop = ClosedLoop(plant, pilot, step_means)
        return log_of(loop.fly(count, progress))
    except SimulationError as error:
        if isinstance(error.kept, Trajectory):
            error.kept = log_of(error.kept)
            error.kept.measured.attrs["diverged_at"] = error.diverged_at
        raise
