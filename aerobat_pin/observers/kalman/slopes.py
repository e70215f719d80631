"""Where the kernels find what the derivative of C^T v by the velocity v needs; `noisy_sample` has the equations."""

from __future__ import annotations

import ctypes

import numpy as np
import pinocchio as pin

from aerobat_pin.numerics import DOUBLE, Integers, addresses, motions

INERTIA_SIZE = 10  # number of doubles: mass, lever, moments of inertia xx, xy, yy, xz, yz, zz
ABOVE, BELOW = 1, 2  # of a velocity: it moves the joint of another one; the other one moves it, and not the reverse


def tree_of(model: pin.Model) -> Integers:
    """Return a table (nv, nv + 1): the joint of each velocity, then how each other velocity stands to it.

    That is `ABOVE` if the other one moves the joint, `BELOW` if it is in a joint further out, else 0.
    """
    nv, joint = int(model.nv), np.zeros(int(model.nv), np.intp)
    for one in model.joints.tolist()[1:]:
        joint[one.idx_v : one.idx_v + one.nv] = one.id
    supports = [set(support.tolist()) for support in model.supports.tolist()]
    table = np.zeros((nv, nv + 1), np.intp)
    table[:, 0] = joint
    for k in range(nv):
        for other in range(nv):
            if joint[other] in supports[joint[k]]:
                table[k, 1 + other] = ABOVE
            elif joint[k] in supports[joint[other]]:
                table[k, 1 + other] = BELOW
    return table


def subtree_places(model: pin.Model, data: pin.Data) -> Integers:
    """Return addresses of what `computeCoriolisMatrix` leaves in `data`, all in world axes about the origin.

    That is the twists of the joints (6 each); the inertias of the subtrees (`INERTIA_SIZE` each); and, with a column
    (6,) for each velocity, the rates of the Jacobian's columns, and the subtree's inertia times these columns.

    Raises:
        RuntimeError: the inertias do not lie in memory as this version expects.
    """
    q, v = pin.integrate(model, pin.neutral(model), np.linspace(0.1, 0.4, model.nv)), np.linspace(-0.3, 0.2, model.nv)
    pin.computeCoriolisMatrix(model, data, q, v)
    twists, first = motions(data.ov), data.oYcrb[0].lever.ctypes.data - DOUBLE
    count = int(model.njoints)
    seen = np.reshape((ctypes.c_double * (count * INERTIA_SIZE)).from_address(first), (count, INERTIA_SIZE))
    for joint in range(1, count):
        one = data.oYcrb[joint]
        moments = one.inertia[[0, 0, 1, 0, 1, 2], [0, 1, 1, 2, 2, 2]]
        right = np.array_equal(seen[joint], [one.mass, *one.lever, *moments])
        if not right or not np.array_equal(twists[joint], data.ov[joint].vector):
            raise RuntimeError("Pinocchio's inertias do not lie in memory as this version expects")
    twist_at, rate_at, carried_at = addresses(twists[0], data.dJ, data.Ag)
    return np.array([twist_at, first, rate_at, carried_at], np.intp)
