"""When the linkage changes, adapt what depends on it: the limits of the joints and the length of the proximal panel."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from aerobat_description.morphology_tables import Joints, LinkageLengths, WingShape
from aerobat_description.position_closure import ClosureError, elbow, reach
from aerobat_description.reading import MorphologyError, build, merge

LIMIT_MARGIN = 0.1  # [rad] between the linkage's range and an adapted limit


def laid_over(values: Mapping[str, Any], changes: Mapping[str, Any]) -> dict[str, Any]:
    """Return the nested values of a morphology with changes laid over them, and adapted to a changed linkage.

    Joint limits that are narrower than the linkage's range plus `LIMIT_MARGIN` are widened to it. The proximal stations
    are stretched with the distance from shoulder to elbow. Keys that `changes` contains are not adapted. Values that no
    robot can have are kept; building the robot then raises an error that explains them.
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
