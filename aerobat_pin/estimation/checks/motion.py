"""Check the measured motion against itself, and joints against the limits that the robot's file states."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial

import numpy as np

from aerobat_pin.estimation.checks.agreement import (
    accelerometer_findings,
    agreement_findings,
    comparison_of,
    read_attitudes,
    reading_findings,
    turned_so_far,
)
from aerobat_pin.estimation.checks.readings import UNLIMITED
from aerobat_pin.estimation.checks.samples import sample_findings
from aerobat_pin.estimation.findings import Finding
from aerobat_pin.numerics import COMPARED_OVER, FEWEST_POINTS, Array
from aerobat_pin.observers import rotation_matrices
from aerobat_pin.records import (
    LARGEST_DELAY,
    Agreement,
    Map,
    Record,
    body_turn,
    has_world_axes,
    said_unit,
    sampled_turns,
    sensor_turn,
    world_turn,
)

MOST_SAMPLES = 60_000  # that are compared: the longest used part, or its beginning
LARGEST_TURN = 0.02  # [rad] in a window; a gyro's bias of 2 mrad/s makes a hundredth of it
LARGEST_STEP = 0.01  # [m] in a window
LARGEST_ACCELERATION = 50.0  # [m/s2], rms over windows: five times gravity
RARE = 0.05  # share of the samples on either side that may be a sensor's faults
FAST, FAST_FOR = 3.0, 0.02  # times the speed that its file allows, and for how long [s]: no joint ever turns so fast
SLIGHT = 0.25  # of the range: so far beyond its file's limits a real joint may be
SENSIBLE = 0.01  # of a joint's range, which what another unit makes of its positions must reach
AXES_FIT = 0.25  # of what a velocity leaves of the pose as mapped, that it leaves at most in the axes that are right
AXES_OFF = 0.1  # of the motion, that it leaves at least in wrong ones
A_TURN, TEN_RANGES = 2.0 * np.pi, 10.0  # [rad], ranges beyond them: no joint that has limits ever is there
TAKEN_FOR = {"position": "rad", "velocity": "rad/s", "effort": "N m"}  # part of joints -> unit if a map states none
SMALLER = {"rad": ("deg", np.pi / 180.0), "m": ("mm", 1e-3)}  # unit -> what may have been meant

BASE_CHANNELS = ("base.position", "base.rate", "base.velocity", "check.specific_force")

Measured = Callable[[str], Array | None]  # key -> samples (m, k); None if there is no such channel


def checked_part(record: Record) -> tuple[int, int]:
    """Return the longest used part, or its beginning: first and last index of the common times."""
    first, last = max(record.parts, key=lambda part: part[1] - part[0])
    return first, min(last, first + MOST_SAMPLES)


def record_findings(record: Record) -> Iterator[Finding]:
    """Yield what a record shows of itself, before any force is known: its samples and its motion."""
    yield from sample_findings(record)
    yield from unit_findings(record.map)
    yield from motion_findings(record)


def unit_findings(chosen: Map) -> Iterator[Finding]:
    """Yield columns of joints whose names say another unit than the one they are taken for, as the map states none."""
    table = chosen.joints
    for part, section in (("position", table.position), ("velocity", table.velocity), ("effort", table.effort)):
        if section is None or section.unit is not None or getattr(section, "torque_per_unit", None):
            continue
        unit, taken = said_unit(part, section.columns), TAKEN_FOR[part]
        if unit not in (None, taken):
            torque = " and torque_per_unit" if unit in ("A", "mA") else ""
            what = f"{', '.join(section.columns)} look like {unit} and are taken for {taken}, as the map states no unit"
            yield Finding(f"unit of joints.{part}", "warning", f'{what}: unit = "{unit}"{torque}')


def motion_findings(record: Record) -> Iterator[Finding]:
    """Yield what the channels of a record's motion say about each other, and about what its robot knows to agree."""
    every = record.times(*checked_part(record))
    rising = np.diff(every, prepend=-np.inf) > 0.0  # a log's own times can repeat
    time = every[rising]
    if len(time) < FEWEST_POINTS:
        return

    def measured(key: str) -> Array | None:
        return record.at(key, every)[rising] if key in record.channels else None

    latest = max(LARGEST_DELAY, 0.5 * float(time[-1] - time[0]) / (len(time) - 1))
    for pair in record.robot.agreements(time, measured):
        yield from agreement_findings(pair)
    angles, rates = measured("joints.position"), measured("joints.velocity")
    if angles is not None:
        yield from limit_findings(record, angles)
        yield from speed_findings(record, time, angles if rates is None else rates, differs=rates is None)
    if angles is not None and rates is not None:
        yield from agreement_findings(_joint_pair(record, time, angles, rates, latest))
    if record.robot.free and not record.map.base.held:
        yield from _base_findings(record, time, measured, latest)


