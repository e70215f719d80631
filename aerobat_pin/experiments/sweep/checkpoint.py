"""The folder of a sweep, from which an interrupted sweep can be resumed.

* `sweep.json`: the sweep file and the versions of the packages; a different sweep in this folder is an error;
* `base.toml`: the base scenario, `[set]` included;
* `finished.jsonl`: one line for each finished run, written to disk as soon as the run ends;
* `results.nc`, `results.csv`, `sweep.png`: all results as tables, and what each varied quantity does.
What an earlier process left can be cut off, forged, or no file at all.
"""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import asdict
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter

from aerobat_pin.errors import (
    LARGEST_TABLE,
    OutputError,
    claimed,
    cleaned,
    content_of,
    locked,
    opened_folder,
    plain_json,
    replace_results,
    write_files,
)
from aerobat_pin.estimation import versions
from aerobat_pin.experiments.flight_summary import FlightSummary
from aerobat_pin.experiments.sweep.plan import LOOP_UNITS, Sweep
from aerobat_pin.forces import ObserverScores
from aerobat_pin.scenario import Scenario, scenario_toml

FILES = ("sweep.json", "base.toml", "finished.jsonl", "results.csv", "results.nc", "sweep.png")
MOST_MANIFEST = 10_000_000  # bytes of a sweep file as JSON
MANIFEST, BASE_SCENARIO, FINISHED, TABLE, GRID, _ = FILES
MOST_BYTES_PER_RUN = 1_000_000  # of a line; one of two observers has 3,000
KEYS = {"observers", "flight", "failed", "warnings"}
ADVICE = "--force starts anew"
VALID_SCORES, VALID_FLIGHT = TypeAdapter(ObserverScores), TypeAdapter(FlightSummary)


class Checkpoint:
    """The folder of a sweep, locked so that only one process uses it. Use it in a `with` statement.

    Args:
        folder: folder of the sweep; OutputError if it holds something else, or cannot be written.
        sweep: the sweep to resume, or to start if the folder is empty.
        force: start from the beginning even if the folder holds a sweep; files that no sweep wrote are left alone.
    """

    def __init__(self, folder: Path, sweep: Sweep, *, force: bool) -> None:
        self.folder = Path(os.path.abspath(folder))
        if self.folder.exists() and not self.folder.is_dir():
            raise OutputError(f"output {self.folder}: is a file; a folder was expected")
        with ExitStack() as stack:
            work = stack.enter_context(claimed(folder))
            self._resume_or_start(_manifest(sweep), sweep, force, work)
            self.finished, whole = _finished_runs(path := self.folder / FINISHED, sweep.scenarios)
            if path.exists() and path.stat().st_size > len(whole):  # an interrupted write has cut off the last line
                write_files({path: whole})
            stack.callback(os.close, inside := opened_folder(self.folder))
            self._file = stack.enter_context(open(locked(path, inside), "ab"))
            stack.enter_context(cleaned(self._remove_if_empty))
            self._until_exit = stack.pop_all()

    def __enter__(self) -> Checkpoint:
        return self

    def __exit__(self, *error: Any) -> None:
        self._until_exit.__exit__(*error)

    def add(self, number: int, outcome: str) -> None:
        """Write the outcome of a run, JSON text, to disk. Raises OutputError if it cannot be written."""
        try:
            self._file.write(f'{{"run": {number}, "outcome": {outcome}}}\n'.encode())
            self._file.flush()
            os.fsync(self._file.fileno())
        except OSError as error:
            raise OutputError(f"output {self.folder / FINISHED}: cannot be written: {error.strerror}") from error
        self.finished[number] = json.loads(outcome)

    def _remove_if_empty(self) -> None:
        """Remove the files of a sweep that has no finished run, so nothing to resume."""
        if not self.finished:
            for name in FILES:
                (self.folder / name).unlink(missing_ok=True)

    def _resume_or_start(self, manifest: dict[str, Any], sweep: Sweep, force: bool, work: Path) -> None:
        """Resume the sweep in the folder, or start a new one."""
        if (self.folder / MANIFEST).is_file() and not force:
            return _refuse_other(self.folder / MANIFEST, manifest)
        begun = any(os.path.lexists(self.folder / name) for name in (MANIFEST, BASE_SCENARIO, FINISHED))
        if self.folder.is_dir() and any(self.folder.iterdir()) and not (force and begun):
            what = f"no whole sweep; {ADVICE}" if begun else "no sweep; an empty or missing one was expected"
            raise OutputError(f"output folder {self.folder} is not empty and holds {what}")
        (work / BASE_SCENARIO).write_text(scenario_toml(sweep.base), encoding="utf-8")
        (work / MANIFEST).write_text(json.dumps(manifest, indent=2) + "\n", encoding="utf-8")
        return replace_results(work, self.folder, FILES)


def _manifest(sweep: Sweep) -> dict[str, Any]:
    """Return what identifies a sweep: its file, the package versions, and a hash of all scenarios and their files."""
    digest = hashlib.sha256()
    for scenario in sweep.scenarios:
        digest.update(scenario.model_dump_json().encode())
    for name in sorted(filter(os.path.isfile, {name for run in sweep.scenarios for name in run.files})):
        with open(name, "rb") as content:
            digest.update(content.read(LARGEST_TABLE))  # a run refuses what is larger
    file = sweep.file.model_dump(mode="json", by_alias=True, exclude_none=True)
    return {**file, "runs": len(sweep.scenarios), "versions": dict(versions()), "sha256": digest.hexdigest()}


def _refuse_other(path: Path, manifest: dict[str, Any]) -> None:
    try:
        stored = plain_json(_stored(path, MOST_MANIFEST))
    except ValueError as error:
        raise OutputError(f"output {path}: cannot be read: {error}; {ADVICE}") from error
    other = [key for key in manifest if stored.get(key) != manifest[key] and key != "description"]
    if other:
        named = [key for key in other if key not in ("sha256", "runs")] or ["a scenario or a file that it reads"]
        differ = f"holds another sweep: {', '.join(named)} differ"
        raise OutputError(f"output folder {path.parent} {differ}; --out chooses another folder, {ADVICE} in this one")


def _stored(path: Path, most: int) -> bytes:
    """Return what a file of a sweep contains, of at most so many bytes; nothing if it does not exist."""
    try:
        return content_of(path, most)
    except FileNotFoundError:
        return b""
    except OSError as error:
        raise OutputError(f"output {path}: cannot be read: {error.strerror}; {ADVICE}") from error


def _finished_runs(path: Path, scenarios: Sequence[Scenario]) -> tuple[dict[int, Any], bytes]:
    """Return run number -> outcome of the finished runs, and the file's content without a last line that is cut off."""
    content = _stored(path, MOST_BYTES_PER_RUN * len(scenarios))
    whole = content[: content.rfind(b"\n") + 1]
    finished: dict[int, Any] = {}
    for k, line in enumerate(whole.splitlines()):
        try:
            read = plain_json(line)
            number, outcome = read["run"], read["outcome"]
            if type(number) is not int or not 0 <= number < len(scenarios) or number in finished:
                raise ValueError(f"run = {number!r}: each number below {len(scenarios)} once was expected")
            _check_outcome(outcome, scenarios[number])
        except (ValueError, KeyError, TypeError, AttributeError) as error:  # a line that no sweep wrote
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
    flight = dict(outcome["flight"])
    TypeAdapter(dict[str, float]).validate_python({name: flight.pop(name) for name in LOOP_UNITS if name in flight})
    VALID_FLIGHT.validate_python(asdict(FlightSummary(**flight)))
