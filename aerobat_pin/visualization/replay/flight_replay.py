"""A flight to look at: the robot with moving bars, true and estimated forces as arrows, its way, and its shed wake."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import xarray as xr

from aerobat_pin.estimation import motion, point_label, true_events, true_force
from aerobat_pin.flight import FlightLog, Wake, wake_of
from aerobat_pin.numerics import Array
from aerobat_pin.robot import Aerobat, place_bars, visual_model_with_bars
from aerobat_pin.scenario import AirSection
from aerobat_pin.visualization import style
from aerobat_pin.visualization.replay.recording import Recording

SLOW_MOTION = 0.1  # of real time: a flap is too fast to be watched
WAKE_LASTS = 0.5  # [s], of each part of it
GROUND_BELOW = 0.35  # [m], of the lowest point of the way
PALEST = 0.97  # a wake without circulation


def replay_flight(
    robot: Aerobat, log: FlightLog, air: AirSection, estimates: xr.Dataset | None, note: str
) -> Recording:
    """Record a flight; `.html(SLOW_MOTION)` is its page.

    Args:
        robot: the robot that flew.
        log: its flight, simulated or recorded.
        air: that it flew in; the lifting line's wake is shown where the log knows the circulation.
        estimates: as `estimate_dataset` makes them; the first observer's forces are shown.
        note: a line about the flight, shown on the page.

    Raises:
        LogError: how the wings moved is not in the log.
    """
    moved = motion(log, robot, air)
    crank = None if moved.crank is None else moved.crank[0]

    def turn(picture: pin.GeometryModel, row: int) -> None:
        assert crank is not None
        place_bars(robot, picture, float(crank[row]))

    visible = robot.visual_model if crank is None else visual_model_with_bars(robot)
    recording = Recording(
        robot.model,
        visible,
        moved.time,
        moved.q,
        title=f"{log.measured.attrs.get('scenario', 'flight')}: {note}",
        floor=float(moved.q[:, 2].min()) - GROUND_BELOW,
        move=None if crank is None else turn,
    )
    if estimates is not None:
        name = str(estimates["observer"].values[0])
        force = estimates["force_W"].sel(observer=name)
        believed = {str(frame): force.sel(point=frame).values for frame in force["point"].values}
        recording.add_forces(f"estimated force ({name})", style.ESTIMATES[0], believed)
    if log.truth is not None:
        points = [str(name) for name in log.truth["point"].values]
        pushed = {name: true_force(log, name)[0] for name in points}
        recording.add_forces("true force", style.TRUTH, pushed, inner=True)
        for event in true_events(log):
            where = ", ".join(point_label(frame) for frame in event.frames)
            recording.add_zone(event.start, event.end, f"{event.name} at {where}", style.STEP_ZONE)
        if air.model == "lifting_line" and log.truth.sizes["strip"] == air.strips:
            _add_wake(recording, wake_of(_keyframes(log, recording.index), robot, air))
    return recording


def _keyframes(log: FlightLog, index: Array) -> FlightLog:
    """Return the log at some of its samples."""
    assert log.truth is not None
    rows = {"time": index, "interval": index[:-1]}
    truth = log.truth.isel({name: at for name, at in rows.items() if name in log.truth.dims})
    return FlightLog(log.measured.isel(rows), truth)


def _add_wake(recording: Recording, wake: Wake) -> None:
    """Show the wake, coloured by the bound circulation that the wing had when it left it."""
    along = wake.wind.drift(wake.time)
    points, bound = wake.position - along[:, None], wake.bound
    moved = wake.wind.drift(recording.time)
    if len(points) < len(moved):  # the last sample begins no interval
        points, bound = (np.concatenate([one, one[-1:]]) for one in (points, bound))
    share = np.clip(bound / max(float(np.percentile(np.abs(bound), 98.0)), 1e-12), -1.0, 1.0)[..., None]
    lift, push = (np.array(style.rgb(colour)) for colour in style.CIRCULATION)
    colours = PALEST + np.abs(share) * (np.where(share > 0.0, lift, push) - PALEST)
    label = "shed wake, blue: of lift, orange: of downforce"
    recording.add_sheet(label, style.CIRCULATION[0], points, colours, moved, WAKE_LASTS)
