"""Rings of a stream: each keeps the `LENGTH` newest samples of a channel.

`stream_samples` puts samples into them, and `stream_kernels` makes an observer's inputs of them. `new_rings` writes
what a map, a robot and a calibration say once.
"""

from __future__ import annotations

from typing import Annotated, NamedTuple

import numpy as np

from aerobat_pin.errors import MapError
from aerobat_pin.estimation.checks.samples import rests_at_zero
from aerobat_pin.forces import FittedValues
from aerobat_pin.numerics import Array, Integers, fields_of, inner, new_state
from aerobat_pin.records import HOLE, Map, PlainRobot, Request, axes_of, has_world_axes

LENGTH = 2048  # samples that a ring keeps; a power of two
CLOCK_JUMP = 1.0  # [s]: a stamp further from the newest one is off
STALL = 0.1  # [s] behind the newest stamp of all channels, after which a channel is named as stalled

# What became of a sample: columns of `Rings.tally`.
TAKEN, INSERTED, REFUSED, DUPLICATE, TOO_LATE, OUTLIER, CLOCK_STEP = range(7)
FATES = ("taken", "inserted", "refused", "duplicate", "late", "outlier", "clock_step")
# What `build_interval` found: nothing yet; a time without a past; an interval; one at whose end u begins at zero again.
NO_ESTIMATE, STREAM_START, INTERVAL, REZEROED = range(4)
# Channels by what they are: rows of `Rings.slot`.
ANGLE, RATE, EFFORT_RING, PLACE_RING, TURN_RING, SPEED, GYRO_RING, FORCE = range(8)
STREAM_KEYS = (
    *(f"joints.{part}" for part in ("position", "velocity", "effort")),
    *(f"base.{part}" for part in ("position", "quaternion", "velocity", "rate", "acceleration")),
)
# Cells of `Rings.now` [s], and then the velocity u of the accelerometer (3,) [m/s] in world axes.
LAST, LAST_SEEN, CLOCK_ORIGIN, INDEX, BEGAN, ZERO, BROKEN, DT, COUNT, U = range(10)


class Rings(NamedTuple):
    """Data of a stream between calls."""

    channels: int
    width: int  # largest number of columns of a channel
    nq: int
    nv: int
    rubbing: int  # number of joints with friction
    head: Annotated[Integers, "channels"]  # index of the oldest sample
    filled: Annotated[Integers, "channels"]  # number of samples
    columns: Annotated[Integers, "channels"]
    mixed: Annotated[Integers, "channels"]  # 1 if `mix` applies
    slot: Annotated[Integers, "8"]  # which channel is the joints' position and so on; -1 for none
    places: Annotated[Integers, "3, width"]  # indices of joints in q, of joints in v, and of driven joints in v
    rubbed: Annotated[Integers, "rubbing"]  # indices in v of joints with friction
    tally: Annotated[Integers, "channels, 7"]  # number of samples by what became of them
    skipped: Annotated[Integers, "1"]  # number of times inside holes, for which there is no estimate
    setting: Annotated[Array, "8"]  # longest hole, wait, rate, epoch; whether the twist has world axes: linear, angular
    now: Annotated[Array, "12"]
    delay: Annotated[Array, "channels"]
    factor: Annotated[Array, "channels, width"]
    mix: Annotated[Array, "channels, width, width"]
    shift: Annotated[Array, "channels, width"]
    turn: Annotated[Array, "channels, width"]  # a full turn of a column, 0 if it does not turn
    shown: Annotated[Array, "channels, width"]  # what it showed last, the jumps by full turns taken out
    jumped: Annotated[Array, "channels, width"]  # what takes these jumps out of what it shows
    usual: Annotated[Array, "channels"]  # usual step of a channel [s]
    rests: Annotated[Integers, "channels"]  # 1 if it may show exactly zero for long
    stuck: Annotated[Integers, "channels"]  # 1 while it repeats one value and others change
    changed: Annotated[Array, "channels"]  # stamp [s] of the newest sample that is not the one before again
    pending: Annotated[Array, "channels, 3"]  # stamps that are off but rise: their number, the latest, the first
    friction: Annotated[Array, "6, rubbing"]  # coulomb, viscous, inertia, offset, rate, factor of the effort
    arm: Annotated[Array, "3"]  # place of the accelerometer in the base [m]
    gravity: Annotated[Array, "3"]
    neutral: Annotated[Array, "nq"]
    q: Annotated[Array, "nq"]  # written by `build`, like all that follow
    v: Annotated[Array, "nv"]
    before: Annotated[Array, "nv"]  # velocity at the start of the interval, and where u was zeroed that before it
    tau: Annotated[Array, "nv"]
    squares: Annotated[Array, "nv"]  # sum of the squares of all mean efforts
    sample: Annotated[Array, "width"]  # scratch
    frame: Annotated[Array, "5, 4"]  # scratch
    time: Annotated[Array, f"channels, {LENGTH}"]
    value: Annotated[Array, f"channels, {LENGTH}, width"]


