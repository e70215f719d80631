"""The command `aerobat check`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from aerobat_pin.cli.calibrate import opened
from aerobat_pin.cli.options import BelievedMorphology, Force, Settings, out_option

CHANGED_MODEL = 3  # exit code
FIGURE_KINDS = ("png", "pdf", "svg")


def check_command(
    flight: Annotated[
        Path,
        typer.Argument(metavar="RUN|LOG", help="Run (folder), log (.nc, .csv), or a recording by --map."),
    ],
    calibration: Annotated[Path, typer.Option(metavar="FILE", help="What `aerobat calibrate` learnt.")],
    morphology: BelievedMorphology = None,
    settings: Settings = None,
    map_file: Annotated[Path | None, typer.Option("--map", help="What the recording's columns mean.")] = None,
    out: Annotated[Path, out_option("File of the figure, .png, .pdf or .svg.")] = Path("check.png"),
    force: Force = False,
) -> None:
    """Is a calibration still good? Print one line, draw one figure; exit code 0 if nothing changed, else 3.

    Five seconds without unknown forces suffice, and forces at the known points do no harm.
    """
    from aerobat_pin.errors import CalibrationError, check_file, write_files
    from aerobat_pin.estimation import estimate, read_calibration
    from aerobat_pin.visualization import draw_unexplained, render_figure

    kind = out.suffix.removeprefix(".")
    if kind not in FIGURE_KINDS:
        raise CalibrationError(f"check: --out {out}: a file .{' or .'.join(FIGURE_KINDS)} was expected")
    check_file(out, force=force)
    learnt = read_calibration(calibration)
    [record] = opened([flight], map_file, morphology, settings or [], free=False)
    found = estimate(record, ["force_level"], learnt, trust=True)
    if found.model is None:
        raise CalibrationError(f"{calibration}: it does not say what it leaves over, so nothing can be checked")
    write_files({out: render_figure(draw_unexplained(found), kind)})
    typer.echo(f"{found.model}; figure: {out}")
    for line in learnt.warnings:
        typer.echo(f"warning: calibration: {line}", err=True)
    if found.model.verdict == "changed":
        raise typer.Exit(CHANGED_MODEL)
