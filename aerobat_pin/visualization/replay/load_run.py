"""Load what `aerobat play` shows: the folder of a run, or a recorded flight with the forces estimated from it."""

from __future__ import annotations

from pathlib import Path

from aerobat_pin.errors import LogError
from aerobat_pin.estimation import SUM, belief_about, estimate_log, read_log
from aerobat_pin.experiments import estimate_dataset, flight_note, read_run, recorded_note
from aerobat_pin.flight import log_with_motion
from aerobat_pin.robot import believed_robot, load_robot
from aerobat_pin.scenario import changed_keys, changes_text
from aerobat_pin.visualization.replay.flight_replay import replay_flight
from aerobat_pin.visualization.replay.recording import Recording


def replay_run(folder: Path) -> Recording:
    """Prepare the replay of the flight in a run's folder.

    Raises:
        LogError: the folder is not that of a run, or its log cannot be read.
        AerobatError: another file in the folder cannot be read.
    """
    scenario, log, estimates = read_run(folder)
    robot = load_robot(scenario)
    strangers = [
        str(name) for name in estimates["point"].values if not (robot.model.existFrame(str(name)) or name == SUM)
    ]
    if strangers:
        raise LogError(f"estimates {folder / 'estimate.nc'}: the robot has no frame {', '.join(strangers)}")
    log = log_with_motion(log)
    recording = replay_flight(robot, log, scenario.air, estimates, flight_note(scenario, robot, log))
    recording.subtitle = changes_text(scenario.name, changed_keys(scenario))
    return recording


def replay_log(file: Path, morphology: str | None = None) -> Recording:
    """Prepare the replay of a flight log, with the forces that an observer estimates from it.

    Args:
        file: flight log, `.nc` or `.csv`.
        morphology: morphology of the robot that is assumed to have flown, a shipped name or a TOML file. When omitted,
            the robot noted in the log, or the default robot if the log notes none.

    Raises:
        AerobatError: the log or the morphology cannot be read.
    """
    log = read_log(file)
    belief = belief_about(log, file.stem, morphology, [], [])
    robot = believed_robot(belief)
    inputs, estimates = estimate_log(log, robot, belief)
    log = log_with_motion(log, inputs.q, inputs.v, inputs.crank)
    return replay_flight(robot, log, belief.believed_air, estimate_dataset(estimates), recorded_note(log, robot))
