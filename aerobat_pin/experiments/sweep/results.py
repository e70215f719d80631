"""The outcomes of a sweep as tables: one grid labelled by what was varied, and one row a run."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

from aerobat_pin.estimation import AXES
from aerobat_pin.experiments.experiment import versions
from aerobat_pin.experiments.sweep.columns import FLIGHT_UNITS, JUDGED, LISTS, SCORES
from aerobat_pin.experiments.sweep.sweep_file import DRAW

if TYPE_CHECKING:
    from aerobat_pin.experiments.sweep.plan import Sweep


def grid(sweep: Sweep, outcomes: Mapping[int, Any]) -> xr.Dataset:
    """Label every number by what was varied.

    Args:
        sweep: the runs.
        outcomes: run number -> outcome.

    Returns:
        Scores over (*dimensions of the sweep, observer, point, axis), rank and condition over (..., observer), the
        flight's numbers over the sweep's dimensions, and `failed`, the reason where a run has none. NaN is "none".
    """
    dims = tuple(one.name for one in sweep.dimensions)
    observers = list(dict.fromkeys(name for one in outcomes.values() for name in one.get("observers", {})))
    points = list(dict.fromkeys(point for one in outcomes.values() for _, point, _ in _scored(one)))
    scores = np.full((len(SCORES), *sweep.shape, len(observers), len(points), len(AXES)), np.nan)
    judged = np.full((len(JUDGED), *sweep.shape, len(observers)), np.nan)
    failed = np.full(sweep.shape, "", object)
    flight: dict[str, Any] = {}
    for number, outcome in outcomes.items():
        at = sweep.indices[number]
        failed[at] = outcome.get("failed", "")
        for name, point, found in _scored(outcome):
            here = (*at, observers.index(name), points.index(point))
            for k, axis in enumerate(AXES):
                for i, score in enumerate(SCORES):
                    scores[(i, *here, k)] = _number(found[axis][score])
        for name, found in outcome.get("observers", {}).items():
            for i, key in enumerate(JUDGED):
                judged[(i, *at, observers.index(name))] = _number(found[key])
        for key, value in outcome.get("flight", {}).items():
            size = np.shape(value)
            flight.setdefault(key, np.full((*sweep.shape, *size), np.nan))[at] = value
    made = xr.Dataset(attrs=_attributes(sweep))
    for one in sweep.dimensions:
        made.coords[one.name] = (one.name, list(one.labels), _told_of(sweep, one.name))
        if one.name == DRAW:
            for key in one.settings[0]:
                made.coords[key] = (DRAW, [row[key] for row in one.settings])
    made.coords.update({"observer": observers, "point": points, "axis": ["x", "y", "z"]})
    for i, (name, (unit, meaning)) in enumerate(SCORES.items()):
        made[name] = ((*dims, "observer", "point", "axis"), scores[i], {"units": unit, "long_name": meaning})
    for i, (name, meaning) in enumerate(JUDGED.items()):
        made[name] = ((*dims, "observer"), judged[i], {"units": "1", "long_name": f"{name} {meaning}"})
    for key, values in flight.items():
        more, coordinate = LISTS.get(values.shape[-1], ("", [])) if values.ndim > len(dims) else ("", [])
        if values.ndim == len(dims) or more:
            if more:
                made.coords[more] = coordinate
            made[key] = ((*dims, more) if more else dims, values, {"units": FLIGHT_UNITS.get(key, "1")})
    made["failed"] = (dims, failed, {"long_name": "why the run has no numbers"})
    return made


def table(sweep: Sweep, outcomes: Mapping[int, Any]) -> str:
    """Return one row a run as CSV: its labels, why it failed, what it warned of, and its numbers."""
    rows = []
    for number, index in enumerate(sweep.indices):
        outcome = outcomes[number]
        row = {"run": number, **sweep.labels(index), "failed": outcome.get("failed", "")}
        row["warnings"] = "; ".join(outcome.get("warnings", []))
        for name, point, found in _scored(outcome):
            row |= {f"{name}.{point}.{axis}.{score}": found[axis][score] for axis in AXES for score in SCORES}
        for name, found in outcome.get("observers", {}).items():
            row |= {f"{name}.{key}": found[key] for key in JUDGED}
        for key, value in outcome.get("flight", {}).items():
            if isinstance(value, list):
                row |= {f"{key}.{i}": one for i, one in enumerate(value)}
            else:
                row[key] = value
        rows.append(row)
    columns = dict.fromkeys(key for row in rows for key in row)
    text = io.StringIO()
    writer = csv.DictWriter(text, list(columns), lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return text.getvalue()


def _scored(outcome: Mapping[str, Any]) -> Iterator[tuple[str, str, Mapping[str, Any]]]:
    """Yield observer, point and its scores by axis."""
    for name, found in outcome.get("observers", {}).items():
        for point, scores in found.items():
            if isinstance(scores, dict) and AXES[0] in scores:
                yield name, point, scores


def _told_of(sweep: Sweep, name: str) -> dict[str, str]:
    """Return what a factor is a factor of; other dimensions are named after what they set."""
    factors = sweep.file.factors.get(name)
    if factors is None:
        return {}
    return {"units": "1", "long_name": "factor of " + ", ".join(f"{key} = {one}" for key, one in factors.of.items())}


def _number(value: float | None) -> float:
    return np.nan if value is None else value


def _attributes(sweep: Sweep) -> dict[str, Any]:
    return {
        "sweep": sweep.file.name,
        "description": sweep.file.description,
        "base": sweep.base.name,
        "versions": json.dumps(versions()),
    }
