"""The commands `aerobat live` and `aerobat node`."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from aerobat_pin.cli.console import doing, write_results
from aerobat_pin.cli.options import CalibrationFile, Settings, option_names
from aerobat_pin.cli.spoken_progress import voice

if TYPE_CHECKING:
    from aerobat_pin.experiments import LiveSource


def live_command(
    what: Annotated[
        str,
        typer.Argument(
            metavar="[SCENARIO|ROBOT|LOG]",
            help="A scenario, by default hover_closed_loop; a robot by name or URDF file; or a log.",
        ),
    ] = "",
    map_file: Annotated[
        Path | None, typer.Option("--map", help="What the log's columns mean, or without a log the topics of ROS 2.")
    ] = None,
    points: Annotated[str | None, typer.Option(help="Frames of a robot that can be pushed: A,B.")] = None,
    settings: Settings = None,
    out: Annotated[
        Path, typer.Option("--out", "-o", help="Folder for what is saved; further ones get a number.")
    ] = Path("runs/live"),
    port: Annotated[int, typer.Option(min=0, max=65535, help="Serve at this port; 0 takes a free one.")] = 0,
) -> None:
    """Watch a robot in the browser and push it: true and estimated forces, while it flies, stands or is heard."""
    from aerobat_pin.visualization import serve_live

    with doing("loading the robot"):
        source = _source(what, map_file, points, settings or [])

    def save() -> str:
        target, count = out, 1
        while target.exists():
            count += 1
            target = out.with_name(f"{out.name}-{count}")
        write_results(source.result, target, force=False)
        return str(target)

    try:
        with voice.resting():
            serve_live(source, lambda address: typer.echo(f"live at {address} (Ctrl-C stops)"), save, port)
    finally:
        source.close()
    typer.echo("stopped")


def _source(what: str, map_file: Path | None, points: str | None, settings: list[str]) -> LiveSource:
    """Return what is to be watched. Raises LogError for an option of something else, or for a log without a map."""
    from aerobat_pin.aerobat import needs_map
    from aerobat_pin.errors import LogError
    from aerobat_pin.experiments import LiveFlight, LiveRecording, LiveRobot, LiveTopics
    from aerobat_pin.records import load_map
    from aerobat_pin.scenario import load_scenario, shipped_scenarios

    flies = map_file is None and (not what or what in shipped_scenarios() or what.endswith(".toml"))
    if points is not None and (flies or map_file is not None):
        raise LogError("live: --points is for a robot by name or URDF file; a scenario or a map says its own")
    if settings and not flies:
        raise LogError("live: --set is for a scenario")
    if map_file is not None:
        chosen, folder = load_map(map_file), map_file.absolute().parent
        return LiveRecording(Path(what), chosen, folder) if what else LiveTopics(chosen, folder, typer.echo)
    if flies:
        return LiveFlight(load_scenario(what or "hover_closed_loop", settings))
    if os.path.isfile(what) and not what.endswith(".urdf"):
        raise needs_map(Path(what))
    return LiveRobot(what, tuple(option_names(points)))


def node_command(
    map_file: Annotated[Path, typer.Option("--map", help="What the topics mean (`aerobat describe map`).")],
    calibration: CalibrationFile = None,
    wait: Annotated[float, typer.Option(metavar="SECONDS", help="By how much messages may arrive late.")] = 0.0,
    name: Annotated[str, typer.Option(help="Of the node, and where its topics begin.")] = "aerobat",
) -> None:
    """Run as a ROS 2 node: publish forces and contacts while messages arrive, until Ctrl-C."""
    from aerobat_pin.estimation import read_calibration
    from aerobat_pin.experiments import ForceNode
    from aerobat_pin.records import load_map

    chosen, learnt = load_map(map_file), None if calibration is None else read_calibration(calibration)
    with doing("starting the node"):
        node = ForceNode(chosen, map_file.absolute().parent, typer.echo, name, learnt, wait=wait)
    typer.echo(f"/{name}: forces of {', '.join(node.estimator.observers)} on /{name}/<observer>/<point>/force")
    with voice.resting():
        node.spin()
    node.close()
    typer.echo(str(node.estimator.health))
