"""A stretch of a record at common times: what robots and observers are given, or a robot finds by itself."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from aerobat_pin.numerics import Array
from aerobat_pin.observers import Estimate


@dataclass(frozen=True)
class Block:
    """A stretch of a record at common times, ready for an observer.

    Attributes:
        time: (m + 1,) [s].
        q: (m + 1, nq) configurations.
        v: (m + 1, nv) velocities.
        tau: (m, nv) measured joint torques, interval means.
        extra: name -> samples (m + 1, ...) or interval means (m, ...) of what only the robot itself reads.
        measured: keys of the channels that the record has, such as `base.velocity`.
        source: quantity -> `measured`, `reconstructed` or `believed`, of what the robot completed.
    """

    time: Array
    q: Array
    v: Array
    tau: Array
    extra: Mapping[str, Array] = field(default_factory=dict)
    measured: frozenset[str] = frozenset()
    source: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class SmoothedMotion:
    """Motion and forces that a robot found together, from channels that are each on a clock of its own.

    Attributes:
        block: the motion, and the joint torques.
        known: name -> (m, nv) known generalised forces, interval means.
        estimates: observer -> estimate.
    """

    block: Block
    known: Mapping[str, Array]
    estimates: Mapping[str, Estimate]
