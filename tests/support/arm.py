"""A robot arm on the ground and the forces that push on it: a model that is no bird."""

import numpy as np
import pinocchio as pin

from aerobat_pin.aerobat import Aerobat
from aerobat_pin.observers import Identifiability, MomentumObserver, Observer, Rows, Sample
from aerobat_pin.observers.identifiability import judge
from support.observer_twins import point_jacobian

ALIGNED = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED


def arm() -> tuple[pin.Model, str]:
    """Return a fixed-base six-joint arm and the frame at its end."""
    model = pin.buildSampleModelManipulator()
    model.addFrame(pin.Frame("tool", model.njoints - 1, 0, pin.SE3(np.eye(3), np.array([0.0, 0.0, 0.3])), pin.OP_FRAME))
    return model, "tool"


def rest(model: pin.Model, q: np.ndarray) -> np.ndarray:
    """Return the joint torque that holds the robot still against gravity alone."""
    return pin.computeGeneralizedGravity(model, model.createData(), q).copy()


def push(model: pin.Model, frame: str, q: np.ndarray, force: np.ndarray) -> np.ndarray:
    """Return J^T f of a force (3,) or wrench (6,) at a frame's origin, world axes."""
    data = model.createData()
    return pin.computeFrameJacobian(model, data, q, model.getFrameId(frame), ALIGNED)[: len(force)].T @ force


def settled(observer: Observer, q: np.ndarray, tau: np.ndarray, samples: int = 20) -> Sample:
    """Return what an observer finds after some samples, 1 ms apart, of a robot that joint torques hold still."""
    v = np.zeros(observer.model.nv)
    observer.reset(q, v)
    for k in range(samples):
        sample = observer.update((k + 1) * 1e-3, q, v, tau)
    return sample


def identifiability(robot: Aerobat, frames: list[str], rows: Rows = "all") -> Identifiability:
    """Judge force points at the robot's start."""
    observer = MomentumObserver(robot.model, frames, rows=rows)
    J = point_jacobian(robot.model, frames, robot.q0)
    return judge(observer.applications, J[None], np.ones((1, robot.model.nv)), observer.believed)
