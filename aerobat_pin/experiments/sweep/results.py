"""Convert the outcomes of a sweep to tables: a grid labelled by the sweep's dimensions, and CSV with a row per run."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from aerobat_pin.errors import SweepError
from aerobat_pin.estimation import versions
from aerobat_pin.experiments.sweep.plan import FLIGHT_UNITS, JUDGED, LISTS, SCORES, Sweep
from aerobat_pin.experiments.sweep.sweep_file import DRAW, SEED
from aerobat_pin.forces import FORCE_AXES, ObserverScores
from aerobat_pin.numerics import Array, guarded
from aerobat_pin.records import netcdf_bytes

COURSE = ("rms_x", "rms_y", "rms_z")
THIRDS = ("lowest third", "middle third", "highest third")  # of the values that were drawn of a key


def results_grid(sweep: Sweep, outcomes: Mapping[int, Any]) -> xr.Dataset:
    """Arrange outcomes, by run number, as `outcome_of` returns them, in a grid with an axis for each dimension.

    Scores are over (*dimensions of the sweep, observer, point, axis), rank and condition over (*dimensions, observer),
    numbers of the flight, and `failed`, why a run has none, over the dimensions. Missing numbers are NaN.
    """
    dims = tuple(dimension.name for dimension in sweep.dimensions)
    outcomes = dict(sorted(outcomes.items()))  # they end in any order
    entries = {number: _observers(outcome) for number, outcome in outcomes.items()}
    observers = list(dict.fromkeys(name for scored in entries.values() for name in scored))
    points = list(
        dict.fromkeys(point for scored in entries.values() for entry in scored.values() for point in entry.points)
    )
    scores = np.full((len(SCORES), *sweep.shape, len(observers), len(points), len(FORCE_AXES)), np.nan)
    judged = np.full((len(JUDGED), *sweep.shape, len(observers)), np.nan)
    failed = np.full(sweep.shape, "", object)
    flight: dict[str, Any] = {}
    for number, outcome in outcomes.items():
        at = sweep.indices[number]
        failed[at] = outcome.get("failed", "")
        for name, scored in entries[number].items():
            index: tuple[Any, ...] = (slice(None), *at, observers.index(name))
            judged[index] = np.array([getattr(scored, key) for key in JUDGED], float)  # None becomes NaN
            for point, axes in scored.points.items():
                values = [[getattr(axes[axis], score) for axis in FORCE_AXES] for score in SCORES]
                scores[(*index, points.index(point))] = np.array(values, float)
        for key, value in outcome.get("flight", {}).items():
            flight.setdefault(key, np.full((*sweep.shape, *np.shape(value)), np.nan))[at] = value
    notes = {"sweep": sweep.file.name, "description": sweep.file.description, "base": sweep.base.name}
    grid = xr.Dataset(attrs={**notes, "versions": json.dumps(versions())})
    for dimension in sweep.dimensions:
        attributes, factors = {}, sweep.file.factors.get(dimension.name)
        if factors is not None:
            references = ", ".join(f"{key} = {reference}" for key, reference in factors.of.items())
            attributes = {"units": "1", "long_name": f"factor of {references}"}
        grid.coords[dimension.name] = (dimension.name, list(dimension.labels), attributes)
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
        scores = _observers(outcome)
        for name, entry in scores.items():
            for point, axes in entry.points.items():
                row |= {
                    f"{name}.{point}.{axis}.{key}": getattr(axes[axis], key) for axis in FORCE_AXES for key in SCORES
                }
        row |= {f"{name}.{key}": getattr(entry, key) for name, entry in scores.items() for key in JUDGED}
        for key, value in outcome.get("flight", {}).items():
            row |= {f"{key}.{i}": x for i, x in enumerate(value)} if isinstance(value, list) else {key: value}
        rows.append(row)
    return str(pd.DataFrame(rows, dtype=object).to_csv(index=False, lineterminator="\n"))


def _observers(outcome: Mapping[str, Any]) -> dict[str, ObserverScores]:
    """Return the scores of each observer of a run; empty if the run failed."""
    return {name: ObserverScores.from_json(entry) for name, entry in outcome.get("observers", {}).items()}


@dataclass(frozen=True)
class Effect:
    """Errors along one varied quantity, over all runs with the same value of it.

    Attributes:
        name: dimension of the sweep, or key of its draws.
        labels: what each of the n values is called.
        values: (n,) the values; None if they are no numbers.
        errors: what errs, in which unit -> median, least and largest error (n, 3); NaN where all runs failed.
    """

    name: str
    labels: tuple[str, ...]
    values: Array | None
    errors: dict[str, Array]


@guarded()
def sweep_effects(grid: xr.Dataset) -> list[Effect]:
    """Return the effect of each varied quantity.

    What errs is the force of each observer: rms of the error over axes and points [mN]; and of a closed loop the place
    about its course [mm]. Seeds are no effect unless nothing else is varied.

    Args:
        grid: the results of a sweep, as `run_sweep` returns them.

    Raises:
        SweepError: these are no results of a sweep.
    """
    if not {"rmse", "failed"} <= set(grid.data_vars):
        raise SweepError("sweep_effects(grid): results of a sweep, with rmse and failed, were expected")
    dims = [str(name) for name in grid["failed"].dims if grid.sizes[name] > 1]
    dims = [name for name in dims if name != SEED] or dims
    return [effect for name in dims for effect in _effects_along(grid, name)]


def _effects_along(grid: xr.Dataset, name: str) -> Iterator[Effect]:
    errors: dict[str, Any] = {
        f"{observer} [mN]": 1e3
        * np.sqrt((grid["rmse"].sel(observer=observer) ** 2).sum("axis", skipna=False).mean("point"))
        for observer in grid["observer"].values
    }
    if set(COURSE) <= set(grid.data_vars):
        errors["off course [mm]"] = 1e3 * np.sqrt(sum(grid[axis] ** 2 for axis in COURSE))
    rows = {what: sizes.transpose(name, ...).values.reshape(grid.sizes[name], -1) for what, sizes in errors.items()}
    if name != DRAW:
        labels = grid[name].values
        numbers = np.asarray(labels, float) if labels.dtype.kind in "if" else None
        texts = tuple(str(label) if numbers is None else f"{label:.4g}" for label in labels)
        yield Effect(name, texts, numbers, {what: _spread(list(values)) for what, values in rows.items()})
        return
    for key in (str(key) for key, axis in grid.coords.items() if axis.dims == (DRAW,) and key != DRAW):
        values = np.asarray(grid[key].values, float)
        thirds = [third for third in np.array_split(np.argsort(values), len(THIRDS)) if len(third)]
        middles = np.array([np.median(values[third]) for third in thirds])
        texts = tuple(f"{middle:.4g} ({third})" for middle, third in zip(middles, THIRDS, strict=False))
        spreads = {what: _spread([values[third] for third in thirds]) for what, values in rows.items()}
        yield Effect(key, texts, middles, spreads)


def _spread(groups: list[Array]) -> Array:
    """Return median, least and largest (n, 3) of each group of errors, without those of runs that failed."""
    finite = [group[np.isfinite(group)] for group in map(np.ravel, groups)]
    nothing = np.full(3, np.nan)
    return np.array([[np.median(errors), errors.min(), errors.max()] if len(errors) else nothing for errors in finite])


@guarded()
def effects_text(effects: list[Effect]) -> str:
    """Return a table as text: a row for each value of each quantity, with the median error and its range."""
    names = list(dict.fromkeys(what for effect in effects for what in effect.errors))
    cells = [("median error, least .. largest", *names)]
    for effect in effects:
        for k, label in enumerate(effect.labels):
            spreads = (effect.errors[what][k] for what in names)
            numbers = (
                "-" if np.isnan(spread[0]) else f"{spread[0]:.3g}, {spread[1]:.3g} .. {spread[2]:.3g}"
                for spread in spreads
            )
            cells.append((f"{effect.name} = {label}", *numbers))
    widths = [max(map(len, column)) for column in zip(*cells, strict=True)]
    return "\n".join("  ".join(map(str.ljust, row, widths)).rstrip() for row in cells)
