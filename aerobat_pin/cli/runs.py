"""The commands about runs that are there: `aerobat play`, `aerobat compare` and `aerobat convert`."""

from __future__ import annotations

import math
import os
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from aerobat_pin.cli.console import doing, progress_bar
from aerobat_pin.cli.options import BelievedMorphology, Force, out_option
from aerobat_pin.cli.spoken_progress import voice

if TYPE_CHECKING:
    from aerobat_pin.visualization import Replay

PICTURES_PER_SECOND = 30.0  # frame rate of a video made from the pictures
MOST_PICTURES, DRAWN_PER_SECOND = 100_000, 3.0  # of one command; measured without a graphics card


def play_command(
    source: Annotated[
        Path | None, typer.Argument(metavar="RUN|LOG", help="Folder of a run, or a recorded flight (.nc, .csv).")
    ] = None,
    morphology: BelievedMorphology = None,
    out: Annotated[Path | None, out_option("Write the page to this file.")] = None,
    frames: Annotated[Path | None, typer.Option(help="Write PNG pictures to this folder, 30 a second.")] = None,
    rate: Annotated[
        float | None, typer.Option(min=1e-3, help="Speed, of real time; default 0.1 for flights, else 1.")
    ] = None,
    from_csv: Annotated[
        Path | None, typer.Option(help="Replay any motion of any robot (columns in docs/replay.md); needs --urdf.")
    ] = None,
    urdf: Annotated[Path | None, typer.Option(help="The robot of --from-csv.")] = None,
    port: Annotated[int, typer.Option(min=0, max=65535, help="Serve at this port; 0 takes a free one.")] = 0,
    force: Force = False,
) -> None:
    """Replay a flight in the browser: serve the page until Ctrl-C, or write it to a file or as pictures."""
    import numpy as np

    from aerobat_pin.errors import LogError, check_file, output_folder, write_text
    from aerobat_pin.visualization import SLOW_MOTION, serve, snapshots

    if out is not None:
        check_file(out, force=force)
    rate = rate or (1.0 if source is None else SLOW_MOTION)
    if not math.isfinite(rate):
        raise LogError(f"play: --rate {rate}: a finite number was expected")
    with doing("reading the motion"):
        replay = _replay(source, morphology, from_csv, urdf)
    count = replay.duration / rate * PICTURES_PER_SECOND
    if frames is not None and count > MOST_PICTURES:
        raise LogError(
            f"play: {count:.0f} pictures at --rate {rate:g} take about {count / DRAWN_PER_SECOND:.3g} s; at most "
            f"{MOST_PICTURES} are allowed: a larger --rate was expected"
        )
    page = replay.html(rate)
    if frames is not None:
        times = np.arange(0.0, replay.duration, rate / PICTURES_PER_SECOND)
        with (
            output_folder(frames, force=force, replaces=("frame_*.png",), sign="frame_*.png") as folder,
            progress_bar() as show,
        ):
            show("opening the page", 0.0)
            for k, picture in enumerate(snapshots(page, times)):
                show("taking pictures", (k + 1) / len(times))
                (folder / f"frame_{k:05d}.png").write_bytes(picture)
        typer.echo(f"{len(times)} pictures, {PICTURES_PER_SECOND:g} a second, in {frames}/")
    if out is not None:
        write_text(out, page)
        typer.echo(f"written to {out}")
    if out is None and frames is None:
        with voice.resting():
            serve(page, lambda address: typer.echo(f"playing at {address} (Ctrl-C stops)"), port)
        typer.echo("stopped")


def _replay(source: Path | None, morphology: str | None, table: Path | None, urdf: Path | None) -> Replay:
    """Load a run, a log, or a CSV file with its robot. Raises AerobatError for any other combination of arguments."""
    from aerobat_pin import visualization
    from aerobat_pin.errors import LogError

    is_run = source is not None and os.path.isdir(source)  # unlike `source.is_dir()`, takes names of any length
    if morphology is not None and (source is None or is_run):
        raise LogError("play: --morphology says which robot is believed to have flown a log; a log was expected")
    if source is not None and table is None and urdf is None:
        return visualization.replay_run(source) if is_run else visualization.replay_log(source, morphology)
    if source is None and table is not None and urdf is not None:
        return visualization.replay_table(table, urdf)
    raise LogError("play: a run or a log was expected, or --from-csv FILE with --urdf FILE")


def compare_command(
    first: Annotated[Path, typer.Argument(metavar="RUN", help="Folder of a run.")],
    second: Annotated[Path, typer.Argument(metavar="RUN", help="Folder of another run.")],
    out: Annotated[Path | None, out_option("Output folder; default `runs/compare-<first>-<second>`.")] = None,
    force: Force = False,
) -> None:
    """Set two runs side by side: what differs between their scenarios, their scores and their figures."""
    from aerobat_pin.errors import output_folder
    from aerobat_pin.visualization import compare_runs

    with doing("reading both runs"):
        comparison = compare_runs(first, second)
    typer.echo(str(comparison))
    names = "-".join(os.path.basename(os.path.realpath(folder)) for folder in (first, second))
    target = out or Path("runs") / f"compare-{names}"
    with (
        output_folder(target, force=force, replaces=comparison.FILES, sign="comparison.html") as folder,
        doing("drawing both runs"),
    ):
        comparison.write(folder)
        files = sorted(path.relative_to(folder) for path in folder.rglob("*") if path.is_file())
    typer.echo(f"\nresults in {target}/: {', '.join(map(str, files))}\nopen {target / 'comparison.html'}")


def convert_command(
    run: Annotated[Path, typer.Argument(metavar="RUN", help="Folder of a run, with flight.nc and estimate.nc.")],
    out: Annotated[Path, out_option("MCAP file, for Foxglove, rerun, ROS 2.")],
    force: Force = False,
) -> None:
    """Convert a simulated flight to MCAP: forces per point, joint states, pose and arrows. Needs the extra ros."""
    from aerobat_pin.aerobat import flown_robot
    from aerobat_pin.experiments import check_mcap_file, read_run, write_flight_mcap

    check_mcap_file(out, force=force)
    with doing("converting"):
        scenario, log, estimates = read_run(run)
        write_flight_mcap(flown_robot(scenario).model, log, estimates, out)
    typer.echo(f"written to {out}")
