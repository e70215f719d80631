"""From a scenario to a flight log."""

from __future__ import annotations

import json
from collections.abc import Callable

import numpy as np
import xarray as xr

from aerobat_pin.arrays import Array
from aerobat_pin.disturbances import PointForce
from aerobat_pin.flight_log import KNOWN, FlightLog, channel
from aerobat_pin.jit import announce_compilation
from aerobat_pin.plant import Flown, Plant
from aerobat_pin.plant_kernels import advance
from aerobat_pin.robot import JOINTS, Aerobat, load_aerobat
from aerobat_pin.scenario import Scenario

Q_AXIS = ("x", "y", "z", "qx", "qy", "qz", "qw")
V_AXIS = ("vx", "vy", "vz", "wx", "wy", "wz")


def load_robot(scenario: Scenario) -> Aerobat:
    """Load a scenario's robot, with its changes and its gravity. Raises as `load_aerobat`."""
    chosen = scenario.robot
    return load_aerobat(chosen.morphology, chosen.changes, gravity=scenario.flight.gravity)


def simulate(scenario: Scenario, progress: Callable[[float], None] | None = None) -> FlightLog:
    """Fly a scenario.

    Args:
        scenario: what happens.
        progress: called with the share done, 0..1, about a hundred times.

    Raises:
        ScenarioError, MorphologyFileError, LinkageError: the scenario asks for what the robot cannot do.
        SimulationError: the flight diverged.
    """
    settings = scenario.simulation
    announce_compilation(advance)
    plant = Plant(load_robot(scenario), scenario)
    count, dt = settings.count, settings.dt
    time = np.arange(count + 1) * dt
    flown = plant.fly(count, dt, held_parts(plant.forces, time, settings.seed), progress)
    return _flight_log(plant, time, flown)


def held_parts(forces: tuple[PointForce, ...], edges: Array, seed: int) -> Array:
    """Draw noise and step of every force (2, forces, n), each from a stream of its own, by its place in the list."""
    parts = np.zeros((2, len(forces), len(edges) - 1))
    for i, force in enumerate(forces):
        parts[:, i] = force.signal.held(edges, np.random.default_rng([seed, i]))
    return parts


def _flight_log(plant: Plant, time: Array, flown: Flown) -> FlightLog:
    robot, scenario, mean = plant.robot, plant.scenario, flown.forces
    order = [name for _, name in sorted(zip(robot.idx_v, JOINTS, strict=True))]
    per_sample, per_interval = ("time",), ("interval",)
    generalized = (*per_interval, "v_axis")
    coords = {
        "time": channel(time, per_sample, "s", "sample time"),
        "interval": channel(time[:-1], per_interval, "s", "start of the interval"),
    }
    measured = xr.Dataset(
        {
            "q": channel(
                flown.q, ("time", "q_axis"), "m, -, rad", "configuration: position in world, quaternion, joints"
            ),
            "v": channel(flown.v, ("time", "v_axis"), "m/s, rad/s", "velocity: body twist in body axes, joint rates"),
            "crank_angle": channel(
                plant.crank_start + plant.crank_rate * time, per_sample, "rad", "absolute crank angle t1"
            ),
            "motor_torque": channel(mean.motor, generalized, "N m", "motor torque at the joints, interval mean"),
            f"{KNOWN}aerodynamic": channel(
                mean.aerodynamic, generalized, "N, N m", "aerodynamic generalised force, interval mean"
            ),
            f"{KNOWN}thrusters": channel(
                mean.thrusters, generalized, "N, N m", "attitude hold's generalised force, interval mean"
            ),
        },
        coords={**coords, "q_axis": [*Q_AXIS, *order], "v_axis": [*V_AXIS, *order]},
        attrs={
            "scenario": scenario.name,
            "morphology": scenario.robot.morphology,
            "morphology_changes": json.dumps(scenario.robot.changes),
            "gravity": scenario.flight.gravity,
        },
    )
    at_point = (*per_interval, "point", "axis")
    strip = (*per_interval, "strip")
    truth = xr.Dataset(
        {
            "force_W": channel(mean.force_W, at_point, "N", "unknown force in world axes, interval mean"),
            "force_noise_free_W": channel(
                mean.force_noise_free_W, at_point, "N", "unknown force without its noise, interval mean"
            ),
            "unknown": channel(mean.unknown, generalized, "N, N m", "unknown generalised force, interval mean"),
            "motor_power": channel(mean.motor_power, per_interval, "W", "motor power, interval mean"),
            "air_state": channel(flown.air, ("time", "air_axis"), "m, m, m2/s", "zeta_1, zeta_2, circulation"),
            "incidence": channel(
                np.arctan2(flown.loads[:, 1], flown.loads[:, 0]), strip, "rad", "incidence at the 3/4 chord, at start"
            ),
            "strip_force_z": channel(flown.loads[:, 4], strip, "N", "force along the link's z, at start"),
            "strip_force_x": channel(flown.loads[:, 3], strip, "N", "force along the link's x, at start"),
        },
        coords={
            **coords,
            "v_axis": [*V_AXIS, *order],
            "point": list(plant.points),
            "axis": ["x", "y", "z"],
            "strip": channel(plant.air.line.y, ("strip",), "m", "arc coordinate, left wing positive"),
        },
    )
    stepped = [force.signal for force in plant.forces if force.signal.step != 0.0]
    if stepped:
        truth.attrs["step_zone"] = [stepped[0].step_start, stepped[0].step_end]
    return FlightLog(measured, truth)
