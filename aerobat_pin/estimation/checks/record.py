"""What the checks take from a record, once: its channels, and its motion at common times."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from aerobat_pin.estimation.checks.attitude import Reading
from aerobat_pin.estimation.checks.motion import MeasuredMotion, motion_findings
from aerobat_pin.estimation.checks.samples import sample_findings
from aerobat_pin.estimation.findings import Finding
from aerobat_pin.numerics import Array
from aerobat_pin.records import (
    Map,
    QuaternionSection,
    Record,
    as_attitude,
    body_turn,
    sampled_turns,
    world_turn,
)

MOST_SAMPLES = 60_000  # that are compared: the longest used part, or its beginning


def record_findings(record: Record) -> Iterator[Finding]:
    """Yield what a record shows of itself before any force is known: samples, motion, and what its robot knows."""
    yield from sample_findings(record)
    time = record.times(*checked_part(record))
    rising = np.diff(time, prepend=-np.inf) > 0.0  # a log's own times can repeat

    def measured(key: str) -> Array | None:
        return record.at(key, time)[rising] if key in record.channels else None

    yield from motion_findings(measured_motion(record, time, rising), record.robot.agreements(time[rising], measured))


def checked_part(record: Record) -> tuple[int, int]:
    """Return the longest used part, or its beginning: first and last index of the common times."""
    first, last = max(record.parts, key=lambda part: part[1] - part[0])
    return first, min(last, first + MOST_SAMPLES)


def measured_motion(record: Record, every: Array, rows: NDArray[np.bool_]) -> MeasuredMotion:
    """Return what was measured of a record's motion, at those of some common times that `rows` chooses."""
    chosen, channels = record.map, record.channels

    def rotated(key: str, turn: Array) -> Array | None:
        return record.at(key, every)[rows] @ (turn @ _turn_of(record, key)).T if key in channels else None

    motion = MeasuredMotion(every[rows], weight=record.robot.weight, gravity=chosen.robot.gravity)
    if record.joints and "joints.velocity" in channels:
        motion = replace(
            motion,
            joints=record.joints,
            angles=record.at("joints.position", every)[rows],
            rates=record.at("joints.velocity", every)[rows],
            slides=tuple(record.robot.slides(joint) for joint in record.joints),
        )
    if not record.robot.free or chosen.base.held:
        return motion
    in_world, rate = set(), chosen.base.rate
    speed = chosen.base.velocity
    if speed is not None and speed.axes == "world" and "base.velocity" in channels and not record.twist_of_topic:
        in_world.add("velocity")
    if rate is not None and rate.columns and rate.axes == "world":
        in_world.add("gyro")
    body, world = body_turn(chosen), world_turn(chosen)
    if channels["base.quaternion"].time is record.knots:
        turns = record.at("base.quaternion", every)
    else:
        turns = sampled_turns(*record.cut("base.quaternion", every), every)
    return replace(
        motion,
        position=rotated("base.position", world),
        attitudes={reading: _read_as(chosen, reading, turns[rows]) for reading in _readings(chosen)},
        velocity=rotated("base.velocity", world if "velocity" in in_world else body),
        gyro=rotated("base.rate", world if "gyro" in in_world else body),
        specific_force=rotated("check.specific_force", body),
        in_world=frozenset(in_world),
    )


def _turn_of(record: Record, key: str) -> Array:
    """Return the rotation (3, 3) from the axes of a sensor on the body to those whose attitude is measured."""
    if key not in ("base.rate", "check.specific_force"):
        return np.eye(3)
    own, seen = (record.channels[name].turn for name in (key, "base.quaternion"))
    return np.asarray((np.eye(3) if seen is None else seen).T @ (np.eye(3) if own is None else own))


def _readings(chosen: Map) -> list[Reading]:
    """Return order and sense of the map's quaternion, and then the other ones."""
    section = chosen.base.quaternion or QuaternionSection()
    others = itertools.product(("xyzw", "wxyz"), ("body_to_world", "world_to_body"))
    return list(dict.fromkeys([(section.order, section.sense), *others]))


def _read_as(chosen: Map, reading: Reading, turns: Array) -> Array:
    own = chosen.base.quaternion or QuaternionSection()
    section = own.model_copy(update={"order": reading[0], "sense": reading[1]})
    base = chosen.base.model_copy(update={"quaternion": section})
    return as_attitude(chosen.model_copy(update={"base": base}), turns)
