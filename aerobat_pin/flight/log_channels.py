"""The channels of a simulated flight: the plant's results as a labelled log with units."""

from __future__ import annotations

import json

import numpy as np
import xarray as xr

from aerobat_pin.aerodynamics import strips_of
from aerobat_pin.flight.crank import RateControlledMotor
from aerobat_pin.flight.flight_log import KNOWN, POSE_AXIS, TWIST_AXIS, FlightLog, channel
from aerobat_pin.flight.plant.plant import Flown, Plant
from aerobat_pin.numerics import Array
from aerobat_pin.robot import JOINTS, LINKS, rotations

Row = tuple[Array, tuple[str, ...], str, str]  # values, dimensions, unit, meaning


def flight_log_of(plant: Plant, time: Array, flown: Flown) -> FlightLog:
    """Return the log of a flight simulated by a plant, with exact channels at times (n + 1,) [s]."""
    robot, scenario, mean = plant.robot, plant.scenario, flown.forces
    order = [name for _, name in sorted(zip(robot.idx_v, JOINTS, strict=True))]
    per_sample, per_interval = ("time",), ("interval",)
    generalized = (*per_interval, "v_axis")
    coords = {
        "time": channel(time, per_sample, "s", "sample time"),
        "interval": channel(time[:-1], per_interval, "s", "start of the interval"),
    }
    n, nm = "N", "N, N m"
    measured: dict[str, Row] = {
        "q": (flown.q, ("time", "q_axis"), "m, -, rad", "configuration: position in world, quaternion, joints"),
        "v": (flown.v, ("time", "v_axis"), "m/s, rad/s", "velocity: body twist in body axes, joint rates"),
        "crank_angle": (flown.crank_angle, per_sample, "rad", "absolute crank angle t1"),
        "airspeed": (_airspeed(plant, time, flown), per_sample, "m/s", "airspeed along the body's x axis, at its COM"),
        "motor_torque": (mean.motor, generalized, "N m", "motor torque at the joints, interval mean"),
        f"{KNOWN}thrusters": (mean.thrusters, generalized, nm, "attitude hold's generalised force, interval mean"),
    }
    attributes = {
        "scenario": scenario.name,
        "morphology": scenario.robot.morphology,
        "morphology_changes": json.dumps(scenario.robot.changes),
        "gravity": scenario.flight.gravity,
        "air": scenario.believed_air.model_dump_json(),
    }
    at_point, link = (*per_interval, "point", "axis"), (*per_interval, "link", "wrench_axis")
    strip, strips = (*per_interval, "strip"), strips_of(flown.loads)
    true: dict[str, Row] = {
        "force_W": (mean.force_W, at_point, n, "unknown force in world axes, interval mean"),
        "force_noise_free_W": (mean.force_noise_free_W, at_point, n, "unknown force without its noise, interval mean"),
        "unknown": (mean.unknown, generalized, nm, "unknown generalised force, interval mean"),
        "aerodynamic": (mean.aerodynamic, generalized, nm, "aerodynamic generalised force, interval mean"),
        "added_mass": (mean.added_mass, generalized, nm, "generalised force of the wings' added mass, interval mean"),
        "motor_power": (mean.motor_power, per_interval, "W", "motor power, interval mean"),
        "air_power": (mean.air_power, per_interval, "W", "power of air and added mass, interval mean"),
        "thruster_power": (mean.thruster_power, per_interval, "W", "power of the attitude hold, interval mean"),
        "unknown_power": (mean.unknown_power, per_interval, "W", "power of the unknown forces, interval mean"),
        "link_wrench": (mean.link_wrench, link, nm, "air on links, at and in their frames"),
        "airspeed": (strips.airspeed, strip, "m/s", "air past the strip, in its plane, at start"),
        "incidence": (strips.incidence, strip, "rad", "incidence at the 3/4 chord, at start"),
        "downwash": (strips.downwash, strip, "m/s", "downwash of the wake, at start"),
        "circulation": (strips.circulation, strip, "m2/s", "bound circulation, at start"),
        "strip_force_z": (strips.force_z, strip, n, "force along the link's z, at start"),
        "strip_force_x": (strips.force_x, strip, n, "force along the link's x, at start"),
    }
    if isinstance(plant.drive, RateControlledMotor):
        true |= {
            "crank_rate": (flown.crank_rate, per_sample, "rad/s", "rate of the crank"),
            "crank_torque": (mean.crank_torque, per_interval, "N m", "torque from crank to linkage, interval mean"),
            "drive_torque": (mean.drive_torque, per_interval, "N m", "torque of the motor on the crank, interval mean"),
            "drive_power": (mean.drive_power, per_interval, "W", "power of the motor on the crank, interval mean"),
            "friction_power": (mean.friction_power, per_interval, "W", "power lost to friction, interval mean"),
        }
    axes = {
        "v_axis": [*TWIST_AXIS, *order],
        "point": list(plant.points),
        "axis": ["x", "y", "z"],
        "link": list(LINKS),
        "wrench_axis": ["fx", "fy", "fz", "mx", "my", "mz"],
        "strip": channel(plant.air.line.y, ("strip",), "m", "arc coordinate, left wing positive"),
    }
    truth = xr.Dataset({name: channel(*row) for name, row in true.items()}, coords={**coords, **axes})
    if flown.air.size:
        truth["air_state"] = channel(flown.air, ("time", "air_axis"), "m, m, m2/s", "zeta_1, zeta_2, circulation")
    events = [(force.frame, *force.signal.event) for force in plant.forces if force.signal.event is not None]
    if events:
        points, names, starts, ends = zip(*events, strict=True)
        truth = truth.assign_coords(event=list(names), event_point=("event", list(points)))
        truth["event_start"] = channel(starts, ("event",), "s", "when an unknown force comes")
        truth["event_end"] = channel(ends, ("event",), "s", "when it goes; infinity where it stays")
    seen = {name: channel(*row) for name, row in measured.items()}
    axes = {"q_axis": [*POSE_AXIS, *order], "v_axis": [*TWIST_AXIS, *order]}
    return FlightLog(xr.Dataset(seen, coords={**coords, **axes}, attrs=attributes), truth)


def _airspeed(plant: Plant, time: Array, flown: Flown) -> Array:
    wind = plant.wind(time)[:, 0]
    return np.asarray(flown.v[:, 0] - np.sum(rotations(flown.q)[:, :, 0] * wind, axis=1))
