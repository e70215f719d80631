"""One run of a sweep, in any process: turn a scenario into its scores, or into the reason why it failed."""

from __future__ import annotations

import json
import os
import warnings
from functools import lru_cache
from pathlib import Path
from typing import Any

from aerobat_description import MORPHOLOGIES
from aerobat_pin.errors import AerobatError
from aerobat_pin.experiments.experiment import run
from aerobat_pin.experiments.sweep.columns import flight_columns
from aerobat_pin.robot import Aerobat, load_aerobat
from aerobat_pin.scenario import RobotSection, Scenario


def outcome_of(scenario: Scenario) -> str:
    """Simulate and score a scenario; a failure is returned, not raised.

    Returns:
        JSON text: the entries `"observers"` and `"flight"` as in `metrics.json`, or `"failed"` with the reason. The
        entry `"warnings"` is added if there are any.
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
    own = section.morphology not in MORPHOLOGIES and os.path.isfile(section.morphology)
    stamp = Path(section.morphology).stat().st_mtime_ns if own else 0
    found = _loaded(section.morphology, json.dumps(section.changes), scenario.flight.gravity, stamp)
    if isinstance(found, AerobatError):
        raise found
    return found


@lru_cache(maxsize=16)
def _loaded(morphology: str, changes: str, gravity: float, stamp: int) -> Aerobat | AerobatError:
    """Load a robot, or return the error that prevents it.

    Args:
        morphology: shipped name or TOML file.
        changes: JSON text of the changes to the morphology.
        gravity: acceleration of gravity [m/s2].
        stamp: time when the TOML file was last changed, so that a changed file is loaded again.
    """
    try:
        return load_aerobat(morphology, json.loads(changes), gravity=gravity)
    except AerobatError as error:
        return error
