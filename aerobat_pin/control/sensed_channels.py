"""The seven channels of the sensors: which samples are good, what one says of another, and turns by an attitude."""

from __future__ import annotations

from math import cos, isfinite, pi, sin, sqrt
from typing import Annotated, NamedTuple

from aerobat_pin.numerics import Array, Integers, inner

CHANNELS = ("position", "attitude", "velocity", "gyro", "joint_angle", "joint_rate", "crank_angle")
FAULTS = ("invalid", "held", "jumped")  # not finite or no rotation; not changed when it should have; out of reach
EDGES = (0, 3, 7, 10, 13, 17, 21, 22)  # where each channel begins in a row of all
POSITION, ATTITUDE, VELOCITY, GYRO_CHANNEL, JOINT_CHANNEL, RATES, CRANK = range(7)
JUMP_BELIEVED = 0.1  # [s]
SURE_OF_RATE = 6.0  # logarithm of the odds at which a gyro that jumped, or what was expected, is taken for wrong


class Senses(NamedTuple):
    """State of the seven channels, in the order of `CHANNELS`; rows (22,) hold all, as `EDGES` divides them.

    Constants: `joints` (2, 4) places of the joints in q and v, `series` of the linkage, `start`, `course` (3,) position
    and velocity of the course, `level` (4,) its attitude, `swing` as in `Nominal`, `rate` () of the crank, `wrench`
    (6,), `steering` (2,), `inertia` (3,) as in `Nominal`, `tick` () [s], `first` () the crank's angle at the start
    [rad], `share` (7,) by which an offset follows a sample, `correct` (2, 2) what an attitude missed by 1 rad adds to
    `followed` [rad] and to the rate [rad/s], and a position missed by 1 m to `place` [m] and to the velocity [m/s],
    `trust` (4,) share by which the doubt follows, its limit [rad/s], the jump that puts a gyro on trial [rad/s], and
    the attitude's variance [rad2], `delay`, `period`, `still` (7,) in ticks: how late a sample is, how long one lasts,
    and after how long one that has not changed is taken for a new one; `reach` (7, 2) tolerance, and what is added to
    it in a tick.

    State: `ticks` (1,), `age` (7,) ticks since the last good sample, `faults` (7, 3), `raw` (22,) samples, `offset`
    (22,) of estimates from carriers, `followed` (4,) attitude and `place` (3,) position that follow the measured ones,
    `turned` (3,) rate that moments made, `doubt` (3,) by how much the gyro shows too little [rad/s]; `trial` (1,)
    samples of the gyro that are on trial, 0 if none, -1 if they were found wrong, `expected` (3,) the offset without
    them, `evidence` () logarithm of the odds that they are right, `apart` (2, 3) the angle by which they turn more than
    what was expected, and what `followed` has been turned back meanwhile [rad]; `carriers` (delays + 1, 22), the newest
    at row `ticks` modulo their number.

    Results: `beyond` (7,) ticks by which the last good sample is older than its period; `estimate` (22,), and the same
    as `q`, `v` and in `estimate[21]` the crank angle; `error` (6,) position off the course [m], world axes, and
    attitude off the level one [rad]. Scratch: the rest.
    """

    joints: Annotated[Integers, "2, 4"]
    series: Annotated[Array, "harmonics, 4"]
    start: Annotated[Array, "3"]
    course: Annotated[Array, "3"]
    level: Annotated[Array, "4"]
    swing: Annotated[Array, "2 * waves, 12"]
    rate: Annotated[Array, ""]
    wrench: Annotated[Array, "6"]
    steering: Annotated[Array, "2"]
    inertia: Annotated[Array, "3"]
    tick: Annotated[Array, ""]
    first: Annotated[Array, ""]
    delay: Annotated[Integers, "7"]
    period: Annotated[Integers, "7"]
    still: Annotated[Integers, "7"]
    reach: Annotated[Array, "7, 2"]
    share: Annotated[Array, "7"]
    correct: Annotated[Array, "2, 2"]
    trust: Annotated[Array, "4"]
    ticks: Annotated[Integers, "1"]
    age: Annotated[Integers, "7"]
    faults: Annotated[Integers, "7, 3"]
    raw: Annotated[Array, "22"]
    offset: Annotated[Array, "22"]
    followed: Annotated[Array, "4"]
    turned: Annotated[Array, "3"]
    doubt: Annotated[Array, "3"]
    place: Annotated[Array, "3"]
    trial: Annotated[Integers, "1"]
    expected: Annotated[Array, "3"]
    evidence: Annotated[Array, ""]
    apart: Annotated[Array, "2, 3"]
    carriers: Annotated[Array, "rows, 22"]
    beyond: Annotated[Integers, "7"]
    estimate: Annotated[Array, "22"]
    q: Annotated[Array, "nq"]
    v: Annotated[Array, "nv"]
    error: Annotated[Array, "6"]
    whole: Annotated[Integers, "7"]
    now: Annotated[Array, "22"]
    candidate: Annotated[Array, "22"]
    reference: Annotated[Array, "12"]
    closed: Annotated[Array, "3, 2"]
    a: Annotated[Array, "4"]
    b: Annotated[Array, "4"]


