"""The command `aerobat convert`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from aerobat_pin.cli.options import Force


def convert_command(
    run: Annotated[Path, typer.Argument(metavar="RUN", help="Folder of a run, with flight.nc and estimate.nc.")],
    mcap: Annotated[Path, typer.Option(help="MCAP file for Foxglove, PlotJuggler, rerun, ROS 2.")],
    force: Force = False,
) -> None:
    """Convert a simulated flight to MCAP: forces per point, joint states, pose and arrows. Needs the extra ros."""
    from aerobat_pin.errors import check_file
    from aerobat_pin.estimation import write_flight_mcap
    from aerobat_pin.experiments import read_run
    from aerobat_pin.robot import load_robot

    check_file(mcap, force=force)
    scenario, log, estimates = read_run(run)
    write_flight_mcap(load_robot(scenario).model, log, estimates, mcap)
    typer.echo(f"written to {mcap}")
