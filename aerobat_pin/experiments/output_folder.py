"""Write results atomically (either all files or none), and never overwrite a file that is not a result."""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path

from aerobat_pin.errors import OutputError
from aerobat_pin.numerics import guarded

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
WORK = ".aerobat-"  # prefix of files and folders that are still being written


@guarded()
@contextmanager
def output_folder(target: Path, *, force: bool, replaces: Sequence[str] = RESULTS) -> Iterator[Path]:
    """Provide an empty temporary folder, and move its content to `target` if the `with` block ends without an error.

    Nothing appears at the target unless everything was written. With `force`, the results of an earlier run are
    replaced; other files in the folder are left alone.

    Args:
        target: folder for the results. Missing folders are created, and removed again if the block fails.
        force: allow a target that is not empty.
        replaces: glob patterns of an earlier run's results, which are deleted.

    Raises:
        OutputError: the target is a file, is not empty (without `force`), or cannot be written, now or later.
    """
    target = Path(os.path.abspath(target))
    if target.exists() and not target.is_dir():
        raise OutputError(f"output {target}: is a file; a folder was expected")
    try:
        with unmade_on_failure((target, *target.parents)):
            found = target.iterdir() if target.is_dir() else ()
            if any(not path.name.startswith(WORK) for path in found) and not force:
                raise OutputError(
                    f"output folder {target} is not empty; --force replaces an earlier run's results in it"
                )
            for stale in target.glob(f"{WORK}*"):  # temporary folders of a run that was killed
                shutil.rmtree(stale, ignore_errors=True)
            target.mkdir(parents=True, exist_ok=True)
            with tempfile.TemporaryDirectory(prefix=WORK, dir=target, ignore_cleanup_errors=True) as work:
                yield Path(work)
                _replace(Path(work), target, replaces)
    except OSError as error:
        if isinstance(error, OutputError):
            raise
        raise OutputError(f"output folder {target}: cannot be written: {error.strerror or error}") from error


@contextmanager
def unmade_on_failure(folders: Iterable[Path]) -> Iterator[None]:
    """If the `with` block fails, remove those of the folders that did not exist before it and are empty."""
    missing = [folder for folder in folders if not folder.exists()]
    try:
        yield
    except BaseException:
        for folder in sorted(missing, key=lambda path: -len(path.parts)):
            with suppress(OSError):
                folder.rmdir()
        raise


@guarded()
def check_file(target: Path, *, force: bool) -> None:
    """Raise OutputError if a file cannot be written, or if it exists and `force` is False."""
    if target.is_dir():
        raise OutputError(f"output {target}: is a folder; a file was expected")
    if target.exists() and not force:
        raise OutputError(f"output {target} exists; --force overwrites it")
    if not target.absolute().parent.is_dir():
        raise OutputError(f"output {target}: there is no folder {target.parent}")
    if not os.access(target.absolute().parent, os.W_OK):
        raise OutputError(f"output {target}: cannot be written: the folder {target.parent} takes no files")


@guarded()
def picture_files(out: Path, name: str, *, force: bool) -> list[Path]:
    """Return the picture files to write: `out` itself if it is a file name, else `name`.png and `name`.pdf in `out`.

    Args:
        out: file that ends in .png, .pdf or .svg, or a folder.
        name: name of the files in a folder, without ending.
        force: allow files that exist.

    Raises:
        OutputError: the ending is none of these three, or a file cannot be written or exists (without `force`).
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


@guarded()
def write_text(target: Path, text: str) -> None:
    """Write a file atomically: either completely or not at all. Raises OutputError if it cannot be written."""
    write_files({target: text.encode()})


@guarded()
def write_files(contents: Mapping[Path, bytes]) -> None:
    """Write files atomically: either all of them or none. Missing folders are created.

    Args:
        contents: path -> content.

    Raises:
        OutputError: a file or folder cannot be written.
    """
    parts = {path: path.with_name(f"{WORK}{os.getpid()}-{path.name}") for path in contents}
    path = Path()
    try:
        with unmade_on_failure({folder for path in contents for folder in path.absolute().parents}):
            try:
                for path, content in contents.items():
                    path.parent.mkdir(parents=True, exist_ok=True)
                    parts[path].write_bytes(content)
                for path, part in parts.items():
                    os.replace(part, path)
            finally:
                for part in parts.values():
                    with suppress(OSError):
                        part.unlink(missing_ok=True)
    except OSError as error:
        raise OutputError(f"output {path}: cannot be written: {error.strerror or error}") from error


def _replace(work: Path, target: Path, replaces: Sequence[str]) -> None:
    """Delete the results of an earlier run from `target`, and move the new ones there."""
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
