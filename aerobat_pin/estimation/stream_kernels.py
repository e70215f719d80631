"""Kernels of a stream: `put` takes a sample of a channel into its ring, `build` makes an observer's next inputs.

A ring keeps the `LENGTH` newest samples of a channel in the order of their stamps. `build` follows the rule of records
(`records/resample.py`): positions, velocities and attitudes are interpolated linearly at the time of the estimate,
efforts are means over the interval since the last one, and an interval with a hole in any channel is not used.

With an accelerometer in place of a measured velocity, u' = R f + g is integrated between the times of estimates and the
accelerometer's stamps by trapezoids; the base then has the velocity R^T u - w x r, r the accelerometer's place. Its
constant is free, as no force depends on it: every `ZEROED` seconds u begins at zero again.
"""

from __future__ import annotations

from typing import Annotated, NamedTuple

import numpy as np

from aerobat_pin.numerics import Array, Integers, inner, kernel, memory_layout, merged
from aerobat_pin.records import ZEROED

LENGTH = 2048  # samples that a ring keeps; a power of two
JUMP = 1.0  # [s]: a stamp further from the newest one is off, unless `CONFIRM` that follow each other agree
CONFIRM = 3
STALL = 0.1  # [s] behind the newest stamp of all channels, after which a channel is named as stalled
SLOW = 2.5  # usual steps of a slow channel, beyond which it has a hole
SETTLE_STEP = 1.1  # factor by which the usual step of a channel changes at most from sample to sample
LARGEST_SAMPLE = 1.0e6  # SI: no sample of a robot is larger
UNIT_TOLERANCE = 0.05  # of a quaternion's length, as in records

# What became of a sample: columns of `Rings.tally`.
TAKEN, INSERTED, REFUSED, DUPLICATE, LATE, OUTLIER, CLOCK_STEP = range(7)
FATES = ("taken", "inserted", "refused", "duplicate", "late", "outlier", "clock_step")
# What `build` found: nothing yet; a time without a past; an interval; one at whose end u begins at zero again.
NOTHING, START, INTERVAL, REZEROED = range(4)
# Channels by what they are: rows of `Rings.slot`.
ANGLE, RATE, EFFORT, PLACE, TURN, SPEED, GYRO, FORCE = range(8)
STREAM_KEYS = (
    "joints.position",
    "joints.velocity",
    "joints.effort",
    "base.position",
    "base.quaternion",
    "base.velocity",
    "base.rate",
    "base.acceleration",
)
# Cells of `Rings.now` [s], and then the velocity u of the accelerometer (3,) [m/s] in world axes.
LAST, SEEN, ORIGIN, INDEX, BEGAN, ZERO, BROKEN, DT, COUNT, U = range(10)


class Rings(NamedTuple):
    """Data of a stream between calls."""

    channels: int
    width: int  # largest number of columns of a channel
    nq: int
    nv: int
    rubbing: int  # number of joints with friction
    head: Annotated[Integers, "channels"]  # index of the oldest sample
    held: Annotated[Integers, "channels"]  # number of samples
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
    usual: Annotated[Array, "channels"]  # usual step of a channel [s]
    pending: Annotated[Array, "channels, 2"]  # stamps in a row that are off but agree: their number, and the latest
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


rings_in = memory_layout(Rings, "channels", "width", "nq", "nv", "rubbing")


@inner
def stamp_at(rings: Rings, c: int, i: int) -> float:
    """Return the stamp [s] of the i-th oldest sample of a channel."""
    return float(rings.time[c, (rings.head[c] + i) & (LENGTH - 1)])


@inner
def bracket(rings: Rings, c: int, t: float) -> int:
    """Return the sample of a channel (two or more) at whose stamp the line through a time begins."""
    low, high = 0, rings.held[c] - 1
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
    usual = rings.usual[c]
    return float(max(rings.setting[0], SLOW * usual if usual > rings.setting[0] else 0.0))


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
    if rings.held[c] == LENGTH:
        rings.head[c] = (rings.head[c] + 1) & (LENGTH - 1)
        rings.held[c] -= 1


@inner
def usable(rings: Rings, c: int, given: Array) -> bool:
    """Write a sample of the columns in SI units to the scratch; return False if it cannot be one."""
    count, sample = rings.columns[c], rings.sample
    if given.shape[0] != count:
        return False
    for j in range(count):
        sample[j] = rings.factor[c, j] * given[j]
        if rings.mixed[c] > 0:
            sample[j] = 0.0
            for k in range(count):
                sample[j] += rings.mix[c, j, k] * (rings.factor[c, k] * given[k])
            sample[j] += rings.shift[c, j]
        if not abs(sample[j]) <= LARGEST_SAMPLE:  # NaN too
            return False
    if c == rings.slot[TURN]:
        square = 0.0
        for j in range(count):
            square += sample[j] ** 2
        if not abs(np.sqrt(square) - 1.0) <= UNIT_TOLERANCE:
            return False
        for j in range(count):
            sample[j] /= np.sqrt(square)
    return True


