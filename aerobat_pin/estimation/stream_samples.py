"""Samples of a stream: `put` takes one of a channel into its ring, in the order of stamps, or says why not.

A stamp is off that is far from the newest one, or goes back to a time from which its channel has samples already: where
several that follow each other rise, the clock was set, and is followed.
"""

from __future__ import annotations

import numpy as np

from aerobat_pin.estimation.checks.samples import STUCK
from aerobat_pin.estimation.stream_rings import (
    ANGLE,
    CLOCK_JUMP,
    CLOCK_ORIGIN,
    CLOCK_STEP,
    DUPLICATE,
    INSERTED,
    LAST,
    LAST_SEEN,
    LENGTH,
    OUTLIER,
    REFUSED,
    TAKEN,
    TOO_LATE,
    TURN_RING,
    Rings,
    longest_step,
    stamp_at,
)
from aerobat_pin.numerics import Array, fields_of, inner, kernel
from aerobat_pin.records import LARGEST_VALUE, NEAR_TURN

CONFIRM, CONFIRM_NEAR, CONFIRM_UNEVEN = 3, 4, 10  # stamps in a row that are off but rise: far, by little, or unevenly
EVENLY = 0.5  # of the usual time that so many steps take
SPACED = 16  # steps of a channel, over which they show how far apart its samples are
ROOM = 1.5  # of these steps between neighbours, from which a late sample can belong there
SETTLE_STEP = 1.1  # factor by which the usual step of a channel changes at most from sample to sample
UNIT_TOLERANCE = 0.05  # of a quaternion's length, as in records


@inner
def write_cell(rings: Rings, c: int, i: int, at: float) -> None:
    """Write the scratch sample as the i-th oldest of a channel."""
    k = (rings.head[c] + i) & (LENGTH - 1)
    rings.time[c, k] = at
    for j in range(rings.columns[c]):
        rings.value[c, k, j] = rings.sample[j]


@inner
def make_room(rings: Rings, c: int) -> None:
    """Drop the oldest sample of a channel whose ring is full."""
    if rings.filled[c] == LENGTH:
        rings.head[c] = (rings.head[c] + 1) & (LENGTH - 1)
        rings.filled[c] -= 1


@inner
def usable(rings: Rings, c: int, given: Array) -> bool:
    """Write a sample of the columns in SI units to the scratch; return False if it cannot be one."""
    count, sample = rings.columns[c], rings.sample
    if given.shape[0] != count:
        return False
    for j in range(count):
        step = given[j] + rings.jumped[c, j] - rings.shown[c, j]
        if abs(abs(step) - rings.turn[c, j]) < NEAR_TURN * rings.turn[c, j]:
            rings.jumped[c, j] -= np.copysign(rings.turn[c, j], step)
    for j in range(count):
        sample[j] = rings.factor[c, j] * (given[j] + rings.jumped[c, j])
        if rings.mixed[c] > 0:
            sample[j] = 0.0
            for k in range(count):
                sample[j] += rings.mix[c, j, k] * (rings.factor[c, k] * (given[k] + rings.jumped[c, k]))
            sample[j] += rings.shift[c, j]
        if not abs(sample[j]) <= LARGEST_VALUE:  # NaN too
            return False
    if c == rings.slot[TURN_RING]:
        square = 0.0
        for j in range(count):
            square += sample[j] ** 2
        if not abs(np.sqrt(square) - 1.0) <= UNIT_TOLERANCE:
            return False
        for j in range(count):
            sample[j] /= np.sqrt(square)
    for j in range(count):
        rings.shown[c, j] = given[j] + rings.jumped[c, j]
    return True


@inner
def place_sample(rings: Rings, c: int, at: float) -> int:
    """Place the scratch sample with a stamp [s] in its ring; return what became of it."""
    if not abs(at) <= 1.0e12:
        return REFUSED
    count, off = rings.filled[c], rings.pending[c, 0] > 0.0
    if count == 0:
        write_cell(rings, c, 0, at)
        rings.filled[c], rings.pending[c, 0] = 1, 0.0
        return CLOCK_STEP if off else TAKEN
    step, i = at - stamp_at(rings, c, count - 1), count
    if step == 0.0:
        return DUPLICATE
    while i > 0 and stamp_at(rings, c, i - 1) > at:
        i -= 1
    if abs(step) > CLOCK_JUMP or (i < count and is_filled(rings, c, i)):
        return follow_clock(rings, c, at, abs(step) > CLOCK_JUMP)
    if i < count:
        return insert_sample(rings, c, i, at)
    rings.pending[c, 0] = 0.0
    usual = rings.usual[c]
    if usual == 0.0:
        rings.usual[c] = step
    else:
        rings.usual[c] = min(max(step, usual / SETTLE_STEP), usual * SETTLE_STEP)
    if has_changed(rings, c):
        rings.changed[c] = at
    make_room(rings, c)
    write_cell(rings, c, rings.filled[c], at)
    rings.filled[c] += 1
    return TAKEN