def _joint_pair(record: Record, time: Array, angles: Array, rates: Array, latest: float) -> Agreement:
    slides = [record.robot.slides(joint) for joint in record.joints]
    return Agreement(
        "joint velocities against positions",
        ("joint positions", "joint velocities"),
        time,
        angles,
        rates,
        "rates",
        tuple(f"at {joint}" for joint in record.joints),
        "rad" if not any(slides) else "m" if all(slides) else "rad or m",
        LARGEST_TURN,
        "rad/s or m/s, and the order of the positions, were expected",
        latest,
        apart=True,
    )


def _base_findings(record: Record, time: Array, measured: Measured, latest: float) -> Iterator[Finding]:
    """Yield how the quaternion must be read, and what gyro, velocity and accelerometer say about the pose."""
    chosen, world, body = record.map, world_turn(record.map), body_turn(record.map)
    position, gyro, velocity, felt = map(measured, BASE_CHANNELS)
    sensor, imu = sensor_turn(chosen), measured("base.acceleration")
    evidence, steps, turns = [], None, None
    if gyro is not None:
        in_world = has_world_axes(chosen, "base.rate", record.channels["base.rate"].names)
        axes = (sensor @ _sensor_turn(record, "base.rate"), world)
        turns, turns_else = (
            partial(_turns, time, gyro @ axes[of_world].T, of_world, latest) for of_world in (in_world, not in_world)
        )
        evidence.append(turns)
    if position is not None:
        position = position @ world.T
    if velocity is not None and position is not None:
        in_world = has_world_axes(chosen, "base.velocity", record.channels["base.velocity"].names)
        steps, steps_else = (
            partial(_steps, time, position, velocity @ (body, world)[of_world].T, of_world, latest)
            for of_world in (in_world, not in_world)
        )
        evidence += [] if in_world else [steps]
    if imu is not None:
        felt = imu @ sensor.T
    elif felt is not None:
        felt = felt @ (body @ _sensor_turn(record, "check.specific_force")).T
    attitude = measured("base.quaternion")
    assert attitude is not None
    attitudes = read_attitudes(record, time, attitude)
    weightless = record.robot.weightless
    misread = [*reading_findings(attitudes, lambda attitude: [pair(attitude) for pair in evidence], felt, weightless)]
    yield from misread
    if any(finding.warns for finding in misread):
        return
    attitude = next(iter(attitudes.values()))
    if turns is not None:
        findings = list(axes_findings("base.rate", turns(attitude), turns_else(attitude)))
        yield from findings
        early = sum(finding.value or 0.0 for finding in findings if finding.check == "late channel")
        if early < 0.0:  # the attitude is late; a channel is never early
            attitude = sampled_turns(time, attitude, time - early)
    if position is None:
        if felt is not None and not weightless:
            still = np.zeros((len(time), 3))  # an IMU's record has no place, and over it hardly another mean speed
            yield from accelerometer_findings(felt, attitude, still, time, chosen.robot.gravity, record.robot.weight)
        return
    if steps is None:
        yield from _accelerations(position, time)
    else:
        yield from axes_findings("base.velocity", steps(attitude), steps_else(attitude))
    if felt is not None and not weightless:
        yield from accelerometer_findings(felt, attitude, position, time, chosen.robot.gravity, record.robot.weight)


