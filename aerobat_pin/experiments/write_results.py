"""Write a result into a folder: forces, scores, and what they were estimated from, so that it can be repeated."""

from __future__ import annotations

import errno
import json
import os
import shutil
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import h5netcdf
import numpy as np
import pandas as pd
import tomli_w
import xarray as xr

from aerobat_description import MORPHOLOGIES
from aerobat_pin.aerobat import FlightLog
from aerobat_pin.errors import LogError
from aerobat_pin.estimation import Result, calibration_bytes
from aerobat_pin.experiments.experiment import Experiment
from aerobat_pin.numerics import Array, guarded
from aerobat_pin.observers import Estimate
from aerobat_pin.records import Map, netcdf_bytes, read_netcdf, seal_netcdf
from aerobat_pin.scenario import RecordedForce, Scenario, described, scenario_of_run, scenario_toml

FORCE_DIMS = ("observer", "interval", "point", "axis")
FIGURES = (
    *("position", "states", "stick_diagram", "estimation", "linkage", "aerodynamics", "power", "control"),
    *("sensor", "motion", "contacts", "unexplained"),
)
RESULTS = (  # all that a run or an estimate writes, as glob patterns
    *("scenario.toml", "belief.toml", "map.toml", "morphology.toml", "believed_morphology.toml", "unknown_force_*.csv"),
    *("flight.nc", "estimate.nc", "estimate.csv", "calibration.nc", "metrics.json", "forces.mcap"),
    *(f"figures/{name}.{kind}" for name in FIGURES for kind in ("png", "pdf")),
    *("report.html", "replay.html"),
)


@guarded()
def estimate_dataset(estimates: dict[str, Estimate]) -> xr.Dataset:
    """Join the estimates of several observers into one dataset, the content of `estimate.nc`.

    All estimates must belong to the same log and have the same components.
    """
    return xr.concat([estimate.to_xarray() for estimate in estimates.values()], "observer", join="exact")


def read_run(folder: Path) -> tuple[Scenario, FlightLog, xr.Dataset]:
    """Read scenario, flight log and estimated forces from the folder of a run.

    Raises:
        LogError: the folder is not that of a run, or its log or estimates cannot be read.
        ScenarioError: its scenario cannot be read.
    """
    names = ("scenario.toml", "flight.nc", "estimate.nc")
    missing = [name for name in names if not os.path.isfile(folder / name)]  # False for names that no file can have
    if missing:
        page = folder / "replay.html"  # of an estimate by a map
        hint = f"; it has a replay: open {page}" if os.path.isfile(page) else ""
        raise LogError(f"{folder} is not the folder of a run: it has no {', '.join(missing)}{hint}")
    scenario, log = scenario_of_run(folder), FlightLog.load(folder / "flight.nc")
    return scenario, log, read_estimates(folder / "estimate.nc", log)


def read_estimates(path: Path, log: FlightLog) -> xr.Dataset:
    """Read the forces of `estimate.nc`. Raises LogError if it has none in world axes, or is of another flight."""
    name = f"estimates {path}"
    data = read_netcdf(path, "estimates")[""]
    force = data.variables.get("force_W")
    if force is None or sorted(map(str, force.dims)) != sorted(FORCE_DIMS):
        raise LogError(f"{name}: no channel force_W ({', '.join(FORCE_DIMS)})")
    if force.attrs.get("units") != "N" or force.dtype.kind != "f":
        raise LogError(f"{name}: force_W [{str(force.attrs.get('units'))[:40]}]: numbers in N were expected")
    for dim in ("observer", "point", "axis"):
        labels = data.variables[dim].values.tolist() if dim in data.coords else []
        if not labels or len(set(labels)) < len(labels) or not all(isinstance(label, str) for label in labels):
            raise LogError(f"{name}: {dim} has no labels or one label twice: names were expected")
    if sorted(data["axis"].values) != ["x", "y", "z"]:
        raise LogError(f"{name}: axis has the labels {', '.join(data['axis'].values)}: x, y, z were expected")
    start = data.variables["interval"].values if "interval" in data.coords else np.empty(0)
    if start.shape != log.time[:-1].shape or not np.allclose(start, log.time[:-1], rtol=0.0, atol=1e-9):
        raise LogError(f"{name}: its {len(start)} intervals are not the {len(log.time) - 1} of the flight log")
    forces = data["force_W"].transpose(*FORCE_DIMS).sel(axis=["x", "y", "z"])
    if not np.all(np.isfinite(forces.values)):
        at = np.argwhere(~np.isfinite(forces.values))[0]
        where = ", ".join(str(data.variables[dim].values[i]) for dim, i in zip(FORCE_DIMS, at, strict=True))
        raise LogError(f"{name}: force_W at {where}: a finite number was expected")
    return forces.to_dataset()


def estimate_table(estimates: dict[str, Estimate], ends: Array) -> str:
    """Return the estimates as CSV text, with a row for each interval and a column for each observer and component.

    A cell is empty where the component is not seen. The ends (m,) [s] of intervals are beside a hole not where the next
    one starts.
    """
    stamps = {"start [s]": next(iter(estimates.values())).time[:-1], "end [s]": ends}  # Unix's need more digits
    columns: dict[str, Any] = {name: [f"{stamp:.9f}" for stamp in column] for name, column in stamps.items()}
    for name, estimate in estimates.items():
        shown = estimate.shown
        for i, (label, unit) in enumerate(zip(estimate.identifiability.components, estimate.units, strict=True)):
            columns[f"{name}.{label} [{unit}]"] = np.where(shown[:, i], estimate.components[:, i], np.nan)
            if estimate.standard_deviation is not None:
                columns[f"{name}.{label} deviation [{unit}]"] = estimate.standard_deviation[:, i]
    table = pd.DataFrame(columns)
    return str(table.to_csv(index=False, float_format="%.9g", na_rep="", lineterminator="\n"))


