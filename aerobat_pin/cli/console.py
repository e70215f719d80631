"""Print what several commands show: progress, scores, and the files that were written."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from aerobat_pin.files import cleaned

if TYPE_CHECKING:
    from aerobat_pin.estimation import Scores


@contextmanager
def progress_bar() -> Iterator[Callable[[str, float], None] | None]:
    """Show a progress bar during a `with` block.

    Yields:
        A function that updates the label and the share done, or None if standard error is not a terminal.
    """
    if sys.stderr is None or not sys.stderr.isatty():
        yield None
        return
    from rich.console import Console
    from rich.progress import Progress

    with Progress(transient=True, console=Console(stderr=True)) as bar, cleaned(bar.stop):
        task = bar.add_task("starting", total=1.0)
        yield lambda label, share: bar.update(task, description=label, completed=share)


def print_scores(scores: Scores, *, noisy: bool = False) -> None:
    """Print the table of scores, and an advice if the sensors are noisy and an R2 is below 0."""
    typer.echo(f"\n{scores}")
    if noisy and scores.worse_than_nothing:
        typer.echo("R2 below 0 is worse than no estimate: a smaller observers.gain follows the sensors' noise less")


def files_in(folder: Path) -> list[Path]:
    """Return all files in a folder and its subfolders, sorted, as paths relative to the folder."""
    return sorted(path.relative_to(folder) for path in folder.rglob("*") if path.is_file())


def print_files(target: Path, files: list[Path]) -> None:
    """Print the folder of the results and the files that were written into it."""
    typer.echo(f"\nresults in {target}/")
    for file in files:
        typer.echo(f"  {target / file}")
