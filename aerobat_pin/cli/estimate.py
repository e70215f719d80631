"""The command `aerobat estimate`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from aerobat_pin.cli.console import files_in, print_files, print_scores, progress_bar
from aerobat_pin.cli.options import BelievedMorphology, Force, ObserverNames, Settings

if TYPE_CHECKING:
    from aerobat_pin.estimation import Scores
    from aerobat_pin.scenario import Scenario


def estimate_command(
    log: Annotated[
        Path | None, typer.Argument(help="Recorded flight: `.nc` of a run, or `.csv` (columns in docs/recorded.md).")
    ] = None,
    morphology: BelievedMorphology = None,
    observers: ObserverNames = None,
    settings: Settings = None,
    out: Annotated[Path | None, typer.Option(help="Output folder; default runs/<log>-estimate.")] = None,
    force: Force = False,
    self_check: Annotated[
        bool,
        typer.Option("--self-check", help="First, or without a log only, estimate known forces on a simulated flight."),
    ] = False,
) -> None:
    """Estimate the unknown forces of a recorded flight, whose true forces need not be known.

    --set takes keys of robot, air and observers, and flight.gravity.
    """
    from aerobat_pin import experiments
    from aerobat_pin.errors import LogError
    from aerobat_pin.estimation import belief_about, describe_belief, read_log
    from aerobat_pin.files import output_folder

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
    target = out or Path("runs") / f"{name}-estimate"
    with output_folder(target, force=force, replaces=experiments.RESULTS) as folder, progress_bar() as show:
        estimated = experiments.run_recorded(flight, belief, show)
        experiments.write(estimated, folder)
        from aerobat_pin.visualization import draw_estimation, save_figure

        (folder / "figures").mkdir()
        save_figure(draw_estimation(flight, estimated.estimates), folder / "figures" / "estimation")
        files = files_in(folder)
    _print_inputs(estimated.scores)
    print_scores(estimated.scores)
    print_files(target, files)


def _passes_self_check(belief: Scenario) -> bool:
    """Run the self-check (known forces on a simulated flight), print its results, and return whether all are right."""
    from aerobat_pin.estimation import self_check
    from aerobat_pin.robot import believed_robot

    checks = self_check(believed_robot(belief), belief)
    for check in checks:
        typer.echo(str(check))
    passed = all(check.ok for check in checks)
    typer.echo("self-check: sign, frame and unit are right" if passed else "self-check: FAILED")
    return passed


def _print_inputs(scores: Scores) -> None:
    """Print the source of each input of the observers, and size and deviation of each estimated component."""
    for name, source in scores.inputs.items():
        typer.echo(f"{name:<14} {source}")
    for name, found in scores.observers.items():
        for component in found.components:
            size = f"rms {1e3 * component.rms:9.2f} m{component.unit}"
            typer.echo(f"{name:<14} {component.name:<24} {size}, deviation {component.certainty}")