@inner
def place_sample(rings: Rings, c: int, at: float) -> int:
    """Place the scratch sample with a stamp [s] in its ring; return what became of it."""
    if not abs(at) <= 1.0e12:
        return REFUSED
    count = rings.held[c]
    if count == 0:
        write_cell(rings, c, 0, at)
        rings.held[c] = 1
        return TAKEN
    step = at - stamp_at(rings, c, count - 1)
    if abs(step) > JUMP:
        near = rings.pending[c, 0] > 0.0 and 0.0 < at - rings.pending[c, 1] <= JUMP
        rings.pending[c, 0] = rings.pending[c, 0] + 1.0 if near else 1.0
        rings.pending[c, 1] = at
        if rings.pending[c, 0] < CONFIRM:
            return OUTLIER
        rings.head[c], rings.held[c], rings.usual[c] = 0, 1, 0.0
        write_cell(rings, c, 0, at)
        rings.pending[c, 0] = 0.0
        rings.now[LAST] = rings.now[SEEN] = rings.now[ORIGIN] = np.nan
        return CLOCK_STEP
    rings.pending[c, 0] = 0.0
    if step > 0.0:
        usual = rings.usual[c]
        if usual == 0.0:
            rings.usual[c] = step
        else:
            rings.usual[c] = min(max(step, usual / SETTLE_STEP), usual * SETTLE_STEP)
        make_room(rings, c)
        write_cell(rings, c, rings.held[c], at)
        rings.held[c] += 1
        return TAKEN
    if step == 0.0:
        return DUPLICATE
    return insert_sample(rings, c, at)


@inner
def insert_sample(rings: Rings, c: int, at: float) -> int:
    """Place the scratch sample before newer ones, unless there has been an estimate behind its stamp [s]."""
    i = rings.held[c]
    while i > 0 and stamp_at(rings, c, i - 1) > at:
        i -= 1
    if i > 0 and stamp_at(rings, c, i - 1) == at:
        return DUPLICATE
    if at <= rings.now[SEEN] or (i == 0 and rings.held[c] == LENGTH):
        return LATE
    if rings.held[c] == LENGTH:
        make_room(rings, c)
        i -= 1
    rings.held[c] += 1
    for k in range(rings.held[c] - 1, i, -1):
        a, b = (rings.head[c] + k) & (LENGTH - 1), (rings.head[c] + k - 1) & (LENGTH - 1)
        rings.time[c, a] = rings.time[c, b]
        for j in range(rings.columns[c]):
            rings.value[c, a, j] = rings.value[c, b, j]
    write_cell(rings, c, i, at)
    return INSERTED


@kernel
def put(memory: Array, c: int, time: float, given: Array) -> int:
    """Take a sample of a channel, its columns (k,) as the map names them, at a time [s]; return what became of it."""
    rings = rings_in(memory)
    fate = place_sample(rings, c, time - rings.delay[c]) if usable(rings, c, given) else REFUSED
    rings.tally[c, fate] += 1
    return fate


@inner
def interpolate(rings: Rings, c: int, t: float, out: Array) -> None:
    """Write a channel at a time [s]: on the line through the samples around it; attitudes with length one."""
    i = bracket(rings, c, t)
    a, b = (rings.head[c] + i) & (LENGTH - 1), (rings.head[c] + i + 1) & (LENGTH - 1)
    first, last = rings.value[c, a], rings.value[c, b]
    share = (t - rings.time[c, a]) / (rings.time[c, b] - rings.time[c, a])
    sign, square, count = 1.0, 0.0, rings.columns[c]
    if c == rings.slot[TURN]:
        along = 0.0
        for j in range(count):
            along += first[j] * last[j]
        sign = -1.0 if along < 0.0 else 1.0
    for j in range(count):
        out[j] = first[j] + share * (sign * last[j] - first[j])
        square += out[j] ** 2
    if c == rings.slot[TURN]:
        for j in range(count):
            out[j] /= np.sqrt(square)


