"""Several runs by one command: one scenario with several seeds (`aerobat run SCENARIO --seeds 1-5`), and a sweep."""

from __future__ import annotations

import io
import json
import os
import re
import time
from collections.abc import Callable, Iterator
from contextlib import redirect_stdout
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from aerobat_pin.cli.console import progress_bar
from aerobat_pin.cli.options import Force, NameOrFile, out_option
from aerobat_pin.errors import raising

if TYPE_CHECKING:
    import pandas as pd

MOST_SEEDS = 1000
SEED_TABLE = "seeds.csv"
AXIS = ["observer", "point", "axis"]
SEED_SCORES = ["r2", "r2_noise_free", "rmse", "lag_s"]


def run_seeds(
    text: str, seed: int | None, scenario: str, out: Path | None, run: Callable[[int, Path], None], *, force: bool
) -> None:
    """Run a scenario with several seeds, a folder `seed_N` for each, and write and print one table of all scores.

    The seeds' `text` is as typed, `--seed` would contradict it, and `run` writes one seed's results into a folder.

    Raises:
        ScenarioError: the seeds are no list of whole numbers, or `--seed` is given too.
        OutputError: there is a table of earlier seeds.
        SimulationError: a flight diverged; raised after all others were run, and their results are there.
    """
    import pandas as pd

    from aerobat_pin.errors import ScenarioError, SimulationError, check_file, write_text

    if seed is not None:
        raise ScenarioError("run: --seed and --seeds: one of them was expected")
    target = out or Path("runs") / f"{Path(scenario).stem}-seeds"
    check_file(target / SEED_TABLE, force=force)
    rows: list[dict[str, Any]] = []
    failed: SimulationError | None = None
    names = {f"seed_{number}": number for number in seeds_of(text)}
    for name, number in names.items():
        folder = target / name
        try:
            with redirect_stdout(io.StringIO()):
                run(number, folder)
        except SimulationError as error:
            failed = failed or error
            if error.kept is None:  # nothing was written
                continue
        typer.echo(f"seed {number}: {folder}/")
        rows += _scores(number, json.loads((folder / "metrics.json").read_text(encoding="utf-8")))
    if rows:
        table = pd.DataFrame(rows, columns=["seed", *AXIS, *SEED_SCORES])
        write_text(target / SEED_TABLE, table.to_csv(index=False, lineterminator="\n"))
        typer.echo(f"\n{summary(table)}\n\nresults in {target}/\nopen {target / SEED_TABLE}")
        if older := sorted(path.name for path in target.glob("seed_*") if path.name not in names):
            typer.echo(f"of earlier runs, and not in the table: {', '.join(older)}")
    if failed is not None:
        raise failed


def seeds_of(text: str) -> list[int]:
    """Return the seeds that a text such as `1-5` or `1,4,9` names. Raises ScenarioError for another text."""
    from aerobat_pin.errors import ScenarioError

    seeds: dict[int, None] = {}
    for part in text.split(","):
        match = re.fullmatch(r"\s*(\d{1,9})(?:-(\d{1,9}))?\s*", part)
        if match is None or (match[2] and int(match[2]) < int(match[1])):
            raise ScenarioError(f"run: --seeds {text[:60]}: a list such as 1-5 or 1,4,9 was expected")
        first, last = int(match[1]), int(match[2] or match[1])
        if len(seeds) + last - first >= MOST_SEEDS:
            raise ScenarioError(
                f"run: --seeds {text[:60]}: at most {MOST_SEEDS} seeds were expected; see aerobat sweep"
            )
        seeds |= dict.fromkeys(range(first, last + 1))
    return list(seeds)


def summary(table: pd.DataFrame) -> str:
    """Return mean and least R2 and the mean error of each axis over the seeds, as text."""
    from aerobat_pin.forces import one_unit

    lines = [
        f"{'observer':<12} {'point':<12} {'axis':<4} {'seeds':>5} {'R2 mean':>9} {'R2 least':>9} {'error rms':>10}"
    ]
    errors = table.groupby(AXIS, sort=False)["rmse"].mean()
    say = one_unit(errors)
    for (observer, point, axis), group in table.groupby(AXIS, sort=False):
        r2 = group["r2"].dropna()
        shown = f"{r2.mean():9.5f} {r2.min():9.5f}" if len(r2) else "no signal no signal"
        error = say(group["rmse"].mean(), "N")
        lines.append(f"{observer:<12} {point:<12} {axis:<4} {len(group):>5} {shown} {error:>10}")
    return "\n".join(lines)


