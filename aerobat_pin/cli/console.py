"""What commands print: progress, scores, and the files they wrote."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import typer

if TYPE_CHECKING:
    from aerobat_pin.estimation import Scores

INTERRUPTED = 130  # exit code of a program that Ctrl-C ended


@contextmanager
def interruptible() -> Iterator[None]:
    """End on Ctrl-C with a line and exit code 130; for commands that write all of their files at the end."""
    try:
        yield
    except KeyboardInterrupt:
        typer.echo("interrupted: nothing was written", err=True)
        raise typer.Exit(INTERRUPTED) from None


@contextmanager
def progress_bar() -> Iterator[Callable[[str, float], None] | None]:
    """Give a function that shows a label and the share done in a bar; None where standard error is no terminal."""
    if sys.stderr is None or not sys.stderr.isatty():
        yield None
        return
    from rich.console import Console
    from rich.progress import Progress

    with Progress(transient=True, console=Console(stderr=True)) as bar:
        task = bar.add_task("starting", total=1.0)
        yield lambda label, share: bar.update(task, description=label, completed=share)


def print_scores(scores: Scores, *, noisy: bool = False) -> None:
    """Print the table of scores; where the sensors are `noisy` and an R2 is below 0, say what helps."""
    typer.echo(f"\n{scores}")
    if noisy and scores.worse_than_nothing:
        typer.echo("R2 below 0 is worse than no estimate: a smaller observers.gain follows the sensors' noise less")


def files_in(folder: Path) -> list[Path]:
    """Return the files of a folder and those below it, relative to it, in order."""
    return sorted(path.relative_to(folder) for path in folder.rglob("*") if path.is_file())


def print_files(target: Path, files: list[Path]) -> None:
    """Print the folder of the results and the files written into it."""
    typer.echo(f"\nresults in {target}/")
    for file in files:
        typer.echo(f"  {target / file}")
