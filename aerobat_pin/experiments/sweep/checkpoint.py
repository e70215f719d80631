"""The folder of a sweep, which holds at any time what is swept and every finished run.

| file | content |
|---|---|
| `sweep.json` | what is swept, with which versions; another sweep is refused here |
| `base.toml` | the base scenario, `[set]` included |
| `finished.jsonl` | a line per finished run, on the disk before the next one counts |
| `results.nc`, `results.csv` | all of it as tables, written at the end |
"""

from __future__ import annotations

import fcntl
import hashlib
import json
import os
from collections.abc import Mapping
from pathlib import Path
from types import TracebackType
from typing import Any

from aerobat_description import MORPHOLOGIES
from aerobat_pin.errors import OutputError
from aerobat_pin.experiments.experiment import versions
from aerobat_pin.experiments.output_folder import WORK, write_files
from aerobat_pin.experiments.sweep.plan import Sweep
from aerobat_pin.scenario import scenario_toml

FILES = ("sweep.json", "base.toml", "finished.jsonl", "results.csv", "results.nc")
MANIFEST, BASE_SCENARIO, FINISHED, TABLE, GRID = FILES


class Checkpoint:
    """A sweep's folder, held by one process at a time. Use it in a `with` statement.

    Args:
        folder: where; made when missing.
        sweep: to go on with, or to start there.
        force: start anew, whatever is there; files that are not of a sweep are left alone.

    Raises:
        OutputError: the folder holds something else, another process sweeps in it, or it cannot be written.
    """

    def __init__(self, folder: Path, sweep: Sweep, *, force: bool) -> None:
        """Find or start the sweep."""
        self.folder = folder = Path(os.path.abspath(folder))
        if folder.exists() and not folder.is_dir():
            raise OutputError(f"output {folder}: is a file; a folder was expected")
        try:
            self._made = [path for path in (folder, *folder.parents) if not path.exists()]
            folder.mkdir(parents=True, exist_ok=True)
            self._lock = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
        except OSError as error:
            raise OutputError(f"output folder {folder}: cannot be written: {error.strerror}") from error
        try:
            self._lock_folder()
            self._resume_or_start(_manifest(sweep), sweep, force)
            self.finished = self._read_finished(len(sweep.scenarios))
            self._file = (folder / FINISHED).open("ab")
        except BaseException:
            os.close(self._lock)
            raise

    def __enter__(self) -> Checkpoint:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._file.close()
        if error is not None and not self.finished:  # nothing to go on with
            for name in FILES:
                (self.folder / name).unlink(missing_ok=True)
            for folder in self._made:
                if not any(folder.iterdir()):
                    folder.rmdir()
        os.close(self._lock)

    def add(self, number: int, outcome: str) -> None:
        """Keep the outcome of a run, on the disk when this returns. Raises OutputError when it cannot be written."""
        try:
            self._file.write(f'{{"run": {number}, "outcome": {outcome}}}\n'.encode())
            self._file.flush()
            os.fsync(self._file.fileno())
        except OSError as error:
            raise OutputError(f"output {self.folder / FINISHED}: cannot be written: {error.strerror}") from error
        self.finished[number] = json.loads(outcome)

    def write(self, tables: Mapping[str, bytes]) -> None:
        """Write the results, all of them whole or none. Raises OutputError when they cannot be written."""
        write_files({self.folder / name: content for name, content in tables.items()})

    def _lock_folder(self) -> None:
        try:
            fcntl.flock(self._lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            raise OutputError(f"output folder {self.folder}: another process is sweeping in it") from error

    def _resume_or_start(self, manifest: dict[str, Any], sweep: Sweep, force: bool) -> None:
        """Go on with the sweep that is there, or start one."""
        for stale in self.folder.glob(f"{WORK}*"):  # of a sweep that was killed while it wrote
            if stale.is_file():
                stale.unlink()
        there = self.folder / MANIFEST
        if there.is_file() and not force:
            _refuse_other(there, manifest)
            return
        if any(self.folder.iterdir()) and not force:
            raise OutputError(f"output folder {self.folder} is not empty and holds no sweep; --force starts one in it")
        for name in FILES:
            (self.folder / name).unlink(missing_ok=True)
        text = json.dumps(manifest, indent=2) + "\n"
        write_files({self.folder / BASE_SCENARIO: scenario_toml(sweep.base).encode(), there: text.encode()})

    def _read_finished(self, count: int) -> dict[int, Any]:
        """Read the finished runs; drop a line that was not written to its end, in the file too."""
        path = self.folder / FINISHED
        content = path.read_bytes() if path.exists() else b""
        finished, good = {}, []
        for line in content.splitlines(keepends=True):
            try:
                read = json.loads(line)
                number, outcome = int(read["run"]), dict(read["outcome"])
            except (ValueError, KeyError, TypeError):
                continue
            if line.endswith(b"\n") and 0 <= number < count:
                finished[number] = outcome
                good.append(line)
        if b"".join(good) != content:
            write_files({path: b"".join(good)})
        return finished


def _manifest(sweep: Sweep) -> dict[str, Any]:
    """Return what tells this sweep from others: its file, every scenario, the user's own morphologies, the versions."""
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
        there = dict(json.loads(path.read_text(encoding="utf-8")))
    except (OSError, ValueError, TypeError) as error:
        raise OutputError(f"output {path}: cannot be read: {error}; --force starts anew") from error
    other = [key for key in manifest if there.get(key) != manifest[key] and key != "description"]
    if other:
        named = [key for key in other if key not in ("sha256", "runs")] or ["a scenario or a robot"]
        raise OutputError(
            f"output folder {path.parent} holds another sweep: {', '.join(named)} differ; --out chooses another "
            "folder, --force starts anew in this one"
        )
