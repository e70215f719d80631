"""What `aerobat play` shows: the folder of a run, or a recorded flight with what an observer makes of it."""

from __future__ import annotations

from pathlib import Path

import xarray as xr

from aerobat_pin.errors import LogError
from aerobat_pin.estimation import belief_about, estimate_log, read_log
from aerobat_pin.experiments import estimate_dataset, flight_note, recorded_note
from aerobat_pin.flight import FlightLog
from aerobat_pin.robot import believed_robot, load_robot
from aerobat_pin.scenario import load_scenario
from aerobat_pin.visualization.replay.flight_replay import replay_flight
from aerobat_pin.visualization.replay.recording import Recording

PARTS = ("scenario.toml", "flight.nc", "estimate.nc")


def flight_of(source: Path, morphology: str | None = None) -> Recording:
    """Record a run's folder, or a flight (`.nc`, `.csv`) with what an observer finds in it.

    Args:
        source: folder or file.
        morphology: of the robot that is believed to have flown a file, shipped name or TOML file; what the log notes,
            else the default robot, when omitted.

    Raises:
        AerobatError: it is neither.
    """
    if source.is_dir():
        missing = [name for name in PARTS if not (source / name).is_file()]
        if missing:
            raise LogError(f"{source} is not the folder of a run: it has no {', '.join(missing)}")
        scenario = load_scenario(str(source / "scenario.toml"))
        robot = load_robot(scenario)
        log = FlightLog.load(source / "flight.nc")
        estimates = xr.load_dataset(source / "estimate.nc", engine="h5netcdf")
        return replay_flight(robot, log, scenario.air, estimates, flight_note(scenario, robot))
    log = read_log(source)
    belief = belief_about(log, source.stem, morphology, [], [])
    robot = believed_robot(belief)
    _, found = estimate_log(log, robot, belief)
    return replay_flight(robot, log, belief.believed_air, estimate_dataset(found), recorded_note(log, robot))
