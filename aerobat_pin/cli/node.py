"""The command `aerobat node`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from aerobat_pin.cli.options import CalibrationFile


def node_command(
    map_file: Annotated[Path, typer.Option("--map", help="What the topics mean (`aerobat describe map`).")],
    calibration: CalibrationFile = None,
    wait: Annotated[float, typer.Option(metavar="SECONDS", help="By how much messages may arrive late.")] = 0.0,
    name: Annotated[str, typer.Option(help="Of the node, and where its topics begin.")] = "aerobat",
) -> None:
    """Run as a ROS 2 node: publish forces and contacts while messages arrive, until Ctrl-C."""
    from aerobat_pin.estimation import ForceNode, read_calibration
    from aerobat_pin.records import load_map

    chosen, learnt = load_map(map_file), None if calibration is None else read_calibration(calibration)
    typer.echo("compiling the stream's kernels (half a minute, once) ...", err=True)
    node = ForceNode(chosen, map_file.absolute().parent, typer.echo, name, learnt, wait=wait)
    typer.echo(f"/{name}: forces of {', '.join(node.estimator.observers)} on /{name}/<observer>/<point>/force")
    node.spin()
    node.close()
    typer.echo(str(node.estimator.health))
