"""One experiment from scenario to files: simulate, estimate, evaluate, write. All or nothing."""

from __future__ import annotations

import json
import os
import shutil
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from aerobat_pin.errors import OutputError, ScenarioError
from aerobat_pin.evaluation import flight_metrics, observer_metrics
from aerobat_pin.flight_log import FlightLog, channel
from aerobat_pin.known_inputs import known_inputs
from aerobat_pin.observers import OBSERVERS, Estimate
from aerobat_pin.robot import Aerobat, load_aerobat
from aerobat_pin.scenario import Scenario, scenario_toml
from aerobat_pin.simulation import simulate

RESULTS = ("scenario.toml", "flight.nc", "estimate.nc", "metrics.json", "figures", "report.html", "replay.html")
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
    robot = load_aerobat(scenario.robot.morphology, scenario.robot.changes)
    model = robot.model.copy()
    model.gravity.linear = np.array([0.0, 0.0, -scenario.flight.gravity])
    observers = [OBSERVERS[name](model, scenario.observers.frames, scenario.observers.gain) for name in names]
    log = simulate(scenario, None if progress is None else lambda share: progress("flying", share))
    inputs = known_inputs(log)
    estimates = {}
    for i, observer in enumerate(observers):
        if progress is not None:
            progress("estimating", i / len(observers))
        estimates[observer.name] = observer.run(inputs.time, inputs.q, inputs.v, inputs.tau, inputs.known)
    metrics = {
        "scenario": scenario.name,
        "seed": scenario.simulation.seed,
        "versions": versions(),
        "torque": log.measured.attrs["torque"],
        "note": flight_note(scenario, robot),
        "observers": {name: observer_metrics(estimate, log) for name, estimate in estimates.items()},
        "flight": flight_metrics(log, robot.mass),
    }
    return Experiment(scenario, robot, log, estimates, metrics)


def flight_note(scenario: Scenario, robot: Aerobat) -> str:
    """Say in a line what keeps the robot up: it belongs wherever the flight is shown."""
    if scenario.hold is None:
        return "free flight, nothing held"
    share = scenario.hold.lift / (robot.mass * scenario.flight.gravity) if scenario.flight.gravity > 0.0 else 0.0
    return f"attitude held, {100.0 * share:.0f} % thruster-borne"


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


def write(experiment: Experiment, folder: Path, *, report: bool, progress: Progress | None = None) -> list[Path]:
    """Write an experiment's files into a folder that holds nothing else yet; return them in order.

    Args:
        experiment: what `run` returned.
        folder: an existing folder.
        report: whether to draw figures, report and replay.
        progress: as in `run`.
    """
    (folder / "scenario.toml").write_text(scenario_toml(experiment.scenario), encoding="utf-8")
    experiment.log.save(folder / "flight.nc")
    estimate_dataset(experiment.estimates).to_netcdf(folder / "estimate.nc", engine="h5netcdf")
    text = json.dumps(experiment.metrics, indent=2, allow_nan=False)
    (folder / "metrics.json").write_text(text + "\n", encoding="utf-8")
    if report:
        from aerobat_pin import figures
        from aerobat_pin.replay import replay_html
        from aerobat_pin.report import report_html

        drawn = figures.draw_all(experiment.robot, experiment.log, experiment.estimates)
        (folder / "figures").mkdir()
        for i, (name, figure) in enumerate(drawn.items()):
            if progress is not None:
                progress("drawing", i / len(drawn))
            figures.save(figure, folder / "figures" / name)
        images = {name: folder / "figures" / f"{name}.png" for name in drawn}
        page = report_html(experiment.metrics, experiment.scenario, images)
        (folder / "report.html").write_text(page, encoding="utf-8")
        replay = replay_html(experiment.robot, experiment.log, experiment.estimates, experiment.metrics["note"])
        (folder / "replay.html").write_text(replay, encoding="utf-8")
    return sorted(path for path in folder.rglob("*") if path.is_file())


@contextmanager
def output_folder(target: Path, *, force: bool) -> Iterator[Path]:
    """Give a fresh folder to write into, and move its content to `target` when all went well.

    Nothing appears at the target unless everything was written. With `force` the results of an earlier run are
    replaced; other files in the folder are left alone.

    Raises:
        OutputError: the target is not empty (and not `force`), is a file, or cannot be written.
    """
    if target.exists() and not target.is_dir():
        raise OutputError(f"output {target}: is a file; a folder was expected")
    try:
        if target.is_dir() and any(target.iterdir()) and not force:
            raise OutputError(f"output folder {target} is not empty; --force replaces an earlier run's results in it")
        made = _missing_parents(target)
        target.mkdir(parents=True, exist_ok=True)
        work = Path(tempfile.mkdtemp(prefix=".aerobat-", dir=target))
    except OSError as error:
        if isinstance(error, OutputError):
            raise
        raise OutputError(f"output folder {target}: cannot be written: {error.strerror or error}") from error
    done = False
    try:
        yield work
        for name in RESULTS:
            _remove(target / name)
            if (work / name).exists():
                os.replace(work / name, target / name)
        done = True
    finally:
        shutil.rmtree(work, ignore_errors=True)
        if not done:
            for folder in made:
                if folder.is_dir() and not any(folder.iterdir()):
                    folder.rmdir()


def _missing_parents(target: Path) -> list[Path]:
    """Return the folders that making `target` will create, deepest first."""
    return [folder for folder in (target, *target.parents) if not folder.exists()]


def _remove(path: Path) -> None:
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path)
    else:
        path.unlink(missing_ok=True)
