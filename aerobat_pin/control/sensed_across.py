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
    product,
)
from aerobat_pin.numerics import inner


@inner
def follow_attitude(s: Senses) -> None:
    """Let `followed` follow the attitude, and correct the body rate by what it misses while the gyro is not good."""
    if s.ticks[0] == 0:
        s.followed[:] = s.estimate[3:7]
        s.doubt[:] = 0.0
    x, y, z = -s.followed[0], -s.followed[1], -s.followed[2]
    s.a[0], s.a[1], s.a[2], s.a[3] = x, y, z, s.followed[3]
    product(s.a, s.estimate[3:7], 1.0, s.b)
    twice, wrong = 2.0 if s.b[3] >= 0.0 else -2.0, False
    waiting = s.waits[0] > 0 and weigh_gyro(s, twice)
    for i in range(3):
        s.a[i] = 0.5 * s.correct[0, 0] * twice * s.b[i]
        if waiting:
            s.doubt[i] = 0.0
        elif s.age[GYRO_CHANNEL] > 0:
            s.offset[10 + i] += s.correct[0, 1] * twice * s.b[i]
            s.estimate[10 + i] += s.correct[0, 1] * twice * s.b[i]
            s.doubt[i] = 0.0
        else:
            # by how much the gyro shows too little
            said = s.correct[0, 0] / (s.period[ATTITUDE] * s.tick[()]) * twice * s.b[i]
            s.doubt[i] += s.trust[0] * (said - s.doubt[i])
            wrong = wrong or abs(s.doubt[i]) > s.trust[1]
    if wrong:
        s.faults[GYRO_CHANNEL, 2] += 1
        s.age[GYRO_CHANNEL] = s.period[GYRO_CHANNEL]
        for i in range(3):
            s.offset[10 + i] += s.doubt[i]
            s.estimate[10 + i] += s.doubt[i]
            s.a[i] = s.doubt[i] = 0.0
        s.followed[:] = s.estimate[3:7]
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
def weigh_gyro(s: Senses, twice: float) -> bool:
    """Weigh gyro and expected rate by the attitude that `followed` misses; return whether neither has won."""
    for i in range(3):
        missed, turned = twice * s.b[i], s.apart[1, i]
        s.evidence[()] += turned * (missed - s.apart[2, i] - 0.5 * turned) / s.trust[3]
        s.apart[1, i] += s.tick[()] * s.apart[0, i]
        s.apart[2, i] -= s.correct[0, 0] * missed
    if s.evidence[()] > SURE_OF_RATE:
        for i in range(3):
            s.offset[10 + i] += s.apart[0, i]
            s.estimate[10 + i] += s.apart[0, i]
        s.age[GYRO_CHANNEL] = s.waits[0] = 0
        s.waits[1] = int(JUMP_BELIEVED / s.tick[()])
    return bool(s.evidence[()] > -SURE_OF_RATE)
