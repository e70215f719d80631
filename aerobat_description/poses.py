"""Compute the reference configurations of the SRDF: named sets of joint angles."""

from __future__ import annotations

import cmath
import itertools

from aerobat_description.morphology import Morphology
from aerobat_description.position_closure import Pose, turn


def poses(morphology: Morphology) -> dict[str, tuple[float, float]]:
    """Return the reference configurations: name -> (shoulder angle, elbow angle) [rad], equal on both sides.

    In `neutral` both angles are zero: the wing is spread flat, which the linkage does not allow. The linkage reaches
    all others: in `glide` the tips are farthest from the body, in `folded` nearest to it, and in `mid_downstroke` and
    `mid_upstroke` the shoulder angle is halfway between its extremes.
    """
    cycle = turn(morphology.linkage)
    tip = morphology.wing.distal_stations[-1]

    def reach(pose: Pose) -> float:
        return (pose.pins["J6"] + cmath.rect(tip, pose.angles["L7"])).real

    angles = [pose.theta_s for pose in cycle]
    middle = 0.5 * (min(angles) + max(angles))
    after = list(itertools.pairwise([*cycle, cycle[0]]))
    found = {
        "glide": max(cycle, key=reach),
        "mid_downstroke": next(a for a, b in after if a.theta_s >= middle > b.theta_s),
        "mid_upstroke": next(a for a, b in after if a.theta_s <= middle < b.theta_s),
        "folded": min(cycle, key=reach),
    }
    return {"neutral": (0.0, 0.0)} | {name: (pose.theta_s, pose.theta_e) for name, pose in found.items()}
