"""The commands of the command line `aerobat`.

Exit codes are 0 for success, 2 for bad input, and 1 for a failed check or a bug.
"""

from __future__ import annotations

import errno
import gc
import os
import sys
import warnings
from pathlib import Path
from typing import Annotated, Any, Literal

import typer
from typer.core import TyperGroup

from aerobat_pin.cli.calibrate import calibrate_command, check_command
from aerobat_pin.cli.console import doing, picture_files, print_version, write_results
from aerobat_pin.cli.estimate import estimate_command
from aerobat_pin.cli.live import live_command, node_command
from aerobat_pin.cli.options import (
    CalibrationFile,
    Correct,
    Force,
    NameOrFile,
    ObserverNames,
    Settings,
    complete_key,
    out_option,
    read_learnt,
    renamed,
)
from aerobat_pin.cli.runs import compare_command, convert_command, play_command
from aerobat_pin.cli.several_runs import run_seeds, sweep_command
from aerobat_pin.cli.urdf import urdf_command

LONGEST_MESSAGE = 2000  # characters of an error message, which can quote a file


class _Commands(TyperGroup):
    """Commands of whose descriptions the help shows the whole first sentence."""

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        with formatter.section("Commands"):
            formatter.write_dl([(name, self.commands[name].get_short_help_str(1000)) for name in self.commands])


app = typer.Typer(
    name="aerobat",
    cls=_Commands,
    help="Fly Aerobat, and ask what is pushing on it.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,  # boxes around the help take half of its time
)


@app.callback()
def top_command(
    version: Annotated[
        bool, typer.Option("--version", callback=print_version, is_eager=True, help="Print the version and exit.")
    ] = False,
) -> None:
    """Fly Aerobat, and ask what is pushing on it."""


@app.command("run")
def run_command(
    scenario: NameOrFile,
    out: Annotated[Path | None, out_option("Output folder; default `runs/<scenario>`.")] = None,
    force: Force = False,
    seed: Annotated[int | None, typer.Option(help="Seed of all random numbers.")] = None,
    settings: Settings = None,
    observers: ObserverNames = None,
    calibration: CalibrationFile = None,
    correct: Correct = False,
    no_report: Annotated[bool, typer.Option("--no-report", help="Skip figures, report and replay.")] = False,
    plant: Annotated[
        Literal["mujoco"] | None, typer.Option(help="Simulator of the motion, in our air; needs the extra of its name.")
    ] = None,
    seeds: Annotated[
        str | None, typer.Option(metavar="LIST", help="Run several seeds, such as 1-5 or 1,4,9: a folder for each.")
    ] = None,
) -> None:
    """Simulate a scenario, estimate the unknown forces, and write log, estimates, metrics, figures and replay."""
    if seeds is not None:
        more = settings, observers, calibration, correct, no_report, plant

        def run_one(number: int, folder: Path) -> None:
            run_command(scenario, folder, force, number, *more)

        run_seeds(seeds, seed, scenario, out, run_one, force=force)
        return
    from aerobat_pin import experiments
    from aerobat_pin.errors import SimulationError
    from aerobat_pin.scenario import load_scenario

    changes = list(settings or [])
    if plant is not None:
        changes.append(f"plant.simulator={plant}")
    if seed is not None:
        changes.append(f"simulation.seed={seed}")
    if observers:
        quoted = ", ".join(f'"{name}"' for name in observers)
        changes.append(f"observers.names=[{quoted}]")
    loaded = load_scenario(scenario, changes)
    learnt = read_learnt(calibration, correct=correct)
    target = out or Path("runs") / loaded.name
    diverged: list[SimulationError] = []

    def flown(show: experiments.Progress) -> experiments.Experiment:
        try:
            return experiments.beside_pd(experiments.run(loaded, show, calibration=learnt), show)
        except SimulationError as error:
            if not isinstance(error.kept, experiments.Experiment):
                raise
            diverged.append(error)
            return error.kept

    outcomes: list[experiments.Experiment] = []
    write_results(flown, target, force=force, pages=not no_report, also=outcomes.append)
    if diverged:
        raise diverged[0]
    if outcomes[0].failed:
        raise SimulationError(f"{loaded.name}: the controller is {outcomes[0].failed}", 0.0, outcomes[0])


