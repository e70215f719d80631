"""Replay a result: a flight of Aerobat, or any robot of a record, with estimated and actual forces as arrows."""

from __future__ import annotations

from pathlib import Path

import coal
import numpy as np
import pinocchio as pin

from aerobat_pin.aerobat import belief_about, read_log
from aerobat_pin.errors import LogError
from aerobat_pin.estimation import Result
from aerobat_pin.experiments import Experiment, estimate_dataset, force_columns, run_recorded
from aerobat_pin.records import urdf_of
from aerobat_pin.visualization import style
from aerobat_pin.visualization.replay.any_robot import load_any_robot
from aerobat_pin.visualization.replay.flight_replay import replay_flight
from aerobat_pin.visualization.replay.moving_page import Replay

LONGEST_REPLAY = 60.0  # [s] of the longest part
STICK = 0.04  # radius of a stick, in lengths of the robot
REPLAY_RATE = 240.0  # [Hz] of the samples that a replay is made from


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
    low = next(iter(outcome.stored.values())).index(block.time[0])
    at = np.minimum(rows, last - first - 1)
    for name, stored in outcome.stored.items():
        estimate = stored.between(low, low + last - first)
        found = force_columns(estimate).items()
        forces = {frame: estimate.components[at][:, columns[:3]] for frame, columns in found}
        if forces:
            replay.add_forces(f"estimated force ({name})", style.ESTIMATES[0], forces, choice=name)
    for reference in outcome.references:
        if reference.labels[:3] == ("Fx", "Fy", "Fz"):
            values = reference.values[low : low + last - first][at, :3]
            replay.add_forces("force sensor", style.TRUTH, {reference.frame: values}, inner=True)
    return replay


def replay_log(file: Path, morphology: str | None = None) -> Replay:
    """Prepare the replay of a flight log, with the forces that an observer estimates from it.

    Args:
        file: flight log, `.nc` or `.csv`.
        morphology: morphology of the robot that is assumed to have flown, a shipped name or a TOML file. When omitted,
            the robot noted in the log, or the default robot if the log notes none.

    Raises:
        AerobatError: the log or the morphology cannot be read.
    """
    log = read_log(file)
    return replay_result(run_recorded(log, belief_about(log, file.stem, morphology, [], [])))


def visible_parts(path: Path | None, model: pin.Model, name: str) -> tuple[pin.Model, pin.GeometryModel]:
    """Return the model with its own shapes if its URDF file names any that can be read, else with sticks."""
    if path is not None:
        try:
            model_of_file, visual = load_any_robot(path, int(model.nq), Path(name))
            if visual.ngeoms > 0:
                return model_of_file, visual
        except LogError:
            pass
    return model, sticks(model)


def sticks(model: pin.Model) -> pin.GeometryModel:
    """Return shapes for a robot without any: a stick from each joint to the next ones and to its frames, and a box."""
    visual, data = pin.GeometryModel(), model.createData()
    pin.framesForwardKinematics(model, data, pin.neutral(model))
    places = [place.translation for place in (*data.oMi, *data.oMf)]
    length = max(float(np.max(np.ptp(places, axis=0))), 0.05)
    for joint in range(1, model.njoints):
        ends = [model.jointPlacements[k].translation for k in range(2, model.njoints) if model.parents[k] == joint]
        for frame in model.frames.tolist():
            end = frame.placement.translation
            if frame.parentJoint == joint and not any(np.allclose(other, end) for other in ends):
                ends.append(end)
        shapes = {}
        if joint == 1:
            shapes["box"] = coal.Box(0.3 * length, 0.2 * length, 0.08 * length), pin.SE3.Identity()
        for k, end in enumerate(ends):
            size = float(np.linalg.norm(end))
            if size > 1e-3 * length:
                turn = pin.Quaternion.FromTwoVectors(np.array([0.0, 0.0, 1.0]), end / size).matrix()
                shapes[f"stick_{joint}_{k}"] = coal.Cylinder(0.5 * STICK * length, size), pin.SE3(turn, 0.5 * end)
        for name, (shape, place) in shapes.items():
            part = pin.GeometryObject(name, joint, place, shape)
            part.meshColor = np.array([*style.rgb(style.BLUE if joint > 1 else style.GREEN), 1.0])
            visual.addGeometryObject(part)
    return visual
