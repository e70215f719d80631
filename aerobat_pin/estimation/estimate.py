"""From a flight log and a belief to estimates, for simulated and recorded flights alike."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any

from aerobat_pin.errors import LogError, ScenarioError
from aerobat_pin.estimation.known_inputs import ROWS_OF_TORQUE, KnownInputs, known_inputs, noted_air
from aerobat_pin.flight import FlightLog, read_csv
from aerobat_pin.observers import OBSERVERS, Estimate
from aerobat_pin.robot import Aerobat, load_morphology
from aerobat_pin.scenario import Scenario, parse_scenario, with_settings

BELIEF_TABLES, GRAVITY = ("robot", "air", "observers"), "flight.gravity"  # what may be set of a belief


def read_log(path: Path) -> FlightLog:
    """Read a flight: NetCDF of ours, or a recorded table. Raises LogError."""
    if not path.is_file():
        raise LogError(f"flight log {path}: there is no such file")
    return read_csv(path) if path.suffix.lower() == ".csv" else FlightLog.load(path)


def belief_about(
    log: FlightLog | None, name: str, morphology: str | None, names: Sequence[str], settings: Iterable[str]
) -> Scenario:
    """Return what is believed of a recorded flight, as a scenario; only its robot, air, observers and gravity count.

    Args:
        log: the flight; the robot and air that it notes are believed by default. None for no flight.
        name: of the result.
        morphology: of the robot, shipped name or TOML file.
        names: of the observers; those of the scenario's default when empty.
        settings: `dotted.key=value` texts.

    Raises:
        ScenarioError: a value that breaks its rule, or a key that a belief does not have.
    """
    settings = list(settings)
    _check_keys(settings)
    noted = {} if log is None else log.measured.attrs
    channels = () if log is None else tuple(map(str, log.measured.data_vars))
    robot: dict[str, Any] = {"morphology": morphology} if morphology is not None else {}
    if morphology is None and "morphology" in noted:
        robot = {"morphology": noted["morphology"], "changes": json.loads(noted.get("morphology_changes", "{}"))}
    joints = "motor_torque" in channels or "joint_torque" in channels
    torque = "measured" if joints else "motor_only" if "crank_torque" in channels else "none"
    values: dict[str, Any] = {
        "name": name,
        "robot": robot,
        "air": {} if log is None else noted_air(log).model_dump(exclude_none=True),
        "observers": {"torque": torque, **({"names": list(names)} if names else {})},
    }
    if "gravity" in noted:
        values["flight"] = {"gravity": float(noted["gravity"])}
    return parse_scenario(with_settings(values, settings), f"belief about {name}")


def describe_belief(belief: Scenario, morphology: str | None, settings: Iterable[str]) -> str:
    """Return a line that says which robot is believed, its mass, and why it is this one.

    Args:
        belief: as `belief_about` gives it.
        morphology: as it was given.
        settings: as they were given.

    Raises:
        MorphologyFileError: there is no such robot.
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


def estimate_log(
    log: FlightLog, robot: Aerobat, belief: Scenario, progress: Callable[[float], None] | None = None
) -> tuple[KnownInputs, dict[str, Estimate]]:
    """Run the observers of a belief on a log.

    Args:
        log: the flight.
        robot: the believed robot.
        belief: the scenario whose believed air and observers count.
        progress: called with the share done.

    Raises:
        ScenarioError: an observer that there is not.
        LogError, ObserverError, FrameNotFoundError: as `known_inputs` and the observers.
    """
    section = belief.observers
    check_names(section.names)
    rows = ROWS_OF_TORQUE[section.torque]
    observers = [
        OBSERVERS[name](robot.model, section.frames, section.gain, rows, **section.settings(name))
        for name in section.names
    ]
    inputs = known_inputs(log, robot, section.torque, belief.believed_air)
    estimates = {}
    for i, observer in enumerate(observers):
        if progress is not None:
            progress(i / len(observers))
        estimates[observer.name] = observer.run(inputs.time, inputs.q, inputs.v, inputs.tau, inputs.known)
    return inputs, estimates


def check_names(names: Sequence[str]) -> None:
    """Raise ScenarioError unless there are observers of these names."""
    if not names or any(name not in OBSERVERS for name in names):
        raise ScenarioError(f"observers.names = {list(names)}: choose from {', '.join(OBSERVERS)}")


def _check_keys(settings: Iterable[str]) -> None:
    """Raise ScenarioError for a setting of what the recorded flight itself fixes, such as its crank or sensors."""
    for setting in settings:
        key = setting.partition("=")[0].strip()
        if key.partition(".")[0] not in BELIEF_TABLES and key != GRAVITY:
            raise ScenarioError(
                f"--set {setting}: '{key}' does not belong to the belief about a recorded flight; keys of "
                f"{', '.join(BELIEF_TABLES)}, and {GRAVITY}, may be set"
            )
