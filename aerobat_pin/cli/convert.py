"""The command `aerobat convert`."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Annotated

import typer

from aerobat_pin.cli.options import Force


def convert_command(
    run: Annotated[Path, typer.Argument(metavar="RUN", help="Folder of a run, with flight.nc and estimate.nc.")],
    mcap: Annotated[Path, typer.Option(help="MCAP file, for Foxglove, rerun, ROS 2.")],
    force: Force = False,
) -> None:
    """Convert a simulated flight to MCAP: forces per point, joint states, pose and arrows. Needs the extra ros."""
    from aerobat_pin.errors import LogError, check_file
    from aerobat_pin.estimation import write_flight_mcap
    from aerobat_pin.experiments import read_estimates
    from aerobat_pin.flight import FlightLog
    from aerobat_pin.robot import load_robot
    from aerobat_pin.scenario import load_scenario

    missing = [name for name in ("scenario.toml", "flight.nc", "estimate.nc") if not os.path.isfile(run / name)]
    if missing:
        raise LogError(f"convert {run}: not the folder of a run: it has no {', '.join(missing)}")
    check_file(mcap, force=force)
    robot = load_robot(load_scenario(str(run / "scenario.toml")))
    log = FlightLog.load(run / "flight.nc")
    write_flight_mcap(robot.model, log, read_estimates(run / "estimate.nc", log), mcap)
    typer.echo(f"written to {mcap}")
