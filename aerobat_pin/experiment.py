"""One experiment from scenario to numbers: simulate, estimate, evaluate, write."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from aerobat_description import MORPHOLOGIES
from aerobat_pin.errors import ScenarioError
from aerobat_pin.evaluation import flight_metrics, observer_metrics
from aerobat_pin.flight_log import FlightLog, channel
from aerobat_pin.known_inputs import ROWS_OF_TORQUE, known_inputs
from aerobat_pin.observers import OBSERVERS, Estimate
from aerobat_pin.robot import Aerobat
from aerobat_pin.scenario import Scenario, scenario_toml
from aerobat_pin.simulation import load_robot, simulate

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


def run(scenario: Scenario, progress: Progress | None = None) -> Experiment:
    """Fly, estimate and evaluate a scenario, in memory.

    Args:
        scenario: what happens.
        progress: called with the name of the stage and the share of it that is done.

    Raises:
        AerobatError: the scenario asks for what cannot be done.
    """
    names = scenario.observers.names
    unknown = [name for name in names if name not in OBSERVERS]
    if unknown or not names:
        raise ScenarioError(f"observers.names = {list(names)}: choose from {', '.join(OBSERVERS)}")
    robot = load_robot(scenario)
    torque = scenario.observers.torque
    rows, frames, gain = ROWS_OF_TORQUE[torque], scenario.observers.frames, scenario.observers.gain
    observers = [OBSERVERS[name](robot.model, frames, gain, rows) for name in names]
    log = simulate(scenario, None if progress is None else lambda share: progress("flying", share))
    inputs = known_inputs(log, robot, torque)
    estimates = {}
    for i, observer in enumerate(observers):
        if progress is not None:
            progress("estimating", i / len(observers))
        estimates[observer.name] = observer.run(inputs.time, inputs.q, inputs.v, inputs.tau, inputs.known)
    metrics = {
        "scenario": scenario.name,
        "seed": scenario.simulation.seed,
        "versions": versions(),
        "torque": torque,
        "inputs": dict(inputs.source),
        "note": flight_note(scenario, robot),
        "observers": {name: observer_metrics(estimate, log) for name, estimate in estimates.items()},
        "flight": flight_metrics(log, robot.mass),
    }
    return Experiment(scenario, robot, log, estimates, metrics)


def flight_note(scenario: Scenario, robot: Aerobat) -> str:
    """Say in a line what keeps the robot up, and which forces nobody looks for; it goes wherever the flight is shown.

    The share is the hold's constant lift over the weight; what it lifts on average in flight is among the metrics.
    """
    weight = robot.mass * scenario.flight.gravity
    note = "free flight, nothing held"
    if scenario.hold is not None:
        note = "attitude held"
        if weight > 0.0:
            note += f", {100.0 * scenario.hold.lift / weight:.0f} % thruster-borne"
    unseen = sorted({force.frame for force in scenario.unknown_force} - set(scenario.observers.frames))
    return note + (f"; forces act at {', '.join(unseen)} where no observer looks" if unseen else "")


def versions() -> dict[str, str]:
    """Return the versions of the packages that make the numbers."""
    return {name: metadata.version(name) for name in PACKAGES}


def estimate_dataset(estimates: dict[str, Estimate]) -> xr.Dataset:
    """Label the estimates of several observers on one log for `estimate.nc`."""
    first = next(iter(estimates.values()))
    names = list(estimates)
    dims = ("observer", "interval", "point", "axis")
    force = np.stack([estimates[name].force for name in names])
    residual = np.stack([estimates[name].residual for name in names])
    return xr.Dataset(
        {
            "force_W": channel(force, dims, "N", "estimated force in world axes, mean over the interval"),
            "residual": channel(residual, (*dims[:2], "v_axis"), "N, N m", "estimated generalised force"),
        },
        coords={
            "observer": names,
            "interval": channel(first.time[:-1], ("interval",), "s", "start of the interval"),
            "interval_end": channel(first.time[1:], ("interval",), "s", "end of the interval"),
            "point": list(first.frames),
            "axis": ["x", "y", "z"],
        },
    )


def write(experiment: Experiment, folder: Path) -> None:
    """Write an experiment's scenario, log, estimates and metrics into an existing folder.

    A morphology file of the user's own is copied beside the scenario, so that the folder can be run again anywhere.
    """
    scenario = experiment.scenario
    if scenario.robot.morphology not in MORPHOLOGIES:
        shutil.copyfile(scenario.robot.morphology, folder / "morphology.toml")
        robot = scenario.robot.model_copy(update={"morphology": "morphology.toml"})
        scenario = scenario.model_copy(update={"robot": robot})
    (folder / "scenario.toml").write_text(scenario_toml(scenario), encoding="utf-8")
    experiment.log.save(folder / "flight.nc")
    estimate_dataset(experiment.estimates).to_netcdf(folder / "estimate.nc", engine="h5netcdf")
    text = json.dumps(experiment.metrics, indent=2, allow_nan=False)
    (folder / "metrics.json").write_text(text + "\n", encoding="utf-8")
