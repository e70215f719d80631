"""What `aerobat estimate` does with a recording of any robot, read by a map."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import typer

from aerobat_pin.cli.console import files_in, print_files, progress_bar

if TYPE_CHECKING:
    from aerobat_pin.estimation import RecordingEstimate
    from aerobat_pin.records import Map


def chosen_map(file: Path | None, urdf: Path | None, points: str | None, observers: list[str]) -> tuple[Map, Path]:
    """Return the map of a file, with the options laid over it, and the folder where its paths begin."""
    from aerobat_pin.records import load_map, parse_map, with_options

    names = [name.strip() for name in (points or "").split(",") if name.strip()]
    robot = None if urdf is None else str(urdf.absolute())
    if file is not None:
        return with_options(load_map(file), robot, names, observers), file.absolute().parent
    return with_options(parse_map({"robot": {"urdf": robot}}, "of the options"), robot, names, observers), Path.cwd()


def estimate_by_map(
    log: Path,
    chosen: Map,
    folder: Path,
    target: Path,
    mcap: Path | None,
    calibration: Path | None,
    *,
    force: bool,
    trust: bool,
) -> None:
    """Estimate, print what was found, and write the results."""
    from aerobat_pin import experiments
    from aerobat_pin.errors import check_file, output_folder
    from aerobat_pin.estimation import estimate_recording, read_calibration
    from aerobat_pin.experiments import write_mcap

    if mcap is not None:
        check_file(mcap, force=force)
    learnt = None if calibration is None else read_calibration(calibration)
    with output_folder(target, force=force, replaces=experiments.RECORDED_RESULTS) as work, progress_bar() as show:
        report = None if show is None else lambda share: show("estimating", share)
        found = estimate_recording(log, chosen, folder, report, trust, learnt)
        experiments.write_recorded(found, work)
        from aerobat_pin.visualization import write_recording_pages

        write_recording_pages(found, work)
        if mcap is not None:
            write_mcap(found, mcap)
        files = files_in(work)
    print_recording(found)
    print_files(target, files)
    if mcap is not None:
        typer.echo(f"  {mcap}")


def print_recording(found: RecordingEstimate) -> None:
    """Print robot, notes, findings, fits, forces and scores."""
    record = found.record
    parts = "one part" if len(record.parts) == 1 else f"{len(record.parts)} parts"
    typer.echo(
        f"{record.robot.title}, {record.robot.mass:.4g} kg; {record.duration:.4g} s in {parts} at {record.rate:.4g} Hz"
    )
    for note in found.notes:
        typer.echo(f"note: {note}")
    for finding in found.findings:
        mark = {"good": "ok", "note": "  ", "warning": "!!", "refused": "!!"}[finding.verdict]
        typer.echo(f"{mark} {finding}")
    for fit in found.forces.fits:
        typer.echo(f"fit: {fit}")
    if found.use is not None:
        typer.echo(found.use.words)
    for estimate in found.stored.values():
        typer.echo(str(estimate))
    for name, side in found.compared.items():
        for label, score in side.scores(record.dt).items():
            r2 = "no signal" if score.r2 is None else f"R2 {score.r2:.3f}"
            outside = "" if score.r2_outside_fit is None else f" ({score.r2_outside_fit:.3f} outside the fit)"
            typer.echo(
                f"{name} against the sensor, {side.point}.{label}: {r2}{outside}, difference {score.rmse:.3g} rms"
            )
    for name in found.stored:
        for event in found.events(name) or []:
            typer.echo(f"{name}: {event}")
    for text in found.warnings:
        typer.echo(f"warning: {text}", err=True)
