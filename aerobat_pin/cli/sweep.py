"""The command `aerobat sweep`."""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Annotated

import typer

from aerobat_pin.cli.console import LINE_EVERY, progress_bar
from aerobat_pin.cli.options import NameOrFile
from aerobat_pin.errors import raising


def sweep_command(
    sweep: NameOrFile,
    jobs: Annotated[
        int | None, typer.Option(min=1, help="Processes on this machine; default one for each processor.")
    ] = None,
    cluster: Annotated[
        str | None, typer.Option(metavar="ADDRESS", help="Fly on the Dask cluster with its scheduler there instead.")
    ] = None,
    out: Annotated[Path | None, typer.Option(help="Output folder; default runs/<sweep>.")] = None,
    force: Annotated[bool, typer.Option("--force", help="Start anew, whatever the folder holds.")] = False,
) -> None:
    """Simulate a sweep of scenarios and write its tables; the same command resumes an interrupted sweep."""
    from aerobat_pin.experiments import load_sweep, run_sweep

    planned = load_sweep(sweep)
    target = out or Path("runs") / planned.file.name
    typer.echo(f"{planned.file.name}: {planned.file.size_text} = {len(planned.scenarios)} runs of {planned.base.name}")
    processes = len(os.sched_getaffinity(0)) if jobs is None else jobs
    with progress_bar() as bar:
        progress = _SweepProgress(bar if sys.stderr is not None and sys.stderr.isatty() else None)
        try:
            with raising():
                grid = run_sweep(planned, target, jobs=processes, cluster=cluster, force=force, progress=progress)
        except KeyboardInterrupt:
            typer.echo(f"\ninterrupted: {progress.text}; the same command goes on from there", err=True)
            raise typer.Exit(130) from None
    reasons = [str(reason) for reason in grid["failed"].values.flat if reason]
    typer.echo(f"{progress.text}; results in {target}/: results.nc, results.csv")
    if reasons:
        typer.echo(f"first failure: {reasons[0]}", err=True)
    if len(reasons) == len(planned.scenarios):
        raise typer.Exit(2)


class _SweepProgress:
    """Show how many runs are finished: in a progress bar, or without a terminal in a line every ten seconds."""

    def __init__(self, bar: Callable[[str, float], None] | None) -> None:
        self.text = "nothing is finished"
        self._bar = bar
        self._resumed_at: int | None = None
        self._start = self._last_line = time.monotonic()

    def __call__(self, finished: int, count: int, failed: int) -> None:
        """Update the numbers of runs: finished, in total, and failed."""
        self.text = f"{finished} of {count} runs are finished" + (f", {failed} of them failed" if failed else "")
        now = time.monotonic()
        if self._resumed_at is None:
            self._resumed_at = finished
            if finished:
                typer.echo(f"going on: {self.text}")
        if self._bar is not None:
            self._bar(self.text, finished / count)
        elif finished == self._resumed_at + 1:  # the first run also starts processes and loads kernels
            self._start = now
        elif now - self._last_line > LINE_EVERY and self._resumed_at < finished < count:
            self._last_line = now
            left = (now - self._start) / (finished - self._resumed_at - 1) * (count - finished)
            typer.echo(f"{self.text}, {left:.0f} s left", err=True)
