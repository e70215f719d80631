"""Any robot, held by springs and dampers in its joints about a posture that gravity does not change.

    M v' + h = g(q0) + K (q0 - q) - D v + J^T f

is integrated implicitly in springs and dampers, so that light joints need no smaller steps. The base stands still. The
torque of the joints is what the stream is told, so the force f at the points is found as on a robot that stands there.
"""

from __future__ import annotations

import tempfile
from collections import deque
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pandas as pd
import pinocchio as pin
from scipy.linalg import cho_factor, cho_solve

from aerobat_pin.errors import LogError
from aerobat_pin.estimation import OnlineEstimator, Result
from aerobat_pin.experiments.experiment import Progress
from aerobat_pin.experiments.live.heard_robot import LiveStream
from aerobat_pin.experiments.live.source import KEPT, PUSH_SHARE, LiveRow
from aerobat_pin.numerics import Array, frame_id, guarded
from aerobat_pin.observers import robot_length
from aerobat_pin.records import RobotTable, parse_map, robot_of_map

LIVE_STEP = 2e-3  # [s]
GIVES = 0.2  # [rad]: by how much the largest force at the robot's reach turns a joint
BENT = 0.6  # [rad]: of the posture, to and fro along each chain of joints
SAMPLE_NOISE = (1e-5, 3e-4, 1e-3)  # deviation of a sample: angle [rad], rate [rad/s], torque as a share of the springs'
LIVE_GAIN = 50.0  # [1/s]
MOST_PUSHED = 4


class LiveRobot(LiveStream):
    """A robot that stands.

    Args:
        name: of the extra `robots`, such as ur5, or a URDF file.
        points: frames at which forces are set and sought; the ends of its chains of joints when empty.

    Attributes:
        posture: (nq,) the posture q0 that the springs keep.
        spring: K, of every joint [N m/rad, N/m].

    Raises:
        LogError: there is no such robot or frame.
    """

    knobs: ClassVar[tuple[str, ...]] = ("noise",)

    @guarded()
    def __init__(self, name: str, points: tuple[str, ...] = ()) -> None:
        given = {"urdf": str(Path(name).absolute())} if name.endswith(".urdf") else {"name": name}
        table: dict[str, Any] = {**given, "root": "fixed"}
        points = points or _last_frames(robot_of_map(RobotTable(**table, points=()), Path()).model)
        robot = robot_of_map(RobotTable(**table, points=points), Path())
        self._columns = [f"{what}.{joint}" for what in ("q", "v", "tau") for joint in robot.joints]
        position, velocity, effort = ({"columns": part} for part in np.split(np.array(self._columns), 3))
        self._sensed = [f"{points[0]}.{axis}" for axis in ("Fx", "Fy", "Fz")]
        chosen = parse_map(
            {
                "log": {"time": {"column": "time"}},
                "robot": {**table, "points": points},
                "joints": {"names": robot.joints, "position": position, "velocity": velocity, "effort": effort},
                "check": {"wrench": {"columns": self._sensed, "point": points[0]}},
                "observer": {"names": ["force_level"], "gain": LIVE_GAIN},
            },
            "of a live robot",
        )
        super().__init__(robot.title, OnlineEstimator(chosen, Path()), chosen, Path())
        self.limit = PUSH_SHARE * robot.weight
        self._data = robot.model.createData()
        self._frames = [frame_id(self.model, point) for point in points]
        self.q = self.posture = _posture(self.model)
        self._v = np.zeros(self.model.nv)
        self.spring = self.limit * robot_length(self.model) / GIVES
        self._damping = 1.4 * np.sqrt(self.spring * np.diag(pin.crba(self.model, self._data, self.q)))
        self._rng = np.random.default_rng(1)
        self._rows: deque[Array] = deque(maxlen=round(KEPT / LIVE_STEP))

    def step(self) -> list[LiveRow]:
        """Move for `LIVE_STEP`, and let the stream hear of it."""
        model, data, q, v, dt = self.model, self._data, self.q, self._v, LIVE_STEP
        inertia, h = np.array(pin.crba(model, data, q)), np.array(pin.nonLinearEffects(model, data, q, v))
        inertia = np.triu(inertia) + np.triu(inertia, 1).T
        effort = pin.computeGeneralizedGravity(model, data, self.posture) + self.spring * (self.posture - q)
        effort -= (self._damping + dt * self.spring) * v
        pushed = np.zeros(model.nv)
        pin.computeJointJacobians(model, data, q)
        for frame, force in zip(self._frames, self.force, strict=True):
            if force.any():
                J = pin.getFrameJacobian(model, data, frame, pin.ReferenceFrame.LOCAL_WORLD_ALIGNED)
                pushed += J[:3].T @ force
        soft = self._damping * dt + self.spring * dt**2
        a = cho_solve(cho_factor(inertia + np.diag(soft)), effort + pushed - h)
        tau, self._v = effort - soft * a, v + dt * a
        self.q, self.time = q + dt * self._v, self.time + dt
        noise = self.noise * np.repeat([*SAMPLE_NOISE[:2], SAMPLE_NOISE[2] * self.spring * GIVES], model.nv)
        values = np.concatenate([self.q, self._v, tau]) + noise * self._rng.standard_normal(3 * model.nv)
        sensed = self.force[0] + self.noise * SAMPLE_NOISE[2] * self.limit * self._rng.standard_normal(3)
        self._rows.append(np.concatenate([[self.time], values, sensed]))
        samples = self.stream.push(self.time, dict(zip(self._columns, values.tolist(), strict=True)))
        return self.rows(samples, self.force.copy())

    def result(self, show: Progress) -> Result:
        """Return the last seconds as `aerobat estimate` finds them, the force at the first point as its check."""
        if len(self._rows) < 50:
            raise LogError("nothing has happened yet that could be saved")
        table = pd.DataFrame(list(self._rows), columns=["time", *self._columns, *self._sensed])
        with tempfile.TemporaryDirectory() as folder:
            log = Path(folder, f"{self.title}.csv")
            table.to_csv(log, index=False, float_format="%.9g")
            return self.estimated(log, show)


def _last_frames(model: pin.Model) -> tuple[str, ...]:
    """Return the last frame of each joint that carries no other, the first `MOST_PUSHED`."""
    parents = set(model.parents.tolist())
    last: dict[int, str] = {}
    for frame in model.frames.tolist():
        if frame.parentJoint and frame.parentJoint not in parents and frame.type == pin.FrameType.BODY:
            last[frame.parentJoint] = frame.name
    return tuple(last.values())[:MOST_PUSHED]


def _posture(model: pin.Model) -> Array:
    """Return a posture (nq,) with bent joints, within their limits."""
    depth = [0] * model.njoints
    q = np.zeros(model.nq)
    for joint in range(1, model.njoints):
        depth[joint] = depth[model.parents[joint]] + 1
        turns = model.joints[joint].shortname().startswith("JointModelR")
        q[model.joints[joint].idx_q] = (BENT if turns else 0.0) * (-1.0) ** depth[joint]
    return np.clip(q, np.nan_to_num(model.lowerPositionLimit), np.nan_to_num(model.upperPositionLimit))