@inner
def mean_of_lines(rings: Rings, c: int, first: float, last: float, out: Array) -> None:
    """Write the mean (k,) of the line through the samples of a channel between two times [s]."""
    i, count = bracket(rings, c, first), rings.columns[c]
    for j in range(count):
        out[j] = 0.0
    begin = first
    while begin < last:
        a, b = (rings.head[c] + i) & (LENGTH - 1), (rings.head[c] + i + 1) & (LENGTH - 1)
        start, step = rings.time[c, a], rings.time[c, b] - rings.time[c, a]
        end = min(last, rings.time[c, b]) if i + 2 < rings.held[c] else last
        share = 0.5 * (begin + end - 2.0 * start) / step
        for j in range(count):
            mean = rings.value[c, a, j] + share * (rings.value[c, b, j] - rings.value[c, a, j])
            out[j] += mean * (end - begin) / (last - first)
        begin, i = end, i + 1


@inner
def rotation_of(turn: Array, v: Array, back: bool, out: Array) -> None:
    """Write R v, or with `back` R^T v, of a unit quaternion x, y, z, w."""
    x, y, z, w = turn[0], turn[1], turn[2], turn[3]
    R00, R01, R02 = 1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)
    R10, R11, R12 = 2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)
    R20, R21, R22 = 2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)
    a, b, c = v[0], v[1], v[2]
    if back:
        out[0], out[1], out[2] = R00 * a + R10 * b + R20 * c, R01 * a + R11 * b + R21 * c, R02 * a + R12 * b + R22 * c
    else:
        out[0], out[1], out[2] = R00 * a + R01 * b + R02 * c, R10 * a + R11 * b + R12 * c, R20 * a + R21 * b + R22 * c


@inner
def acceleration_at(rings: Rings, t: float, out: Array) -> None:
    """Write R f + g (3,) [m/s2] in world axes at a time."""
    interpolate(rings, rings.slot[TURN], t, rings.frame[2])
    interpolate(rings, rings.slot[FORCE], t, rings.frame[3])
    rotation_of(rings.frame[2], rings.frame[3], False, out)
    for j in range(3):
        out[j] += rings.gravity[j]


@inner
def integrate_acceleration(rings: Rings, first: float, last: float) -> None:
    """Add the integral of R f + g between two times [s] to u."""
    c, begin = rings.slot[FORCE], first
    before, after, u = rings.frame[0], rings.frame[1], rings.now[U:]
    acceleration_at(rings, first, before)
    i = bracket(rings, c, first) + 1
    while begin < last:
        end = min(stamp_at(rings, c, i), last) if i < rings.held[c] else last
        if end > begin:
            acceleration_at(rings, end, after)
            for j in range(3):
                u[j] += 0.5 * (end - begin) * (before[j] + after[j])
                before[j] = after[j]
            begin = end
        i += 1


@inner
def write_twist(rings: Rings, t: float, v: Array) -> None:
    """Write the base's twist (6,) in body axes at a time [s], whose attitude q holds."""
    turn, slot = rings.q[3:7], rings.slot
    if slot[GYRO] >= 0:
        interpolate(rings, slot[GYRO], t, rings.frame[1])
        if rings.setting[5] > 0.0:
            rotation_of(turn, rings.frame[1], True, v[3:6])
        else:
            v[3:6] = rings.frame[1, :3]
    if slot[SPEED] >= 0:
        interpolate(rings, slot[SPEED], t, rings.frame[1])
        if rings.setting[4] > 0.0:
            rotation_of(turn, rings.frame[1], True, v[:3])
        else:
            v[:3] = rings.frame[1, :3]
    if slot[FORCE] >= 0:
        rotation_of(turn, rings.now[U:], True, v[:3])
        x, y, z = rings.arm
        v[0] -= v[4] * z - v[5] * y
        v[1] -= v[5] * x - v[3] * z
        v[2] -= v[3] * y - v[4] * x


@inner
def write_state(rings: Rings, t: float) -> None:
    """Write q and v at a time [s]."""
    q, v, slot = rings.q, rings.v, rings.slot
    q[:] = rings.neutral
    v[:] = 0.0
    for row in range(2):
        if slot[row] >= 0:
            interpolate(rings, slot[row], t, rings.sample)
            out = q if row == ANGLE else v
            for j in range(rings.columns[slot[row]]):
                out[rings.places[row, j]] = rings.sample[j]
    if slot[PLACE] >= 0:
        interpolate(rings, slot[PLACE], t, q[:3])
    if slot[TURN] >= 0:
        interpolate(rings, slot[TURN], t, q[3:7])
        write_twist(rings, t, v)


