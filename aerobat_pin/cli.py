"""The command line: parse, call, print, exit code. 0 success, 2 bad input, 1 a failure of our own."""

from __future__ import annotations

import gc
import signal
import sys
from pathlib import Path
from typing import Annotated, Any

import typer

app = typer.Typer(
    name="aerobat",
    help="Fly Aerobat, and ask what is pushing on it.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
)


@app.command()
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
    from aerobat_pin import experiment
    from aerobat_pin.output import output_folder
    from aerobat_pin.scenario import load_scenario

    chosen = list(settings or [])
    if seed is not None:
        chosen.append(f"simulation.seed={seed}")
    if observers:
        quoted = ", ".join(f'"{name}"' for name in observers)
        chosen.append(f"observers.names=[{quoted}]")
    loaded = load_scenario(scenario, chosen)
    target = out if out is not None else Path("runs") / loaded.name
    with output_folder(target, force=force) as folder, _progress() as show:
        made = experiment.run(loaded, show)
        experiment.write(made, folder)
        if not no_report:
            from aerobat_pin import gallery

            gallery.draw(made, folder, show)
        written = sorted(path.relative_to(folder) for path in folder.rglob("*") if path.is_file())
    _print_table(made.metrics)
    typer.echo(f"\nresults in {target}/")
    for path in written:
        typer.echo(f"  {target / path}")


@app.command()
def trim(
    scenario: Annotated[str, typer.Argument(help="Shipped name or TOML file: robot, speed and first guesses.")],
    out: Annotated[Path | None, typer.Option(help="File for the trimmed scenario; printed when omitted.")] = None,
    force: Annotated[bool, typer.Option("--force", help="Overwrite an existing file.")] = False,
    settings: Annotated[
        list[str] | None, typer.Option("--set", metavar="KEY=VALUE", help="Set one dotted key; repeatable.")
    ] = None,
) -> None:
    """Find the frequency, wing offset and start of a flight that repeats itself every flap; write it as a scenario."""
    from aerobat_pin import trim as solver
    from aerobat_pin.output import check_file, write_text
    from aerobat_pin.scenario import load_scenario, scenario_toml

    if out is not None:
        check_file(out, force=force)
    found = solver.trim(load_scenario(scenario, settings or []))
    flight, crank = found.scenario.flight, found.scenario.crank
    offset = found.scenario.robot.changes["wing"]["offset_x"]
    doubling = found.time_to_double
    summary = (
        f"{crank.frequency:.3f} Hz, wing offset {1e3 * offset:.2f} mm, pitch {flight.pitch_deg:.2f} deg, "
        f"vertical speed {flight.velocity[2]:.3f} m/s; one flap misses its start by {found.residual:.1e}; "
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
def doctor() -> None:
    """Examine the installation: what is there, and what to do about what is not."""
    from aerobat_pin.doctor import check

    findings = check()
    for one in findings:
        typer.echo(str(one))
    raise typer.Exit(0 if all(one.ok for one in findings) else 1)


@app.command("list")
def list_shipped() -> None:
    """List the shipped scenarios, morphologies and observers."""
    from aerobat_description import MORPHOLOGIES
    from aerobat_description.morphology import Morphology
    from aerobat_pin.observers import OBSERVERS
    from aerobat_pin.scenario import shipped_scenarios

    sections = {
        "scenarios": shipped_scenarios(),
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

    signal.signal(signal.SIGPIPE, signal.SIG_DFL)  # end quietly when whoever reads our output goes away
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(143))  # leave as tidily as on Ctrl-C
    try:
        app()
    except AerobatError as error:
        typer.echo(f"error: {error}", err=True)
        sys.exit(2)
    finally:
        gc.freeze()  # or Python would search every library for garbage on its way out: a quarter of a second


def _progress() -> Any:
    """Return a context that shows progress on a terminal and stays silent elsewhere."""
    from contextlib import nullcontext

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


def _print_table(metrics: dict[str, Any]) -> None:
    """Print R2 per wing and axis, with the absolute error beside it."""
    typer.echo(f"\n{metrics['scenario']}, seed {metrics['seed']}: {metrics['note']}; motor torque {metrics['torque']}")
    typer.echo(f"{'observer':<12} {'wing':<6} {'axis':<4} {'R2':>9} {'R2 noise-free':>14} {'error rms':>10} {'lag':>9}")
    for name, scores in metrics["observers"].items():
        if scores["null_direction"] is not None:
            hidden = ", ".join(f"({x:.2f}, {y:.2f}, {z:.2f})" for x, y, z in scores["null_direction"])
            typer.echo(
                f"{name}: rank {scores['rank']}; cannot be seen at all: forces along {hidden} on the points in turn"
            )
        for wing, axes in scores.items():
            if not isinstance(axes, dict):
                continue
            for axis, one in axes.items():
                r2, clean = (
                    f"{one[key]:.5f}" if one[key] is not None else "no signal" for key in ("r2", "r2_noise_free")
                )
                delay = f"{1e3 * one['lag_s']:.2f} ms" if one["lag_s"] is not None else "-"
                error = f"{1e3 * one['rmse']:.2f} mN"
                typer.echo(f"{name:<12} {wing:<6} {axis:<4} {r2:>9} {clean:>14} {error:>10} {delay:>9}")


if __name__ == "__main__":
    main()
