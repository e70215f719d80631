"""Open the robot in a browser, in meshcat's own viewer, with a camera that frames it; from Python it then moves.

view = open_robot(load_aerobat())
view.turn(0.7)               # crank angle [rad]: wings and linkage
view.display(robot.q0)       # any configuration; the linkage then stays where the crank was
"""

from __future__ import annotations

from pathlib import Path

import meshcat
import numpy as np
import pinocchio as pin
from pinocchio.visualize import MeshcatVisualizer

from aerobat_pin.aerobat import CRANK_START, Aerobat, place_bars, visual_model_with_bars
from aerobat_pin.errors import LogError
from aerobat_pin.experiments import Experiment
from aerobat_pin.numerics import Array, guarded
from aerobat_pin.records import PlainRobot, RobotTable, urdf_of
from aerobat_pin.visualization.replay.any_robot import visible_parts
from aerobat_pin.visualization.replay.flight_replay import replay_result
from aerobat_pin.visualization.replay.moving_page import CAMERA, Replay
from aerobat_pin.visualization.replay.scene import clear_background

CLOSE_UP = 1.2  # distance of the camera for each distance in `CAMERA`, both in sizes of the robot
JOINT_SWING = 0.3  # [rad, m] of every joint, to and fro, within its limits
MOMENTS = np.linspace(0.0, 4.0, 121)  # [s] of such a swing


class RobotView:
    """The robot in a browser; `open_robot` makes one.

    Attributes:
        url: address of the page, for browsers on this machine.
        visualizer: Pinocchio's visualizer, for anything that this class does not do.
    """

    def __init__(self, robot: Aerobat, viewer: meshcat.Visualizer) -> None:
        """Draw the robot with the crank straight down."""
        self.robot = robot
        self.url = str(viewer.url())
        self._picture = visual_model_with_bars(robot)
        self.visualizer = MeshcatVisualizer(robot.model, pin.GeometryModel(), self._picture)
        self.visualizer.initViewer(viewer=viewer)
        self.visualizer.loadViewerModel(rootNodeName="aerobat")
        self.turn(CRANK_START)
        clear_background(viewer)
        x, y, z = CLOSE_UP * _reach(robot) * np.array(CAMERA)
        viewer["/Cameras/default/rotated/<object>"].set_property("position", [x, z, -y])  # meshcat's order

    @guarded()
    def turn(self, crank_angle: float) -> None:
        """Turn the crank to an absolute angle t1 [rad]; the body is at the origin, level.

        Raises:
            LinkageError: the linkage cannot close.
        """
        closure = self.robot.linkage.solve(crank_angle)
        place_bars(self.robot, self._picture, crank_angle)
        self.display(self.robot.configuration(self.robot.q0[:7], closure.theta_s, closure.theta_e))

    def display(self, q: Array) -> None:
        """Show a configuration (nq,); the bars keep to the body where the crank put them last."""
        self.visualizer.display(q)

    def close(self) -> None:
        """Stop the server of the page; a browser that shows it keeps its last picture."""
        window = self.visualizer.viewer.window
        window.zmq_socket.close()
        if window.server_proc is not None:
            window.server_proc.terminate()
            window.server_proc.wait()


@guarded()
def open_robot(robot: Aerobat, *, browser: bool = True) -> RobotView:
    """Open the robot in a browser, and return the view, through which Python moves it.

    If `browser` is False, open `url` of the view yourself.
    """
    view = RobotView(robot, meshcat.Visualizer())
    if browser:
        view.visualizer.viewer.open()
    return view


def _reach(robot: Aerobat) -> float:
    """Return how far the robot extends from the body's centre of mass: half the span, or a guard around it [m]."""
    fixed = [item for item in robot.visual_model.geometryObjects if item.parentJoint == 1]
    points = np.concatenate([item.geometry.vertices() for item in fixed])
    return max(0.5 * robot.morphology.span, float(np.linalg.norm(points, axis=1).max()))


def in_frame(shown: Aerobat | PlainRobot | Experiment) -> str:
    """Return HTML: of a flight its scores and replay, of Aerobat a slow flap, of another robot each joint's swing."""
    if isinstance(shown, Experiment):
        return shown.scores._repr_html_() + replay_result(shown)._repr_html_()
    return (_slow_flap(shown) if isinstance(shown, Aerobat) else _swing(shown))._repr_html_()


def _slow_flap(robot: Aerobat) -> Replay:
    angles = CRANK_START + 2.0 * np.pi * MOMENTS / MOMENTS[-1]
    closure = robot.linkage.solve(angles)
    q = robot.configuration(np.tile(robot.q0[:7], (len(angles), 1)), closure.theta_s, closure.theta_e)

    def move_bars(visual_model: pin.GeometryModel, row: int) -> None:
        place_bars(robot, visual_model, float(angles[row]))

    title = f"{robot.model.name}, {1e3 * robot.mass:.1f} g"
    return Replay(robot.model, visual_model_with_bars(robot), MOMENTS, q, title=title, move=move_bars)


def _swing(robot: PlainRobot) -> Replay:
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
    return Replay(model, visual, MOMENTS, q, title=f"{robot.title}, {robot.mass:.4g} kg")