def _scores(seed: int, metrics: dict[str, Any]) -> Iterator[dict[str, Any]]:
    for observer, points in metrics["observers"].items():
        for point, axes in points.items():
            if isinstance(axes, dict) and "Fx" in axes:
                for axis, score in axes.items():
                    named = {"seed": seed, "observer": observer, "point": point, "axis": axis}
                    yield named | {key: score[key] for key in SEED_SCORES}


def sweep_command(
    sweep: NameOrFile,
    jobs: Annotated[
        int | None, typer.Option(min=1, help="Processes on this machine; default one for each processor.")
    ] = None,
    cluster: Annotated[
        str | None, typer.Option(metavar="ADDRESS", help="Fly on the Dask cluster with its scheduler there instead.")
    ] = None,
    out: Annotated[Path | None, out_option("Output folder; default `runs/<sweep>`.")] = None,
    force: Force = False,
) -> None:
    """Simulate a sweep of scenarios and write its tables; the same command resumes an interrupted sweep."""
    from aerobat_pin.errors import write_files
    from aerobat_pin.experiments import effects_text, load_sweep, run_sweep, sweep_effects

    planned = load_sweep(sweep)
    target = out or Path("runs") / planned.file.name
    typer.echo(f"{planned.file.name}: {planned.file.size_text} = {len(planned.scenarios)} runs of {planned.base.name}")
    processes = len(os.sched_getaffinity(0)) if jobs is None else jobs
    with progress_bar() as bar:
        progress = _SweepProgress(bar)
        try:
            with raising():
                grid = run_sweep(planned, target, jobs=processes, cluster=cluster, force=force, progress=progress)
        except KeyboardInterrupt:
            typer.echo(f"\ninterrupted: {progress.text}; the same command goes on from there", err=True)
            raise typer.Exit(130) from None
    reasons = [str(reason) for reason in grid["failed"].values.flat if reason]
    effects = sweep_effects(grid)
    drawn = ""
    if effects and len(reasons) < len(planned.scenarios):
        from aerobat_pin.visualization import draw_sweep, render_figure

        title = f"{planned.file.name}: {planned.file.size_text} runs of {planned.base.name}"
        write_files({target / "sweep.png": render_figure(draw_sweep(effects, title), "png")})
        typer.echo(f"\n{effects_text(effects)}\n")
        drawn = ", sweep.png"
    typer.echo(f"{progress.text}; results in {target}/: results.nc, results.csv{drawn}")
    if reasons:
        typer.echo(f"first failure: {reasons[0]}", err=True)
    if len(reasons) == len(planned.scenarios):
        raise typer.Exit(2)


class _SweepProgress:
    """Show how many runs are finished, and for how long the rest will take."""

    def __init__(self, bar: Callable[[str, float], None]) -> None:
        self.text = "nothing is finished"
        self._bar = bar
        self._resumed_at: int | None = None
        self._start = time.monotonic()
        bar("starting the first runs", 0.0)

    def __call__(self, finished: int, count: int, failed: int) -> None:
        """Update the numbers of runs: finished, in total, and failed."""
        self.text = f"{finished} of {count} runs are finished" + (f", {failed} of them failed" if failed else "")
        now = time.monotonic()
        if self._resumed_at is None:
            self._resumed_at = finished
            if finished:
                typer.echo(f"going on: {self.text}")
            return
        if finished == self._resumed_at + 1:  # the first run also starts processes and loads kernels
            self._start = now
        flown = finished - self._resumed_at - 1
        remaining = f", {(now - self._start) / flown * (count - finished):.0f} s left" if flown else ""
        self._bar(f"{self.text}{remaining}", finished / count)