def new_rings(
    chosen: Map,
    robot: PlainRobot,
    joints: tuple[str, ...],
    requests: tuple[Request, ...],
    values: FittedValues,
    wait: float,
) -> Array:
    """Return the state of a stream without samples, for joints in the order of their columns.

    Samples may arrive late by the wait [s]. Raises MapError if it is below 0, or too long.
    """
    if not 0.0 <= wait < CLOCK_JUMP:
        raise MapError(f"online: wait = {wait}: at least 0 s and less than {CLOCK_JUMP:g} s was expected")
    if any(request.of_angles for request in requests):
        raise MapError("online: base.quaternion: four columns were expected; roll, pitch and yaw need a whole record")
    rubbing = values.joints if values.friction is not None or len(values.scale) else ()
    width = max(4, *(len(request.names) for request in requests))
    model = robot.model
    memory = new_state(Rings, channels=len(requests), width=width, nq=model.nq, nv=model.nv, rubbing=len(rubbing))
    rings = fields_of(memory, Rings)
    rings.slot[:] = -1
    for c, request in enumerate(requests):
        count = len(request.names)
        rings.columns[c], rings.delay[c] = count, request.delay
        rings.factor[c, :count] = request.factor
        rings.turn[c, : len(request.turns)] = request.turns
        mix, shift = request.mix, request.shift
        if (turn := axes_of(chosen, request.key, request.names)) is not None:
            mix = turn if mix is None else turn @ mix
        if mix is not None:
            rings.mixed[c], rings.mix[c, :count, :count], rings.shift[c, :count] = 1, mix, shift
        row = STREAM_KEYS.index(request.key)
        rings.slot[row], rings.rests[c] = c, rests_at_zero(request.key)
        if row in (ANGLE, RATE, EFFORT_RING):
            index = robot.q_index if row == ANGLE else robot.v_index
            rings.places[row, :count] = np.array([index(joint) for joint in (request.joints or joints)])
    rings.rubbed[:] = [robot.v_index(joint) for joint in rubbing]
    rings.friction[4:] = 1.0
    if values.friction is not None:
        law = values.friction
        rings.friction[:4], rings.friction[4] = (law.coulomb, law.viscous, law.inertia, law.offset), law.rate
    if len(values.scale):
        rings.friction[5] = values.scale
    rings.setting[:4] = chosen.log.longest_gap, wait, chosen.log.rate or 0.0, 0.0
    in_world = {request.key for request in requests if has_world_axes(chosen, request.key, request.names)}
    rings.setting[4:6] = "base.velocity" in in_world, "base.rate" in in_world
    rings.shown[:] = rings.changed[:] = rings.now[:COUNT] = np.nan
    rings.now[BROKEN] = 0.0
    rings.arm[:], rings.gravity[:], rings.neutral[:] = chosen.base.imu.place, model.gravity.linear, robot.neutral()
    for joint, place in chosen.joints.held.items():
        rings.neutral[robot.q_index(joint)] = place
    return memory


@inner
def stamp_at(rings: Rings, c: int, i: int) -> float:
    """Return the stamp [s] of the i-th oldest sample of a channel."""
    return float(rings.time[c, (rings.head[c] + i) & (LENGTH - 1)])


@inner
def bracket(rings: Rings, c: int, t: float) -> int:
    """Return the sample of a channel (two or more) at whose stamp the line through a time begins."""
    low, high = 0, rings.filled[c] - 1
    while high - low > 1:
        middle = (low + high) // 2
        if stamp_at(rings, c, middle) <= t:
            low = middle
        else:
            high = middle
    return low


@inner
def longest_step(rings: Rings, c: int) -> float:
    """Return the step of a channel [s] beyond which it has a hole."""
    return float(max(rings.setting[0], HOLE * rings.usual[c]))
