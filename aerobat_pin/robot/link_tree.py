"""The five links of a Pinocchio model, as tables for compiled kernels."""

from __future__ import annotations

from typing import Annotated, NamedTuple

import numpy as np
import pinocchio as pin

from aerobat_pin.numerics import Array, Integers, guarded
from aerobat_pin.robot.aerobat import JOINTS
from aerobat_pin.robot.wing import LINKS


class Tree(NamedTuple):
    """The five links in the order of `LINKS`.

    For each link: index of its `joint` in Pinocchio (5,); index of its `parent` link (5,), -1 for the body; first `row`
    of its joint in v (5,); `angle` (5,), 0 if the joint is a shoulder and 1 if it is an elbow; `axis` (5, 3) of its
    joint in the link's frame.
    """

    joint: Annotated[Integers, "link_count"]
    parent: Annotated[Integers, "link_count"]
    row: Annotated[Integers, "link_count"]
    angle: Annotated[Integers, "link_count"]
    axis: Annotated[Array, "link_count, 3"]


@guarded()
def tree_of(model: pin.Model) -> Tree:
    """Return the tree of the five links in a model."""
    joints = [model.frames[model.getFrameId(link)].parentJoint for link in LINKS]
    axis = np.zeros((len(LINKS), 3))
    for link, joint in enumerate(joints[1:], 1):
        neutral = model.joints[joint].createData()
        model.joints[joint].calc(neutral, np.zeros(1))
        axis[link] = np.ravel(neutral.S)[3:]
    return Tree(
        joint=np.array(joints),
        parent=np.array([-1, *(joints.index(model.parents[joint]) for joint in joints[1:])]),
        row=np.array([model.joints[joint].idx_v for joint in joints]),
        angle=np.array([0, *(JOINTS.index(model.names[joint]) % 2 for joint in joints[1:])]),
        axis=axis,
    )
