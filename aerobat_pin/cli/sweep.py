"""`aerobat sweep`: parse, call, show how far it is."""

from __future__ import annotations

import os
import sys
import time
from pathlib import Path
from typing import Annotated, Any

import typer

from aerobat_pin.cli.console import INTERRUPTED

LINE_EVERY = 10.0  # [s], where there is no terminal


def sweep(
    file: Annotated[str, typer.Argument(metavar="SWEEP", help="Shipped name (see `aerobat list`) or TOML file.")],
    jobs: Annotated[
        int | None, typer.Option(min=1, help="Processes on this machine; default one for each processor.")
    ] = None,
    cluster: Annotated[
        str | None, typer.Option(metavar="ADDRESS", help="Fly on the Dask cluster whose scheduler is there instead.")
    ] = None,
    out: Annotated[Path | None, typer.Option(help="Output folder; default runs/<sweep>.")] = None,
    force: Annotated[bool, typer.Option("--force", help="Start anew, whatever the folder holds.")] = False,
) -> None:
    """Fly a sweep of scenarios and write its tables; interrupted, the same command goes on where it was."""
    from aerobat_pin.experiments import load_sweep
    from aerobat_pin.experiments.sweep import run_sweep

    loaded = load_sweep(file)
    target = out if out is not None else Path("runs") / loaded.file.name
    parts = " x ".join(f"{len(one.labels)} {one.name}" for one in loaded.dimensions)
    typer.echo(f"{loaded.file.name}: {parts} = {len(loaded.scenarios)} runs of {loaded.base.name}")
    processes = len(os.sched_getaffinity(0)) if jobs is None else jobs
    with _Shown() as show:
        try:
            grid = run_sweep(loaded, target, jobs=processes, cluster=cluster, force=force, progress=show)
        except KeyboardInterrupt:
            typer.echo(f"\ninterrupted: {show.said}; the same command goes on from there", err=True)
            raise typer.Exit(INTERRUPTED) from None
    reasons = [str(one) for one in grid["failed"].values.flat if one]
    typer.echo(f"{show.said}; results in {target}/: results.nc, results.csv")
    if reasons:
        typer.echo(f"first failure: {reasons[0]}", err=True)
    if len(reasons) == len(loaded.scenarios):
        raise typer.Exit(2)


class _Shown:
    """Progress with the time that is left: a bar on a terminal, a line now and then elsewhere."""

    def __init__(self) -> None:
        self.said = "nothing is finished"
        self._bar: Any = None
        self._task: Any = None
        self._start = self._last = time.monotonic()
        self._before = -1

    def __enter__(self) -> _Shown:
        if sys.stderr is not None and sys.stderr.isatty():
            from rich.console import Console
            from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

            columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
            self._bar = Progress(*columns, transient=True, console=Console(stderr=True))
            self._bar.start()
        return self

    def __exit__(self, *_: object) -> None:
        if self._bar is not None:
            self._bar.stop()

    def __call__(self, finished: int, count: int, failed: int) -> None:
        """Take in the numbers of runs finished, in all, and failed."""
        self.said = f"{finished} of {count} runs are finished" + (f", {failed} of them failed" if failed else "")
        if self._before < 0:
            self._before = finished
            if finished:
                typer.echo(f"going on: {self.said}")
            if self._bar is not None:
                self._task = self._bar.add_task("flying", total=count, completed=finished)
        elif self._bar is not None:
            told = f"flying, {failed} failed" if failed else "flying"
            self._bar.update(self._task, completed=finished, description=told)
        elif finished == self._before + 1:  # the first run also starts processes and loads kernels
            self._start = time.monotonic()
        elif time.monotonic() - self._last > LINE_EVERY and finished < count:
            self._last = time.monotonic()
            left = (self._last - self._start) / (finished - self._before - 1) * (count - finished)
            typer.echo(f"{self.said}, {left:.0f} s left", err=True)
