"""Where unknown forces can act: a list of frames, and for each frame the kind of force or wrench that acts there.

Every unknown is the size of a component: a unit force or unit moment at a frame's origin, in world or in frame axes.
Take a component with force direction d and moment direction m, in world axes at the point P. Moved to the world's
origin, it is the wrench (d, m + P x d). This wrench times Pinocchio's world Jacobian of the joint that carries the
frame is the component's row of the Jacobian.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from aerobat_pin.errors import ObserverError
from aerobat_pin.numerics import Array, frame_id, guarded, placements
from aerobat_pin.observers.rows import MOMENT_ARM


@guarded()
@dataclass(frozen=True)
class Application:
    """A frame at whose origin an unknown force or wrench acts.

    Attributes:
        frame: name of the frame.
        kind: `force` (three components), or `wrench` (six: force, then moment about the frame's origin).
        axes: axes in which the components are given, those of the `world` or of the `frame`.
        direction: if given, the force acts only along this vector, in `axes`, and there is one component. The vector
            does not need unit length.
    """

    frame: str
    kind: Literal["force", "wrench"] = "force"
    axes: Literal["world", "frame"] = "world"
    direction: tuple[float, float, float] | None = None

    @property
    def labels(self) -> tuple[str, ...]:
        """Names of the components, such as `tool.Fx`."""
        if self.direction is not None:
            return (f"{self.frame}.along",)
        names = ("Fx", "Fy", "Fz", "Mx", "My", "Mz")[: 6 if self.kind == "wrench" else 3]
        mark = "" if self.axes == "world" else "'"
        return tuple(f"{self.frame}.{name}{mark}" for name in names)

    @property
    def units(self) -> tuple[str, ...]:
        """Unit of each component, `N` or `N m`."""
        return tuple("N m" if np.any(direction[3:]) else "N" for direction in self.directions)

    @property
    def directions(self) -> Array:
        """(k, 6) force direction and moment direction of each component, in `axes`."""
        if self.direction is not None:
            along = np.array(self.direction, float)
            size = float(np.linalg.norm(along)) if along.shape == (3,) else 0.0
            if self.kind != "force" or not (np.isfinite(size) and size > 0.0):
                raise ObserverError(
                    f"application at '{self.frame}': a direction of three finite numbers, not all zero, was expected"
                )
            return np.concatenate([along / size, np.zeros(3)])[None]
        return np.eye(6)[: 6 if self.kind == "wrench" else 3]


class Applications:
    """All applications of an observer, looked up in its model.

    Args:
        model: any model.
        applications: applications, or names of frames at whose origins a force acts.

    Raises:
        FrameNotFoundError: a frame is not in the model.
        ObserverError: a frame is named twice or fixed to the world, or a direction is
            not three finite numbers or is zero.

    Attributes:
        frames: (n,) names of the frames.
        components: (c,) labels of the components.
        units: (c,) unit of each component, `N` or `N m`.
        table: (c, 11) for each component: joint, position (3) in the joint's frame [m], force and moment direction (6),
            and 1 if the directions are fixed in the joint's frame, 0 if in the world.
        support: (c, nv) 1 where the velocity coordinate moves the frame, else 0.
        scale: (c,) 1 for forces and `MOMENT_ARM` [m] for moments: the moment of 1 N at that lever arm.
    """

    def __init__(self, model: pin.Model, applications: Sequence[str | Application]) -> None:
        self.model = model
        self.given = tuple(Application(item) if isinstance(item, str) else item for item in applications)
        self.frames = tuple(application.frame for application in self.given)
        if len(set(self.frames)) != len(self.frames):
            raise ObserverError(f"force frames {list(self.frames)}: different names were expected")
        self.components = tuple(label for application in self.given for label in application.labels)
        self.units = tuple(unit for application in self.given for unit in application.units)
        rows, support = [], []
        for application in self.given:
            frame = model.frames[frame_id(model, application.frame)]
            if frame.parentJoint == 0:
                raise ObserverError(
                    f"force frame '{frame.name}' is fixed to the world: a force on it cannot be observed"
                )
            moves = np.zeros(model.nv)
            for joint in (model.joints[k] for k in model.supports[frame.parentJoint].tolist()[1:]):
                moves[joint.idx_v : joint.idx_v + joint.nv] = 1.0
            R = frame.placement.rotation if application.axes == "frame" else np.eye(3)
            for direction in application.directions:
                both = (*(R @ direction[:3]), *(R @ direction[3:]))
                rows.append([frame.parentJoint, *frame.placement.translation, *both, application.axes == "frame"])
                support.append(moves)
        self.table: Array = np.array(rows, float).reshape(-1, 11)
        self.support: Array = np.array(support).reshape(-1, model.nv)
        self.scale = np.where(np.any(self.table[:, 7:10] != 0.0, axis=1), MOMENT_ARM, 1.0)

    def jacobian(self, q: ArrayLike) -> Array:
        """Return J (..., c, nv) at configurations (..., nq): components f have the generalised force J^T f."""
        model, data, q = self.model, self.model.createData(), np.asarray(q, float)
        every, oMi = q.reshape(-1, model.nq), placements(data.oMi)
        world, places = np.empty((len(every), 6, model.nv)), np.empty((len(every), *oMi.shape))
        for q_k, J, place in zip(every, world, places, strict=True):
            J[:] = pin.computeJointJacobians(model, data, q_k).reshape(J.shape)  # that of one joint is (6,)
            place[:] = oMi
        return self.jacobians(world, places).reshape(*q.shape[:-1], len(self.components), model.nv)

    def jacobians(self, world: Array, places: Array) -> Array:
        """Return J (m, c, nv) at m configurations, from Pinocchio's world Jacobians and the placements of its joints.

        Args:
            world: (m, 6, nv) `data.J`, at the world's origin.
            places: (m, njoints, 12) `data.oMi`, each as rotation by columns, then translation.
        """
        blocks = [np.zeros((len(world), 0, world.shape[2]))]
        for application in self.given:
            frame = self.model.frames[frame_id(self.model, application.frame)]
            joint, at = places[:, frame.parentJoint], frame.placement
            x, y, z = (at.translation @ joint[:, :9].reshape(-1, 3, 3) + joint[:, 9:]).T[..., None]  # of the point
            a, b, c = world[:, 3:].swapaxes(0, 1)
            linear = world[:, :3] + np.stack([b * z - c * y, c * x - a * z, a * y - b * x], axis=1)  # its velocity
            moving = np.concatenate([linear, world[:, 3:]], axis=1)
            directions = application.directions
            if application.axes == "frame":
                R = at.rotation.T @ joint[:, :9].reshape(-1, 3, 3)  # its rows are the frame's axes in the world
                directions = np.concatenate([directions[:, :3] @ R, directions[:, 3:] @ R], axis=2)
            blocks.append(directions @ moving)
        return np.concatenate(blocks, axis=1) * self.support
