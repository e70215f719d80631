"""What C^T v and its derivative by v need of the robot; `noisy_sample` has the equations."""

from __future__ import annotations

import ctypes

import numpy as np
import pinocchio as pin

from aerobat_pin.numerics import DOUBLE, Integers

INERTIA_SIZE = 10  # number of doubles: mass, lever, moments of inertia xx, xy, yy, xz, yz, zz
ABOVE, BELOW = 1, 2  # of a velocity: it moves the joint of another one; the other one moves it, and not the reverse


def kinship_of(model: pin.Model) -> Integers:
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


def inertias_at(model: pin.Model, data: pin.Data) -> int:
    """Return the address of what `crba` in the world's convention leaves in `data`: the inertias of the subtrees.

    They are `INERTIA_SIZE` numbers for each joint, in world axes about the world's origin.

    Raises:
        RuntimeError: they do not lie in memory as this version expects.
    """
    pin.crba(
        model, data, pin.integrate(model, pin.neutral(model), np.linspace(0.1, 0.4, model.nv)), pin.Convention.WORLD
    )
    first, count = int(data.oYcrb[0].lever.ctypes.data) - DOUBLE, int(model.njoints)
    seen = np.reshape((ctypes.c_double * (count * INERTIA_SIZE)).from_address(first), (count, INERTIA_SIZE))
    for joint in range(1, count):
        one = data.oYcrb[joint]
        moments = one.inertia[[0, 0, 1, 0, 1, 2], [0, 1, 1, 2, 2, 2]]
        if not np.array_equal(seen[joint], [one.mass, *one.lever, *moments]):
            raise RuntimeError("Pinocchio's inertias do not lie in memory as this version expects")
    return first
