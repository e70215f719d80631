"""What the commands print: progress and tables."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from typing import TYPE_CHECKING, Any

import typer

if TYPE_CHECKING:
    from aerobat_pin.estimation import Scores

INTERRUPTED = 130  # exit code of a program that Ctrl-C ended


@contextmanager
def interruptible() -> Iterator[None]:
    """End on Ctrl-C with a line and exit code 130; for what writes everything at its end, or nothing."""
    try:
        yield
    except KeyboardInterrupt:
        typer.echo("interrupted: nothing was written", err=True)
        raise typer.Exit(INTERRUPTED) from None


def progress() -> Any:
    """Return a context that shows progress on a terminal and stays silent elsewhere."""
    if sys.stderr is None or not sys.stderr.isatty():
        return nullcontext(None)
    return _Bar()


class _Bar:
    """One rich progress bar whose label follows the stage."""

    def __enter__(self) -> Any:
        from rich.progress import Progress

        self._bar = Progress(transient=True)
        self._bar.start()
        self._task = self._bar.add_task("starting", total=1.0)
        return lambda stage, share: self._bar.update(self._task, description=stage, completed=share)

    def __exit__(self, *_: object) -> None:
        self._bar.stop()


def print_table(scores: Scores, *, noisy: bool = False) -> None:
    """Print the scores; where the sensors are `noisy` and an estimate drowns in that, say what helps."""
    typer.echo(f"\n{scores}")
    if noisy and scores.worse_than_nothing:
        typer.echo("R2 below 0 is worse than no estimate: a smaller observers.gain follows the sensors' noise less")
