"""The outcome of a run of a sweep: how a scenario becomes one, and its columns in the results."""

from __future__ import annotations

import json
import os
import warnings
from collections.abc import Mapping
from dataclasses import fields
from functools import lru_cache
from pathlib import Path
from typing import Any

from aerobat_description import MORPHOLOGIES
from aerobat_pin.aerobat import Aerobat, load_aerobat
from aerobat_pin.errors import AerobatError
from aerobat_pin.experiments.experiment import run
from aerobat_pin.experiments.flight_summary import FlightSummary
from aerobat_pin.forces import TRUTH_SCORES, Score
from aerobat_pin.scenario import RobotSection, Scenario

SCORE_FIELDS = {item.name: item.metadata for item in fields(Score)}
SCORES = {name: (SCORE_FIELDS[name]["unit"], SCORE_FIELDS[name]["meaning"]) for name in TRUTH_SCORES}
JUDGED = {"rank": "of the equations for the forces", "condition": "of the equations for the forces"}
CONTROL_UNITS = {"slew_rms": "N/s", "saturated_share": "1", "largest_ms": "1", "delay_margin": "s"}
COURSE_UNITS = {f"rms_{axis}": "m" if axis in "xyz" else "rad" for axis in ("x", "y", "z", "roll", "pitch", "yaw")}
FLIGHT_UNITS = {item.name: item.metadata["unit"] for item in fields(FlightSummary)} | CONTROL_UNITS | COURSE_UNITS
LISTS: dict[int, tuple[str, list[str]]] = {2: ("bound", ["lowest", "highest"]), 3: ("axis", ["x", "y", "z"])}
RESERVED_NAMES = frozenset(
    {"run", "failed", "warnings", "observer", "point", "axis", "bound", *SCORES, *JUDGED, *FLIGHT_UNITS}
)


def flight_columns(metrics: Mapping[str, Any]) -> dict[str, Any]:
    """Return the numbers of a run's flight and of its control, without nested tables, as columns of the results."""
    columns = dict(metrics["flight"])
    columns |= {f"rms_{axis}": value for axis, value in columns.pop("rms", {}).items()}
    control = metrics.get("control")
    if control is not None:
        margins = control["margins"].values()
        columns |= {name: control[name] for name in ("slew_rms", "saturated_share")}
        columns["largest_ms"] = max(margin["ms"] for margin in margins)
        columns["delay_margin"] = min(margin["delay"] for margin in margins if margin["delay"] is not None)
    return columns


def outcome_of(scenario: Scenario) -> str:
    """Simulate and score a scenario; a failure is returned, not raised.

    The result is JSON text: `"observers"` and `"flight"` as in `metrics.json`, or the reason why it `"failed"`; and
    `"warnings"` if there are any.
    """
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("default")
        try:
            robots = _load_once(scenario.robot, scenario), _load_once(scenario.believed_robot, scenario)
            metrics = run(scenario, robots=robots).metrics
            outcome: dict[str, Any] = {"observers": metrics["observers"], "flight": flight_columns(metrics)}
            json.dumps(outcome, allow_nan=False)
        except AerobatError as error:
            outcome = {"failed": str(error)}
        except Exception as error:  # a bug that shows in one run must not end the others
            outcome = {"failed": f"{type(error).__name__}: {error}"}
    texts = dict.fromkeys(str(item.message) for item in caught if issubclass(item.category, UserWarning))
    return json.dumps(outcome | ({"warnings": list(texts)} if texts else {}))


def _load_once(section: RobotSection, scenario: Scenario) -> Aerobat:
    from_file = section.morphology not in MORPHOLOGIES and os.path.isfile(section.morphology)
    stamp = Path(section.morphology).stat().st_mtime_ns if from_file else 0
    return _loaded(section.morphology, json.dumps(section.changes), scenario.flight.gravity, stamp)


@lru_cache(maxsize=16)
def _loaded(morphology: str, changes: str, gravity: float, stamp: int) -> Aerobat:
    """Load a robot, with changes as JSON text; another `stamp`, the time of its file, loads a changed file again."""
    return load_aerobat(morphology, json.loads(changes), gravity=gravity)
