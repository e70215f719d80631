"""The channels of a simulated flight: the plant's results as a labelled log with units."""

from __future__ import annotations

import json

import numpy as np
import xarray as xr

from aerobat_pin.aerobat import KNOWN_FORCE, LABELS, MEASURED, THRUSTERS, TRUE_CHANNELS, FlightLog, channel, filled
from aerobat_pin.aerodynamics import strips_of
from aerobat_pin.flight.crank import RateControlledMotor
from aerobat_pin.flight.loop import LoopRecord
from aerobat_pin.flight.plant.elastic_joints import as_measured
from aerobat_pin.flight.plant.plant import Plant
from aerobat_pin.flight.plant.tables import Trajectory
from aerobat_pin.numerics import Array
from aerobat_pin.observers import rotations

FORCES = (  # of the truth, means over the intervals
    *("force_W", "force_noise_free_W", "unknown", "aerodynamic", "added_mass"),
    *("motor_power", "air_power", "thruster_power", "unknown_power", "link_wrench"),
)
LOGGED = {  # channel of the truth -> row of the strip loads
    "airspeed": "airspeed",
    "incidence": "incidence",
    "downwash": "downwash",
    "circulation": "circulation",
    "strip_force_z": "force_z",
    "strip_force_x": "force_x",
}


def flight_log_of(plant: Plant, time: Array, trajectory: Trajectory, record: LoopRecord | None = None) -> FlightLog:
    """Return the log of a flight simulated by a plant, with exact channels at times (n + 1,) [s].

    If thrusters flew it, `record` is what happened in the loop: the log's known force is then the wrench that the
    controller's model of the thrusters gave, the only one that is known beside a robot; the real one is in the truth.
    """
    scenario, mean, strips = plant.scenario, trajectory.forces, strips_of(trajectory.loads)
    q, v, crank = as_measured(
        scenario, plant.robot, trajectory.q, trajectory.v, trajectory.crank_angle, trajectory.crank_rate
    )
    coords = {
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
    attributes = {
        "scenario": scenario.name,
        "morphology": scenario.robot.morphology,
        "morphology_changes": json.dumps(scenario.robot.changes),
        "gravity": scenario.flight.gravity,
        "air": scenario.believed_air.model_dump_json(),
    }
    true = {name: getattr(mean, name) for name in FORCES}
    true |= {name: getattr(strips, field).copy() for name, field in LOGGED.items()}  # so that the other rows can go
    more = []
    if scenario.plant.shows_joints:
        true |= {"q": trajectory.q, "v": trajectory.v, "crank_angle": trajectory.crank_angle}
        more.append("q_axis")
    if plant.elastic.count:
        true["deflection"] = trajectory.deflection
        more.append("joint")
    if isinstance(plant.drive, RateControlledMotor):
        true["crank_rate"] = trajectory.crank_rate
        true |= {
            name: getattr(mean, name) for name in ("crank_torque", "drive_torque", "drive_power", "friction_power")
        }
    if record is not None:
        true |= {
            "thrust": record.thrust,
            "thruster_wrench": record.thrust @ record.thrusters.map.T,
            "unrealised_wrench": record.unrealised,
            "seen_disturbance": record.disturbance,
        }
        coords["thruster"] = channel(list(record.thrusters.names), ("thruster",), "", "thruster")
    axes = {
        **{name: list(LABELS[name]) for name in ("v_axis", "axis", "link", "wrench_axis", *more)},
        "point": list(plant.points),
        "strip": channel(plant.air.line.y, ("strip",), "m", "arc coordinate, left wing positive"),
    }
    if trajectory.air.size:
        true["air_state"] = trajectory.air
    events = [(force.frame, *force.signal.event) for force in plant.forces if force.signal.event is not None]
    if events:
        points, names, true["event_start"], true["event_end"] = zip(*events, strict=True)
        axes |= {"event": list(names), "event_point": ("event", list(points))}
    truth = xr.Dataset(
        {name: filled(name, values, TRUE_CHANNELS) for name, values in true.items()}, coords={**coords, **axes}
    )
    table = MEASURED | {THRUSTERS: KNOWN_FORCE}
    seen = {name: filled(name, values, table) for name, values in measured.items()}
    labels = {name: list(LABELS[name]) for name in ("q_axis", "v_axis")}
    return FlightLog(xr.Dataset(seen, coords={**coords, **labels}, attrs=attributes), truth)
