"""Where results go: everything or nothing, and never at the cost of a file that is not ours."""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from aerobat_pin.errors import OutputError

FIGURES = ("position", "states", "stick_diagram", "estimation", "linkage")
RESULTS = (
    "scenario.toml",
    "morphology.toml",
    "flight.nc",
    "estimate.nc",
    "metrics.json",
    *(f"figures/{name}.{kind}" for name in FIGURES for kind in ("png", "pdf")),
    "report.html",
    "replay.html",
)
WORK = ".aerobat-"  # begins the name of the folder that results are first written to


@contextmanager
def output_folder(target: Path, *, force: bool) -> Iterator[Path]:
    """Give a fresh folder to write into, and move its content to `target` when all went well.

    Nothing appears at the target unless everything was written. With `force` the results of an earlier run are
    replaced; other files in the folder are left alone.

    Args:
        target: folder for the results; it and its parents are made when missing, and unmade on failure.
        force: allow a target that is not empty.

    Raises:
        OutputError: the target is not empty (and not `force`), is a file, or cannot be written, now or while writing.
    """
    target = Path(os.path.abspath(target))
    if target.exists() and not target.is_dir():
        raise OutputError(f"output {target}: is a file; a folder was expected")
    made = [folder for folder in (target, *target.parents) if not folder.exists()]
    work = None
    done = False
    try:
        if target.is_dir():
            left = [path for path in target.iterdir() if not path.name.startswith(WORK)]
            if left and not force:
                raise OutputError(
                    f"output folder {target} is not empty; --force replaces an earlier run's results in it"
                )
            for stale in target.glob(f"{WORK}*"):  # of a run that was killed
                shutil.rmtree(stale, ignore_errors=True)
        target.mkdir(parents=True, exist_ok=True)
        work = Path(tempfile.mkdtemp(prefix=WORK, dir=target))
        yield work
        _replace(work, target)
        done = True
    except OSError as error:
        if isinstance(error, OutputError):
            raise
        raise OutputError(f"output folder {target}: cannot be written: {error.strerror or error}") from error
    finally:
        if work is not None:
            shutil.rmtree(work, ignore_errors=True)
        for folder in [] if done else made:
            if folder.is_dir() and not any(folder.iterdir()):
                folder.rmdir()


def check_file(target: Path, *, force: bool) -> None:
    """Raise OutputError where a file is not to be written: a folder, no folder for it, or (not `force`) a file."""
    if target.is_dir():
        raise OutputError(f"output {target}: is a folder; a file was expected")
    if target.exists() and not force:
        raise OutputError(f"output {target} exists; --force overwrites it")
    if not target.absolute().parent.is_dir():
        raise OutputError(f"output {target}: there is no folder {target.parent}")


def write_text(target: Path, text: str) -> None:
    """Write a file whole or not at all. Raises OutputError when it cannot be written."""
    part = target.with_name(f"{WORK}{os.getpid()}-{target.name}")
    try:
        part.write_text(text, encoding="utf-8")
        os.replace(part, target)
    except OSError as error:
        raise OutputError(f"output {target}: cannot be written: {error.strerror or error}") from error
    finally:
        part.unlink(missing_ok=True)


def _replace(work: Path, target: Path) -> None:
    """Remove an earlier run's files and move the new ones in."""
    for name in RESULTS:
        (target / name).unlink(missing_ok=True)
    for path in sorted(work.rglob("*")):
        place = target / path.relative_to(work)
        if path.is_dir():
            place.mkdir(exist_ok=True)
        else:
            os.replace(path, place)
    figures = target / "figures"
    if figures.is_dir() and not any(figures.iterdir()):
        figures.rmdir()
