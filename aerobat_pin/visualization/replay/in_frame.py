"""Robots and flights as a notebook shows them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio as pin

from aerobat_pin.errors import LogError
from aerobat_pin.experiments import Experiment
from aerobat_pin.records import PlainRobot, RobotTable, urdf_of
from aerobat_pin.robot import CRANK_START, Aerobat, place_bars, visual_model_with_bars
from aerobat_pin.visualization.replay.recording import Recording
from aerobat_pin.visualization.replay.result_replay import replay_result, visible_parts

JOINT_SWING = 0.3  # [rad, m] of every joint, to and fro, within its limits
MOMENTS = np.linspace(0.0, 4.0, 121)  # [s] of such a swing


def in_frame(shown: Aerobat | PlainRobot | Experiment) -> str:
    """Return HTML: of a flight its scores and replay, of Aerobat a slow flap, of another robot each joint's swing."""
    if isinstance(shown, Experiment):
        return shown.scores._repr_html_() + replay_result(shown)._repr_html_()
    return (_slow_flap(shown) if isinstance(shown, Aerobat) else _swing(shown))._repr_html_()


def _slow_flap(robot: Aerobat) -> Recording:
    angles = CRANK_START + 2.0 * np.pi * MOMENTS / MOMENTS[-1]
    closure, level = robot.linkage.solve(angles), np.tile([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0], (len(angles), 1))
    q = robot.configuration(level, closure.theta_s, closure.theta_e)

    def move_bars(visual_model: pin.GeometryModel, row: int) -> None:
        place_bars(robot, visual_model, float(angles[row]))

    title = f"{robot.model.name}, {1e3 * robot.mass:.1f} g"
    return Recording(robot.model, visual_model_with_bars(robot), MOMENTS, q, title=title, move=move_bars)


def _swing(robot: PlainRobot) -> Recording:
    try:
        path = urdf_of(RobotTable(name=robot.title), Path())
    except LogError:
        path = None
    model, visual = visible_parts(path, robot.model, robot.title)
    wave = JOINT_SWING * np.sin(2.0 * np.pi * MOMENTS / MOMENTS[-1])
    free = robot.model.nq - len(robot.joints)
    q = np.tile(robot.neutral(), (len(MOMENTS), 1))
    low, high = robot.model.lowerPositionLimit[free:], robot.model.upperPositionLimit[free:]
    q[:, free:] = np.clip(q[:, free:] + wave[:, None], low, high)
    return Recording(model, visual, MOMENTS, q, title=f"{robot.title}, {robot.mass:.4g} kg")
