"""The command `aerobat play`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from aerobat_pin.cli.console import interruptible

if TYPE_CHECKING:
    from aerobat_pin.visualization import Recording

FRAMES_PER_SECOND = 30.0  # of what is seen


@interruptible()
def play(
    source: Annotated[
        Path | None, typer.Argument(metavar="RUN|LOG", help="Folder of a run, or a recorded flight (.nc, .csv).")
    ] = None,
    morphology: Annotated[
        str | None, typer.Option(help="Believed robot of a log: shipped name or TOML file; else what the log notes.")
    ] = None,
    html: Annotated[Path | None, typer.Option(help="Write the page to this file.")] = None,
    frames: Annotated[Path | None, typer.Option(help="Write PNG pictures to this folder, 30 a second.")] = None,
    rate: Annotated[
        float | None, typer.Option(min=1e-3, help="Speed, of real time; default 0.1 for flights, else 1.")
    ] = None,
    from_csv: Annotated[
        Path | None, typer.Option(help="Replay any motion of any robot (columns in docs/replay.md); needs --urdf.")
    ] = None,
    urdf: Annotated[Path | None, typer.Option(help="The robot of --from-csv.")] = None,
    force: Annotated[bool, typer.Option("--force", help="Replace existing files.")] = False,
) -> None:
    """Show a flight in the browser: serve it until Ctrl-C, or write it as a page or as pictures."""
    import numpy as np

    from aerobat_pin.errors import LogError
    from aerobat_pin.experiments import check_file, output_folder, write_text
    from aerobat_pin.visualization import SLOW_MOTION, snapshots

    if (source is None) == (from_csv is None) or (from_csv is None) != (urdf is None):
        raise LogError("play: a run or a log was expected, or --from-csv FILE with --urdf FILE")
    if html is not None:
        check_file(html, force=force)
    if morphology is not None and (source is None or source.is_dir()):
        raise LogError("play: --morphology says which robot is believed to have flown a log; a log was expected")
    recording = _recording(source, morphology, from_csv, urdf)
    rate = rate or (SLOW_MOTION if source is not None else 1.0)
    page = recording.html(rate)
    if frames is not None:
        times = np.arange(0.0, recording.duration, rate / FRAMES_PER_SECOND)
        with output_folder(frames, force=force, replaces=("frame_*.png",)) as folder:
            for k, picture in enumerate(snapshots(page, times)):
                (folder / f"frame_{k:05d}.png").write_bytes(picture)
        typer.echo(f"{len(times)} pictures, {FRAMES_PER_SECOND:g} a second, in {frames}/")
    if html is not None:
        write_text(html, page)
        typer.echo(f"written to {html}")
    if html is None and frames is None:
        from aerobat_pin.visualization import serve

        serve(page, lambda address: typer.echo(f"playing at {address} (Ctrl-C stops)"))
        typer.echo("stopped")


def _recording(source: Path | None, morphology: str | None, table: Path | None, urdf: Path | None) -> Recording:
    if source is not None:
        from aerobat_pin.visualization import flight_of

        return flight_of(source, morphology)
    from aerobat_pin.visualization import recording_of

    assert table is not None
    assert urdf is not None
    return recording_of(table, urdf)
