"""The outcome of a run of a sweep: how a scenario becomes one, its columns in the results, and reading it back.

What an earlier process of a sweep left in its folder can be cut off, forged, or no file at all.
"""

from __future__ import annotations

import json
import math
import os
import stat
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import asdict, fields
from functools import lru_cache
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter

from aerobat_description import MORPHOLOGIES
from aerobat_pin.errors import AerobatError, OutputError
from aerobat_pin.estimation import TRUTH_SCORES, ObserverScores, Score
from aerobat_pin.experiments import FlightSummary
from aerobat_pin.experiments.experiment import run
from aerobat_pin.robot import Aerobat, load_aerobat
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
MOST_BYTES_PER_RUN = 1_000_000  # of a line; one of two observers has 3,000
KEYS = {"observers", "flight", "failed", "warnings"}
ADVICE = "--force starts anew"
VALID_SCORES, VALID_FLIGHT = TypeAdapter(ObserverScores), TypeAdapter(FlightSummary)


def flight_columns(metrics: Mapping[str, Any]) -> dict[str, Any]:
    """Return the numbers of a run's flight and of its control, without nested tables, as columns of the results."""
    found = dict(metrics["flight"])
    found |= {f"rms_{axis}": value for axis, value in found.pop("rms", {}).items()}
    control = metrics.get("control")
    if control is not None:
        margins = control["margins"].values()
        found |= {name: control[name] for name in ("slew_rms", "saturated_share")}
        found["largest_ms"] = max(margin["ms"] for margin in margins)
        found["delay_margin"] = min(margin["delay"] for margin in margins if margin["delay"] is not None)
    return found


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


def content_of(path: Path, most: int) -> bytes:
    """Return what a file contains; nothing if it does not exist.

    Raises:
        OutputError: it is a pipe, a link, a folder or another thing that this package does not write, or it is larger
            than `most` bytes, or it cannot be read.
    """
    try:
        there = path.lstat()
        if not stat.S_ISREG(there.st_mode):
            raise OutputError(f"output {path}: is no file that a sweep wrote; {ADVICE}")
        if there.st_size > most:
            raise OutputError(f"output {path}: {there.st_size} bytes, at most {most} were expected; {ADVICE}")
        return path.read_bytes()
    except FileNotFoundError:
        return b""
    except OSError as error:
        if isinstance(error, OutputError):
            raise
        raise OutputError(f"output {path}: cannot be read: {error.strerror}") from error


def plain_json(text: bytes) -> dict[str, Any]:
    """Read a JSON object. Raises ValueError, also for NaN, infinity and what nests too deep."""
    try:
        return dict(json.loads(text, parse_float=_finite, parse_constant=_finite))
    except (TypeError, RecursionError) as error:
        raise ValueError(f"an object was expected: {error}") from error


def finished_runs(path: Path, scenarios: Sequence[Scenario]) -> tuple[dict[int, Any], bytes]:
    """Read the finished runs of a sweep.

    Args:
        path: the file, one JSON line for each run.
        scenarios: the scenario of each run.

    Returns:
        Run number -> outcome, and the content of the file without its last line if that is cut off.

    Raises:
        OutputError: the file or one of its lines is not what the sweep wrote; the message names the line.
    """
    content = content_of(path, MOST_BYTES_PER_RUN * len(scenarios))
    whole = content[: content.rfind(b"\n") + 1]
    finished: dict[int, Any] = {}
    for k, line in enumerate(whole.splitlines()):
        try:
            read = plain_json(line)
            number, outcome = read["run"], read["outcome"]
            if type(number) is not int or not 0 <= number < len(scenarios) or number in finished:
                raise ValueError(f"run = {number!r}: each number below {len(scenarios)} once was expected")
            _check_outcome(outcome, scenarios[number])
        except (ValueError, KeyError, TypeError, AttributeError) as error:
            reason = f"no key {error}" if isinstance(error, KeyError) else str(error).splitlines()[0]
            raise OutputError(f"output {path}, line {k + 1}: not what this sweep writes: {reason}; {ADVICE}") from error
        finished[number] = outcome
    return finished, whole


def _check_outcome(outcome: dict[str, Any], scenario: Scenario) -> None:
    """Raise an error unless an outcome has the form that `outcome_of` gives it for this scenario."""
    if unknown := set(outcome) - KEYS:
        raise ValueError(f"unknown key {min(unknown)!r}")
    TypeAdapter(list[str]).validate_python(outcome.get("warnings", []))
    if "failed" in outcome:
        TypeAdapter(str).validate_python(outcome["failed"])
        return
    if (names := set(outcome["observers"])) != set(scenario.observers.names):
        raise ValueError(f"observers {', '.join(sorted(names))}: the run has {', '.join(scenario.observers.names)}")
    for entry in outcome["observers"].values():
        VALID_SCORES.validate_python(asdict(ObserverScores.from_json(entry)))
    VALID_FLIGHT.validate_python(asdict(FlightSummary(**outcome["flight"])))


def _finite(text: str) -> float:
    number = float(text)
    if not math.isfinite(number):
        raise ValueError(f"{text}: a finite number was expected")
    return number
