"""The rows of the generalised residual that an observer uses, and their weights.

Some rows are in N (translation of a free base, sliding joints) and all others in N m. To compare them, a moment is
divided by the lever arm `MOMENT_ARM`. If joint torques are not measured, the joint rows contain no information and are
not used.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
import pinocchio as pin

from aerobat_pin.errors import ObserverError
from aerobat_pin.numerics import Array
from aerobat_pin.observers.joints import has_free_base, row_names, serial_model

MOMENT_ARM = 0.05  # [m]
UNSEEN_SHARE = 1.0e-3  # part of a component in an unseen unit pattern from which it counts as unseen itself
BASE_ROWS = 6  # rows of a free-flyer base
TIED = 3  # integer by which the kernels identify tied rows
ROWS = ("all", "base", "base+power")  # a name's index is the integer by which the kernels identify it


@dataclass(frozen=True)
class Tie:
    """Coordinates assumed to move together, v = S v_s: an observer then uses only S^T times the residual.

    With p_s = S^T p and M_s = S^T M S the tied robot obeys p_s' = S^T (u + J^T f + C^T v - g). The paper ties the left
    wing to the right wing, which leaves eight of ten velocities. The tie is an assumption: generalised forces that
    would move the tied coordinates apart do not appear in S^T times the residual.

    Attributes:
        name: name of the tie, which appears in every result.
        map: the matrix S (nv, ns).
    """

    name: str
    map: Array


@dataclass(frozen=True, init=False)
class AllBut:
    """All rows but some: those whose known force is not to be believed, such as a rail's or an unsensed joint's.

    Args:
        names: names of joints (`rail`), of parts of joints with several rows (`ball.Mx`), `base`, or parts of the base
            (`base.Fx`, in body axes). Any force is considered possible in these rows.
    """

    names: tuple[str, ...]

    def __init__(self, *names: str) -> None:
        """Keep the names."""
        object.__setattr__(self, "names", names)

    def kept(self, model: pin.Model) -> list[int]:
        """Return the indices of the rows that are believed. Raises ObserverError for an unknown name or if none is."""
        rows, dropped = list(row_names(model)), set()
        for name in self.names:
            named = {row for row in rows if row == name or row.startswith(f"{name}.")}
            if not named:
                raise ObserverError(f"rows: no joint or part '{name}' in this model; there are {', '.join(rows)}")
            dropped |= named
        if len(dropped) == len(rows):
            raise ObserverError(f"rows: no row is left without {', '.join(self.names)}")
        return [i for i, row in enumerate(rows) if row not in dropped]


Rows = Literal["all", "base", "base+power"] | Tie | AllBut


def moving_weight(model: pin.Model) -> float:
    """Return the weight [N] of everything that moves: the physical scale of forces on a robot, gravity or not."""
    gravity = -float(pin.Model.gravity981[2])
    return gravity * float(sum(inertia.mass for inertia in model.inertias.tolist()[1:]))


def tie_joints(model: pin.Model, pairs: dict[str, str], name: str = "left-right") -> Tie:
    """Tie the second joint of every pair to the first, so that both have the same rate.

    Args:
        model: any model.
        pairs: joint -> the joint that moves with it, such as `{"left_shoulder": "right_shoulder"}`.
        name: name of the tie.

    Raises:
        ObserverError: a joint is not in the model, or moves with more than one degree of freedom.
    """
    model = serial_model(model)
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
    """The rows of the residual that an observer uses, in the form that kernels and identifiability need.

    Attributes:
        name: `all`, `base`, `base+power`, the name of a tie, or `all but` and names of rows.
        number: the integer by which the kernels identify this choice of rows.
        weight: (nv,) weights of the rows, 1 for forces and 1/`MOMENT_ARM` for moments.
        count: how many rows there are.
        tied: (nv, ns) matrix L for tied rows: L^T phi are their weighted sums, or the weighted rows that are left.
            Empty unless rows are tied or left out.
    """

    def __init__(self, model: pin.Model, rows: Rows) -> None:
        """Check the rows and compute their weights. Raises ObserverError if the model does not have these rows."""
        nv = int(model.nv)
        forces = np.array([unit == "N" for unit in row_names(model).values()])
        self.weight: Array = np.where(forces, 1.0, 1.0 / MOMENT_ARM)
        self.tied: Array = np.zeros((0, 0))
        self.rows = rows
        if isinstance(rows, Tie):
            if np.shape(rows.map)[:1] != (nv,) or not np.all(np.isfinite(rows.map)):
                raise ObserverError(f"tie {rows.name}: a finite map of {nv} rows was expected")
            self.name, self.number = rows.name, TIED
            norms = np.maximum(np.linalg.norm(rows.map, axis=0), 1e-12)
            self.tied = rows.map * np.where(np.any(rows.map[forces], axis=0), 1.0, 1.0 / MOMENT_ARM) / norms
        elif isinstance(rows, AllBut):
            self.name, self.number = f"all but {', '.join(rows.names)}", TIED
            self.tied = np.diag(self.weight)[:, rows.kept(model)]
        elif rows not in ROWS or (rows != "all" and not has_free_base(model)):
            raise ObserverError(
                f"rows = {rows!r}: a Tie, AllBut or one of {', '.join(ROWS)} was expected (fixed base: no {ROWS[1]})"
            )
        else:
            self.name, self.number = rows, ROWS.index(rows)
        self.count = self.map(np.zeros(nv)).shape[1]

    def map(self, velocity: Array) -> Array:
        """Return L (nv, k) such that L^T phi are the weighted rows in use; `velocity` (nv,) gives the power row."""
        if self.number == TIED:
            return self.tied
        diagonal: Array = np.diag(self.weight)
        if self.rows == "all":
            return diagonal
        base: Array = diagonal[:, :BASE_ROWS]
        if self.rows == "base":
            return base
        along = np.zeros((len(velocity), 1))
        joints = velocity[BASE_ROWS:]
        speed = float(np.linalg.norm(joints / (MOMENT_ARM * self.weight[BASE_ROWS:])))
        along[BASE_ROWS:, 0] = joints / max(speed, 1e-12) / MOMENT_ARM
        return np.concatenate([base, along], axis=1)
