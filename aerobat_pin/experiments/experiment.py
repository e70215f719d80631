"""Run one experiment: simulate a scenario or read a recorded flight, estimate the forces, score them, write files."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property
from html import escape
from importlib import metadata
from pathlib import Path
from typing import Any

import pandas as pd

from aerobat_description import MORPHOLOGIES
from aerobat_pin.aerobat import (
    AerobatRobot,
    FlightLog,
    check_names,
    estimate_log,
    flight_findings,
    truth_of,
)
from aerobat_pin.control import Controller, control_summary, course_rms
from aerobat_pin.errors import SimulationError
from aerobat_pin.estimation import Calibration, calibration_bytes, observer_scores
from aerobat_pin.experiments.flight_summary import flight_summary
from aerobat_pin.experiments.metrics import TABLE_HEADER, Scores
from aerobat_pin.experiments.notes import flight_note, recorded_note
from aerobat_pin.experiments.result_tables import estimate_dataset, estimate_table
from aerobat_pin.flight import log_with_motion, simulate
from aerobat_pin.numerics import guarded
from aerobat_pin.observers import Estimate
from aerobat_pin.records import netcdf_bytes
from aerobat_pin.robot import Aerobat, believed_robot, load_robot
from aerobat_pin.scenario import RecordedForce, Scenario, changed_keys, described, scenario_toml

FIGURES = ("position", "states", "stick_diagram", "estimation", "linkage", "aerodynamics", "power", "control")
RESULTS = (  # all that a run or an estimate writes, as glob patterns
    "scenario.toml",
    "belief.toml",
    "morphology.toml",
    "unknown_force_*.csv",
    "flight.nc",
    "estimate.nc",
    "estimate.csv",
    "calibration.nc",
    "metrics.json",
    *(f"figures/{name}.{kind}" for name in FIGURES for kind in ("png", "pdf")),
    "report.html",
    "replay.html",
)
VERSIONED_PACKAGES = ("aerobat-pinocchio", "pin", "numpy", "scipy", "xarray", "h5netcdf", "pydantic")
Progress = Callable[[str, float], None]  # called with the name of the stage and the share of the stage that is done


@dataclass(frozen=True, repr=False)
class Experiment:
    """The results of one flight, simulated or recorded.

    Attributes:
        scenario: the simulated scenario; for a recorded flight, what is assumed about it (robot, air, observers).
        robot: the robot that flew; for a recorded flight, the assumed robot.
        log: the flight log.
        estimates: observer -> estimate.
        scores: how well the estimates match the true forces, and a summary of the flight.
        drawn: the log that figures and replay show: `log`, or for raw samples one with the true or smoothed motion.
        calibration: what free flights had shown about the belief; None without a calibration.
    """

    scenario: Scenario
    robot: Aerobat
    log: FlightLog
    estimates: dict[str, Estimate]
    scores: Scores
    drawn: FlightLog
    calibration: Calibration | None = None

    @cached_property
    def metrics(self) -> dict[str, Any]:
        """The scores as plain values, as written to `metrics.json`."""
        return self.scores.to_json()

    @property
    def is_recorded(self) -> bool:
        """True if the flight was recorded, False if it was simulated."""
        return self.scores.flight is None

    def __repr__(self) -> str:
        robot = f"{self.robot.model.name}, {1e3 * self.robot.mass:.1f} g"
        time = self.log.time
        return (
            f"Experiment {self.scores.title}\n"
            f"  robot {robot}; {time[-1] - time[0]:.3g} s, {len(time)} samples; observers {', '.join(self.estimates)}"
        )

    def _repr_html_(self) -> str:
        """Return the table of scores as HTML, for notebooks."""
        table = pd.DataFrame(list(self.scores.rows()), columns=list(TABLE_HEADER)).to_html(index=False)
        return f"<p>{escape(self.scores.title)}</p>{table}"


@guarded()
def run(
    scenario: Scenario,
    progress: Progress | None = None,
    robots: tuple[Aerobat, Aerobat] | None = None,
    calibration: Calibration | None = None,
) -> Experiment:
    """Simulate a scenario, estimate the forces and score the estimates; no file is written.

    Args:
        scenario: the scenario to run.
        progress: called with the name of the stage and the share of the stage that is done.
        robots: the robot that flies and the robot that the observers assume; loaded from the scenario when omitted.
        calibration: what free flights showed about the scenario's belief.

    Raises:
        SimulationError: the flight diverged; its attribute `kept` is the experiment until then.
        AerobatError: the scenario cannot be run, for instance because it names an unknown observer.
    """
    check_names(scenario.observers.names)
    if robots is None:
        flies = load_robot(scenario)
        robots = flies, flies if scenario.believed_robot == scenario.robot else believed_robot(scenario)
    robot, believed = robots
    pilot = None if scenario.control is None else Controller(scenario, believed)

    def judged(log: FlightLog) -> Experiment:
        made = _estimated(log, believed, scenario, flight_note(scenario, robot, log), progress, calibration)
        scores = replace(made.scores, seed=scenario.simulation.seed, flight=flight_summary(log, robot.mass))
        scores = replace(scores, changed=changed_keys(scenario), noisy=bool(scenario.sensors.sampled))
        if pilot is not None:
            flight = replace(flight_summary(log, robot.mass), rms=course_rms(scenario, log))
            control = control_summary(scenario, log, pilot).to_json()
            scores = replace(scores, flight=flight, control=control, notices=tuple(pilot.warnings))
        return replace(made, robot=robot, scores=scores)

    try:
        return judged(simulate(scenario, _stage(progress, "flying"), robot=robot, pilot=pilot))
    except SimulationError as error:
        if isinstance(error.kept, FlightLog):
            error.kept = judged(error.kept)
        raise


@guarded()
def run_recorded(
    log: FlightLog, belief: Scenario, progress: Progress | None = None, calibration: Calibration | None = None
) -> Experiment:
    """Estimate the forces on a recorded flight, and score the estimates if the log contains the true forces.

    Args:
        log: the recorded flight.
        belief: what is assumed about the flight (robot, air, observers), as `estimation.belief_about` returns it.
        progress: as in `run`.
        calibration: what free flights showed about this belief.

    Raises:
        AerobatError: the log or the belief lacks something that the observers need.
    """
    robot = believed_robot(belief)
    return _estimated(log, robot, belief, recorded_note(log, robot), progress, calibration)


def _estimated(
    log: FlightLog,
    believed: Aerobat,
    belief: Scenario,
    note: str,
    progress: Progress | None,
    calibration: Calibration | None,
) -> Experiment:
    """Run the observers of a scenario or belief on a log, and score their estimates."""
    names = belief.observers.names
    inputs, estimates = estimate_log(log, believed, belief, progress and _observer_stages(progress, names), calibration)
    robot = AerobatRobot.of(believed, belief.believed_air, belief.observers.torque)
    findings = flight_findings(log, robot, inputs)
    scores = Scores(
        scenario=belief.name,
        seed=None,
        versions=versions(),
        torque=belief.observers.torque,
        inputs=inputs.source,
        note=note,
        observers={
            name: observer_scores(estimate, truth_of(log), inputs.calibration) for name, estimate in estimates.items()
        },
        calibration=inputs.calibration,
        findings=tuple(str(finding) for finding in findings if finding.warns),
    )
    drawn = log_with_motion(log, inputs.q, inputs.v, inputs.crank)
    return Experiment(belief, believed, log, estimates, scores, drawn, calibration)


def _stage(progress: Progress | None, name: str) -> Callable[[float], None] | None:
    return None if progress is None else lambda share: progress(name, share)


def _observer_stages(progress: Progress, names: Sequence[str]) -> Callable[[float], None]:
    """Return a function that takes the share of all observers that is done, and shows each as a stage of its own."""

    def show(share: float) -> None:
        at = min(int(share * len(names) + 1e-9), len(names) - 1)
        progress(f"estimating with {names[at]}", share * len(names) - at)

    return show


@cache
def versions() -> dict[str, str]:
    """Return the versions of the packages that can change the results: package -> version."""
    return {name: metadata.version(name) for name in VERSIONED_PACKAGES}


@guarded()
def write(experiment: Experiment, folder: Path) -> None:
    """Write scenario, log, estimates and metrics into an existing folder.

    Files that the scenario names, and the calibration, are copied into the folder, so that the run can be repeated on
    any machine. For a
    recorded flight, `belief.toml` takes the place of the scenario, and `estimate.csv` that of the log.
    """
    if experiment.is_recorded:
        write_scenario(experiment.scenario, folder, "belief.toml")
        (folder / "estimate.csv").write_text(estimate_table(experiment.estimates), encoding="utf-8")
    else:
        write_scenario(experiment.scenario, folder)
        (folder / "flight.nc").write_bytes(netcdf_bytes(experiment.log.measured, experiment.log.truth))
    (folder / "estimate.nc").write_bytes(netcdf_bytes(estimate_dataset(experiment.estimates)))
    if experiment.calibration is not None:
        (folder / "calibration.nc").write_bytes(calibration_bytes(experiment.calibration))
    write_metrics(experiment.metrics, folder)


def write_scenario(scenario: Scenario, folder: Path, name: str = "scenario.toml") -> None:
    """Write a scenario, and copy the user's files that it names (morphology, recorded forces) into the same folder."""
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
    (folder / name).write_text(scenario_toml(described(scenario)), encoding="utf-8")


def write_metrics(metrics: dict[str, Any], folder: Path) -> None:
    """Write `metrics.json`."""
    text = json.dumps(metrics, indent=2, allow_nan=False)
    (folder / "metrics.json").write_text(text + "\n", encoding="utf-8")
