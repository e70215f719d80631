"""The command `aerobat estimate`, of Aerobat's own recordings and of any robot's by a map."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from aerobat_pin.cli.console import doing, write_results
from aerobat_pin.cli.options import (
    BelievedMorphology,
    CalibrationFile,
    Correct,
    Force,
    ObserverNames,
    Settings,
    option_names,
    out_option,
    read_learnt,
)

if TYPE_CHECKING:
    from aerobat_pin.estimation import Calibration
    from aerobat_pin.records import Map
    from aerobat_pin.scenario import Scenario


def estimate_command(
    log: Annotated[
        Path | None,
        typer.Argument(
            help="Recorded flight of Aerobat (`.nc` of a run, or `.csv`, docs/recorded.md); with --map any "
            "robot's CSV, NetCDF, MCAP or ROS bag (docs/recordings.md)."
        ),
    ] = None,
    morphology: BelievedMorphology = None,
    observers: ObserverNames = None,
    settings: Settings = None,
    calibration: CalibrationFile = None,
    correct: Correct = False,
    out: Annotated[
        Path | None, out_option("Output folder, default `runs/<log>-estimate`; or, for --out-mcap, X.mcap.")
    ] = None,
    force: Force = False,
    map_file: Annotated[
        Path | None, typer.Option("--map", help="What the log's columns mean (`aerobat describe map`).")
    ] = None,
    urdf: Annotated[
        Path | None,
        typer.Option(help="Robot in place of the map's, or of the map that --suggest prints: a file or a name as ur5."),
    ] = None,
    points: Annotated[str | None, typer.Option(metavar="A,B", help="Frames at which unknown forces act.")] = None,
    out_mcap: Annotated[Path | None, typer.Option(help="Also write the forces to this MCAP file.")] = None,
    suggest: Annotated[
        bool, typer.Option("--suggest", help="Print a map for this log, with questions as comments.")
    ] = False,
    trust: Annotated[bool, typer.Option("--trust", help="Estimate also what a check would refuse.")] = False,
    self_check: Annotated[
        bool,
        typer.Option(
            "--self-check",
            help="First play known forces into the recording of a map, or, also without a log, a simulated flight.",
        ),
    ] = False,
) -> None:
    """Estimate the unknown forces of a recording, whose true forces need not be known.

    Of Aerobat's own tables without a map: --set takes keys of robot, air and observers, and flight.gravity.
    """
    from aerobat_pin.aerobat import belief_about, describe_belief, needs_map, read_log
    from aerobat_pin.errors import LogError
    from aerobat_pin.experiments import run_recorded
    from aerobat_pin.records import load_map, suggested_map, with_options

    if out is not None and out.suffix.lower() == ".mcap":
        if out_mcap is not None:
            raise LogError(f"estimate: --out {out} and --out-mcap {out_mcap}: one MCAP file was expected")
        out, out_mcap = None, out
    robot = None if urdf is None else str(urdf)
    if log is None and not self_check:
        raise LogError("estimate: a recorded flight was expected, or --self-check")
    idle = {"--map": map_file, "--urdf": urdf, "--suggest": suggest, "--calibration": calibration, "--correct": correct}
    if log is None and any(idle.values()):
        named = ", ".join(name for name, given in idle.items() if given)
        raise LogError(f"estimate: {named} without a log: a log was expected")
    if suggest and log is not None:
        beside = {"--map": map_file, "--out": out, "--out-mcap": out_mcap}
        if unused := [name for name, given in beside.items() if given]:
            raise LogError(f"estimate: --suggest prints a map, as in `--suggest > map.toml`, without {unused[0]}")
        with doing("looking at the log"):
            text = suggested_map(log, robot, option_names(points))
        typer.echo(text, nl=False)
        return
    if log is not None and (map_file is not None or urdf is not None):
        if settings or morphology:
            raise LogError("estimate: --set and --morphology are for Aerobat's own tables, without --map")
        if map_file is None:
            raise needs_map(log, robot=str(urdf))
        chosen = with_options(load_map(map_file), robot, option_names(points), observers or [])
        target, learnt = out or Path("runs") / f"{log.stem}-estimate", read_learnt(calibration, correct=correct)
        options = {"force": force, "trust": trust, "self_check": self_check}
        estimate_by_map(log, chosen, map_file.absolute().parent, target, out_mcap, learnt, **options)
        return
    if out_mcap is not None:
        raise LogError("estimate: --out-mcap is for recordings by --map; `aerobat convert RUN` writes MCAP of a run")
    given = list(settings or [])
    if points is not None:
        given.append(f"observers.frames=[{', '.join(repr(name.strip()) for name in points.split(','))}]")
    flight = None if log is None else read_log(log)
    name = "self-check" if log is None else log.stem
    belief = belief_about(flight, name, morphology, observers or [], given)
    typer.echo(describe_belief(belief, morphology, given))
    if self_check and not _passes_self_check(belief):
        raise typer.Exit(1)
    if flight is None:
        return
    learnt = read_learnt(calibration, correct=correct)
    target = out or Path("runs") / f"{name}-estimate"
    write_results(lambda show: run_recorded(flight, belief, show, learnt), target, force=force)


def _passes_self_check(belief: Scenario) -> bool:
    """Run the self-check (known forces on a simulated flight), print its results, and return whether all are right."""
    from aerobat_pin.aerobat import believed_robot
    from aerobat_pin.experiments import self_check

    checks = self_check(believed_robot(belief), belief)
    for check in checks:
        typer.echo(str(check))
    wrong = dict.fromkeys(check.observer for check in checks if not check.ok)
    lag = ", whose forces lag behind wings that turn: the more, the lower the gain" if [*wrong] == ["momentum"] else ""
    failed = f"FAILED for {', '.join(wrong)}{lag}"
    typer.echo(f"self-check: {failed if wrong else 'sign, frame and unit are right'}")
    return not wrong


def estimate_by_map(
    log: Path,
    chosen: Map,
    folder: Path,
    target: Path,
    mcap: Path | None,
    learnt: Calibration | None,
    *,
    force: bool,
    trust: bool,
    self_check: bool,
) -> None:
    """Estimate, after a self-check if it is wanted; print what was found, and write the results."""
    from aerobat_pin.estimation import estimate
    from aerobat_pin.experiments import check_mcap_file, check_record, write_mcap
    from aerobat_pin.records import open_by_map

    if mcap is not None:
        check_mcap_file(mcap, force=force)
    record = open_by_map(log, chosen, folder) if self_check else None  # else only once the folder is known to be free
    if record is not None:
        checks = check_record(record, learnt)
        passed = sum(check.ok for check in checks)
        others = "" if passed == len(checks) else "; what no measured row shows cannot be recovered"
        for check in checks:
            typer.echo(str(check))
        typer.echo(f"self-check: {passed} of {len(checks)} known forces are recovered within 2 %{others}")
    write_results(
        lambda show: estimate(
            record or open_by_map(log, chosen, folder),
            progress=lambda share: show("estimating", share),
            trust=trust,
            calibration=learnt,
        ),
        target,
        force=force,
        also=None if mcap is None else lambda result: write_mcap(result, mcap),
    )
    if mcap is not None:
        typer.echo(f"  {mcap}")
