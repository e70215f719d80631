"""Convert the outcomes of a sweep to tables: a grid labelled by the sweep's dimensions, and CSV with a row per run."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from aerobat_pin.errors import SweepError
from aerobat_pin.estimation import FORCE_AXES, ObserverScores, versions
from aerobat_pin.experiments.sweep.outcomes import FLIGHT_UNITS, JUDGED, LISTS, SCORES
from aerobat_pin.experiments.sweep.plan import Sweep
from aerobat_pin.experiments.sweep.sweep_file import DRAW
from aerobat_pin.records import netcdf_bytes


def results_grid(sweep: Sweep, outcomes: Mapping[int, Any]) -> xr.Dataset:
    """Arrange the results of all runs in a grid with one axis for each dimension of the sweep.

    Args:
        sweep: the sweep.
        outcomes: run number -> outcome, as `outcome_of` returns it, parsed.

    Returns:
        Scores over (*dimensions of the sweep, observer, point, axis); rank and condition over (*dimensions of the
        sweep, observer); numbers of the flight over the dimensions of the sweep; `failed`, the reason why a run has no
        numbers. Missing numbers are NaN.
    """
    dims = tuple(dimension.name for dimension in sweep.dimensions)
    entries = {number: _observers(outcome) for number, outcome in outcomes.items()}
    observers = list(dict.fromkeys(name for found in entries.values() for name in found))
    points = list(
        dict.fromkeys(point for found in entries.values() for entry in found.values() for point in entry.points)
    )
    scores = np.full((len(SCORES), *sweep.shape, len(observers), len(points), len(FORCE_AXES)), np.nan)
    judged = np.full((len(JUDGED), *sweep.shape, len(observers)), np.nan)
    failed = np.full(sweep.shape, "", object)
    flight: dict[str, Any] = {}
    for number, outcome in outcomes.items():
        at = sweep.indices[number]
        failed[at] = outcome.get("failed", "")
        for name, found in entries[number].items():
            here: tuple[Any, ...] = (slice(None), *at, observers.index(name))
            judged[here] = np.array([getattr(found, key) for key in JUDGED], float)  # None becomes NaN
            for point, axes in found.points.items():
                values = [[getattr(axes[axis], score) for axis in FORCE_AXES] for score in SCORES]
                scores[(*here, points.index(point))] = np.array(values, float)
        for key, value in outcome.get("flight", {}).items():
            flight.setdefault(key, np.full((*sweep.shape, *np.shape(value)), np.nan))[at] = value
    grid = xr.Dataset(attrs=_attributes(sweep))
    for dimension in sweep.dimensions:
        grid.coords[dimension.name] = (dimension.name, list(dimension.labels), _label_attributes(sweep, dimension.name))
        if dimension.name == DRAW:
            for key in dimension.settings[0]:
                grid.coords[key] = (DRAW, [row[key] for row in dimension.settings])
    grid.coords.update({"observer": observers, "point": points, "axis": ["x", "y", "z"]})
    for i, (name, (unit, meaning)) in enumerate(SCORES.items()):
        grid[name] = ((*dims, "observer", "point", "axis"), scores[i], {"units": unit, "long_name": meaning})
    for i, (name, meaning) in enumerate(JUDGED.items()):
        grid[name] = ((*dims, "observer"), judged[i], {"units": "1", "long_name": f"{name} {meaning}"})
    for key, values in flight.items():
        more, coordinate = LISTS.get(values.shape[-1], ("", [])) if values.ndim > len(dims) else ("", [])
        if values.ndim == len(dims) or more:
            if more:
                grid.coords[more] = coordinate
            grid[key] = ((*dims, more) if more else dims, values, {"units": FLIGHT_UNITS.get(key, "1")})
    grid["failed"] = (dims, failed, {"long_name": "why the run has no numbers"})
    return grid


def check_labels(sweep: Sweep) -> None:
    """Raise SweepError if NetCDF cannot hold the labels of a dimension; the last run would be too late to find this."""
    for dimension in sweep.dimensions:
        try:
            netcdf_bytes(xr.Dataset(coords={dimension.name: list(dimension.labels)}))
        except (TypeError, ValueError, OverflowError) as error:
            labels = ", ".join(map(repr, dimension.labels[:3]))
            raise SweepError(f"sweep {sweep.file.name}: labels {labels}, ... of {dimension.name}: {error}") from error


def results_csv(sweep: Sweep, outcomes: Mapping[int, Any]) -> str:
    """Return the results as CSV text: for each run a row with its labels, reason of failure, warnings and numbers."""
    rows = []
    for number, index in enumerate(sweep.indices):
        outcome = outcomes[number]
        row = {"run": number, **sweep.labels(index), "failed": outcome.get("failed", "")}
        row["warnings"] = "; ".join(outcome.get("warnings", []))
        found = _observers(outcome)
        for name, entry in found.items():
            for point, axes in entry.points.items():
                row |= {
                    f"{name}.{point}.{axis}.{key}": getattr(axes[axis], key) for axis in FORCE_AXES for key in SCORES
                }
        row |= {f"{name}.{key}": getattr(entry, key) for name, entry in found.items() for key in JUDGED}
        for key, value in outcome.get("flight", {}).items():
            row |= {f"{key}.{i}": x for i, x in enumerate(value)} if isinstance(value, list) else {key: value}
        rows.append(row)
    return str(pd.DataFrame(rows, dtype=object).to_csv(index=False, lineterminator="\n"))


def _observers(outcome: Mapping[str, Any]) -> dict[str, ObserverScores]:
    """Return the scores of each observer of a run; empty if the run failed."""
    return {name: ObserverScores.from_json(entry) for name, entry in outcome.get("observers", {}).items()}


def _label_attributes(sweep: Sweep, name: str) -> dict[str, str]:
    """Return unit and description of a dimension of factors; empty for other dimensions, which need no description."""
    factors = sweep.file.factors.get(name)
    if factors is None:
        return {}
    references = ", ".join(f"{key} = {reference}" for key, reference in factors.of.items())
    return {"units": "1", "long_name": f"factor of {references}"}


def _attributes(sweep: Sweep) -> dict[str, Any]:
    return {
        "sweep": sweep.file.name,
        "description": sweep.file.description,
        "base": sweep.base.name,
        "versions": json.dumps(versions()),
    }
