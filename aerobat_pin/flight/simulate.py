"""Simulation: from a scenario to a flight log, the plant's results as labelled channels with units."""

from __future__ import annotations

import json
from collections.abc import Callable
from typing import Any

import numpy as np
import xarray as xr

from aerobat_pin.aerobat import (
    KNOWN_FORCE,
    LABELS,
    MEASURED,
    THRUSTERS,
    TRUE_CHANNELS,
    Aerobat,
    FlightLog,
    channel,
    filled,
    flown_robot,
)
from aerobat_pin.aerodynamics import strips_of
from aerobat_pin.errors import ScenarioError, SimulationError
from aerobat_pin.flight.crank import CrankDrive, RateControlledMotor
from aerobat_pin.flight.loop import ClosedLoop, LoopRecord, Pilot
from aerobat_pin.flight.plant.elastic_joints import as_measured
from aerobat_pin.flight.plant.kernels import advance_stage
from aerobat_pin.flight.plant.plant import Plant
from aerobat_pin.flight.plant.plant_state import interval_means
from aerobat_pin.flight.plant.simulated_elsewhere import Simulator
from aerobat_pin.flight.plant.tables import Trajectory
from aerobat_pin.flight.sensors import measure
from aerobat_pin.numerics import Array, announce_compilation, guarded
from aerobat_pin.observers import rotations
from aerobat_pin.scenario import Scenario

FORCES = (  # of the truth, means over the intervals
    *("force_W", "force_noise_free_W", "unknown", "aerodynamic", "added_mass"),
    *("motor_power", "air_power", "thruster_power", "unknown_power", "link_wrench"),
)
CRANK_FORCES = ("crank_torque", "drive_torque", "drive_power", "friction_power")  # if a motor turns the crank
LOGGED = ("airspeed", "incidence", "downwash", "circulation", "strip_force_z", "strip_force_x")  # of the strips' loads


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
        SimulationError: the flight diverged, or the pilot failed after its first interval; the attribute `kept` is the
            log until then, with an attribute `diverged_at` [s], or None if nothing was flown.
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


def flight_log_of(plant: Plant, time: Array, trajectory: Trajectory, record: LoopRecord | None = None) -> FlightLog:
    """Return the log of a flight simulated by a plant, with exact channels at times (n + 1,) [s].

    If thrusters flew it, `record` is what happened in the loop: the log's known force is then the wrench that the
    controller's model of the thrusters gave, the only one that is known beside a robot; the real one is in the truth.
    """
    scenario, mean, motion = plant.scenario, trajectory.forces, (trajectory.q, trajectory.v)
    q, v, crank = as_measured(scenario, plant.robot, *motion, trajectory.crank_angle, trajectory.crank_rate)
    coords: dict[str, Any] = {
        "time": channel(time, ("time",), "s", "sample time"),
        "interval": channel(time[:-1], ("interval",), "s", "start of the interval"),
    }
    wind = plant.wind(time)[:, 0]
    measured = {
        "q": q,
        "v": v,
        "crank_angle": crank,
        "airspeed": trajectory.v[:, 0] - np.sum(rotations(trajectory.q)[:, :, 0] * wind, axis=1),
        "motor_torque": mean.motor,
        THRUSTERS: mean.thrusters,
    }
    if record is not None:
        measured[THRUSTERS] = np.pad(record.modelled, ((0, 0), (0, plant.model.nv - record.modelled.shape[1])))
        measured["thruster_command"] = record.command
        coords["thruster"] = channel(list(record.thrusters.names), ("thruster",), "", "thruster")
    attributes = {
        "scenario": scenario.name,
        "morphology": scenario.robot.morphology,
        "morphology_changes": json.dumps(scenario.robot.changes),
        "gravity": scenario.flight.gravity,
        "air": scenario.believed_air.model_dump_json(),
    }
    table = MEASURED | {THRUSTERS: KNOWN_FORCE}
    seen = {name: filled(name, values, table) for name, values in measured.items()}
    labels = {name: list(LABELS[name]) for name in ("q_axis", "v_axis")}
    data = xr.Dataset(seen, coords={**coords, **labels}, attrs=attributes)
    return FlightLog(data, _truth(plant, trajectory, record, coords))


def _truth(plant: Plant, trajectory: Trajectory, record: LoopRecord | None, coords: dict[str, Any]) -> xr.Dataset:
    """Return what only a simulation knows of a flight; `coords` are the log's."""
    mean, strips, motion = trajectory.forces, strips_of(trajectory.loads), ("q", "v", "crank_angle")
    names = ["v_axis", "axis", "link", "wrench_axis"]
    true: dict[str, Any] = {name: getattr(mean, name) for name in FORCES}
    for name in LOGGED:
        true[name] = getattr(strips, name.removeprefix("strip_")).copy()  # so that the other rows can go
    if plant.scenario.plant.shows_joints:
        true |= {name: getattr(trajectory, name) for name in motion}
        names.append("q_axis")
    if plant.elastic.count:
        true["deflection"] = trajectory.deflection
        names.append("joint")
    if isinstance(plant.drive, RateControlledMotor):
        true["crank_rate"] = trajectory.crank_rate
        true |= {name: getattr(mean, name) for name in CRANK_FORCES}
    if record is not None:
        true |= {
            "thrust": record.thrust,
            "thruster_wrench": record.thrust @ record.thrusters.map.T,
            "unrealised_wrench": record.unrealised,
            "seen_disturbance": record.disturbance,
        }
    if trajectory.air.size:
        true["air_state"] = trajectory.air
    axes: dict[str, Any] = {name: list(LABELS[name]) for name in names}
    axes["point"] = list(plant.points)
    axes["strip"] = channel(plant.air.line.y, ("strip",), "m", "arc coordinate, left wing positive")
    events = [(force.frame, *force.signal.event) for force in plant.forces if force.signal.event is not None]
    if events:
        points, events_named, true["event_start"], true["event_end"] = zip(*events, strict=True)
        axes |= {"event": list(events_named), "event_point": ("event", list(points))}
    channels = {name: filled(name, values, TRUE_CHANNELS) for name, values in true.items()}
    return xr.Dataset(channels, coords={**coords, **axes})