@inner
def has_changed(rings: Rings, c: int) -> bool:
    """Return whether the scratch sample differs from the newest of its channel, or is zero where this may last."""
    newest, zero = rings.value[c, (rings.head[c] + rings.filled[c] - 1) & (LENGTH - 1)], rings.rests[c] > 0
    for j in range(rings.columns[c]):
        if rings.sample[j] != newest[j]:
            return True
        zero = zero and rings.sample[j] == 0.0
    return bool(zero)


@inner
def is_stuck(rings: Rings, c: int) -> bool:
    """Return whether a channel that has changed repeats its value while others change, as of a driver that hangs.

    Joints may stand; their rates say if they move.
    """
    latest = -np.inf
    for k in range(rings.channels):
        if rings.changed[k] > latest:
            latest = rings.changed[k]
    return bool(c != rings.slot[ANGLE] and latest - rings.changed[c] > max(STUCK, longest_step(rings, c)))


@inner
def is_filled(rings: Rings, c: int, i: int) -> bool:
    """Return whether the i-th oldest sample of a channel follows the one before so closely that none is late between.

    How far apart samples are is known from those before. Of a channel that has begun just now, nothing is known.
    """
    if i <= SPACED:
        return False
    usual = (stamp_at(rings, c, i - 1) - stamp_at(rings, c, i - 1 - SPACED)) / SPACED
    return stamp_at(rings, c, i) - stamp_at(rings, c, i - 1) < ROOM * usual


@inner
def follow_clock(rings: Rings, c: int, at: float, far: bool) -> int:
    """Leave out the scratch sample, whose stamp [s] is off, unless several in a row rise: the clock was set.

    Of stamps that are not far off more are asked for, most if they are not as far apart as usual: messages that
    overtake each other rise for a while, too. From then on the clock is followed: what all channels showed before is
    forgotten, so that nothing of it is mixed with what follows.
    """
    if not (rings.pending[c, 0] > 0.0 and 0.0 < at - rings.pending[c, 1] <= CLOCK_JUMP):
        rings.pending[c, 0], rings.pending[c, 2] = 0.0, at
    usually = rings.pending[c, 0] * rings.usual[c]  # for so many steps
    even = abs(at - rings.pending[c, 2] - usually) < EVENLY * usually
    rings.pending[c, 0] += 1.0
    rings.pending[c, 1] = at
    if rings.pending[c, 0] < (CONFIRM if far else CONFIRM_NEAR if even else CONFIRM_UNEVEN):
        return OUTLIER
    rings.filled[:], rings.usual[:], rings.changed[:], rings.pending[c, 0] = 0, 0.0, np.nan, 0.0
    write_cell(rings, c, 0, at)
    rings.filled[c] = 1
    rings.now[LAST] = rings.now[LAST_SEEN] = rings.now[CLOCK_ORIGIN] = np.nan
    return CLOCK_STEP


@inner
def insert_sample(rings: Rings, c: int, i: int, at: float) -> int:
    """Place the scratch sample before the i-th oldest, unless there has been an estimate behind its stamp [s]."""
    if i > 0 and stamp_at(rings, c, i - 1) == at:
        return DUPLICATE
    if at <= rings.now[LAST_SEEN] or (i == 0 and rings.filled[c] == LENGTH):
        return TOO_LATE
    if rings.filled[c] == LENGTH:
        make_room(rings, c)
        i -= 1
    rings.filled[c] += 1
    for k in range(rings.filled[c] - 1, i, -1):
        a, b = (rings.head[c] + k) & (LENGTH - 1), (rings.head[c] + k - 1) & (LENGTH - 1)
        rings.time[c, a] = rings.time[c, b]
        for j in range(rings.columns[c]):
            rings.value[c, a, j] = rings.value[c, b, j]
    write_cell(rings, c, i, at)
    return INSERTED


@kernel
def put(memory: Array, c: int, time: float, given: Array) -> int:
    """Take a sample of a channel, its columns (k,) as the map names them, at a time [s]; return what became of it."""
    rings = fields_of(memory, Rings)
    fate = place_sample(rings, c, time - rings.delay[c]) if usable(rings, c, given) else REFUSED
    rings.tally[c, fate] += 1
    rings.stuck[c] = is_stuck(rings, c)
    return fate
