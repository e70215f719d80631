"""The five links of a Pinocchio model for kernels: tree, placements, motion relative to the air, force of wrenches."""

from __future__ import annotations

from typing import Annotated, NamedTuple

import numpy as np
import pinocchio as pin

from aerobat_pin.aerobat.aerobat import JOINTS
from aerobat_pin.aerobat.wing import LINKS
from aerobat_pin.numerics import ELSEWHERE, Array, Integers, copy_values, guarded, in_outer_axes, inner, kernel


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


class PinocchioResults(NamedTuple):
    """Views of Pinocchio's results in a `pin.Data`.

    Inertia `M` (nv, nv), bias `nle` (nv,), joint placements `liMi` (njoints, 12) as rotation by columns, then
    translation, joint twists `v` (njoints, 6), and accelerations `a_gf` (njoints, 6), which include gravity.
    """

    M: Annotated[Array, "nv, nv", ELSEWHERE]
    nle: Annotated[Array, "nv", ELSEWHERE]
    liMi: Annotated[Array, "joints, 12", ELSEWHERE]
    v: Annotated[Array, "joints, 6", ELSEWHERE]
    a_gf: Annotated[Array, "joints, 6", ELSEWHERE]


class Links(NamedTuple):
    """The five links at one instant.

    `rotation` (5, 3, 3) and `origin` (5, 3) place the links in the body's frame. `twists` (5, 6) relative to the air
    and `wrenches` (5, 6) from the air are both at the origin and in the axes of each link's frame. Vectors (3,) in body
    axes: `gravity_B`, gravitational acceleration with its sign reversed (upward), `wind_B`, the wind velocity, and
    `wind_rate_B`, its rate of change. `normals` (3, 8) is a scratch array of `add_mass`: three rows, with columns for
    the six base velocities, the link's joint and the parent's joint, in this order.
    """

    rotation: Annotated[Array, "link_count, 3, 3"]
    origin: Annotated[Array, "link_count, 3"]
    twists: Annotated[Array, "link_count, 6"]
    wrenches: Annotated[Array, "link_count, 6"]
    gravity_B: Annotated[Array, "3"]
    wind_B: Annotated[Array, "3"]
    wind_rate_B: Annotated[Array, "3"]
    normals: Annotated[Array, "3, 8"]


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


@kernel
def climb(tree: Tree, liMi: Array, wrenches: Array, force: Array) -> None:
    """Write the generalised force (nv,), the sum of J^T f over all links, from the wrenches f (5, 6) on the links.

    Each wrench is added to that of the parent link, so `wrenches` is overwritten.
    """
    joint_of, parent_of, row_of, axis = tree.joint, tree.parent, tree.row, tree.axis
    for link in range(joint_of.shape[0] - 1, 0, -1):
        joint, parent, row = joint_of[link], parent_of[link], row_of[link]
        wrench = wrenches[link]
        fx, fy, fz, mx, my, mz = wrench[0], wrench[1], wrench[2], wrench[3], wrench[4], wrench[5]
        force[row] = axis[link, 0] * mx + axis[link, 1] * my + axis[link, 2] * mz
        P = liMi[joint]
        gx, gy, gz = in_outer_axes(P, fx, fy, fz)
        tx, ty, tz = in_outer_axes(P, mx, my, mz)
        up = wrenches[parent]
        up[0] += gx
        up[1] += gy
        up[2] += gz
        up[3] += tx + P[10] * gz - P[11] * gy
        up[4] += ty + P[11] * gx - P[9] * gz
        up[5] += tz + P[9] * gy - P[10] * gx
    base = row_of[0]
    copy_values(wrenches[0], force[base : base + 6])


@kernel
def chain(tree: Tree, liMi: Array, rotation: Array, origin: Array) -> None:
    """Write the rotations (5, 3, 3) from link axes to body axes, and the links' origins (5, 3) in the body's frame."""
    joint_of, parent_of = tree.joint, tree.parent
    for i in range(3):
        origin[0, i] = 0.0
        for j in range(3):
            rotation[0, i, j] = 1.0 if i == j else 0.0
    for link in range(1, joint_of.shape[0]):
        P, parent = liMi[joint_of[link]], parent_of[link]
        for i in range(3):
            a, b, c = rotation[parent, i, 0], rotation[parent, i, 1], rotation[parent, i, 2]
            origin[link, i] = origin[parent, i] + a * P[9] + b * P[10] + c * P[11]
            for j in range(3):
                rotation[link, i, j] = a * P[3 * j] + b * P[1 + 3 * j] + c * P[2 + 3 * j]


@inner
def place_links(tree: Tree, results: PinocchioResults, gravity: Array, wind: Array, links: Links) -> None:
    """Write placements of the links, their twists relative to the air, and gravity and wind in body axes.

    Args:
        tree: tree of the links.
        results: Pinocchio's placements and twists.
        gravity: () gravitational acceleration, positive downward [m/s2].
        wind: (2, 3) wind velocity and its rate of change, world axes.
        links: all fields except `wrenches` and `normals` are written.
    """
    chain(tree, results.liMi, links.rotation, links.origin)
    joint, v, rotation, twists = tree.joint, results.v, links.rotation, links.twists
    gravity_B, wind_B, wind_rate_B = links.gravity_B, links.wind_B, links.wind_rate_B
    body = results.liMi[joint[0]]
    for i in range(3):
        x, y, z = body[3 * i], body[3 * i + 1], body[3 * i + 2]
        gravity_B[i] = gravity[()] * z
        wind_B[i] = x * wind[0, 0] + y * wind[0, 1] + z * wind[0, 2]
        wind_rate_B[i] = x * wind[1, 0] + y * wind[1, 1] + z * wind[1, 2]
    for link in range(joint.shape[0]):
        R, twist = rotation[link], twists[link]
        copy_values(v[joint[link]], twist)
        for i in range(3):
            twist[i] -= R[0, i] * wind_B[0] + R[1, i] * wind_B[1] + R[2, i] * wind_B[2]
