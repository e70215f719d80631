"""One experiment from scenario to numbers: simulate, estimate, evaluate, write."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from aerobat_description import MORPHOLOGIES
from aerobat_pin.estimation import check_names, estimate_log
from aerobat_pin.evaluation import flight_metrics, observer_metrics
from aerobat_pin.flight_log import FlightLog, channel
from aerobat_pin.observers import Estimate
from aerobat_pin.robot import Aerobat
from aerobat_pin.scenario import Scenario, scenario_toml
from aerobat_pin.signals import RecordedForce
from aerobat_pin.simulation import believed_robot, load_robot, simulate

PACKAGES = ("aerobat-pinocchio", "pin", "numpy", "scipy", "xarray", "h5netcdf", "pydantic")
Progress = Callable[[str, float], None]


@dataclass(frozen=True)
class Experiment:
    """What one run made."""

    scenario: Scenario
    robot: Aerobat
    log: FlightLog
    estimates: dict[str, Estimate]
    metrics: dict[str, Any]


def run(
    scenario: Scenario, progress: Progress | None = None, robots: tuple[Aerobat, Aerobat] | None = None
) -> Experiment:
    """Fly, estimate and evaluate a scenario, in memory.

    Args:
        scenario: what happens.
        progress: called with the name of the stage and the share of it that is done.
        robots: the scenario's robot and the believed one, where they are loaded already.

    Raises:
        AerobatError: the scenario asks for what cannot be done.
    """
    check_names(scenario.observers.names)
    robot, believed = loaded(scenario) if robots is None else robots
    log = simulate(scenario, None if progress is None else lambda share: progress("flying", share), robot=robot)
    inputs, estimates = estimate_log(
        log, believed, scenario, None if progress is None else lambda share: progress("estimating", share)
    )
    metrics = {
        "scenario": scenario.name,
        "seed": scenario.simulation.seed,
        "versions": dict(versions()),
        "torque": scenario.observers.torque,
        "inputs": dict(inputs.source),
        "note": flight_note(scenario, robot),
        "observers": {name: observer_metrics(estimate, log) for name, estimate in estimates.items()},
        "flight": flight_metrics(log, robot.mass),
    }
    return Experiment(scenario, robot, log, estimates, metrics)


def loaded(scenario: Scenario) -> tuple[Aerobat, Aerobat]:
    """Load a scenario's robot and the believed one: one and the same where they do not differ. Raises AerobatError."""
    robot = load_robot(scenario)
    return robot, robot if scenario.believed_robot == scenario.robot else believed_robot(scenario)


def flight_note(scenario: Scenario, robot: Aerobat) -> str:
    """Say in a line what keeps the robot up, which sensors err, and which forces nobody looks for.

    It goes wherever the flight is shown. The share is the hold's constant lift over the weight; what it lifts on
    average in flight is among the metrics.
    """
    weight = robot.mass * scenario.flight.gravity
    note = "free flight, nothing held"
    if scenario.hold is not None:
        note = "attitude held"
        if weight > 0.0:
            note += f", {100.0 * scenario.hold.lift / weight:.0f} % thruster-borne"
    unseen = sorted({force.frame for force in scenario.unknown_force} - set(scenario.observers.frames))
    sensors = scenario.sensors.fitted
    note += f"; imperfect sensors: {', '.join(sensors)}" if sensors else ""
    return note + (f"; forces act at {', '.join(unseen)} where no observer looks" if unseen else "")


def recorded_note(log: FlightLog, robot: Aerobat) -> str:
    """Say in a line how long a recorded flight is, and which robot is believed to have flown it."""
    duration = log.time[-1] - log.time[0]
    return f"recorded flight of {duration:.3g} s, {len(log.time)} samples; believed robot {robot.model.name}"


@cache
def versions() -> dict[str, str]:
    """Return the versions of the packages that make the numbers."""
    return {name: metadata.version(name) for name in PACKAGES}


