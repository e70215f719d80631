"""The folder of a sweep, from which an interrupted sweep can be resumed.

| file | content |
|---|---|
| `sweep.json` | the sweep file and the versions of the packages; a different sweep in this folder is an error |
| `base.toml` | the base scenario, `[set]` included |
| `finished.jsonl` | one line for each finished run, written to disk as soon as the run ends |
| `results.nc`, `results.csv` | all results as tables, written at the end |
"""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any

from aerobat_description import MORPHOLOGIES
from aerobat_pin.errors import OutputError, claimed, cleaned, replace_results, write_files
from aerobat_pin.estimation import versions
from aerobat_pin.experiments.sweep.outcomes import content_of, finished_runs, plain_json
from aerobat_pin.experiments.sweep.plan import Sweep
from aerobat_pin.scenario import Scenario, scenario_toml

FILES = ("sweep.json", "base.toml", "finished.jsonl", "results.csv", "results.nc")
MOST_MANIFEST = 10_000_000  # bytes of a sweep file as JSON
MANIFEST, BASE_SCENARIO, FINISHED, TABLE, GRID = FILES


class Checkpoint:
    """The folder of a sweep, locked so that only one process uses it. Use it in a `with` statement.

    Args:
        folder: folder of the sweep; created when missing.
        sweep: the sweep to resume, or to start if the folder is empty.
        force: start from the beginning even if the folder is not empty; files that no sweep wrote are left alone.

    Raises:
        OutputError: the folder contains something else, another process uses it, or it cannot be written.
    """

    def __init__(self, folder: Path, sweep: Sweep, *, force: bool) -> None:
        self.folder = folder = Path(os.path.abspath(folder))
        if folder.exists() and not folder.is_dir():
            raise OutputError(f"output {folder}: is a file; a folder was expected")
        with ExitStack() as stack:
            work = stack.enter_context(claimed(folder))
            self._resume_or_start(_manifest(sweep), sweep, force, work)
            self.finished = self._read_finished(sweep.scenarios)
            self._file = stack.enter_context((folder / FINISHED).open("ab"))
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

    def write(self, tables: Mapping[str, bytes]) -> None:
        """Write the results atomically: either all of them or none. Raises OutputError if they cannot be written."""
        write_files({self.folder / name: content for name, content in tables.items()})

    def _remove_if_empty(self) -> None:
        """Remove the files of a sweep that has no finished run, so nothing to resume."""
        if not self.finished:
            for name in FILES:
                (self.folder / name).unlink(missing_ok=True)

    def _resume_or_start(self, manifest: dict[str, Any], sweep: Sweep, force: bool, work: Path) -> None:
        """Resume the sweep in the folder, or start a new one."""
        there = self.folder / MANIFEST
        if there.is_file() and not force:
            _refuse_other(there, manifest)
        elif self.folder.is_dir() and any(self.folder.iterdir()) and not force:
            raise OutputError(f"output folder {self.folder} is not empty and holds no sweep; --force starts one in it")
        else:
            (work / BASE_SCENARIO).write_text(scenario_toml(sweep.base), encoding="utf-8")
            (work / MANIFEST).write_text(json.dumps(manifest, indent=2) + "\n", encoding="utf-8")
            replace_results(work, self.folder, FILES)

    def _read_finished(self, scenarios: Sequence[Scenario]) -> dict[int, Any]:
        """Read the finished runs; delete the last line from the file if an interrupted write has cut it off."""
        path = self.folder / FINISHED
        finished, whole = finished_runs(path, scenarios)
        if path.exists() and path.stat().st_size > len(whole):
            write_files({path: whole})
        return finished


def _manifest(sweep: Sweep) -> dict[str, Any]:
    """Return what identifies a sweep: its file, the package versions, and a hash of all scenarios and morphologies."""
    digest = hashlib.sha256()
    for scenario in sweep.scenarios:
        digest.update(scenario.model_dump_json().encode())
    named = {name for run in sweep.scenarios for name in (run.robot.morphology, run.believed_robot.morphology)}
    for name in sorted(named - set(MORPHOLOGIES)):
        digest.update(Path(name).read_bytes() if Path(name).is_file() else b"")
    file = sweep.file.model_dump(mode="json", by_alias=True, exclude_none=True)
    return {**file, "runs": len(sweep.scenarios), "versions": dict(versions()), "sha256": digest.hexdigest()}


def _refuse_other(path: Path, manifest: dict[str, Any]) -> None:
    try:
        there = plain_json(content_of(path, MOST_MANIFEST))
    except ValueError as error:
        raise OutputError(f"output {path}: cannot be read: {error}; --force starts anew") from error
    other = [key for key in manifest if there.get(key) != manifest[key] and key != "description"]
    if other:
        named = [key for key in other if key not in ("sha256", "runs")] or ["a scenario or a robot"]
        raise OutputError(
            f"output folder {path.parent} holds another sweep: {', '.join(named)} differ; --out chooses another "
            "folder, --force starts anew in this one"
        )
