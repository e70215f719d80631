"""Open whatever was recorded as a record: any robot's log by its map, a flight of Aerobat with the belief about it."""

from __future__ import annotations

import os
from collections.abc import Iterable
from pathlib import Path

from aerobat_pin.aerobat.estimate import belief_about, robot_of_belief
from aerobat_pin.aerobat.flight_log import FlightLog
from aerobat_pin.aerobat.flight_record import flight_record
from aerobat_pin.aerobat.tables import read_log
from aerobat_pin.errors import LogError
from aerobat_pin.numerics import guarded
from aerobat_pin.records import Map, PlainRobot, Record, open_by_map
from aerobat_pin.scenario import Scenario, scenario_of_run


@guarded()
def open_record(
    path: Path | str,
    chosen: Map | Path | str | None = None,
    folder: Path | str | None = None,
    robot: PlainRobot | None = None,
) -> Record:
    """Open a recording by its map; without one, a flight of Aerobat: the folder of a run, its `flight.nc`, or a table.

    What is believed of a run is what its scenario says; of a log, what it notes.

    Args:
        path: the recording.
        chosen: the map, or its file; None for a flight of Aerobat.
        folder: where relative paths of the map begin; at its file, or here, when omitted.
        robot: a robot that knows more than the map says; the map's own when omitted.

    Raises:
        LogError, MapError: log or map lack something, do not fit together, or only a map explains the log.
        ScenarioError: the scenario of a run cannot be read.
    """
    if chosen is not None:
        return open_by_map(path, chosen, folder, robot)
    log, belief = read_flight(Path(path))
    return flight_record(log, robot_of_belief(belief), belief.observers, str(path))


def read_flight(path: Path, morphology: str | None = None, settings: Iterable[str] = ()) -> tuple[FlightLog, Scenario]:
    """Read the folder of a run, or a log, with the belief about it.

    Raises:
        LogError: it is neither, or a morphology is given for a run, whose scenario names it.
        ScenarioError: a setting breaks its rule.
    """
    if not os.path.isdir(path):  # unlike `path.is_dir()`, takes names of any length
        log = read_log(path)
        return log, belief_about(log, path.stem, morphology, [], settings)
    if not (path / "scenario.toml").is_file() or not (path / "flight.nc").is_file():
        raise LogError(f"{path} is not the folder of a run: scenario.toml and flight.nc were expected in it")
    if morphology is not None:
        raise LogError(f"{path}: --morphology says which robot is believed to have flown a log; a log was expected")
    return read_log(path / "flight.nc"), scenario_of_run(path, settings)
