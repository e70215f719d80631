"""Checks of the motion against itself: velocity against position, gyro and accelerometer against the pose."""

from __future__ import annotations

import itertools
from collections.abc import Iterator

import numpy as np

from aerobat_pin.estimation.checks.compare import SeriesComparison, compare
from aerobat_pin.estimation.findings import FindingVerdict, LogFinding
from aerobat_pin.numerics import Array
from aerobat_pin.records import (
    QuaternionSection,
    Record,
    as_attitude,
    body_turn,
    rotation_matrices,
    slopes,
    turn_rates,
    world_turn,
)

MOST_SAMPLES = 60_000  # that are compared: the longest used part, or its beginning
SLOPE_WINDOW = 0.03  # [s]: parabolas that differentiate
LATE_FROM = 1.0e-3  # [s] and half a sample: a lag that is named
FOLLOWS = 0.8  # correlation from which one series is taken to follow the other
CONFUSED = 0.5  # correlation below which it does not
LEAST_RATE = 0.02  # [rad/s, m/s] rms: slower motion shows nothing


def motion_findings(record: Record) -> Iterator[LogFinding]:
    """Yield what positions, velocities, gyro and accelerometer say about each other."""
    time = checked_times(record)
    if record.joints and "joints.velocity" in record.channels:
        yield from _joint_velocities(record, time)
    if record.robot.free and not record.map.base.held:
        attitude = record.turns(time)
        if "base.velocity" in record.channels:
            yield from _base_velocity(record, time, attitude)
        yield from _readings(record, time)
        if "base.rate" in record.channels:
            reference = turn_rates(attitude, record.dt, max(SLOPE_WINDOW, 4.0 * record.dt))
            yield from judged("gyro against pose", "base.rate", reference, record.gyro(time, attitude), record.dt)
        if "check.specific_force" in record.channels:
            yield from _check_accelerometer(record, time, attitude)


def checked_times(record: Record) -> Array:
    """Return the common times of the longest used part, or of its beginning."""
    first, last = max(record.parts, key=lambda part: part[1] - part[0])
    return record.times(first, min(last, first + MOST_SAMPLES))


def judged(check: str, key: str, reference: Array, measured: Array, dt: float) -> Iterator[LogFinding]:
    """Yield factor and lag of a measured series (m, k) against its reference, with verdicts."""
    if float(np.sqrt(np.mean(reference**2))) < LEAST_RATE and float(np.sqrt(np.mean(measured**2))) < LEAST_RATE:
        yield LogFinding(check, "note", f"{key}: hardly any motion to compare")
        return
    found = compare(reference, measured, dt)
    if found is None:
        yield LogFinding(check, "warning", f"{key} does not change although the pose or the position does", 0.0)
        return
    verdict, text = _verdict(key, found, dt)
    yield LogFinding(check, verdict, text, found.factor, "1")
    if found.correlation > FOLLOWS and abs(found.lag) > max(LATE_FROM, 0.5 * dt):
        late = f"{key} is {'late' if found.lag > 0.0 else 'early'} by {1e3 * abs(found.lag):.1f} ms"
        yield LogFinding("late channel", "warning", f"{late}; delay = {found.lag:.4f} takes it off", found.lag, "s")


def _verdict(key: str, found: SeriesComparison, dt: float) -> tuple[FindingVerdict, str]:
    text = f"{key} is {found.factor:.3g} times what the position or pose says, correlation {found.correlation:.2f}"
    if found.correlation > FOLLOWS:
        if found.unit_slip:
            return "refused", f"{text}: {found.unit_slip}"
        return ("good" if abs(found.factor - 1.0) < 0.1 else "warning"), text
    if found.correlation < -FOLLOWS:
        return "refused", f"{text}: its sign is wrong"
    if abs(found.correlation) < CONFUSED:
        return "warning", f"{text}: it does not follow it (columns in another order, other axes, another clock)"
    return "note", text


def _joint_velocities(record: Record, time: Array) -> Iterator[LogFinding]:
    """Compare each joint's rate with its position's slope, and look for columns in another order."""
    rates = slopes(record.at("joints.position", time), record.dt, max(SLOPE_WINDOW, 4.0 * record.dt))
    measured = record.at("joints.velocity", time)
    swapped = swapped_columns(rates, measured)
    for j, k in swapped:
        pair = f"{record.joints[j]} and {record.joints[k]}"
        yield LogFinding("swapped joints", "warning", f"velocities of {pair} fit the positions the other way round")
    skip = {joint for pair in swapped for joint in pair}
    kept = [k for k in range(len(record.joints)) if k not in skip]
    check, lines = "velocity against position", []
    for k in kept:
        name = f"joints.velocity of {record.joints[k]}"
        lines += [
            one
            for one in judged(check, name, rates[:, [k]], measured[:, [k]], record.dt)
            if one.verdict in ("warning", "refused")
        ]
    together = list(judged(check, "joints.velocity", rates[:, kept], measured[:, kept], record.dt)) if kept else []
    if any(one.check == "late channel" for one in together):
        lines = [one for one in lines if one.check != "late channel"]
    yield from together
    yield from lines


