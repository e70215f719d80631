"""Check the measured motion against itself: positions, velocities, attitude, gyro and accelerometer."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from functools import partial

import numpy as np

from aerobat_pin.estimation.checks.agreement_findings import agreement_findings
from aerobat_pin.estimation.checks.attitude import Reading, accelerometer_findings, reading_findings, turned_so_far
from aerobat_pin.estimation.checks.compare import COMPARED_OVER, FEWEST_POINTS
from aerobat_pin.estimation.findings import Finding
from aerobat_pin.numerics import Array
from aerobat_pin.records import LARGEST_DELAY, Agreement, rotation_matrices, sampled_turns

LARGEST_TURN = 0.02  # [rad] in a window; a gyro's bias of 2 mrad/s makes a hundredth of it
LARGEST_STEP = 0.01  # [m] in a window
LARGEST_ACCELERATION = 50.0  # [m/s2], rms over windows: five times gravity


@dataclass(frozen=True)
class MeasuredMotion:
    """What was measured of a motion, at common times; None or empty for what was not.

    Attributes:
        time: (m,) increasing times [s].
        position: (m, 3) of the base in a world with z up [m].
        attitudes: reading of the quaternion -> (m, 4) body to world; the first reading is the map's.
        velocity: (m, 3) of the base [m/s], in body axes unless it is `in_world`.
        gyro: (m, 3) angular velocity of the base [rad/s], in body axes unless it is `in_world`.
        in_world: which of the two are in world axes.
        specific_force: (m, 3) of an accelerometer, body axes [m/s2].
        joints: names of joints.
        angles: (m, n) their positions [rad, m].
        rates: (m, n) their velocities [rad/s, m/s].
        slides: whether each joint slides.
        weight: of the robot [N].
        gravity: [m/s2].
    """

    time: Array
    position: Array | None = None
    attitudes: dict[Reading, Array] = field(default_factory=dict)
    velocity: Array | None = None
    gyro: Array | None = None
    in_world: frozenset[str] = frozenset()
    specific_force: Array | None = None
    joints: tuple[str, ...] = ()
    angles: Array | None = None
    rates: Array | None = None
    slides: tuple[bool, ...] = ()
    weight: float = 0.0
    gravity: float = 9.81

    @property
    def latest(self) -> float:
        """Largest delay between two channels that is allowed [s]."""
        return max(LARGEST_DELAY, 0.5 * float(self.time[-1] - self.time[0]) / (len(self.time) - 1))


def motion_findings(motion: MeasuredMotion, others: Iterable[Agreement] = ()) -> Iterator[Finding]:
    """Yield what the channels of a motion say about each other, and about `others`, which the robot knows to agree."""
    if len(motion.time) < FEWEST_POINTS:
        return
    for pair in others:
        yield from agreement_findings(pair)
    if motion.angles is not None and motion.rates is not None:
        yield from agreement_findings(_joint_pair(motion, motion.angles, motion.rates))
    if motion.attitudes:
        misread = list(reading_findings(motion.attitudes, partial(_of_attitude, motion), motion.specific_force))
        yield from misread
        if not any(one.warns for one in misread):
            yield from _base_findings(motion)


def _joint_pair(motion: MeasuredMotion, angles: Array, rates: Array) -> Agreement:
    unit = "rad" if not any(motion.slides) else "m" if all(motion.slides) else "rad or m"
    labels = tuple(f"at {joint}" for joint in motion.joints)
    names = ("joint positions", "joint velocities")
    return Agreement(
        "joint velocities against positions",
        names,
        motion.time,
        angles,
        rates,
        "rates",
        labels,
        unit,
        LARGEST_TURN,
        "rad/s or m/s, and the order of the positions, were expected",
        motion.latest,
        apart=True,
    )


def _of_attitude(motion: MeasuredMotion, attitude: Array) -> list[Agreement]:
    """Return what must agree with an attitude (m, 4): the gyro, and a velocity in body axes."""
    found = [_turns(motion, attitude, motion.gyro)] if motion.gyro is not None else []
    if motion.velocity is not None and "velocity" not in motion.in_world:
        found.append(_steps(motion, attitude, motion.velocity))
    return found


def _turns(motion: MeasuredMotion, attitude: Array, gyro: Array) -> Agreement:
    return Agreement(
        "gyro against attitude",
        ("attitude", "gyro"),
        motion.time,
        turned_so_far(attitude),
        _turned_by(attitude, gyro, back=True) if "gyro" in motion.in_world else gyro,
        "rates",
        ("about x", "about y", "about z"),
        "rad",
        LARGEST_TURN,
        "rad/s and body axes were expected",
        motion.latest,
    )


def _steps(motion: MeasuredMotion, attitude: Array, velocity: Array) -> Agreement:
    assert motion.position is not None
    return Agreement(
        "position against velocity",
        ("position", "velocity"),
        motion.time,
        motion.position,
        velocity if "velocity" in motion.in_world else _turned_by(attitude, velocity),
        "rates",
        ("along x", "along y", "along z"),
        "m",
        LARGEST_STEP,
        "m, m/s and the axes of the map were expected",
        motion.latest,
    )


def _base_findings(motion: MeasuredMotion) -> Iterator[Finding]:
    """Yield what gyro, velocity and accelerometer say about the pose, as the map reads it."""
    attitude = next(iter(motion.attitudes.values()))
    if motion.gyro is not None:
        findings = list(agreement_findings(_turns(motion, attitude, motion.gyro)))
        yield from findings
        early = sum(one.value or 0.0 for one in findings if one.check == "late channel")
        attitude = _earlier(attitude, max(-early, 0.0), motion.time)  # a channel is never early
    if motion.velocity is not None:
        yield from agreement_findings(_steps(motion, attitude, motion.velocity))
    elif motion.position is not None:
        yield from _accelerations(motion.position, motion.time)
    if motion.specific_force is not None and motion.position is not None:
        yield from accelerometer_findings(
            motion.specific_force, attitude, motion.position, motion.time, motion.gravity, motion.weight
        )


def _turned_by(attitude: Array, vectors: Array, *, back: bool = False) -> Array:
    """Return vectors (m, 3) in body axes in world axes, by attitudes (m, 4); or `back`."""
    return np.asarray(np.einsum("nji,nj->ni" if back else "nij,nj->ni", rotation_matrices(attitude), vectors))


def _earlier(attitude: Array, delay: float, time: Array) -> Array:
    """Return an attitude (m, 4) without its delay [s]."""
    return attitude if delay == 0.0 else sampled_turns(time, attitude, time + delay)


def _accelerations(position: Array, time: Array) -> Iterator[Finding]:
    """Yield that the base seems to move as nothing does; for motions without a velocity."""
    step = float(time[-1] - time[0]) / (len(time) - 1)
    n = min(max(1, round(0.5 * COMPARED_OVER / step)), len(time) // 3)
    steps = (position[n:] - position[:-n]) / (time[n:] - time[:-n])[:, None]
    bends = (steps[n:] - steps[:-n]) / (time[n:-n] - time[: -2 * n])[:, None]
    size = np.sqrt(np.mean(bends**2, axis=0))
    worst = int(np.argmax(size))
    if size[worst] > LARGEST_ACCELERATION:
        yield Finding(
            "position against gravity",
            "warning",
            f"{'xyz'[worst]} accelerates with {size[worst]:.0f} m/s2 (rms), {LARGEST_ACCELERATION:g} are allowed; "
            "metres and seconds were expected",
            float(size[worst]),
            "m/s2",
        )
