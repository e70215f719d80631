"""The commands `aerobat calibrate` and `aerobat check`."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from aerobat_pin.cli.console import doing, progress_bar
from aerobat_pin.cli.options import BelievedMorphology, Force, Settings, out_option

if TYPE_CHECKING:
    from aerobat_pin.records import Record

EXIT_CODES = {"unchanged": 0, "changed": 3, "unverified": 4}
FIGURE_KINDS = ("png", "pdf", "svg")


def calibrate_command(
    flights: Annotated[
        list[Path],
        typer.Argument(metavar="RUN|LOG...", help="Runs (folders) or logs (.nc, .csv) without unknown forces."),
    ],
    out: Annotated[Path, out_option("File of the calibration (.nc), for `run` and `estimate --calibration`.")],
    morphology: BelievedMorphology = None,
    settings: Settings = None,
    harmonics: Annotated[
        int, typer.Option(min=-1, max=40, help="Harmonics of the crank to learn; 0: the mean alone, -1: nothing.")
    ] = 12,
    identify: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME",
            help="Identify this parameter and use it in any case; `none` identifies nothing, nor friction that a map "
            "does not name; repeatable. Default: the usual ones, used if they explain the flights "
            "(docs/calibration.md).",
        ),
    ] = None,
    map_file: Annotated[
        Path | None,
        typer.Option("--map", help="Of any robot's recording: what its columns mean; its keys say what is fitted."),
    ] = None,
    trust: Annotated[
        bool,
        typer.Option("--trust", help="Calibrate also from flights in which something pushes; results will say so."),
    ] = False,
    force: Force = False,
) -> None:
    """Learn from flights without unknown forces what the belief gets wrong; print what was found and what was not.

    With --map, from any robot's recording: friction, factors of efforts and thrust, as the map's joints.friction and
    known.NAME.fit ask, and the mass with --identify mass (docs/recordings.md).

    --set takes keys of robot, air and observers, and flight.gravity. What is believed of a run is what its scenario
    says.
    """
    from aerobat_pin.errors import check_file, write_files
    from aerobat_pin.estimation import calibrate, calibration_bytes

    check_file(out, force=force)
    names = None if identify is None else [name for name in identify if name != "none"]
    with progress_bar() as show:
        show("reading", 0.0)
        given = opened(flights, map_file, morphology, settings or [], free=True)
        learnt = calibrate(
            given, harmonics=harmonics, parameters=names, trust=trust, progress=lambda share: show("identifying", share)
        )
    for line in learnt.notes:
        typer.echo(line)
    for line in learnt.warnings:
        typer.echo(f"warning: {line}", err=True)
    write_files({out: calibration_bytes(learnt)})
    typer.echo(f"written to {out}")


def opened(
    paths: list[Path], map_file: Path | None, morphology: str | None, settings: list[str], *, free: bool
) -> list[Record]:
    """Return the records of runs, logs or recordings by a map, with the belief about them.

    Raises:
        MapError: an option is for other records.
        CalibrationError: a flight should be `free`, and its truth knows an unknown force.
    """
    from aerobat_pin.errors import MapError

    if map_file is None:
        return _flights(paths, morphology, settings, free=free)
    if morphology is not None or settings:
        raise MapError(f"calibrate: {'--set' if morphology is None else '--morphology'} is for Aerobat's own flights")
    from aerobat_pin.records import load_map, open_by_map

    chosen, folder = load_map(map_file), map_file.absolute().parent
    return [open_by_map(log, chosen, folder) for log in paths]


def _flights(paths: list[Path], morphology: str | None, settings: list[str], *, free: bool) -> list[Record]:
    from aerobat_pin.aerobat import describe_belief, flight_record, free_record, read_flight, robot_of_belief

    records = []
    for path in paths:
        log, belief = read_flight(path, morphology, settings)
        if not os.path.isdir(path):
            typer.echo(f"{path}: {describe_belief(belief, morphology, settings)}")
        record_of = free_record if free else flight_record
        records.append(record_of(log, robot_of_belief(belief), belief.observers, str(path)))
    return records


def check_command(
    flight: Annotated[
        Path, typer.Argument(metavar="RUN|LOG", help="Run (folder), log (.nc, .csv), or a recording by --map.")
    ],
    calibration: Annotated[Path, typer.Option(metavar="FILE", help="What `aerobat calibrate` learnt.")],
    morphology: BelievedMorphology = None,
    settings: Settings = None,
    map_file: Annotated[Path | None, typer.Option("--map", help="What the recording's columns mean.")] = None,
    out: Annotated[
        Path | None, out_option("File of the figure: .png, .pdf, .svg; default `runs/<flight>-check.png`, drawn anew.")
    ] = None,
    force: Force = False,
) -> None:
    """Is a calibration still good? Print one line, draw one figure; exit code 0 if nothing changed, 3 if something has.

    It is 4 where nothing can tell, as where the forces sought leave no row to spare. Five seconds without unknown
    forces suffice, and forces at the known points do no harm.
    """
    from aerobat_pin.errors import CalibrationError, check_file, write_files
    from aerobat_pin.estimation import estimate, read_calibration
    from aerobat_pin.visualization import draw_unexplained, render_figure

    figure = out or Path("runs") / f"{flight.stem}-check.png"
    kind = figure.suffix.lower().removeprefix(".")
    if kind not in FIGURE_KINDS:
        raise CalibrationError(f"check: --out {figure}: a file .{' or .'.join(FIGURE_KINDS)} was expected")
    check_file(figure, force=force or out is None)
    learnt = read_calibration(calibration)
    with doing("estimating what the calibration leaves over"):
        [record] = opened([flight], map_file, morphology, settings or [], free=False)
        result = estimate(record, ["force_level"], learnt, trust=True)
    if result.model is None:
        raise CalibrationError(f"{calibration}: it does not say what it leaves over, so nothing can be checked")
    write_files({figure: render_figure(draw_unexplained(result), kind)})
    typer.echo(f"{result.model}; figure: {figure}")
    for line in learnt.warnings:
        typer.echo(f"warning: calibration: {line}", err=True)
    raise typer.Exit(EXIT_CODES[result.model.verdict])