def swapped_columns(reference: Array, measured: Array) -> list[tuple[int, int]]:
    """Return pairs of columns (m, n) that fit each other's reference far better than their own."""
    a, b = reference - reference.mean(axis=0), measured - measured.mean(axis=0)
    sizes = np.outer(np.linalg.norm(a, axis=0), np.linalg.norm(b, axis=0))
    match = np.divide(a.T @ b, sizes, out=np.zeros_like(sizes), where=sizes > 0.0)
    return [
        (j, k)
        for j, k in itertools.combinations(range(match.shape[0]), 2)
        if min(match[j, k], match[k, j]) > FOLLOWS
        and max(match[j, j], match[k, k]) < min(match[j, k], match[k, j]) - 0.1
    ]


def _base_velocity(record: Record, time: Array, attitude: Array) -> Iterator[LogFinding]:
    place = record.at("base.position", time) @ world_turn(record.map).T
    reference = slopes(place, record.dt, max(SLOPE_WINDOW, 4.0 * record.dt))
    section = record.map.base.velocity
    in_world = section is not None and section.axes == "world" and not record.twist_of_topic
    measured = record.at("base.velocity", time) @ (world_turn(record.map) if in_world else body_turn(record.map)).T
    if not in_world:
        measured = np.einsum("nij,nj->ni", rotation_matrices(attitude), measured)
    yield from judged("velocity against position", "base.velocity", reference, measured, record.dt)


def _readings(record: Record, time: Array) -> Iterator[LogFinding]:
    """Try the other orders and senses of the quaternion against the gyro, or else against the accelerometer."""
    gyro = "base.rate" in record.channels
    if not gyro and "check.specific_force" not in record.channels:
        yield LogFinding("quaternion", "note", "its order and sense are not checked: neither gyro nor accelerometer")
        return
    section = record.map.base.quaternion or QuaternionSection()
    own = (section.order, section.sense)
    errors = {}
    for order, sense in itertools.product(("xyzw", "wxyz"), ("body_to_world", "world_to_body")):
        changed = section.model_copy(update={"order": order, "sense": sense})
        base = record.map.base.model_copy(update={"quaternion": changed})
        attitude = as_attitude(record.map.model_copy(update={"base": base}), _raw_turns(record, time))
        errors[order, sense] = _misfit(record, time, attitude, gyro)
    best = min(errors, key=lambda key: errors[key])
    by = "gyro" if gyro else "accelerometer"
    text = f"read as {own[0]}, {own[1]} it leaves {errors[own]:.2g} of the {by}"
    if best != own and errors[best] < 0.6 * errors[own] and errors[best] < 0.7:
        what = f'{text}; as order = "{best[0]}", sense = "{best[1]}" {errors[best]:.2g}'
        yield LogFinding("quaternion", "refused" if errors[own] > 0.9 else "warning", what, errors[own], "1")
    else:
        yield LogFinding("quaternion", "good" if errors[own] < 0.7 else "note", text, errors[own], "1")


def _raw_turns(record: Record, time: Array) -> Array:
    stamps, turns = record.cut("base.quaternion", time)
    return turns[np.clip(np.searchsorted(stamps, time), 0, len(stamps) - 1)]


def _misfit(record: Record, time: Array, attitude: Array, gyro: bool) -> float:
    """Return the miss over the sensor, rms: gyro against the attitude's turn, or accelerometer against gravity."""
    if gyro:
        measured = record.gyro(time, attitude)
        reference = turn_rates(attitude, record.dt, max(SLOPE_WINDOW, 4.0 * record.dt))
        found = compare(reference, measured, record.dt)
        return 1.0 if found is None else (found.share if found.correlation > 0.0 else 2.0)
    measured = record.at("check.specific_force", time) @ body_turn(record.map).T
    world = np.einsum("nij,nj->ni", rotation_matrices(attitude), measured)
    up = np.array([0.0, 0.0, record.map.robot.gravity])
    return float(np.sqrt(np.mean((world - up) ** 2) / np.mean(measured**2)))


def _check_accelerometer(record: Record, time: Array, attitude: Array) -> Iterator[LogFinding]:
    """Compare the accelerometer, turned to the world, with gravity plus the pose's acceleration."""
    measured = record.at("check.specific_force", time) @ body_turn(record.map).T
    gravity = record.map.robot.gravity
    size = float(np.median(np.linalg.norm(measured, axis=1))) / gravity
    if min(abs(size * 9.80665 - 1.0), abs(size / 9.80665 - 1.0)) < 0.1:
        slip = "g is read as m/s2" if size < 1.0 else "m/s2 is read as g"
        yield LogFinding("accelerometer", "refused", f"its median is {size:.3g} of gravity: {slip}", size, "1")
        return
    world = np.einsum("nij,nj->ni", rotation_matrices(attitude), measured).mean(axis=0)
    place = record.at("base.position", time) @ world_turn(record.map).T
    span = max(time[-1] - time[0], record.dt)
    window = max(SLOPE_WINDOW, 8.0 * record.dt)
    ends = slopes(place, record.dt, window)[[0, -1]]
    world = world - (ends[1] - ends[0]) / span
    tilt = float(np.degrees(np.arccos(np.clip(world[2] / np.linalg.norm(world), -1.0, 1.0))))
    text = (
        f"turned to the world it is {np.linalg.norm(world) / gravity:.3f} of gravity and {tilt:.2f} deg "
        "off the vertical: "
        f"{1e3 * record.robot.weight * np.sin(np.radians(tilt)):.3g} mN of seeming force"
    )
    if tilt > 90.0:
        yield LogFinding("accelerometer", "refused", f"{text}; up is down: log.world or base.axes", tilt, "deg")
    else:
        yield LogFinding("accelerometer", "good" if tilt < 5.0 else "warning", text, tilt, "deg")