def axes_findings(key: str, mapped: Agreement, otherwise: Agreement) -> Iterator[Finding]:
    """Yield that a velocity fits the pose in the other axes alone, world or body, or else how it fits as mapped."""
    size, residual = _size_and_residual(mapped)
    least = _size_and_residual(otherwise)[1] if residual > AXES_OFF * size else np.inf
    if size == 0.0 or least > AXES_FIT * residual:
        yield from agreement_findings(mapped)
        return
    text = (
        f"{mapped.names[1]} seems to be in the other axes, the world's or the body's: in these it leaves "
        f"{100.0 * least / size:.2g} % of what follows from {mapped.names[0]}, as mapped "
        f"{100.0 * residual / size:.2g} %: {key}.axes"
    )
    yield Finding(mapped.check, "warning", text, residual / size, "1")


def _size_and_residual(pair: Agreement) -> tuple[float, float]:
    """Return the size of the first of two series and of their difference, rms over all columns; 0 if too short."""
    comparison = comparison_of(pair)
    if comparison is None:
        return 0.0, 0.0
    return float(np.linalg.norm(comparison.sizes[0])), float(np.linalg.norm(comparison.residual))


def _sensor_turn(record: Record, key: str) -> Array:
    """Return the rotation (3, 3) from the axes of a sensor on the body to those whose attitude is measured."""
    sensor, seen = (record.channels[name].turn for name in (key, "base.quaternion"))
    return np.asarray((np.eye(3) if seen is None else seen).T @ (np.eye(3) if sensor is None else sensor))


def _turns(time: Array, gyro: Array, in_world: bool, latest: float, attitude: Array) -> Agreement:
    """Return that the turns of an attitude (m, 4) must agree with the rates (m, 3) of a gyro in body or world axes."""
    return Agreement(
        "gyro against attitude",
        ("attitude", "gyro"),
        time,
        turned_so_far(attitude),
        np.einsum("nji,nj->ni", rotation_matrices(attitude), gyro) if in_world else gyro,
        "rates",
        ("about x", "about y", "about z"),
        "rad",
        LARGEST_TURN,
        "rad/s and body axes were expected",
        latest,
    )


def _steps(time: Array, position: Array, velocity: Array, in_world: bool, latest: float, attitude: Array) -> Agreement:
    """Return that a position (m, 3) must agree with a velocity (m, 3) in world axes, or in those of an attitude."""
    return Agreement(
        "position against velocity",
        ("position", "velocity"),
        time,
        position,
        velocity if in_world else np.einsum("nij,nj->ni", rotation_matrices(attitude), velocity),
        "rates",
        ("along x", "along y", "along z"),
        "m",
        LARGEST_STEP,
        "m, m/s and the axes of the map were expected",
        latest,
    )


