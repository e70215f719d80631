"""The command line: parse, call, print, exit code. 0 success, 2 bad input, 1 a failure of our own."""

from __future__ import annotations

import gc
import signal
import sys
import warnings
from pathlib import Path
from typing import Annotated, Any, Literal

import typer

from aerobat_pin.cli import estimate as cli_estimate
from aerobat_pin.cli import sweep as cli_sweep
from aerobat_pin.cli.console import interruptible, print_table, progress
from aerobat_pin.cli.play import play

app = typer.Typer(
    name="aerobat",
    help="Fly Aerobat, and ask what is pushing on it.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
)


@app.command()
@interruptible()
def run(
    scenario: Annotated[str, typer.Argument(help="Shipped name (see `aerobat list`) or TOML file.")],
    out: Annotated[Path | None, typer.Option(help="Output folder; default runs/<scenario>.")] = None,
    force: Annotated[bool, typer.Option("--force", help="Replace the results of an earlier run.")] = False,
    seed: Annotated[int | None, typer.Option(help="Seed of all random numbers.")] = None,
    settings: Annotated[
        list[str] | None, typer.Option("--set", metavar="KEY=VALUE", help="Set one dotted key; repeatable.")
    ] = None,
    observers: Annotated[
        list[str] | None, typer.Option("--observer", metavar="NAME", help="Run this observer; repeatable.")
    ] = None,
    no_report: Annotated[bool, typer.Option("--no-report", help="Skip figures, report and replay.")] = False,
) -> None:
    """Fly a scenario, estimate the unknown forces, and write log, estimates, metrics, figures and replay."""
    from aerobat_pin import experiments
    from aerobat_pin.experiments import output_folder
    from aerobat_pin.scenario import load_scenario

    chosen = list(settings or [])
    if seed is not None:
        chosen.append(f"simulation.seed={seed}")
    if observers:
        quoted = ", ".join(f'"{name}"' for name in observers)
        chosen.append(f"observers.names=[{quoted}]")
    loaded = load_scenario(scenario, chosen)
    target = out if out is not None else Path("runs") / loaded.name
    with output_folder(target, force=force) as folder, progress() as show:
        made = experiments.run(loaded, show)
        experiments.write(made, folder)
        if not no_report:
            from aerobat_pin.visualization.write_all import write_all

            write_all(made, folder, show)
        written = sorted(path.relative_to(folder) for path in folder.rglob("*") if path.is_file())
    print_table(made.metrics, noisy=bool(loaded.sensors.fitted))
    typer.echo(f"\nresults in {target}/")
    for path in written:
        typer.echo(f"  {target / path}")


app.command()(cli_estimate.estimate)
app.command()(cli_sweep.sweep)


@app.command()
@interruptible()
def trim(
    scenario: Annotated[str, typer.Argument(help="Shipped name or TOML file: robot, speed and first guesses.")],
    out: Annotated[Path | None, typer.Option(help="File for the trimmed scenario; printed when omitted.")] = None,
    force: Annotated[bool, typer.Option("--force", help="Overwrite an existing file.")] = False,
    settings: Annotated[
        list[str] | None, typer.Option("--set", metavar="KEY=VALUE", help="Set one dotted key; repeatable.")
    ] = None,
) -> None:
    """Find the frequency, wing offset and start of a flight that repeats itself every flap; write it as a scenario.

    The horizontal velocity is held. The scenario's frequency, wing offset, pitch, vertical speed and pitch rate, --set
    or not, are first guesses: what is found differs from them.
    """
    from aerobat_pin.experiments import check_file, write_text
    from aerobat_pin.flight import find_trim
    from aerobat_pin.scenario import load_scenario, scenario_toml

    if out is not None:
        check_file(out, force=force)
    guess = load_scenario(scenario, settings or [])
    found = find_trim(guess)
    flight, crank = found.scenario.flight, found.scenario.crank
    offset = found.scenario.robot.changes["wing"]["offset_x"]
    doubling = found.time_to_double
    summary = (
        f"from a first guess of {guess.crank.frequency:g} Hz: {crank.frequency:.3f} Hz, wing offset "
        f"{1e3 * offset:.2f} mm; as the flap starts, pitch {flight.pitch_deg:.2f} deg and vertical speed "
        f"{flight.velocity[2]:.3f} m/s; one flap misses its start by {found.residual:.1e}; "
        "a disturbance " + (f"doubles in {doubling:.2f} s" if doubling < 1e3 else "does not grow")
    )
    typer.echo(summary, err=out is None)
    text = scenario_toml(found.scenario)
    if out is None:
        typer.echo(text, nl=False)
    else:
        write_text(out, text)
        typer.echo(f"written to {out}")


