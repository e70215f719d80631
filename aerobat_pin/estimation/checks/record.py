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
    Agreement,
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
    yield from motion_findings(measured_motion(record), _agreements(record))


def checked_part(record: Record) -> tuple[int, int]:
    """Return the longest used part, or its beginning: first and last index of the common times."""
    first, last = max(record.parts, key=lambda part: part[1] - part[0])
    return first, min(last, first + MOST_SAMPLES)


def _rising(time: Array) -> NDArray[np.bool_]:
    """Return which times (m,) are later than the one before; a log's own can repeat."""
    return np.diff(time, prepend=-np.inf) > 0.0


def _agreements(record: Record) -> Iterator[Agreement]:
    """Yield what the record's robot knows to agree."""
    for pair in record.robot.agreements(record.block(*checked_part(record))):
        rows = _rising(pair.time)
        yield replace(pair, time=pair.time[rows], first=pair.first[rows], second=pair.second[rows])


def measured_motion(record: Record) -> MeasuredMotion:
    """Return what was measured of a record's motion."""
    every, chosen, channels = record.times(*checked_part(record)), record.map, record.channels
    rows = _rising(every)

    def rotated(key: str, turn: Array) -> Array | None:
        return record.at(key, every)[rows] @ turn.T if key in channels else None

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
