"""Open whatever was recorded as a record, and estimate the unknown forces of a flight log, simulated or recorded.

What the observers assume about a flight (robot, air, gravity, settings) is called a belief; it has the form of a
scenario.
"""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from aerobat_description.reading import did_you_mean
from aerobat_pin.aerobat.aerobat import Aerobat, believed_robot, load_morphology
from aerobat_pin.aerobat.flight_log import FlightLog
from aerobat_pin.aerobat.flight_record import flight_record, noted_air
from aerobat_pin.aerobat.robot import AerobatRobot
from aerobat_pin.aerobat.tables import read_log
from aerobat_pin.errors import CalibrationError, LogError, ScenarioError
from aerobat_pin.estimation import Calibration, Result, estimate
from aerobat_pin.numerics import guarded
from aerobat_pin.observers import OBSERVERS
from aerobat_pin.records import Map, PlainRobot, Record, open_by_map
from aerobat_pin.scenario import RawSection, Scenario, name_for, parse_scenario, scenario_of_run, with_settings

BELIEF_TABLES, GRAVITY = ("robot", "air", "observers"), "flight.gravity"  # tables and key of a belief that can be set


@guarded()
def belief_about(
    log: FlightLog | None, name: str, morphology: str | None, names: Sequence[str], settings: Iterable[str]
) -> Scenario:
    """Return what the observers assume about a recorded flight, as a scenario.

    Only robot, air, observers and gravity of the returned scenario are used.

    Args:
        log: the flight log. By default, the robot and the air noted in its attributes are assumed. None if there is
            no flight.
        name: name of the log's file; the returned scenario is called so, with `_` for signs that its name cannot have.
        morphology: morphology of the robot, a shipped name or a TOML file.
        names: names of the observers; empty for the default observers.
        settings: `dotted.key=value` texts.

    Raises:
        ScenarioError: a value breaks its rule, or a key cannot be set for a recorded flight.
    """
    settings = list(settings)
    for setting in settings:  # not of what the recorded flight determines, such as the crank
        key = setting.partition("=")[0].strip()
        if key.partition(".")[0] not in BELIEF_TABLES and key != GRAVITY:
            raise ScenarioError(
                f"--set {setting}: '{key}' does not belong to the belief about a recorded flight; keys of "
                f"{', '.join(BELIEF_TABLES)}, and {GRAVITY}, may be set"
            )
    noted = {} if log is None else log.measured.attrs
    channels = () if log is None else tuple(map(str, log.measured.data_vars))
    robot: dict[str, Any] = {"morphology": morphology} if morphology is not None else {}
    if morphology is None and "morphology" in noted:
        robot = {"morphology": noted["morphology"], "changes": json.loads(noted.get("morphology_changes", "{}"))}
    joints = any(name in channels for name in ("motor_torque", "joint_torque", "joint_torque_sample"))
    crank = "crank_torque" in channels or "crank_torque_sample" in channels
    torque = "measured" if joints else "motor_only" if crank else "none"
    if log is not None and log.is_raw and not names:
        names = ("smoother",)
    values: dict[str, Any] = {
        "name": name_for(name) or "flight",
        "robot": robot,
        "air": {} if log is None else noted_air(log).model_dump(exclude_none=True),
        "observers": {"torque": torque, **({"names": list(names)} if names else {})},
    }
    if "gravity" in noted:
        values["flight"] = {"gravity": float(noted["gravity"])}
    return parse_scenario(with_settings(values, settings), f"belief about {name}")


@guarded()
def describe_belief(belief: Scenario, morphology: str | None, settings: Iterable[str]) -> str:
    """Return a line with the assumed robot, its mass, and where the choice of this robot comes from.

    The morphology and the settings are those that `belief_about` was given.

    Raises:
        MorphologyFileError: the robot cannot be loaded.
    """
    chosen = belief.believed_robot
    shape = load_morphology(chosen.morphology, chosen.changes)
    keys = {setting.partition("=")[0].strip() for setting in settings}
    why = "by default; --morphology chooses another"
    if keys & {"robot", "robot.morphology"}:
        why = "from --set"
    elif morphology is not None:
        why = "from --morphology"
    elif "morphology" in belief.robot.model_fields_set:
        why = "noted in the log"
    return f"believed: {shape.name}{' with changes' if chosen.changes else ''}, {1e3 * shape.mass:.1f} g, {why}"


@guarded()
def estimate_flight(
    log: FlightLog,
    robot: Aerobat,
    belief: Scenario,
    progress: Callable[[float], None] | None = None,
    calibration: Calibration | None = None,
) -> Result:
    """Estimate the unknown forces of a flight log.

    Args:
        log: the flight log.
        robot: the assumed robot.
        belief: scenario of which the observers and the assumed air are used.
        progress: called with the share that is done.
        calibration: what free flights showed about this belief.

    Raises:
        ScenarioError: there is no observer of a given name.
        CalibrationError: the calibration belongs to another belief, or the log lacks the crank's angle.
        LogError, ObserverError, FrameNotFoundError: as raised by `estimation.estimate`.
    """
    section = belief.observers
    check_names(section.names)
    if log.is_raw and calibration is not None and not calibration.extras:
        raise CalibrationError("raw samples: a calibration learnt from raw samples was expected, or none")
    record = flight_record(log, robot_of_belief(belief, robot), section)
    return estimate(record, calibration=calibration, trust=True, progress=progress)


def robot_of_belief(belief: Scenario, robot: Aerobat | None = None) -> AerobatRobot:
    """Return the believed robot, or a loaded one, with the air, torque and smoothing of raw samples of the belief."""
    section = belief.observers
    believed = AerobatRobot.of(robot or believed_robot(belief), belief.believed_air, section.torque)
    return replace(believed, raw=section.raw or RawSection())


@guarded()
def check_names(names: Sequence[str]) -> None:
    """Raise ScenarioError if no name is given, or if there is no observer of one of the names."""
    if wrong := [name for name in names if name not in OBSERVERS] or [""] * (not names):
        raise ScenarioError(f"observers.names = {list(names)}: {did_you_mean(wrong[0], OBSERVERS, 'choose from')}")


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
