"""The command `aerobat estimate`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from aerobat_pin.cli.console import interruptible, print_table, progress

if TYPE_CHECKING:
    from aerobat_pin.estimation import Scores


@interruptible()
def estimate(
    log: Annotated[
        Path | None, typer.Argument(help="Recorded flight: `.nc` of a run, or `.csv` (columns in docs/recorded.md).")
    ] = None,
    morphology: Annotated[
        str | None, typer.Option(help="Believed robot: shipped name or TOML file; else what the log notes.")
    ] = None,
    observers: Annotated[
        list[str] | None, typer.Option("--observer", metavar="NAME", help="Run this observer; repeatable.")
    ] = None,
    settings: Annotated[
        list[str] | None,
        typer.Option("--set", metavar="KEY=VALUE", help="Set a key of robot, air, observers, or flight.gravity."),
    ] = None,
    out: Annotated[Path | None, typer.Option(help="Output folder; default runs/<log>-estimate.")] = None,
    force: Annotated[bool, typer.Option("--force", help="Replace the results of an earlier run.")] = False,
    self_check: Annotated[
        bool, typer.Option("--self-check", help="Push on the simulated robot with known forces first, or only.")
    ] = False,
) -> None:
    """Estimate the unknown forces of a recorded flight; no truth is needed."""
    from aerobat_pin import experiments
    from aerobat_pin.errors import LogError
    from aerobat_pin.estimation import belief_about, describe_belief, read_log
    from aerobat_pin.experiments import output_folder

    if log is None and not self_check:
        raise LogError("estimate: a recorded flight was expected, or --self-check")
    flight = None if log is None else read_log(log)
    name = "self-check" if log is None else log.stem
    belief = belief_about(flight, name, morphology, observers or [], settings or [])
    typer.echo(describe_belief(belief, morphology, settings or []))
    if self_check and not _passes_self_check(belief):
        raise typer.Exit(1)
    if flight is None:
        return
    target = out if out is not None else Path("runs") / f"{name}-estimate"
    with output_folder(target, force=force) as folder, progress() as show:
        made = experiments.run_recorded(flight, belief, show)
        experiments.write(made, folder)
        from aerobat_pin.visualization.figures import paper as figures

        (folder / "figures").mkdir()
        figures.save(figures.estimation(flight, made.estimates), folder / "figures" / "estimation")
        written = sorted(path.relative_to(folder) for path in folder.rglob("*") if path.is_file())
    _print_inputs(made.scores)
    print_table(made.scores)
    typer.echo(f"\nresults in {target}/")
    for path in written:
        typer.echo(f"  {target / path}")


def _passes_self_check(belief: Any) -> bool:
    """Print what was pushed and found; say whether all of it agrees."""
    from aerobat_pin.estimation import self_check
    from aerobat_pin.robot import believed_robot

    checks = self_check(believed_robot(belief), belief)
    for check in checks:
        typer.echo(str(check))
    good = all(check.ok for check in checks)
    typer.echo("self-check: sign, frame and unit are right" if good else "self-check: FAILED")
    return good


def _print_inputs(scores: Scores) -> None:
    """Print where each input of the observers comes from, and how large the forces found are."""
    for name, source in scores.inputs.items():
        typer.echo(f"{name:<14} {source}")
    for name, found in scores.observers.items():
        for component in found.components:
            typer.echo(f"{name:<14} {component.name:<24} rms {1e3 * component.rms:9.2f} m{component.unit}")
