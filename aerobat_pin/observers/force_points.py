"""Where unknown forces are taken to act, and how much of them can be known.

Forces f in world axes at the origins of n frames make J^T f, J the stacked translational Jacobians (3n, nv). Rows of
J^T mix N (base translation) and N m (everything else); moments are weighed as forces at a lever of `MOMENT_ARM`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
import pinocchio as pin

from aerobat_pin.arrays import Array
from aerobat_pin.errors import ObserverError
from aerobat_pin.frames import frame_id

MOMENT_ARM = 0.05  # [m]
RANK_TOLERANCE = 1.0e-6  # of the largest singular value
BASE = 6  # rows of a free-flyer base
Rows = Literal["all", "base", "base+power"]
ROWS = ("all", "base", "base+power")  # in the order of the kernels' numbers


@dataclass(frozen=True)
class Identifiability:
    """What the geometry lets an observer know, at the worst configuration of a run.

    Attributes:
        rank: number of force components that can be told apart.
        singular_values: (3n,) of the weighted map from forces to generalised forces, largest first.
        null_direction: (n, 3) unit pattern of forces that leaves no trace, in world axes; None at full rank.
    """

    rank: int
    singular_values: Array
    null_direction: Array | None

    @property
    def condition(self) -> float:
        """Largest over smallest singular value; infinite where the rank is not full, 1 without points."""
        if not self.singular_values.size:
            return 1.0
        smallest = self.singular_values[-1]
        return float(self.singular_values[0] / smallest) if self.null_direction is None else float("inf")


class ForcePoints:
    """The frames at which unknown forces are taken to act.

    Args:
        model: any model.
        frames: names of the frames.

    Raises:
        FrameNotFoundError: a frame is not in the model.
        ObserverError: a frame is named twice, or fixed to the world.
    """

    def __init__(self, model: pin.Model, frames: Sequence[str]) -> None:
        """Look the frames up."""
        if len(set(frames)) != len(frames):
            raise ObserverError(f"force frames {list(frames)}: different names were expected")
        self.model = model
        self.data = model.createData()
        self.frames = tuple(frames)
        self._ids = [frame_id(model, name) for name in frames]
        self.weight: Array = np.full(model.nv, 1.0 / MOMENT_ARM)
        self.floating = bool(model.njoints > 1 and model.joints[1].nv == BASE)
        if self.floating:
            self.weight[:3] = 1.0
        self.table: Array = np.zeros((len(frames), 4))  # joint that carries the point; its place in the joint's frame
        self.support: Array = np.zeros((len(frames), model.nv))  # 1 where a velocity moves the point
        for i, index in enumerate(self._ids):
            frame = model.frames[index]
            if frame.parentJoint == 0:
                raise ObserverError(f"force frame '{frame.name}' is fixed to the world: a force there moves nothing")
            self.table[i] = frame.parentJoint, *frame.placement.translation
            joint = int(frame.parentJoint)
            while joint > 0:
                start = model.joints[joint].idx_v
                self.support[i, start : start + model.joints[joint].nv] = 1.0
                joint = int(model.parents[joint])

    def jacobian(self, q: Array) -> Array:
        """Return J (3n, nv): world velocities of the frames' origins per unit generalised velocity."""
        pin.computeJointJacobians(self.model, self.data, q)
        pin.updateFramePlacements(self.model, self.data)
        aligned = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
        rows = [pin.getFrameJacobian(self.model, self.data, i, aligned)[:3] for i in self._ids]
        return np.vstack([np.zeros((0, self.model.nv)), *rows])

    def identifiability(
        self, jacobians: Array, velocities: Array, rows: Rows = "all", samples: int = 64
    ) -> Identifiability:
        """Find the worst of up to `samples` instants, spread evenly over those of a run.

        Args:
            jacobians: (m, 3n, nv).
            velocities: (m, nv), whose joint part is the direction of the power row.
            rows: which rows of the generalised residual are believed.
            samples: how many instants to look at.
        """
        if not self.frames:
            return Identifiability(0, np.zeros(0), None)
        at = np.unique(np.linspace(0, len(jacobians) - 1, samples).astype(int))
        chosen = jacobians[at] * self.weight
        if rows != "all":
            believed = [chosen[:, :, :BASE]]
            if rows == "base+power":
                joint = velocities[at, BASE:]
                unit = joint / np.maximum(np.linalg.norm(joint, axis=1, keepdims=True), 1e-12)
                believed.append(chosen[:, :, BASE:] @ unit[:, :, None])
            chosen = np.concatenate(believed, axis=2)
        squares = np.linalg.eigvalsh(chosen @ np.swapaxes(chosen, 1, 2))  # quick, and exact enough to find the worst
        worst = int(np.argmin(squares[:, 0] / np.maximum(squares[:, -1], 1e-300)))
        _, values, vectors = np.linalg.svd(chosen[worst].T, full_matrices=True)
        values = np.concatenate([values, np.zeros(len(vectors) - len(values))])
        rank = int(np.sum(values > RANK_TOLERANCE * values[0]))
        return Identifiability(rank, values, None if rank == len(values) else vectors[-1].reshape(-1, 3))