@app.command()
def urdf(
    morphology: Annotated[str, typer.Argument(help="Shipped name (see `aerobat list`) or TOML file.")] = "aerobat",
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="URDF file; SRDF and meshes go beside it. Else it is printed.")
    ] = None,
    meshes: Annotated[
        Literal["package", "relative", "absolute"], typer.Option(help="How the URDF names its meshes.")
    ] = "package",
    force: Annotated[bool, typer.Option("--force", help="Overwrite existing files.")] = False,
) -> None:
    """Turn a morphology into URDF, SRDF and meshes for other tools."""
    from aerobat_description.export import export, shipped_urdf
    from aerobat_pin.errors import OutputError
    from aerobat_pin.experiments import check_file, write_files
    from aerobat_pin.robot import load_morphology

    robot = load_morphology(morphology)
    if output is None:
        text = shipped_urdf(robot, meshes)
        if text is None:
            raise OutputError(f"robot {robot.name}: its meshes must be written somewhere; give --output FILE")
        typer.echo(text, nl=False)
        return
    contents = export(robot, output, meshes)
    check_file(output, force=force)
    for path in contents:
        if path.exists():
            check_file(path, force=force)
    write_files(contents)
    typer.echo(f"written {output} and, beside it, {len(contents) - 1} files it needs:")
    for path in contents:
        if path != output.absolute():
            typer.echo(f"  {path}")


@app.command()
def linkage(
    morphology: Annotated[str, typer.Argument(help="Shipped name (see `aerobat list`) or TOML file.")] = "aerobat",
    out: Annotated[
        Path | None, typer.Option(help="Picture (.png, .pdf, .svg) or folder for one; default runs/linkage.")
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Overwrite existing files.")] = False,
) -> None:
    """Draw the linkage over a turn of its crank, and print how far its joints and transmission angles go."""
    from aerobat_pin.experiments import picture_files, write_files
    from aerobat_pin.linkage import KineticSculpture
    from aerobat_pin.robot import load_morphology
    from aerobat_pin.visualization import style
    from aerobat_pin.visualization.figures import linkage as linkage_sheet

    shape = load_morphology(morphology)
    files = picture_files(out if out is not None else Path("runs") / "linkage", shape.name, force=force)
    mechanism = KineticSculpture(shape.linkage)
    mechanism.check()
    figure = linkage_sheet.draw(mechanism)
    write_files({file: style.rendered(figure, file.suffix[1:].lower()) for file in files})
    typer.echo(linkage_sheet.table(mechanism))
    typer.echo(f"drawn to {', '.join(str(file) for file in files)}")


app.command()(play)


@app.command()
def doctor() -> None:
    """Examine the installation: what is there, and what to do about what is not."""
    from aerobat_pin.cli.doctor import check

    findings = check()
    for one in findings:
        typer.echo(str(one))
    raise typer.Exit(0 if all(one.ok for one in findings) else 1)


@app.command()
def describe(what: Annotated[Literal["scenario"], typer.Argument(help="What to describe.")]) -> None:
    """Print every key of a scenario file: type, unit, default and meaning."""
    from aerobat_pin.scenario import describe_scenario

    typer.echo({"scenario": describe_scenario}[what](), nl=False)


@app.command("list")
def list_shipped() -> None:
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
        "observers": {name: (kind.__doc__ or "").splitlines()[0] for name, kind in OBSERVERS.items()},
    }
    for title, entries in sections.items():
        typer.echo(title)
        for name, description in entries.items():
            typer.echo(f"  {name:<20} {description}")


def main() -> None:
    """Run the command line; every mistake of the caller's ends in one message and exit code 2."""
    from aerobat_pin.errors import AerobatError

    warnings.showwarning = _show_warning
    signal.signal(signal.SIGPIPE, signal.SIG_DFL)  # end quietly when whoever reads our output goes away
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(143))  # leave as tidily as on Ctrl-C
    try:
        app()
    except AerobatError as error:
        typer.echo(f"error: {error}", err=True)
        sys.exit(2)
    finally:
        gc.freeze()  # or Python would search every library for garbage on its way out: a quarter of a second


def _show_warning(
    message: Warning | str, category: type[Warning], filename: str, lineno: int, file: Any = None, line: Any = None
) -> None:
    """Say what our own warnings say; where in the code any other one arose matters more to a developer."""
    from aerobat_pin.errors import NearSingularWarning

    text = f"warning: {message}\n"
    if not issubclass(category, NearSingularWarning):
        text = warnings.formatwarning(message, category, filename, lineno, line)
    typer.echo(text, err=True, nl=False)


if __name__ == "__main__":
    main()
