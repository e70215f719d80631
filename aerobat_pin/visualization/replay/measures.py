"""Sizes that a replay needs: the box around a visible part, and round numbers for scales."""

from __future__ import annotations

import itertools

import numpy as np
import pinocchio as pin

from aerobat_pin.numerics import Array

UNBOUNDED = 1e3  # [m]: a larger shape is treated as infinite, such as a plane


def box_corners(part: pin.GeometryObject) -> Array:
    """Return the corners (8, 3) of a part's bounding box in the part's axes [m]; all zero for an infinite shape."""
    part.geometry.computeLocalAABB()
    box = part.geometry.aabb_local
    ends = np.array([box.min_, box.max_]) * part.meshScale
    if not np.all(np.abs(ends) < UNBOUNDED):
        ends = np.zeros((2, 3))
    return np.array(list(itertools.product(*ends.T)))


def round_number_above(value: float) -> float:
    """Return the smallest number that is 1, 2 or 5 times a power of ten and not smaller than the value."""
    power = 10.0 ** np.floor(np.log10(value))
    return float(next(digit * power for digit in (1.0, 2.0, 5.0, 10.0) if digit * power >= value * (1.0 - 1e-9)))