def _accelerations(position: Array, time: Array) -> Iterator[Finding]:
    """Yield that the base seems to move as nothing does; for motions without a velocity."""
    step = float(time[-1] - time[0]) / (len(time) - 1)
    n = min(max(1, round(0.5 * COMPARED_OVER / step)), len(time) // 3)
    steps = (position[n:] - position[:-n]) / (time[n:] - time[:-n])[:, None]
    bends = (steps[n:] - steps[:-n]) / (time[n:-n] - time[: -2 * n])[:, None]
    size = np.sqrt(np.mean(bends**2, axis=0))
    worst = int(np.argmax(size))
    if size[worst] > LARGEST_ACCELERATION:
        text = (
            f"{'xyz'[worst]} accelerates with {size[worst]:.0f} m/s2 (rms), {LARGEST_ACCELERATION:g} are allowed; "
            "metres and seconds were expected"
        )
        yield Finding("position against gravity", "warning", text, float(size[worst]), "m/s2")


def limit_findings(record: Record, positions: Array) -> Iterator[Finding]:
    """Yield that joints, at positions (m, n) [rad, m], are beyond their limits: refused where no joint ever is."""
    model, beyond, certain, meant, turned = record.robot.model, [], False, True, True
    joints, section = record.map.joints, record.map.joints.position
    for joint, column in zip(record.joints, positions.T, strict=True):
        at, unit = record.robot.q_index(joint), "m" if record.robot.slides(joint) else "rad"
        low, high = float(model.lowerPositionLimit[at]), float(model.upperPositionLimit[at])
        least, most = np.quantile(column, (RARE, 1.0 - RARE))
        excess, span = float(max(low - least, most - high)), high - low
        if not 0.0 < span < UNLIMITED or excess <= SLIGHT * span or joint in record.channels["joints.position"].turns:
            continue
        where = f"{joint} is at {least:.3g} to {most:.3g} {unit}, its limits are {low:.3g} to {high:.3g} {unit}"
        beyond.append((excess / span, joint, where, unit))
        certain |= excess > (A_TURN if unit == "rad" else TEN_RANGES * span)
        in_force = section is not None and SMALLER[unit][0] in (section.unit, section.slide_unit)  # is not proposed
        zero = 2.0 * joints.offset.get(joint, 0.0)  # which the encoder's factor does not turn
        turned &= low <= zero - most and zero - least <= high and joint not in joints.coupling
        smaller = SMALLER[unit][1] * np.array([least, most])  # zero is within any limits
        meant &= not in_force and low <= smaller[0] and smaller[1] <= high and max(abs(smaller)) > SENSIBLE * span
    if not beyond:
        return
    worst, first, where, unit = max(beyond)
    others = ", ".join(joint for _, joint, _, _ in beyond if joint != first)
    back = ", ".join(f"{joint} = {-joints.factor.get(joint, 1.0):g}" for _, joint, _, _ in beyond)
    cause = f"factor = {{{back}}} under [joints] would leave all within them, or " if turned and not meant else ""
    key = "unit" if unit == "rad" else "slide_unit"
    cause += f'{key} = "{SMALLER[unit][0]}" for joints.position would leave all within them, or ' if meant else ""
    cause += (
        'another zero or gear (joints.offset, joints.factor), order or robot, or it turns on and on (type="continuous")'
    )
    text = f"{where}{'; beyond theirs, too: ' if others else ''}{others}; {cause}"
    yield Finding("joint limits", "refused" if certain else "warning", text, worst, "ranges")


def speed_findings(record: Record, time: Array, motion: Array, *, differs: bool) -> Iterator[Finding]:
    """Yield joints that turn far faster than their robot's file allows, by rates (m, n), or angles that differ.

    Both in [rad/s, m/s] or [rad, m], at times (m,) [s]. Of angles, differences over `FAST_FOR` count, not steps.
    """
    model, too_fast, rates = record.robot.model, [], motion
    if differs:
        n = min(max(1, round(FAST_FOR * (len(time) - 1) / float(time[-1] - time[0]))), len(time) - 1)
        rates = (motion[n:] - motion[:-n]) / (time[n:] - time[:-n])[:, None]
    fastest = np.quantile(np.abs(rates), 1.0 - RARE, axis=0)
    for joint, fast in zip(record.joints, fastest.tolist(), strict=True):
        limit = float(model.velocityLimit[record.robot.v_index(joint)])
        if 0.0 < limit < UNLIMITED and fast > FAST * limit:
            too_fast.append((fast / limit, joint, fast, limit))
    if too_fast:
        times, joint, fast, limit = max(too_fast)
        unit = "m/s" if record.robot.slides(joint) else "rad/s"
        text = (
            f"{joint} moves with {fast:.3g} {unit}, {times:.3g} times what its robot's file allows ({limit:.3g}): is "
            "the rate of the log, or the unit of its time, right?"
        )
        yield Finding("joint speeds", "warning", text, times, "1")
