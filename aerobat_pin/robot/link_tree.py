"""The five links in a Pinocchio model, as tables that kernels walk along."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pinocchio as pin

from aerobat_pin.numerics import Array, Integers
from aerobat_pin.robot.aerobat import JOINTS
from aerobat_pin.robot.wing import LINKS


class Tree(NamedTuple):
    """The five links in the order of `LINKS`.

    `table` (5, 4): Pinocchio joint, parent link, first velocity, 0 shoulder or 1 elbow. `axis` (5, 3): joint axes.
    """

    table: Integers
    axis: Array


def tree_of(model: pin.Model) -> Tree:
    """Find the links in a model."""
    table: list[tuple[int, ...]] = []
    axis = [np.zeros(3)]
    for i, link in enumerate(LINKS):
        joint = model.frames[model.getFrameId(link)].parentJoint
        parents = [k for k, row in enumerate(table) if row[0] == model.parents[joint]]
        which = JOINTS.index(model.names[joint]) % 2 if i else 0
        table.append((joint, parents[0] if parents else -1, model.joints[joint].idx_v, which))
        if i:
            neutral = model.joints[joint].createData()
            model.joints[joint].calc(neutral, np.zeros(1))
            axis.append(np.ravel(neutral.S)[3:])
    return Tree(np.array(table), np.array(axis))
