"""Read what an earlier process of a sweep left in its folder, which can be cut off, forged, or no file at all."""

from __future__ import annotations

import json
import math
import stat
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter

from aerobat_pin.errors import OutputError
from aerobat_pin.estimation import ObserverScores
from aerobat_pin.experiments import FlightSummary
from aerobat_pin.scenario import Scenario

MOST_BYTES_PER_RUN = 1_000_000  # of a line; one of two observers has 3,000
KEYS = {"observers", "flight", "failed", "warnings"}
ADVICE = "--force starts anew"
VALID_SCORES, VALID_FLIGHT = TypeAdapter(ObserverScores), TypeAdapter(FlightSummary)


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
