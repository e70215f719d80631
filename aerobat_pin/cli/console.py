"""Print what several commands show: progress, scores, and the files that were written."""

from __future__ import annotations

import os
import re
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from aerobat_pin.cli.spoken_progress import voice
from aerobat_pin.errors import OutputError, check_file, cleaned, output_folder

if TYPE_CHECKING:
    from aerobat_pin.estimation import Result
    from aerobat_pin.experiments import Experiment, Progress

FIRST_OPENED = ("replay.html", "report.html")  # what a person opens, the most telling last


@contextmanager
def progress_bar() -> Iterator[Callable[[str, float], None]]:
    """Show on stderr how far a command is: a bar for each stage, or without a terminal lines that say what takes long.

    What is compiled is told too, by the name of the kernel: a run then takes a minute more, once. The block gets a
    function that updates the name of the stage and the share of it that is done.
    """
    from aerobat_pin.numerics import told_of_compilation

    if sys.stderr is None or not sys.stderr.isatty():
        with told_of_compilation(voice), voice.speaking():
            yield voice
        return
    from rich.console import Console
    from rich.progress import Progress, TaskID

    with voice.resting(), Progress(transient=True, console=Console(stderr=True)) as bar, cleaned(bar.stop):
        stages: dict[str, TaskID] = {}

        def show(label: str, share: float) -> None:
            stage = re.sub(r"\d+", "#", label.partition(",")[0])  # numbers in a label may count on
            if stage not in stages:
                for done in stages.values():
                    bar.update(done, completed=1.0)
                stages[stage] = bar.add_task(label, total=1.0)
            bar.update(stages[stage], description=label, completed=share)

        with told_of_compilation(show):
            yield show


@contextmanager
def doing(what: str) -> Iterator[None]:
    """Say on stderr what a `with` block does, if that takes long."""
    with progress_bar() as show:
        show(what, 0.0)
        yield


def print_version(wanted: bool) -> None:
    """Print the version and end the program, if it is wanted."""
    if wanted:
        from importlib.metadata import version

        typer.echo(f"aerobat {version('aerobat-pinocchio')}")
        raise typer.Exit


def write_results(
    estimated: Callable[[Progress], Experiment | Result],
    target: Path,
    *,
    force: bool,
    pages: bool = True,
    also: Callable[[Any], None] | None = None,
) -> None:
    """Estimate, write the results into a folder, whole or not at all, and print the scores and what was written.

    `estimated` is given a function that shows its progress; `also` writes what belongs elsewhere.
    """
    from aerobat_pin import experiments

    with (
        output_folder(target, force=force, replaces=experiments.RESULTS, sign="estimate.nc") as folder,
        progress_bar() as show,
    ):
        outcome = estimated(show)
        show("scoring and writing", 0.0)
        experiments.write(outcome, folder)
        if pages:
            from aerobat_pin.visualization import write_figures_and_pages

            write_figures_and_pages(outcome, folder, show)
        if also is not None:
            also(outcome)
        names = dict.fromkeys(f"{path.name}/" if path.is_dir() else path.name for path in sorted(folder.iterdir()))
    typer.echo(f"\n{outcome.scores if isinstance(outcome, experiments.Experiment) else outcome}")
    typer.echo(f"\nresults in {target}/: {', '.join(names)}")
    for page in [name for name in FIRST_OPENED if name in names] or ["metrics.json"]:
        typer.echo(f"open {target / page}")


def picture_files(out: Path, name: str, *, force: bool) -> list[Path]:
    """Return the picture files to write: `out` itself if it is a file name, else `name`.png and `name`.pdf in `out`.

    Raises OutputError if the ending is not .png, .pdf or .svg, or a file cannot be written or exists (without `force`).
    """
    if os.path.isdir(out) or not out.suffix:
        files = [out / f"{name}.png", out / f"{name}.pdf"]
        if os.path.exists(out) and not os.path.isdir(out):
            raise OutputError(f"output {out}: is a file; a folder, or a .png, .pdf or .svg file was expected")
        for file in files:
            if os.path.exists(file):
                check_file(file, force=force)
        return files
    if out.suffix.lower() not in (".png", ".pdf", ".svg"):
        raise OutputError(f"output {out}: {out.suffix} is none of .png, .pdf and .svg, and there is no such folder")
    check_file(out, force=force)
    return [out]