app.command("compare")(compare_command)
app.command("estimate")(estimate_command)
app.command("calibrate")(calibrate_command)
app.command("check")(check_command)
app.command("node")(node_command)
app.command("live")(live_command)
app.command("convert")(convert_command)
app.command("sweep")(sweep_command)


@app.command("trim")
def trim_command(
    scenario: NameOrFile,
    out: Annotated[Path | None, out_option("File for the trimmed scenario; printed when omitted.")] = None,
    force: Force = False,
    settings: Settings = None,
) -> None:
    """Find the frequency, wing offset and start of a flight that repeats itself every flap; write it as a scenario.

    The horizontal velocity is kept. The scenario's frequency, wing offset, pitch, vertical speed and pitch rate are
    only first guesses, even if they are given with --set: the search changes all of them.
    """
    from aerobat_pin.errors import check_file, write_text
    from aerobat_pin.flight import find_trim
    from aerobat_pin.scenario import load_scenario, scenario_toml

    if out is not None:
        check_file(out, force=force)
    guess = load_scenario(scenario, settings or [])
    with doing("searching the trim"):
        trimmed = find_trim(guess)
    flight, crank = trimmed.scenario.flight, trimmed.scenario.crank
    offset, doubling = trimmed.scenario.robot.changes["wing"]["offset_x"], trimmed.time_to_double
    typer.echo(
        f"from a first guess of {guess.crank.frequency:g} Hz: {crank.frequency:.3f} Hz, wing offset "
        f"{1e3 * offset:.2f} mm; as the flap starts, pitch {flight.pitch_deg:.2f} deg and vertical speed "
        f"{flight.velocity[2]:.3f} m/s; one flap misses its start by {trimmed.residual:.1e}; "
        "a disturbance " + (f"doubles in {doubling:.2f} s" if doubling < 1e3 else "does not grow"),
        err=out is None,
    )
    text = scenario_toml(trimmed.scenario)
    if out is None:
        typer.echo(text, nl=False)
    else:
        write_text(out, text)
        typer.echo(f"written to {out}")


app.command("urdf")(urdf_command)


@app.command("crank")
def crank_command(
    morphology: NameOrFile = "aerobat",
    out: Annotated[Path, out_option("The page, an HTML file.")] = Path("crank.html"),
    force: Force = False,
) -> None:
    """Write a page on which one turns the crank by hand and changes the linkage's lengths; it needs no network."""
    from aerobat_pin.aerobat import load_morphology
    from aerobat_pin.errors import check_file, write_text
    from aerobat_pin.visualization import crank_page

    check_file(out, force=force)
    write_text(out, crank_page(load_morphology(morphology)))
    typer.echo(f"written to {out}")


@app.command("linkage")
def linkage_command(
    morphology: NameOrFile = "aerobat",
    out: Annotated[
        Path | None, out_option("Picture (.png, .pdf, .svg) or folder for one; default runs/linkage.")
    ] = None,
    force: Force = False,
) -> None:
    """Draw the linkage over a turn of its crank, and print the ranges of its joints and transmission angles."""
    from aerobat_pin.aerobat import load_morphology
    from aerobat_pin.errors import write_files
    from aerobat_pin.linkage import KineticSculpture
    from aerobat_pin.visualization import draw_linkage, range_table, render_figure

    shape = load_morphology(morphology)
    files = picture_files(out or Path("runs") / "linkage", shape.name, force=force)
    linkage = KineticSculpture(shape.linkage)
    linkage.check()
    figure = draw_linkage(linkage)
    write_files({file: render_figure(figure, file.suffix[1:].lower()) for file in files})
    typer.echo(range_table(linkage))
    typer.echo(f"drawn to {', '.join(map(str, files))}")


