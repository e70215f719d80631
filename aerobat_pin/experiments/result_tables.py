"""Convert estimates to labelled tables, for NetCDF and CSV files, and read the folder of a run again."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pandas as pd
import xarray as xr

from aerobat_pin.aerobat import FlightLog
from aerobat_pin.errors import LogError
from aerobat_pin.numerics import guarded
from aerobat_pin.observers import Estimate
from aerobat_pin.records import read_netcdf
from aerobat_pin.scenario import Scenario, scenario_of_run

FORCE_DIMS = ("observer", "interval", "point", "axis")


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
        raise LogError(f"{folder} is not the folder of a run: it has no {', '.join(missing)}")
    scenario, log = scenario_of_run(folder), FlightLog.load(folder / "flight.nc")
    return scenario, log, read_estimates(folder / "estimate.nc", log)


def read_estimates(path: Path, log: FlightLog) -> xr.Dataset:
    """Read the forces of `estimate.nc`, whose intervals must be those of the flight log.

    Raises:
        LogError: the file cannot be read, contains no forces in world axes, or belongs to another flight.
    """
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


def estimate_table(estimates: dict[str, Estimate]) -> str:
    """Return the estimates as CSV text, with a row for each interval and a column for each observer and component.

    A cell is empty where the component is not seen.
    """
    first = next(iter(estimates.values()))
    columns = {"start [s]": first.time[:-1], "end [s]": first.time[1:]}
    for name, estimate in estimates.items():
        shown = estimate.shown
        for i, (label, unit) in enumerate(zip(estimate.identifiability.components, estimate.units, strict=True)):
            columns[f"{name}.{label} [{unit}]"] = np.where(shown[:, i], estimate.components[:, i], np.nan)
            if estimate.standard_deviation is not None:
                columns[f"{name}.{label} deviation [{unit}]"] = estimate.standard_deviation[:, i]
    table = pd.DataFrame(columns)
    return str(table.to_csv(index=False, float_format="%.9g", na_rep="", lineterminator="\n"))
