"""Which rows of the generalised residual an observer believes, and how it weighs them.

Rows mix N (translation of a free base) and N m (everything else); a moment counts as a force at a lever of
`MOMENT_ARM`. Where joint torques are not measured, the joint rows say nothing.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
import pinocchio as pin

from aerobat_pin.errors import ObserverError
from aerobat_pin.numerics import Array

MOMENT_ARM = 0.05  # [m]
BASE_ROWS = 6  # rows of a free-flyer base
TIED = 3  # the kernels' number of tied rows
Rows = Literal["all", "base", "base+power"]
ROWS = ("all", "base", "base+power")  # in the order of the kernels' numbers


@dataclass(frozen=True)
class Tie:
    """Coordinates moved together, v = S v_s: only S^T times the residual is believed.

    With p_s = S^T p and M_s = S^T M S the tied robot obeys p_s' = S^T (u + J^T f + C^T v - g). The paper ties left and
    right wing, ten velocities to eight. This is an assumption: what forces do against the tie cannot be seen.

    Attributes:
        name: that every result carries.
        map: S (nv, ns).
    """

    name: str
    map: Array


def tie_joints(model: pin.Model, pairs: dict[str, str], name: str = "left-right") -> Tie:
    """Tie the second joint of every pair to the first: equal rates.

    Args:
        model: any model.
        pairs: joint -> the joint that moves with it, such as `{"left_shoulder": "right_shoulder"}`.
        name: of the tie.

    Raises:
        ObserverError: a joint is not in the model, or moves with more than one degree of freedom.
    """
    for joint in [*pairs, *pairs.values()]:
        if not model.existJointName(joint) or model.joints[model.getJointId(joint)].nv != 1:
            raise ObserverError(f"tie {name}: '{joint}' is not a joint of one degree of freedom of this model")
    at = {joint: model.joints[model.getJointId(joint)].idx_v for joint in [*pairs, *pairs.values()]}
    kept = [i for i in range(model.nv) if i not in {at[joint] for joint in pairs.values()}]
    S = np.zeros((model.nv, len(kept)))
    S[kept, range(len(kept))] = 1.0
    for first, second in pairs.items():
        S[at[second], kept.index(at[first])] = 1.0
    return Tie(name, S)


class BelievedRows:
    """The rows an observer believes, as the kernels and the identifiability take them.

    Attributes:
        name: `all`, `base`, `base+power`, or the name of a tie.
        number: the kernels' number for it.
        weight: (nv,) of the rows, 1 for forces and 1/`MOMENT_ARM` for moments.
        metric: (nv, nv) W with phi . W phi the weighted square of what is believed of phi, for tied rows.
    """

    def __init__(self, model: pin.Model, rows: Rows | Tie) -> None:
        """Check and weigh. Raises ObserverError for rows that the model does not have."""
        nv = int(model.nv)
        floating = bool(model.njoints > 1 and model.joints[1].nv == BASE_ROWS)
        self.weight: Array = np.full(nv, 1.0 / MOMENT_ARM)
        if floating:
            self.weight[:3] = 1.0
        self.metric: Array = np.zeros((0, 0))
        self.rows = rows
        if isinstance(rows, Tie):
            if np.shape(rows.map)[:1] != (nv,) or not np.all(np.isfinite(rows.map)):
                raise ObserverError(f"tie {rows.name}: a finite map of {nv} rows was expected")
            self.name, self.number = rows.name, TIED
            norms = np.maximum(np.linalg.norm(rows.map, axis=0), 1e-12)
            forces = np.abs(rows.map[:3]).sum(axis=0) > 0.0 if floating else np.zeros(len(norms), bool)
            self._tied: Array = rows.map * np.where(forces, 1.0, 1.0 / MOMENT_ARM) / norms
            self.metric = self._tied @ self._tied.T
        elif rows not in ROWS or (rows != "all" and not floating):
            raise ObserverError(f"rows = {rows!r}: a Tie, or one of {', '.join(ROWS)}; all on a fixed base")
        else:
            self.name, self.number = rows, ROWS.index(rows)

    def map(self, velocity: Array) -> Array:
        """Return L (nv, k): L^T phi are the weighted rows believed, at a velocity (nv,) for the power row."""
        if isinstance(self.rows, Tie):
            return self._tied
        diagonal: Array = np.diag(self.weight)
        if self.rows == "all":
            return diagonal
        base: Array = diagonal[:, :BASE_ROWS]
        if self.rows == "base":
            return base
        along = np.zeros((len(velocity), 1))
        joints = velocity[BASE_ROWS:]
        along[BASE_ROWS:, 0] = joints / max(float(np.linalg.norm(joints)), 1e-12) / MOMENT_ARM
        return np.concatenate([base, along], axis=1)