@inner
def taken_at(s: Senses, c: int) -> int:
    """Return the row of the carriers when a channel's sample was taken."""
    return int((s.ticks[0] - min(s.delay[c], s.ticks[0])) % s.carriers.shape[0])


@inner
def is_good(s: Senses, c: int) -> bool:
    """Return whether a channel shows a sample that is new and finite; count what it shows in its place."""
    finite, changed, norm = True, s.ticks[0] == 0, 0.0
    for i in range(EDGES[c], EDGES[c + 1]):
        finite = finite and isfinite(s.now[i])
        changed = changed or s.now[i] != s.raw[i]
        norm += s.now[i] * s.now[i]
    if not finite or (c == ATTITUDE and abs(norm - 1.0) > 0.02):
        s.faults[c, 0] += 1
        return False
    if changed or s.age[c] >= s.still[c]:
        return True
    if s.age[c] >= s.period[c] and s.ticks[0] >= s.delay[c] + s.period[c]:
        s.faults[c, 1] += 1
    return False


@inner
def believed(s: Senses, c: int, off: float) -> bool:
    """Return whether a good sample that is off by so much is believed; count it if not."""
    jumps = off > s.reach[c, 0] + s.reach[c, 1] * s.age[c]
    if jumps and s.ticks[0] > 0 and s.age[c] * s.tick[()] < JUMP_BELIEVED + s.period[c] * s.tick[()]:
        s.faults[c, 2] += 1
        return False
    s.age[c] = 0
    s.whole[c] = 1 if jumps or s.ticks[0] == 0 else 0
    return True


@inner
def share(s: Senses, c: int) -> float:
    """Return the share by which a channel's offset follows its sample: all of it at first and after a jump."""
    return 1.0 if s.whole[c] == 1 else float(s.share[c])


@inner
def within_half_a_turn(angle: float) -> float:
    """Return an angle less whole turns, between -pi and pi [rad]."""
    return (angle + pi) % (2.0 * pi) - pi


@inner
def product(a: Array, b: Array, sign: float, out: Array) -> None:
    """Write the product (4,) of quaternions xyzw a and b, or a and the conjugate of b where the sign is -1."""
    x, y, z = sign * b[0], sign * b[1], sign * b[2]
    first = a[3] * x + a[0] * b[3] + a[1] * z - a[2] * y
    second = a[3] * y - a[0] * z + a[1] * b[3] + a[2] * x
    third = a[3] * z + a[0] * y - a[1] * x + a[2] * b[3]
    fourth = a[3] * b[3] - a[0] * x - a[1] * y - a[2] * z
    out[0], out[1], out[2], out[3] = first, second, third, fourth