def estimate_dataset(estimates: dict[str, Estimate]) -> xr.Dataset:
    """Label the estimates of several observers on one log for `estimate.nc`; all of them look for the same.

    Forces in world axes are `force_W` (observer, interval, point, axis). Where anything else is looked for, all is
    `components` (observer, interval, component), each with its `unit`.
    """
    first, all_of = next(iter(estimates.values())), list(estimates.values())
    coords: dict[str, Any] = {
        "observer": list(estimates),
        "interval": channel(first.time[:-1], ("interval",), "s", "start of the interval"),
        "interval_end": channel(first.time[1:], ("interval",), "s", "end of the interval"),
    }
    if first.are_world_forces:
        name, meaning = "force_W", "force in world axes"
        dims: tuple[str, ...] = ("point", "axis")
        coords |= {"point": list(first.frames), "axis": ["x", "y", "z"]}
    else:
        name, meaning, dims = "components", "component", ("component",)
        coords |= {"component": list(first.identifiability.components), "unit": (dims, list(first.units))}
    unit, every = ", ".join(dict.fromkeys(first.units)), ("observer", "interval")
    shape = (len(estimates), len(first.components), *(len(coords[dim]) for dim in dims))
    unknown = np.full_like(first.components, np.nan)
    found = np.stack([one.components for one in all_of]).reshape(shape)
    sure = np.stack([unknown if one.standard_deviation is None else one.standard_deviation for one in all_of])
    residual = np.stack([one.residual for one in all_of])
    return xr.Dataset(
        {
            name: channel(found, (*every, *dims), unit, f"estimated {meaning}, mean over the interval"),
            "standard_deviation": channel(
                sure.reshape(shape), (*every, *dims), unit, f"of the estimated {meaning}, where the observer knows it"
            ),
            "residual": channel(residual, (*every, "v_axis"), "N, N m", "estimated generalised force"),
        },
        coords=coords,
    )


def estimate_table(estimates: dict[str, Estimate]) -> str:
    """Return the estimates as a table of text: one row an interval, a column per observer and component."""
    first = next(iter(estimates.values()))
    header, columns = ["start [s]", "end [s]"], [first.time[:-1], first.time[1:]]
    for name, estimate in estimates.items():
        for i, (label, unit) in enumerate(zip(estimate.identifiability.components, estimate.units, strict=True)):
            header.append(f"{name}.{label} [{unit}]")
            columns.append(estimate.components[:, i])
            if estimate.standard_deviation is not None:
                header.append(f"{name}.{label} deviation [{unit}]")
                columns.append(estimate.standard_deviation[:, i])
    rows = np.column_stack(columns)
    return "\n".join([",".join(header), *(",".join(f"{value:.9g}" for value in row) for row in rows)]) + "\n"


def run_recorded(
    log: FlightLog, belief: Scenario, progress: Progress | None = None
) -> tuple[dict[str, Estimate], dict[str, Any]]:
    """Estimate on a recorded flight; return estimates and metrics, with scores where the log has a truth.

    Raises:
        AerobatError: the log or the belief does not give what is asked for.
    """
    robot = believed_robot(belief)
    inputs, estimates = estimate_log(
        log, robot, belief, None if progress is None else lambda share: progress("estimating", share)
    )
    metrics = {
        "scenario": belief.name,
        "seed": None,
        "versions": dict(versions()),
        "torque": belief.observers.torque,
        "inputs": dict(inputs.source),
        "note": recorded_note(log, robot),
        "observers": {name: observer_metrics(estimate, log) for name, estimate in estimates.items()},
    }
    return estimates, metrics


def write_recorded(belief: Scenario, estimates: dict[str, Estimate], metrics: dict[str, Any], folder: Path) -> None:
    """Write belief, estimates (NetCDF and text) and metrics into an existing folder."""
    write_scenario(belief, folder, "belief.toml")
    estimate_dataset(estimates).to_netcdf(folder / "estimate.nc", engine="h5netcdf")
    (folder / "estimate.csv").write_text(estimate_table(estimates), encoding="utf-8")
    write_metrics(metrics, folder)


def write(experiment: Experiment, folder: Path) -> None:
    """Write an experiment's scenario, log, estimates and metrics into an existing folder.

    Files of the user's own that the scenario names are copied beside it, so that the folder can be run again anywhere.
    """
    write_scenario(experiment.scenario, folder)
    experiment.log.save(folder / "flight.nc")
    estimate_dataset(experiment.estimates).to_netcdf(folder / "estimate.nc", engine="h5netcdf")
    write_metrics(experiment.metrics, folder)


def write_scenario(scenario: Scenario, folder: Path, name: str = "scenario.toml") -> None:
    """Write a scenario, and beside it the user's own files that it names: morphology and recorded forces."""
    if scenario.robot.morphology not in MORPHOLOGIES:
        shutil.copyfile(scenario.robot.morphology, folder / "morphology.toml")
        robot = scenario.robot.model_copy(update={"morphology": "morphology.toml"})
        scenario = scenario.model_copy(update={"robot": robot})
    forces = list(scenario.unknown_force)
    for i, force in enumerate(forces):
        if isinstance(force, RecordedForce):
            shutil.copyfile(force.file, folder / f"unknown_force_{i}.csv")
            forces[i] = force.model_copy(update={"file": f"unknown_force_{i}.csv"})
    scenario = scenario.model_copy(update={"unknown_force": tuple(forces)})
    (folder / name).write_text(scenario_toml(scenario), encoding="utf-8")


def write_metrics(metrics: dict[str, Any], folder: Path) -> None:
    """Write `metrics.json`."""
    text = json.dumps(metrics, indent=2, allow_nan=False)
    (folder / "metrics.json").write_text(text + "\n", encoding="utf-8")
