"""What hangs on the linkage and follows it when it changes: the joints' limits and the length of the proximal panel."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from aerobat_description.morphology_tables import Joints, LinkageLengths, WingShape
from aerobat_description.position_closure import ClosureError, elbow, reach
from aerobat_description.reading import MorphologyError, build, merge

LIMIT_MARGIN = 0.1  # [rad] from what the linkage reaches to a limit that follows it


def laid_over(values: Mapping[str, Any], changes: Mapping[str, Any]) -> dict[str, Any]:
    """Return a morphology's nested values with changes laid over them, and with what follows a changed linkage.

    Limits widen to what the linkage reaches plus `LIMIT_MARGIN` where they are narrower; the proximal stations stretch
    with the distance of the elbow. Keys that the changes state themselves keep their values. Values that no robot can
    have stay too: building the robot refuses them with the reason.
    """
    merged = merge(values, changes)
    if "linkage" not in changes:
        return merged
    try:
        before, after = (build(LinkageLengths, tables["linkage"], "linkage") for tables in (values, merged))
        joints, wing = build(Joints, merged["joints"], "joints"), build(WingShape, merged["wing"], "wing")
        reached = reach(after)
    except (KeyError, MorphologyError, ClosureError):
        return merged
    own = changes.get("joints", {}), changes.get("wing", {})
    limits = {f"{joint}_limits": (low - LIMIT_MARGIN, high + LIMIT_MARGIN) for joint, (low, high) in reached.items()}
    wide = {key: _union(getattr(joints, key), pair) for key, pair in limits.items() if key not in own[0]}
    stretch = abs(elbow(after)) / abs(elbow(before))
    stations = {"proximal_stations": [stretch * y for y in wing.proximal_stations]}
    return merge(merged, {"joints": wide, "wing": {} if "proximal_stations" in own[1] else stations})


def _union(first: tuple[float, float], second: tuple[float, float]) -> tuple[float, float]:
    return min(first[0], second[0]), max(first[1], second[1])