@inner
def write_turn(x: float, y: float, z: float, out: Array) -> None:
    """Write the quaternion xyzw (4,) of a rotation vector [rad]."""
    half = 0.5 * sqrt(x * x + y * y + z * z)
    scale = 0.5 * sin(half) / half if half > 1e-9 else 0.5
    out[0], out[1], out[2], out[3] = scale * x, scale * y, scale * z, cos(half)


@inner
def rotate_vector(q: Array, v: Array, sign: float, out: Array) -> None:
    """Write a vector (3,) of the body's axes in the world's, by the attitude xyzw q; back if the sign is -1."""
    x, y, z, w = sign * q[0], sign * q[1], sign * q[2], q[3]
    a, b, c = 2.0 * (y * v[2] - z * v[1]), 2.0 * (z * v[0] - x * v[2]), 2.0 * (x * v[1] - y * v[0])
    first, second = v[0] + w * a + y * c - z * b, v[1] + w * b + z * a - x * c
    out[2] = v[2] + w * c + x * b - y * a
    out[0], out[1] = first, second


@inner
def add_channel(s: Senses, c: int, at: Array) -> None:
    """Judge a channel whose estimate is its offset plus its carrier."""
    if not is_good(s, c):
        return
    late, off = s.carriers[taken_at(s, c)], 0.0
    for i in range(EDGES[c], EDGES[c + 1]):
        s.candidate[i] = s.now[i] if s.delay[c] == 0 else s.now[i] + (at[i] - late[i])
        off = max(off, abs(s.candidate[i] - s.estimate[i]))
    if believed(s, c, off):
        part = share(s, c)
        for i in range(EDGES[c], EDGES[c + 1]):
            s.estimate[i] = s.candidate[i]
            s.offset[i] += part * (s.now[i] - late[i] - s.offset[i])


@inner
def judge_crank(s: Senses, at: Array) -> None:
    """Judge the crank's angle, which counts without whole turns."""
    now, estimate, offset = s.now, s.estimate, s.offset
    estimate[21] = offset[21] + at[21]
    if is_good(s, CRANK):
        late = s.carriers[taken_at(s, CRANK)]
        ahead = now[21] + (at[21] - late[21])
        if believed(s, CRANK, abs(within_half_a_turn(ahead - estimate[21]))):
            turn = within_half_a_turn(now[21] - late[21] - offset[21])
            offset[21] += share(s, CRANK) * turn
            estimate[21] = ahead


@inner
def judge_attitude(s: Senses, at: Array) -> bool:
    """Judge the attitude, whose offset from its carrier is a turn; return whether there is a sample to be believed."""
    if not is_good(s, ATTITUDE):
        return False
    now, estimate, offset, late = s.now, s.estimate, s.offset, s.carriers[taken_at(s, ATTITUDE)]
    product(now[3:7], late[3:7], -1.0, s.a)
    product(s.a, at[3:7], 1.0, s.b)
    alike = s.b[0] * estimate[3] + s.b[1] * estimate[4] + s.b[2] * estimate[5] + s.b[3] * estimate[6]
    size = s.b[0] * s.b[0] + s.b[1] * s.b[1] + s.b[2] * s.b[2] + s.b[3] * s.b[3]
    if not believed(s, ATTITUDE, 2.0 * sqrt(max(0.0, 1.0 - alike * alike / size))):
        return False
    part, sign, norm = share(s, ATTITUDE), 1.0 if alike >= 0.0 else -1.0, 0.0
    for i in range(4):
        offset[3 + i] += part * (sign * s.a[i] - offset[3 + i])
        norm += offset[3 + i] * offset[3 + i]
        estimate[3 + i] = now[3 + i] if s.delay[ATTITUDE] == 0 else s.b[i]
    for i in range(4):
        offset[3 + i] /= sqrt(norm)
    return True


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
