"""Wrenches on joints as generalised forces, by Pinocchio's Jacobians."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pinocchio as pin


def generalized_force(model: pin.Model, data: pin.Data, fext: Mapping[int, np.ndarray]) -> np.ndarray:
    """Return sum J^T f (nv,) of joint wrenches (6,) in joint axes.

    Args:
        model: any model.
        data: its data, after `computeJointJacobians`.
        fext: joint index -> wrench (6,) about the joint's origin in the joint's axes.
    """
    force = np.zeros(model.nv)
    for joint, wrench in fext.items():
        force += pin.getJointJacobian(model, data, joint, pin.ReferenceFrame.LOCAL).T @ wrench
    return force
