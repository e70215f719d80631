"""What hangs on the linkage and follows it when it changes: the joints' limits and the length of the proximal panel."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from aerobat_description.closure import ClosureError, elbow, reach
from aerobat_description.reading import MorphologyError, build, merge
from aerobat_description.sections import Joints, LinkageLengths, WingShape

MARGIN = 0.1  # [rad] from what the linkage reaches to a limit that follows it


def laid_over(values: Mapping[str, Any], changes: Mapping[str, Any]) -> dict[str, Any]:
    """Return a morphology's nested values with changes laid over them, and with what follows a changed linkage.

    Limits are widened, where they must, to what the linkage reaches and `MARGIN`; the proximal stations are stretched
    with the distance of the elbow. What the changes state themselves stays, and so do values that no robot can have:
    they are refused, with the reason, where the robot is built.
    """
    merged = merge(values, changes)
    if "linkage" not in changes:
        return merged
    try:
        before, after = (build(LinkageLengths, one["linkage"], "linkage") for one in (values, merged))
        joints, wing = build(Joints, merged["joints"], "joints"), build(WingShape, merged["wing"], "wing")
        reached = reach(after)
    except (KeyError, MorphologyError, ClosureError):
        return merged
    own = changes.get("joints", {}), changes.get("wing", {})
    limits = {f"{joint}_limits": (low - MARGIN, high + MARGIN) for joint, (low, high) in reached.items()}
    wide = {key: _union(getattr(joints, key), pair) for key, pair in limits.items() if key not in own[0]}
    stretch = abs(elbow(after)) / abs(elbow(before))
    stations = {"proximal_stations": [stretch * y for y in wing.proximal_stations]}
    return merge(merged, {"joints": wide, "wing": {} if "proximal_stations" in own[1] else stations})


def _union(one: tuple[float, float], other: tuple[float, float]) -> tuple[float, float]:
    return min(one[0], other[0]), max(one[1], other[1])
