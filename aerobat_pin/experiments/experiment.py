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

from aerobat_description import MORPHOLOGIES
from aerobat_pin.estimation import check_names, estimate_log, flight_metrics, observer_metrics
from aerobat_pin.experiments.notes import flight_note, recorded_note
from aerobat_pin.experiments.result_tables import estimate_dataset, estimate_table
from aerobat_pin.flight import FlightLog, simulate
from aerobat_pin.observers import Estimate
from aerobat_pin.robot import Aerobat, believed_robot, load_robot
from aerobat_pin.scenario import RecordedForce, Scenario, scenario_toml

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


@cache
def versions() -> dict[str, str]:
    """Return the versions of the packages that make the numbers."""
    return {name: metadata.version(name) for name in PACKAGES}


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