@inner
def write_effort(rings: Rings, first: float, last: float) -> None:
    """Write what drives the joints between two times [s], friction included, into `tau`."""
    tau, v, before, c = rings.tau, rings.v, rings.before, rings.slot[EFFORT]
    tau[:] = 0.0
    if c >= 0:
        mean_of_lines(rings, c, first, last, rings.sample)
        for j in range(rings.columns[c]):
            tau[rings.places[2, j]] = rings.sample[j]
    for j in range(rings.rubbed.shape[0]):
        tau[rings.rubbed[j]] *= rings.friction[5, j]
    for i in range(tau.shape[0]):
        rings.squares[i] += tau[i] ** 2
    rings.now[COUNT] += 1.0
    for j in range(rings.rubbed.shape[0]):
        i, law = rings.rubbed[j], rings.friction[:, j]
        rate = 0.5 * (v[i] + before[i])
        change = (v[i] - before[i]) * rings.setting[2] if rings.setting[2] > 0.0 else (v[i] - before[i]) / rings.now[DT]
        tau[i] -= law[0] * np.tanh(rate / law[4]) + law[1] * rate + law[2] * change + law[3]


@inner
def next_time(rings: Rings, leading: int, begin: float, ready: float) -> float:
    """Return the next time [s] to estimate at, of the leading channel's stamps or evenly spaced; NaN if not yet."""
    now, rate, epoch = rings.now, rings.setting[2], rings.setting[3]
    if rate > 0.0:
        if np.isnan(now[ORIGIN]):
            now[ORIGIN], now[INDEX] = begin, 0.0
        dt = 1.0 / rate
        if now[ORIGIN] + now[INDEX] * dt < begin:
            now[INDEX] = np.ceil((begin - now[ORIGIN]) / dt - 1.0e-9)
        t = (epoch + now[ORIGIN]) + now[INDEX] * dt - epoch  # rounded as the stamps are
        if t < begin:
            t = begin
        if t > ready:
            return np.nan
        now[INDEX] += 1.0
        return float(t)
    count = rings.held[leading]
    after = max(now[SEEN], np.nextafter(begin, -np.inf)) if not np.isnan(now[SEEN]) else np.nextafter(begin, -np.inf)
    i = bracket(rings, leading, after)
    while i < count and stamp_at(rings, leading, i) <= after:
        i += 1
    return stamp_at(rings, leading, i) if i < count and stamp_at(rings, leading, i) <= ready else np.nan


@merged
def breaks(rings: Rings, t: float) -> int:
    """Return 2 if a time [s] is inside a hole of a channel, 1 if a hole is behind the last estimate, else 0."""
    found, last = 0, rings.now[LAST]
    for c in range(rings.channels):
        longest, i = longest_step(rings, c), bracket(rings, c, t)
        start = stamp_at(rings, c, i)
        if start < t < stamp_at(rings, c, i + 1) and stamp_at(rings, c, i + 1) - start > longest:
            return 2
        while found == 0 and i >= 0 and not np.isnan(last):
            end = stamp_at(rings, c, i + 1)
            if end <= last:
                break
            if end <= t and end - stamp_at(rings, c, i) > longest:
                found = 1
            i -= 1
        if i < 0 and rings.held[c] == LENGTH and not np.isnan(last) and stamp_at(rings, c, 0) > last:
            found = 1  # what lies between has been overwritten
    return found


@kernel
def build(memory: Array, leading: int) -> int:
    """Write the observers' next inputs; return what they are, or that there are none yet."""
    rings = rings_in(memory)
    now = rings.now
    begin, ready = -np.inf, np.inf
    for c in range(rings.channels):
        if rings.held[c] < 2:
            return NOTHING
        begin = max(begin, stamp_at(rings, c, 0))
        ready = min(ready, stamp_at(rings, c, rings.held[c] - 1))
    ready -= rings.setting[1]
    while True:
        t = next_time(rings, leading, begin, ready)
        if np.isnan(t):
            return NOTHING
        now[SEEN], broken = t, breaks(rings, t)
        if broken < 2:
            break
        rings.skipped[0] += 1
        now[BROKEN] = 1.0
    last = now[LAST]
    if np.isnan(last) or now[BROKEN] > 0.0 or broken > 0 or last < begin:
        now[LAST] = now[BEGAN] = now[ZERO] = t
        now[BROKEN] = 0.0
        now[U : U + 3] = 0.0
        write_state(rings, t)
        rings.before[:] = rings.v
        return START
    now[LAST], now[DT] = t, t - last
    rings.before[:] = rings.v
    if rings.slot[FORCE] >= 0:
        integrate_acceleration(rings, last, t)
    write_state(rings, t)
    write_effort(rings, last, t)
    if rings.slot[FORCE] >= 0 and t - now[ZERO] >= ZEROED:
        rings.before[:] = rings.v
        now[ZERO] = t
        now[U : U + 3] = 0.0
        write_twist(rings, t, rings.v)
        return REZEROED
    return INTERVAL
