"""Write results: all of them or none, and never over a file that is not a result."""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path

from aerobat_pin.errors import OutputError

FIGURES = ("position", "states", "stick_diagram", "estimation", "linkage", "aerodynamics", "power")
RESULTS = (
    "scenario.toml",
    "belief.toml",
    "morphology.toml",
    "unknown_force_*.csv",
    "flight.nc",
    "estimate.nc",
    "estimate.csv",
    "metrics.json",
    *(f"figures/{name}.{kind}" for name in FIGURES for kind in ("png", "pdf")),
    "report.html",
    "replay.html",
)
WORK = ".aerobat-"  # begins the names of files and folders that are still being written


@contextmanager
def output_folder(target: Path, *, force: bool, replaces: Sequence[str] = RESULTS) -> Iterator[Path]:
    """Give a fresh folder to write into, and move its content to `target` when all went well.

    Nothing appears at the target unless everything was written. With `force` the results of an earlier run are
    replaced; other files in the folder are left alone.

    Args:
        target: folder for the results; it and its parents are made when missing, and unmade on failure.
        force: allow a target that is not empty.
        replaces: patterns of what an earlier run leaves there.

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
        _replace(work, target, replaces)
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
    """Raise OutputError where a file cannot be written, or exists and may not be replaced (not `force`)."""
    if target.is_dir():
        raise OutputError(f"output {target}: is a folder; a file was expected")
    if target.exists() and not force:
        raise OutputError(f"output {target} exists; --force overwrites it")
    if not target.absolute().parent.is_dir():
        raise OutputError(f"output {target}: there is no folder {target.parent}")
    if not os.access(target.absolute().parent, os.W_OK):
        raise OutputError(f"output {target}: cannot be written: the folder {target.parent} takes no files")


def picture_files(out: Path, name: str, *, force: bool) -> list[Path]:
    """Choose where a picture goes: a file by its ending, or `name`.png and `name`.pdf in a folder.

    Raises:
        OutputError: no such kind of picture, or a file that is not to be written.
    """
    if out.is_dir() or not out.suffix:
        files = [out / f"{name}.png", out / f"{name}.pdf"]
        if out.exists() and not out.is_dir():
            raise OutputError(f"output {out}: is a file; a folder, or a .png, .pdf or .svg file was expected")
        for file in files:
            if file.exists():
                check_file(file, force=force)
        return files
    if out.suffix.lower() not in (".png", ".pdf", ".svg"):
        raise OutputError(f"output {out}: {out.suffix} is none of .png, .pdf and .svg, and there is no such folder")
    check_file(out, force=force)
    return [out]


def write_text(target: Path, text: str) -> None:
    """Write a file whole or not at all. Raises OutputError when it cannot be written."""
    write_files({target: text.encode()})


def write_files(contents: Mapping[Path, bytes]) -> None:
    """Write files, all of them whole or none at all; folders that are missing are made.

    Raises:
        OutputError: a file or folder cannot be written.
    """
    parts = {path: path.with_name(f"{WORK}{os.getpid()}-{path.name}") for path in contents}
    folders = {folder for path in contents for folder in path.absolute().parents}
    made = [folder for folder in sorted(folders, key=lambda path: -len(path.parts)) if not folder.exists()]
    done, path = False, Path()
    try:
        for path, content in contents.items():
            path.parent.mkdir(parents=True, exist_ok=True)
            parts[path].write_bytes(content)
        for path, part in parts.items():
            os.replace(part, path)
        done = True
    except OSError as error:
        raise OutputError(f"output {path}: cannot be written: {error.strerror or error}") from error
    finally:
        for part in parts.values():
            with suppress(OSError):
                part.unlink(missing_ok=True)
        for folder in [] if done else made:
            if folder.is_dir() and not any(folder.iterdir()):
                folder.rmdir()


def _replace(work: Path, target: Path, replaces: Sequence[str]) -> None:
    """Remove an earlier run's files and move the new ones in."""
    for pattern in replaces:
        for path in target.glob(pattern):
            path.unlink()
    for path in sorted(work.rglob("*")):
        place = target / path.relative_to(work)
        if path.is_dir():
            place.mkdir(exist_ok=True)
        else:
            os.replace(path, place)
    figures = target / "figures"
    if figures.is_dir() and not any(figures.iterdir()):
        figures.rmdir()
