"""Replay a flight of Aerobat, with its linkage, path and wake, or any robot of a record; forces are arrows."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import xarray as xr

from aerobat_pin.aerobat import (
    SUM,
    Aerobat,
    FlightLog,
    belief_about,
    flight_motion,
    flown_robot,
    place_bars,
    read_log,
    true_events,
    true_force,
    visual_model_with_bars,
)
from aerobat_pin.errors import LogError
from aerobat_pin.estimation import Result
from aerobat_pin.experiments import Experiment, estimate_dataset, flight_note, force_columns, read_run, run_recorded
from aerobat_pin.flight import Wake, log_with_motion, wake_of
from aerobat_pin.forces import point_label
from aerobat_pin.numerics import Array
from aerobat_pin.records import urdf_of
from aerobat_pin.scenario import AirSection, changed_keys, changes_text
from aerobat_pin.visualization import style
from aerobat_pin.visualization.figures.flight import thrust_forces
from aerobat_pin.visualization.replay.any_robot import visible_parts
from aerobat_pin.visualization.replay.moving_page import Replay
from aerobat_pin.visualization.replay.scene import Sheet

LONGEST_REPLAY = 60.0  # [s] of the longest part
REPLAY_RATE = 240.0  # [Hz] of the samples that a replay is made from
SLOW_MOTION = 0.1  # speed of a flight's replay relative to real time, in which a flap is too fast to be watched
WAKE_LASTS = 0.5  # [s]: time for which each part of the wake is shown
GROUND_BELOW = 0.35  # [m]: distance of the ground below the lowest point of the path
PALEST = 0.97  # red, green and blue of the wake where the wing has no circulation


def replay_flight(robot: Aerobat, log: FlightLog, air: AirSection, estimates: xr.Dataset | None, note: str) -> Replay:
    """Prepare the replay of a flight; `.html(SLOW_MOTION)` of the result returns its page.

    Args:
        robot: the robot that flew.
        log: the flight log, simulated or recorded.
        air: the air of the flight. With a lifting line, the wake is shown if the log contains the circulation.
        estimates: dataset that `estimate_dataset` returns; the forces of its first observer are shown,
            and the page lets people choose another.
        note: a line about the flight, for the title.

    Raises:
        LogError: the log does not contain the motion of the wings.
    """
    flown = flight_motion(log, robot, air)
    crank = None if flown.crank is None else flown.crank[0]
    replay = Replay(
        robot.model,
        robot.visual_model if crank is None else visual_model_with_bars(robot),
        flown.time,
        flown.q,
        title=f"{log.measured.attrs.get('scenario', 'flight')}: {note}",
        floor=float(flown.q[:, 2].min()) - GROUND_BELOW,
        move=None if crank is None else lambda visual, row: place_bars(robot, visual, float(crank[row])),
    )
    replay.rate = SLOW_MOTION
    if estimates is not None and "force_W" in estimates:  # else of the rows alone
        for name in map(str, estimates["observer"].values):
            force = estimates["force_W"].sel(observer=name)
            frames = [str(frame) for frame in force["point"].values if robot.model.existFrame(str(frame))]  # not a sum
            estimated = {frame: force.sel(point=frame).values for frame in frames}
            replay.add_forces(f"estimated force ({name})", style.ESTIMATES[0], estimated, choice=name)
    if log.truth is not None:
        true = {str(frame): true_force(log, str(frame))[0] for frame in log.truth["point"].values}
        replay.add_forces("true force", style.TRUTH, true, inner=True)
        if "thrust" in log.truth:
            replay.add_forces("thrust", style.GREEN, thrust_forces(robot, log))
        for event in true_events(log):
            points = ", ".join(point_label(frame) for frame in event.frames)
            replay.add_zone(event.start, event.end, f"{event.name} at {points}", style.EVENT_ZONE)
        if air.model == "lifting_line" and log.truth.sizes["strip"] == air.strips:
            _add_wake(replay, wake_of(_keyframes(log, replay.index), robot, air))
    return replay


def _keyframes(log: FlightLog, index: Array) -> FlightLog:
    """Return the log reduced to the samples with the given indices (m,)."""
    assert log.truth is not None
    rows = {"time": index, "interval": index[:-1]}
    truth = log.truth.isel({dim: kept for dim, kept in rows.items() if dim in log.truth.dims})
    return FlightLog(log.measured.isel(rows), truth)


def _add_wake(replay: Replay, wake: Wake) -> None:
    """Add the wake to a replay, coloured by the bound circulation that the wing had when it shed each part."""
    points, bound = wake.position - wake.wind.drift(wake.time)[:, None], wake.bound
    drifted = wake.wind.drift(replay.time)
    if len(points) < len(drifted):  # no interval begins at the last sample: repeat the last row
        points, bound = (np.concatenate([rows, rows[-1:]]) for rows in (points, bound))
    share = np.clip(bound / max(float(np.percentile(np.abs(bound), 98.0)), 1e-12), -1.0, 1.0)[..., None]
    lift, downforce = (np.array(style.rgb(colour)) for colour in style.WAKE_COLOURS)
    colours = PALEST + np.abs(share) * (np.where(share > 0.0, lift, downforce) - PALEST)
    label = "shed wake, blue: of lift, orange: of downforce"
    replay.sheet = Sheet(label, style.WAKE_COLOURS[0], points, colours, drifted, WAKE_LASTS)


def replay_run(folder: Path) -> Replay:
    """Prepare the replay of the flight in a run's folder.

    Raises:
        LogError: the folder is not that of a run, or its log cannot be read.
        AerobatError: another file in the folder cannot be read.
    """
    scenario, log, estimates = read_run(folder)
    robot = flown_robot(scenario)
    strangers = [
        str(name) for name in estimates["point"].values if not (robot.model.existFrame(str(name)) or name == SUM)
    ]
    if strangers:
        raise LogError(f"estimates {folder / 'estimate.nc'}: the robot has no frame {', '.join(strangers)}")
    log = log_with_motion(log)
    replay = replay_flight(robot, log, scenario.air, estimates, flight_note(scenario, robot, log))
    replay.subtitle = changes_text(scenario.name, changed_keys(scenario))
    return replay


def replay_result(outcome: Experiment | Result) -> Replay:
    """Return the replay of a flight, or of the longest used part of a record, at most its first minute."""
    if isinstance(outcome, Experiment):
        estimates = estimate_dataset(outcome.estimates)
        flight = replay_flight(outcome.robot, outcome.drawn, outcome.scenario.air, estimates, outcome.note)
        flight.subtitle = outcome.scores.changes
        return flight
    record = outcome.record
    if record is None:
        raise LogError(f"replay of {outcome.name}: a record was expected")
    first, last = max(record.parts, key=lambda part: part[1] - part[0])
    last = min(last, first + round(LONGEST_REPLAY * record.rate))
    block, every = record.block(first, last), max(1, round(record.rate / REPLAY_RATE))
    rows = np.arange(0, len(block.time), every)
    path = urdf_of(record.map.robot, record.folder)
    model, visual = visible_parts(path, record.robot.model, outcome.name)
    replay = Replay(model, visual, block.time[rows] - record.start, block.q[rows], title=outcome.name)
    if last - first < sum(end - begin for begin, end in record.parts):
        shown = f"{block.time[0] - record.start:.4g} to {block.time[-1] - record.start:.4g} s"
        replay.subtitle = f"{shown}; {record.duration:.4g} s are used in all"  # holes left out
    low = next(iter(outcome.stored.values())).index(block.time[0])
    at = np.minimum(rows, last - first - 1)
    for name, stored in outcome.stored.items():
        estimate = stored.between(low, low + last - first)
        by_frame = force_columns(estimate).items()
        forces = {frame: estimate.components[at][:, columns[:3]] for frame, columns in by_frame}
        if forces:
            replay.add_forces(f"estimated force ({name})", style.ESTIMATES[0], forces, choice=name)
    for reference in outcome.references:
        if reference.labels[:3] == ("Fx", "Fy", "Fz"):
            values = reference.values[low : low + last - first][at, :3]
            replay.add_forces("force sensor", style.TRUTH, {reference.frame: values}, inner=True)
    return replay


def replay_log(file: Path, morphology: str | None = None) -> Replay:
    """Prepare the replay of a flight log, `.nc` or `.csv`, with the forces that an observer estimates from it.

    The robot that is assumed to have flown is that of a morphology, a shipped name or a TOML file; when omitted, the
    robot noted in the log, or the default robot if the log notes none.

    Raises:
        AerobatError: the log or the morphology cannot be read.
    """
    log = read_log(file)
    return replay_result(run_recorded(log, belief_about(log, file.stem, morphology, [], [])))
