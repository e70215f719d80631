"""What one channel says of another: the attitude of the body rate, the position of the velocity."""

from __future__ import annotations

from math import sqrt

from aerobat_pin.control.sensed_channels import (
    ATTITUDE,
    GYRO_CHANNEL,
    JUMP_BELIEVED,
    SURE_OF_RATE,
    VELOCITY,
    Senses,
    believed,
    is_good,
    product,
    taken_at,
)
from aerobat_pin.numerics import Array, inner


@inner
def gyro(s: Senses, at: Array) -> None:
    """Judge the gyro: a jump by more than noise is on trial. It waits for a sample that confirms it, then is believed.

    Where the attitude says that the body has not turned so, all of it is taken back (`weigh_gyro`).
    """
    if not is_good(s, GYRO_CHANNEL):
        return
    late, off, jump = s.carriers[taken_at(s, GYRO_CHANNEL)], 0.0, 0.0
    for i in range(3):
        s.candidate[10 + i] = (
            s.now[10 + i] if s.delay[GYRO_CHANNEL] == 0 else s.now[10 + i] + (at[10 + i] - late[10 + i])
        )
        off = max(off, abs(s.candidate[10 + i] - s.estimate[10 + i]))
        before = s.expected[i] if s.trial[0] > 0 else s.offset[10 + i]
        jump = max(jump, abs(s.candidate[10 + i] - before - at[10 + i]))
    if jump <= s.trust[2] or s.ticks[0] == 0 or s.age[GYRO_CHANNEL] * s.tick[()] >= JUMP_BELIEVED:
        if s.trial[0] == 1 or (s.trial[0] > 1 and off > s.trust[2]):  # it jumps back
            s.faults[GYRO_CHANNEL, 2] += s.trial[0]
        s.trial[0] = 0
    elif s.trial[0] == 0:
        s.trial[0], s.evidence[()] = 1, 0.0
        s.apart[:] = 0.0
        s.expected[:] = s.offset[10:13]
        return
    elif s.trial[0] < 0:
        s.faults[GYRO_CHANNEL, 2] += 1
        return
    if believed(s, GYRO_CHANNEL, off):
        s.trial[0] += min(s.trial[0], 1)
        for i in range(3):
            s.estimate[10 + i] = s.candidate[10 + i]
            s.offset[10 + i] = s.now[10 + i] - late[10 + i]


@inner
def follow_attitude(s: Senses, at: Array) -> None:
    """Let `followed` follow the attitude, and correct the body rate by what it misses while the gyro is not good."""
    if s.ticks[0] == 0:
        s.followed[:] = s.estimate[3:7]
        s.doubt[:] = 0.0
    x, y, z = -s.followed[0], -s.followed[1], -s.followed[2]
    s.a[0], s.a[1], s.a[2], s.a[3] = x, y, z, s.followed[3]
    product(s.a, s.estimate[3:7], 1.0, s.b)
    twice, on_trial, wrong = 2.0 if s.b[3] >= 0.0 else -2.0, s.trial[0] > 0, False
    if on_trial:
        weigh_gyro(s, at, twice)
    for i in range(3):
        s.a[i] = 0.5 * s.correct[0, 0] * twice * s.b[i]
        if on_trial:
            s.doubt[i] = 0.0
        elif s.age[GYRO_CHANNEL] > 0:
            s.offset[10 + i] += s.correct[0, 1] * twice * s.b[i]
            s.estimate[10 + i] += s.correct[0, 1] * twice * s.b[i]
            s.doubt[i] = 0.0
        else:
            said = s.correct[0, 0] / (s.period[ATTITUDE] * s.tick[()]) * twice * s.b[i]
            s.doubt[i] += s.trust[0] * (said - s.doubt[i])
            wrong = wrong or abs(s.doubt[i]) > s.trust[1]
    if wrong:
        s.faults[GYRO_CHANNEL, 2] += 1
        s.age[GYRO_CHANNEL] = s.period[GYRO_CHANNEL]
        for i in range(3):
            s.offset[10 + i] += s.doubt[i]
            s.estimate[10 + i] += s.doubt[i]
            s.doubt[i] = 0.0
    if wrong or (on_trial and s.trial[0] < 0):
        s.followed[:] = s.estimate[3:7]
        return
    s.a[3] = sqrt(max(0.0, 1.0 - s.a[0] * s.a[0] - s.a[1] * s.a[1] - s.a[2] * s.a[2]))
    product(s.followed, s.a, 1.0, s.b)
    s.followed[:] = s.b


@inner
def follow_position(s: Senses) -> None:
    """Let `place` follow the position, and correct the velocity by what it misses while that is not good."""
    missing = s.age[VELOCITY] > s.period[VELOCITY]
    for i in range(3):
        if s.ticks[0] == 0:
            s.place[i] = s.estimate[i]
        missed = s.estimate[i] - s.place[i]
        s.place[i] += s.correct[1, 0] * missed
        if missing:
            s.offset[7 + i] += s.correct[1, 1] * missed


@inner
def weigh_gyro(s: Senses, at: Array, twice: float) -> None:
    """Weigh the gyro against the rate that was expected, by the attitude that `followed` misses; perhaps decide."""
    for i in range(3):
        missed, turned = twice * s.b[i], s.apart[0, i]
        s.evidence[()] += turned * (missed - s.apart[1, i] + 0.5 * turned) / s.trust[3]
        s.apart[0, i] += s.tick[()] * (s.estimate[10 + i] - s.expected[i] - at[10 + i])
        s.apart[1, i] -= s.correct[0, 0] * missed
    if s.evidence[()] > SURE_OF_RATE:
        s.trial[0] = 0
    elif s.evidence[()] < -SURE_OF_RATE:
        s.faults[GYRO_CHANNEL, 2] += s.trial[0]
        s.age[GYRO_CHANNEL], s.trial[0] = s.period[ATTITUDE], -1
        for i in range(3):
            s.offset[10 + i] = s.expected[i]
            s.estimate[10 + i] = s.expected[i] + at[10 + i]
