"""Frames and forces: from a wrench at a named frame to Pinocchio's `fext` and to a generalised force."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from aerobat_pin.numerics import Array, frame_id, guarded


@guarded(wrench=(6,))
def joint_wrench(
    model: pin.Model, data: pin.Data, frame: str, wrench: ArrayLike, reference_frame: pin.ReferenceFrame
) -> tuple[int, pin.Force]:
    """Express a wrench given at a frame at the joint that carries the frame, in joint axes, as `fext` requires.

    Args:
        model: any Pinocchio model.
        data: data of the model after `forwardKinematics`; `oMi` is read.
        frame: name of the frame.
        wrench: (6,) force [N] and moment [N m]. LOCAL: frame axes, about the frame's origin; LOCAL_WORLD_ALIGNED:
            world axes, about the frame's origin; WORLD: world axes, about the world's origin.
        reference_frame: LOCAL, LOCAL_WORLD_ALIGNED or WORLD.

    Returns:
        Index of the joint, and the wrench about the joint's origin in the joint's axes.

    Raises:
        FrameNotFoundError: the model has no such frame.
        ShapeError: the wrench is not six finite numbers.
    """
    force = pin.Force(np.asarray(wrench, float))
    item = model.frames[frame_id(model, frame)]
    joint = int(item.parentJoint)
    placement = data.oMi[joint] * item.placement
    if reference_frame == pin.ReferenceFrame.LOCAL:
        local = force
    elif reference_frame == pin.ReferenceFrame.LOCAL_WORLD_ALIGNED:
        local = pin.SE3(placement.rotation, np.zeros(3)).actInv(force)
    else:
        local = placement.actInv(force)
    return joint, item.placement.act(local)


def rotation_matrices(quaternions: Array) -> Array:
    """Return the matrices (m, 3, 3), body to world, of unit quaternions (m, 4) x, y, z, w."""
    x, y, z, w = quaternions.T
    rows = [
        [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)],
        [2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)],
        [2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)],
    ]
    return np.moveaxis(np.array(rows), -1, 0)


@guarded(q=("m", "nq"))
def rotations(q: Array) -> Array:
    """Return the base's rotation matrices (m, 3, 3), body to world, for configurations (m, nq)."""
    return rotation_matrices(q[:, 3:7])


@guarded()
def external_forces(model: pin.Model, wrenches: Iterable[tuple[int, pin.Force]]) -> list[pin.Force]:
    """Collect joint wrenches into the `fext` list of `pin.rnea` and `pin.aba`; wrenches on the same joint are added."""
    fext = [pin.Force.Zero() for _ in range(model.njoints)]
    for joint, wrench in wrenches:
        fext[joint] += wrench
    return fext


@guarded(q=("m", "nq"))
def euler_angles(q: Array) -> Array:
    """Return roll, pitch (nose up is positive) and yaw (m, 3) [rad] for configurations (m, nq)."""
    R = rotations(q)
    up = np.hypot(R[:, 2, 1], R[:, 2, 2])
    return np.stack(
        [np.arctan2(R[:, 2, 1], R[:, 2, 2]), np.arctan2(R[:, 2, 0], up), np.arctan2(R[:, 1, 0], R[:, 0, 0])], axis=1
    )


@guarded(q=("m", "nq"), v=("m", "nv"))
def world_velocity(q: Array, v: Array) -> Array:
    """Return the base's velocity in world axes (m, 3) [m/s] for q (m, nq) and v (m, nv)."""
    return np.asarray(np.einsum("mij,mj->mi", rotations(q), v[:, :3]))