@guarded()
def write(outcome: Experiment | Result, folder: Path) -> None:
    """Write estimates and metrics into an existing folder, and what they were estimated from.

    Of a simulated flight this is the scenario and the flight log; of a recorded one `belief.toml` or `map.toml`, and
    `estimate.csv` with the forces as a table. Files that a scenario names, and the calibration, are copied into the
    folder, so that the run can be repeated on any machine.
    """
    result = outcome.scores if isinstance(outcome, Experiment) else outcome
    if not isinstance(outcome, Experiment):
        (folder / "map.toml").write_text(map_toml(result), encoding="utf-8")
    elif outcome.flight is None:
        write_scenario(outcome.scenario, folder, "belief.toml")
    else:
        write_scenario(outcome.scenario, folder)
        (folder / "flight.nc").write_bytes(netcdf_bytes(outcome.log.measured, outcome.log.truth))
    if isinstance(outcome, Experiment) and outcome.calibration is not None:
        (folder / "calibration.nc").write_bytes(calibration_bytes(outcome.calibration))
    if not (folder / "flight.nc").exists():
        with (folder / "estimate.csv").open("w", encoding="utf-8", newline="") as file:
            for blocks, ends in _together(result):
                text = estimate_table(blocks, ends)
                file.write(text.partition("\n")[2] if file.tell() else text)
    write_netcdf(_datasets(result), len(next(iter(result.stored.values()))), folder / "estimate.nc")
    write_metrics(result.metrics(), folder)


def map_toml(result: Result) -> str:
    """Return the map of a record as TOML, which finds the robot's file from any folder."""
    values = read_map(result).model_dump(exclude_none=True, exclude_defaults=True, by_alias=True, mode="json")
    assert result.record is not None
    robot = values.get("robot", {})
    for key in {"urdf", "mjcf"} & robot.keys():
        robot[key] = os.path.abspath(result.record.folder / robot[key])
    return tomli_w.dumps(values)


def read_map(result: Result) -> Map:
    """Return the map by which a record was read. Raises LogError if it was read by none."""
    if result.record is None:
        raise LogError(f"{result.name}: a record that a map has read was expected")
    return result.record.map


def write_scenario(scenario: Scenario, folder: Path, name: str = "scenario.toml") -> None:
    """Write a scenario, and copy the files of the user that it names (morphologies, recorded forces) beside it."""
    if scenario.robot.morphology not in MORPHOLOGIES:
        shutil.copyfile(scenario.robot.morphology, folder / "morphology.toml")
        robot = scenario.robot.model_copy(update={"morphology": "morphology.toml"})
        scenario = scenario.model_copy(update={"robot": robot})
    believed = scenario.believed.robot
    if (named := believed.get("morphology")) is not None and named not in MORPHOLOGIES:
        shutil.copyfile(named, folder / "believed_morphology.toml")
        belief = scenario.believed.model_copy(update={"robot": {**believed, "morphology": "believed_morphology.toml"}})
        scenario = scenario.model_copy(update={"believed": belief})
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


def write_netcdf(blocks: Iterable[xr.Dataset], count: int, path: Path) -> None:
    """Write blocks, which follow each other along `interval` with `count` intervals in all, into one NetCDF-4 file.

    One block that has them all is written at once. Raises OSError if the disk has too little room, because the HDF5
    library ends the process on a full one.
    """
    done = 0
    for block in blocks:
        size = block.sizes["interval"]
        if size == count:
            path.write_bytes(netcdf_bytes(block))
            return
        if not done:
            if shutil.disk_usage(path.parent).free < 1.5 * block.nbytes * count / size:
                raise OSError(errno.ENOSPC, "no room for the estimates", str(path))
            block.to_netcdf(path, engine="h5netcdf", unlimited_dims=["interval"])
            done = size
            continue
        with h5netcdf.File(path, "a") as file:
            file.resize_dimension("interval", done + size)
            for name, values in block.variables.items():
                if "interval" in values.dims:
                    rows = tuple(slice(done, done + size) if dim == "interval" else slice(None) for dim in values.dims)
                    file[str(name)][rows] = values.values
        done += size
    seal_netcdf(path)


def _together(result: Result) -> Iterator[tuple[dict[str, Estimate], Array]]:
    """Yield blocks of the estimates of all observers, for the same intervals, and the ends (m,) of these [s]."""
    names, (stored, *_), done = list(result.stored), result.stored.values(), 0
    for blocks in zip(*(estimate.blocks() for estimate in result.stored.values()), strict=True):
        ends = stored.ends[done : done + len(blocks[0].components)]
        done += len(ends)
        yield dict(zip(names, blocks, strict=True)), ends


def _datasets(result: Result) -> Iterator[xr.Dataset]:
    """Yield the content of `estimate.nc`: the forces, and beside them those of a sensor."""
    first, sensors = 0, [reference for reference in result.references if reference.kind == "sensor"]
    for blocks, ends in _together(result):
        data = estimate_dataset(blocks)
        data = data.assign_coords(interval_end=data["interval_end"].copy(data=ends))
        rows = slice(first, first + data.sizes["interval"])
        first = rows.stop
        for sensor in sensors:
            words = f"force sensor at {sensor.frame}, behind the filter of the map, world axes"
            attributes = {"units": "N, N m", "long_name": words}
            data = data.assign_coords(sensor_component=[f"{sensor.frame}.{label}" for label in sensor.labels])
            data["sensor"] = (("interval", "sensor_component"), sensor.values[rows], attributes)
        yield data if result.record is None else data.assign_attrs(log=result.name, robot=result.robot)
