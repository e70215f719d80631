"""Kernel of a stream: `build_interval` makes an observer's inputs.

A ring keeps the `LENGTH` newest samples of a channel in the order of their stamps. `build_interval` follows the rule of
records (`records/resample.py`): positions, velocities and attitudes are interpolated linearly at the time of the
estimate, efforts are means over the interval since the last one; an interval with a hole in any channel is not used.

With an accelerometer in place of a measured velocity, u' = R f + g is integrated between the times of estimates and the
accelerometer's stamps by trapezoids; the base then has the velocity R^T u - w x r, r the accelerometer's place. Its
constant is free, as no force depends on it: every `ZEROED` seconds u begins at zero again.
"""

from __future__ import annotations

import numpy as np

from aerobat_pin.estimation.stream_rings import (
    ANGLE,
    BEGAN,
    BROKEN,
    CLOCK_ORIGIN,
    COUNT,
    DT,
    EFFORT_RING,
    FORCE,
    GYRO_RING,
    INDEX,
    INTERVAL,
    LAST,
    LAST_SEEN,
    LENGTH,
    NO_ESTIMATE,
    PLACE_RING,
    REZEROED,
    SPEED,
    STREAM_START,
    TURN_RING,
    ZERO,
    Rings,
    U,
    bracket,
    longest_step,
    stamp_at,
)
from aerobat_pin.numerics import Array, fields_of, inlined, inner, kernel
from aerobat_pin.records import FAR_AWAY, ZEROED


@inner
def interpolate(rings: Rings, c: int, t: float, out: Array) -> None:
    """Write a channel at a time [s]: on the line through the samples around it; attitudes with length one."""
    i = bracket(rings, c, t)
    a, b = (rings.head[c] + i) & (LENGTH - 1), (rings.head[c] + i + 1) & (LENGTH - 1)
    first, last = rings.value[c, a], rings.value[c, b]
    share = (t - rings.time[c, a]) / (rings.time[c, b] - rings.time[c, a])
    sign, square, count = 1.0, 0.0, rings.columns[c]
    if c == rings.slot[TURN_RING]:
        along = 0.0
        for j in range(count):
            along += first[j] * last[j]
        sign = -1.0 if along < 0.0 else 1.0
    for j in range(count):
        out[j] = first[j] + share * (sign * last[j] - first[j])
        square += out[j] ** 2
    if c == rings.slot[TURN_RING]:
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
        end = min(last, rings.time[c, b]) if i + 2 < rings.filled[c] else last
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
    interpolate(rings, rings.slot[TURN_RING], t, rings.frame[2])
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
        end = min(stamp_at(rings, c, i), last) if i < rings.filled[c] else last
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
    if slot[GYRO_RING] >= 0:
        interpolate(rings, slot[GYRO_RING], t, rings.frame[1])
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
    if slot[PLACE_RING] >= 0:
        interpolate(rings, slot[PLACE_RING], t, q[:3])
        q[:3] = np.fmod(q[:3], FAR_AWAY)  # no force depends on it
    if slot[TURN_RING] >= 0:
        interpolate(rings, slot[TURN_RING], t, q[3:7])
        write_twist(rings, t, v)


@inner
def write_effort(rings: Rings, first: float, last: float) -> None:
    """Write what drives the joints between two times [s], friction included, into `tau`."""
    tau, v, before, c = rings.tau, rings.v, rings.before, rings.slot[EFFORT_RING]
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
        if np.isnan(now[CLOCK_ORIGIN]):
            now[CLOCK_ORIGIN], now[INDEX] = begin, 0.0
        dt = 1.0 / rate
        if now[CLOCK_ORIGIN] + now[INDEX] * dt < begin:
            now[INDEX] = np.ceil((begin - now[CLOCK_ORIGIN]) / dt - 1.0e-9)
        t = (epoch + now[CLOCK_ORIGIN]) + now[INDEX] * dt - epoch  # rounded as the stamps are
        if t < begin:
            t = begin
        if t > ready:
            return np.nan
        now[INDEX] += 1.0
        return float(t)
    count = rings.filled[leading]
    after = np.nextafter(begin, -np.inf)
    if not np.isnan(now[LAST_SEEN]):
        after = max(now[LAST_SEEN], after)
    i = bracket(rings, leading, after)
    while i < count and stamp_at(rings, leading, i) <= after:
        i += 1
    return stamp_at(rings, leading, i) if i < count and stamp_at(rings, leading, i) <= ready else np.nan


@inlined
def breaks(rings: Rings, t: float) -> int:
    """Return 2 if a time [s] is inside a hole of a channel, 1 if a hole is behind the last estimate, else 0."""
    hole, last = 0, rings.now[LAST]
    for c in range(rings.channels):
        longest, i = longest_step(rings, c), bracket(rings, c, t)
        start = stamp_at(rings, c, i)
        if start < t < stamp_at(rings, c, i + 1) and stamp_at(rings, c, i + 1) - start > longest:
            return 2
        while hole == 0 and i >= 0 and not np.isnan(last):
            end = stamp_at(rings, c, i + 1)
            if end <= last:
                break
            if end <= t and end - stamp_at(rings, c, i) > longest:
                hole = 1
            i -= 1
        if i < 0 and rings.filled[c] == LENGTH and not np.isnan(last) and stamp_at(rings, c, 0) > last:
            hole = 1  # what lies between has been overwritten
    return hole


@kernel
def build_interval(memory: Array, leading: int) -> int:
    """Write the observers' next inputs; return what they are, or that there are none yet."""
    rings = fields_of(memory, Rings)
    now = rings.now
    begin, ready = -np.inf, np.inf
    for c in range(rings.channels):
        if rings.filled[c] < 2:
            return NO_ESTIMATE
        begin = max(begin, stamp_at(rings, c, 0))
        ready = min(ready, stamp_at(rings, c, rings.filled[c] - 1))
    ready -= rings.setting[1]
    while True:
        t = next_time(rings, leading, begin, ready)
        if np.isnan(t):
            return NO_ESTIMATE
        now[LAST_SEEN], broken = t, breaks(rings, t)
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
        return STREAM_START
    if rings.stuck.any():
        now[BEGAN] = t
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