app.command("play")(play_command)


@app.command("doctor")
def doctor_command() -> None:
    """Check the installation, and say what to do about each problem."""
    from aerobat_pin.cli.doctor import check_installation

    findings = check_installation()
    for finding in findings:
        typer.echo(str(finding))
    raise typer.Exit(0 if all(finding.ok for finding in findings) else 1)


@app.command("describe")
def describe_command(
    what: Annotated[Literal["scenario", "map"], typer.Argument(help="What to describe.")],
    key: Annotated[
        str | None,
        typer.Argument(
            help="One table or key alone, such as crank or observers.gain; else all of them.",
            autocompletion=complete_key,
        ),
    ] = None,
) -> None:
    """Print all keys of a scenario file or of a recording's map, or one, with type, unit, default and meaning."""
    from aerobat_pin.records import describe_map
    from aerobat_pin.scenario import describe_scenario

    typer.echo({"scenario": describe_scenario, "map": describe_map}[what](key), nl=False)


@app.command("list")
def list_command() -> None:
    """List the shipped scenarios, sweeps, morphologies and observers."""
    from aerobat_description import MORPHOLOGIES
    from aerobat_description.morphology import Morphology
    from aerobat_pin.experiments import shipped_sweeps
    from aerobat_pin.observers import OBSERVERS
    from aerobat_pin.scenario import shipped_scenarios

    sections = {
        "scenarios": shipped_scenarios(),
        "sweeps": shipped_sweeps(),
        "morphologies": {name: Morphology.load(name).description for name in MORPHOLOGIES},
        "observers": {name: (kind.__doc__ or "\n").splitlines()[0] for name, kind in OBSERVERS.items()},
    }
    for title, entries in sections.items():
        typer.echo(title)
        for name, description in entries.items():
            typer.echo(f"  {name:<20} {description}")


def main() -> None:
    """Run the command line; an error in the user's input prints one message and exits with code 2.

    Signals are not handled here, but where a program starts: `aerobat_pin.cli.main`.
    """
    from aerobat_pin.errors import AerobatError

    warnings.showwarning = _show_warning
    try:
        try:
            app(renamed(sys.argv[1:]))
        finally:
            sys.stdout.flush()
    except AerobatError as error:
        typer.echo(f"error: {_readable(str(error))}", err=True)
        sys.exit(2)
    except MemoryError as error:
        typer.echo(f"error: not enough memory{f': {error}' if str(error) else ''}", err=True)
        sys.exit(2)
    except OSError as error:
        if error.errno not in (errno.ENOSPC, errno.EDQUOT, errno.EFBIG):
            raise
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # Python writes what is left once more at exit
        typer.echo(f"error: standard output: cannot be written: {error.strerror}", err=True)
        sys.exit(2)
    finally:
        gc.freeze()  # saves a quarter of a second: without it Python searches all libraries for garbage at exit


def _readable(message: str) -> str:
    """Return a message without its middle if it is long, and with signs that a terminal would obey made visible."""
    if len(message) > LONGEST_MESSAGE:
        half = LONGEST_MESSAGE // 2
        message = f"{message[:half]} ... {message[-half:]}"
    return "".join(sign if sign.isprintable() or sign == "\n" else repr(sign)[1:-1] for sign in message)


def _show_warning(
    message: Warning | str, category: type[Warning], filename: str, lineno: int, file: Any = None, line: Any = None
) -> None:
    """Print a warning: those of this package without file and line, which users do not need, all others with them."""
    text = f"warning: {message}\n"
    if not category.__module__.startswith("aerobat_pin."):
        text = warnings.formatwarning(message, category, filename, lineno, line)
    typer.echo(text, err=True, nl=False)
