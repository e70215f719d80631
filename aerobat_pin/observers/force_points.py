"""From a generalised force to point forces: where they act, and how much of them can be known.

Forces f in world axes at the origins of n frames make J^T f, J the stacked translational Jacobians (3n, nv). Rows of
J^T mix N (base translation) and N m (everything else); moments are weighed as forces at a lever of `MOMENT_ARM`, and

    f = argmin |W (phi - J^T f)|^2 + damping |f|^2
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pinocchio as pin

from aerobat_pin.arrays import Array
from aerobat_pin.errors import ObserverError
from aerobat_pin.frames import frame_id

MOMENT_ARM = 0.05  # [m]
DAMPING = 1.0e-12  # of the largest squared singular value
RANK_TOLERANCE = 1.0e-6  # of the largest singular value


class ForcePoints:
    """The frames at which unknown forces are taken to act.

    Args:
        model: any model.
        frames: names of the frames, at least one.

    Raises:
        FrameNotFoundError: a frame is not in the model.
        ObserverError: no frame, or one twice.
    """

    def __init__(self, model: pin.Model, frames: Sequence[str]) -> None:
        """Look the frames up."""
        if not frames or len(set(frames)) != len(frames):
            raise ObserverError(f"force frames {list(frames)}: one or more different names were expected")
        self.model = model
        self.data = model.createData()
        self.frames = tuple(frames)
        self._ids = [frame_id(model, name) for name in frames]
        self._weight = np.full(model.nv, 1.0 / MOMENT_ARM)
        if model.njoints > 1 and model.joints[1].nv == 6:
            self._weight[:3] = 1.0

    def jacobian(self, q: Array) -> Array:
        """Return J (3n, nv): world velocities of the frames' origins per unit generalised velocity."""
        pin.computeJointJacobians(self.model, self.data, q)
        pin.updateFramePlacements(self.model, self.data)
        aligned = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
        return np.vstack([pin.getFrameJacobian(self.model, self.data, i, aligned)[:3] for i in self._ids])

    def project(self, q: Array, generalized: Array) -> Array:
        """Return the forces (n, 3) [N] in world axes that explain a generalised force (nv,) best at q."""
        weighted = self.jacobian(q) * self._weight
        normal = weighted @ weighted.T
        normal.flat[:: len(normal) + 1] += DAMPING * np.trace(normal)
        return np.asarray(np.linalg.solve(normal, weighted @ (self._weight * generalized)).reshape(-1, 3))

    def singular_values(self, q: Array) -> tuple[Array, Array]:
        """Return singular values (3n,) of W J^T at q, largest first, and right singular vectors (3n, 3n) as rows."""
        _, values, vectors = np.linalg.svd((self.jacobian(q) * self._weight).T, full_matrices=True)
        padded = np.zeros(vectors.shape[0])
        padded[: len(values)] = values
        return padded, vectors
