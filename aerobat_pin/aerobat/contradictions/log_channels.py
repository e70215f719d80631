"""Find contradictions between the measured channels of a log: wrong units, wrong orders, held and late channels.

Each check compares two channels that geometry ties to each other, without forces, air or observers:

| pair | tie |
|---|---|
| joint angles, crank angle | the closed linkage |
| attitude, gyro | the attitude turns by the integral of the gyro |
| position, velocity | the position moves by the integral of the velocity in world axes |
| joint angles, joint rates | the angles change by the integral of the rates |

An integral is compared over windows of 0.1 s, so a small bias does not count. The second channel of a pair is first
shifted in time until it fits the first best; the shift is the delay between them, and what is left is compared with a
threshold. Good sensors stay below the thresholds by a factor of three or more, also with the noise, bias and rounding
of the shipped scenarios.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from aerobat_pin.aerobat.contradictions.raw_channels import raw_contradictions
from aerobat_pin.aerobat.flight_log import FlightLog
from aerobat_pin.numerics import Array
from aerobat_pin.robot import JOINTS, Aerobat, rotations

COMPARED_OVER = 0.1  # [s]: over which integrals are compared
LONGEST_SHIFT = 0.05  # [s]
SHIFT_STEPS = 6  # most Gauss-Newton steps of the shift
SMALLEST_SHIFT = 1e-5  # [s]: a smaller step ends the search
WIDEST_GAP = 3.0  # times the mean step; over a longer one no rate is integrated
FEWEST_POINTS = 8  # at which two series are compared, for otherwise they say nothing
MOST_POINTS = 400  # at which two series are compared
LARGEST_DELAY = 0.8e-3  # [s]; a millisecond costs an R2 of 0.1
SHIFT_GAIN = 1.2  # a shift is a delay if it makes the mean square difference smaller by this factor
LARGEST_OPENING = 0.01  # [rad]: rms difference of a joint angle from the closed linkage; encoders are 20 times better
LARGEST_TURN = 0.02  # [rad] in a window; a gyro's bias of 2 mrad/s makes a hundredth of it
LARGEST_STEP = 0.01  # [m] in a window
LARGEST_SHARE = 0.3  # of the motion itself, above which a difference counts
LARGEST_ACCELERATION = 50.0  # [m/s2], rms over windows: five times gravity
FEWEST_CHANGES = 4  # of a channel that can be told to be held
FREQUENT = 0.75  # share of samples that change in a channel that is not held
REGULAR = 0.95  # share of repeats that must come at even intervals; a rounded slow signal repeats irregularly
POSITION_OFF = "position against velocity"
UPRIGHT = 0.5  # mean cosine of the tilt beyond which a flight counts as upright


@dataclass(frozen=True)
class _Pair:
    """Two series (m, c) that should be equal up to a constant, and how they fit.

    Attributes:
        first, second: names of the channels.
        moved: rms of the first series in each column.
        delay: shift of the second series that fits best, None if it does not move or the shift explains little [s].
        left: rms difference in each column after the shift.
    """

    first: str
    second: str
    moved: Array
    delay: float | None
    left: Array

    def misfit(self, floor: float) -> float:
        """Return the largest difference of a column divided by its threshold; above 1 the channels contradict."""
        return float(np.max(self.left / np.maximum(floor, LARGEST_SHARE * self.moved)))


def contradictions(log: FlightLog, robot: Aerobat) -> list[str]:
    """Return the contradictions in the measured channels of a log; an empty list for a consistent log.

    Each is one sentence that begins with the kind of contradiction and says what is wrong and what to check.

    Args:
        log: the flight log.
        robot: the assumed robot, whose linkage ties the joints to the crank.

    Raises:
        LinkageError: the assumed linkage cannot close at a recorded crank angle.
    """
    if log.is_raw:
        return raw_contradictions(log)
    rising = np.diff(log.time, prepend=-np.inf) > 0.0
    found = list(_held(log))
    time = log.time[rising]
    if len(time) < FEWEST_POINTS:
        return found
    channels = {name: values[rising] for name, values in _sampled_channels(log).items()}
    found += _joints(channels, robot, time)
    found += _body(channels, time)
    return found


def _sampled_channels(log: FlightLog) -> dict[str, Array]:
    """Return the sampled channels, each (m, c), by the names that warnings call them."""
    measured = {name: np.asarray(log.measured[name].values, float) for name in log.measured.data_vars}
    pose, twist = measured.get("q", measured.get("pose")), measured.get("v", measured.get("twist"))
    assert pose is not None
    found = {"position": pose[:, :3], "attitude": pose[:, 3:7]}
    if twist is not None:
        found |= {"velocity": twist[:, :3], "gyro": twist[:, 3:6]}
    if "q" in measured or "joint_angle" in measured:
        found["joint angles"] = measured["joint_angle"] if "joint_angle" in measured else pose[:, 7:]
    if "v" in measured or "joint_rate" in measured:
        found["joint rates"] = measured["joint_rate"] if "joint_rate" in measured else measured["v"][:, 6:]
    for name, title in (("crank_angle", "crank angle"), ("airspeed", "airspeed")):
        if name in measured:
            found[title] = measured[name][:, None]
    return found


def _held(log: FlightLog) -> Iterator[str]:
    """Yield the channels that repeat their samples at even intervals, as those of a slower sensor do."""
    step = _step(log.time)
    for name, values in _sampled_channels(log).items():
        changes = np.flatnonzero(np.any(values[1:] != values[:-1], axis=1))
        gaps = np.diff(changes)
        if not FEWEST_CHANGES < len(changes) < FREQUENT * len(values):
            continue
        period = float(np.median(gaps))
        off = np.abs(gaps - period * np.maximum(np.round(gaps / period), 1.0))
        if np.mean(off <= (1.0 if period >= 4.0 else 0.0)) >= REGULAR:
            rate, own = 1.0 / step, 1.0 / (step * float(np.mean(gaps)))
            yield (
                f"held channel: {name} changes only {own:.3g} times a second in a log of {rate:.4g} samples a second; "
                "interpolate it to the log's times"
            )


def _joints(channels: dict[str, Array], robot: Aerobat, time: Array) -> Iterator[str]:
    """Yield contradictions between joint angles and crank angle, and between joint angles and joint rates."""
    angles = channels.get("joint angles")
    if angles is None:
        return
    if "crank angle" in channels:
        closure = robot.linkage.solve(channels["crank angle"][:, 0])
        closed = np.stack([closure.theta_s, closure.theta_e] * 2, axis=1)
        pair = _fit("joint angles", "crank angle", angles, closed, time)
        yield from _late(pair)
        worst = int(np.argmax(pair.left))
        if (opening := float(pair.left[worst])) > LARGEST_OPENING:
            yield (
                f"joints off the linkage: {JOINTS[worst]} is {np.degrees(opening):.2f} deg (rms) off the angle of the "
                f"linkage at crank_angle, {np.degrees(LARGEST_OPENING):.2f} are allowed; check zero and sign of "
                "joints and crank, and the believed linkage"
            )
    if "joint rates" in channels:
        yield from _late(_fit_rates("joint angles", "joint rates", angles, channels["joint rates"], time))


def _body(channels: dict[str, Array], time: Array) -> Iterator[str]:
    """Yield contradictions between position, attitude, velocity and gyro."""
    attitude = channels["attitude"]
    read, up = list(_pairs(channels, attitude, time)), _upright(attitude)
    misfit = max((pair.misfit(floor) for pair, floor in read), default=0.0)
    if misfit > 1.0 or up < -UPRIGHT:
        other = attitude[:, [1, 2, 3, 0]]
        other_up = _upright(other)
        other_misfit = max((pair.misfit(floor) for pair, floor in _pairs(channels, other, time)), default=0.0)
        misread = misfit > 1.0 and other_misfit < min(1.0, 0.5 * misfit)
        if misread or (up < -UPRIGHT and other_up > UPRIGHT):
            yield (
                f"quaternion order: read as qx, qy, qz, qw the body's z axis points up with a mean cosine of {up:.2f}, "
                f"and the rates differ by {misfit:.2g} times what is allowed; read with w first {other_up:.2f} and "
                f"{other_misfit:.2g}: the columns seem to be w, x, y, z"
            )
            return
    for pair, floor in read:
        yield from _late(pair)
        if pair.misfit(floor) > 1.0:
            worst = int(np.argmax(pair.left / np.maximum(floor, LARGEST_SHARE * pair.moved)))
            turn = pair.second == "gyro"
            title, unit, axis = ("gyro against attitude", "rad", "about") if turn else (POSITION_OFF, "m", "along")
            limit = max(floor, LARGEST_SHARE * float(pair.moved[worst]))
            yield (
                f"{title}: in {COMPARED_OVER:g} s they differ by {pair.left[worst]:.3g} {unit} (rms) {axis} "
                f"{'xyz'[worst]}, {limit:.2g} are allowed; {'rad/s' if turn else 'm, m/s'} and body axes were expected"
            )
    if "velocity" not in channels:
        yield from _accelerations(channels["position"], time)


def _pairs(channels: dict[str, Array], attitude: Array, time: Array) -> Iterator[tuple[_Pair, float]]:
    """Yield the pairs of body channels for an attitude (m, 4), with the floors of their thresholds."""
    if "gyro" in channels:
        a, b = attitude[:-1], attitude[1:]
        vector = a[:, 3:] * b[:, :3] - b[:, 3:] * a[:, :3] - np.cross(a[:, :3], b[:, :3])
        scalar = np.einsum("ij,ij->i", a, b)
        sine = np.maximum(np.linalg.norm(vector, axis=1), 1e-12)
        angle = 2.0 * np.arctan2(sine, np.abs(scalar)) * np.where(scalar < 0.0, -1.0, 1.0)
        turned = np.concatenate([np.zeros((1, 3)), np.cumsum(vector * (angle / sine)[:, None], axis=0)])
        pair = _fit_rates("attitude", "gyro", turned, channels["gyro"], time)
        yield pair, LARGEST_TURN
        attitude = _earlier(attitude, max(pair.delay or 0.0, 0.0), time)  # a channel is never early
    if "velocity" in channels:
        velocity = np.einsum("mij,mj->mi", _rotations(attitude), channels["velocity"])
        yield _fit_rates("position", "velocity", channels["position"], velocity, time), LARGEST_STEP


def _earlier(attitude: Array, delay: float, time: Array) -> Array:
    """Return an attitude (m, 4) without its delay [s]."""
    if delay == 0.0:
        return attitude
    sign = np.cumprod(np.where(np.einsum("ij,ij->i", attitude[1:], attitude[:-1]) < 0.0, -1.0, 1.0))
    smooth = attitude * np.concatenate([[1.0], sign])[:, None]
    shifted = np.stack([np.interp(time + delay, time, column) for column in smooth.T], axis=1)
    return np.asarray(shifted / np.linalg.norm(shifted, axis=1)[:, None])


def _rotations(attitude: Array) -> Array:
    return rotations(np.pad(attitude, ((0, 0), (3, 0))))


def _upright(attitude: Array) -> float:
    """Return the mean cosine of the angle between the body's z axis and the vertical."""
    return float(np.mean(1.0 - 2.0 * (attitude[:, 0] ** 2 + attitude[:, 1] ** 2)))


def _step(time: Array) -> float:
    """Return the mean time between samples [s]."""
    return float(time[-1] - time[0]) / (len(time) - 1)


def _fit_rates(first: str, second: str, values: Array, rates: Array, time: Array) -> _Pair:
    """Fit the integral of rates (m, c) to values (m, c), both over windows."""
    steps = 0.5 * (rates[1:] + rates[:-1]) * np.diff(time)[:, None]
    integral = np.concatenate([np.zeros((1, values.shape[1])), np.cumsum(steps, axis=0)])
    n = min(max(1, round(COMPARED_OVER / _step(time))), len(time) // 3)
    gaps = np.concatenate([[0], np.cumsum(np.diff(time) > WIDEST_GAP * _step(time))])
    whole = gaps[n:] == gaps[:-n]
    moved, turned = (values[n:] - values[:-n])[whole], (integral[n:] - integral[:-n])[whole]
    return _fit(first, second, moved, turned, time[n:][whole], offset=False)


def _fit(first: str, second: str, a: Array, b: Array, time: Array, *, offset: bool = True) -> _Pair:
    """Shift the series b (m, c) in time until it fits a (m, c) best; with `offset`, they may differ by a constant."""
    if len(a) < FEWEST_POINTS:
        return _Pair(first, second, np.zeros(a.shape[1]), None, np.zeros(a.shape[1]))
    longest = min(LONGEST_SHIFT, 0.125 * (time[-1] - time[0]))
    inside = np.flatnonzero((time >= time[0] + longest) & (time <= time[-1] - longest))
    inside = inside[:: max(1, len(inside) // MOST_POINTS)]
    a, at = a[inside], time[inside]

    def shifted(delay: float) -> tuple[Array, Array]:
        """Return the series and its slope at the times, both late by a delay."""
        after = np.clip(np.searchsorted(time, at - delay, side="right"), 1, len(time) - 1)
        slope = (b[after] - b[after - 1]) / (time[after] - time[after - 1])[:, None]
        return b[after - 1] + slope * (at - delay - time[after - 1])[:, None], slope

    def centred(series: Array) -> Array:
        return np.asarray(series - series.mean(axis=0)) if offset else series

    delay = 0.0
    series, slope = shifted(delay)
    before = after = a - series
    for _ in range(SHIFT_STEPS):
        power = float(np.sum(centred(slope) ** 2))
        step = -float(np.sum(centred(after) * centred(slope))) / power if power > 0.0 else 0.0
        delay = min(max(delay + step, -longest), longest)
        series, slope = shifted(delay)
        after = a - series
        if abs(step) < SMALLEST_SHIFT:
            break
    squares = [float(np.mean(centred(one) ** 2)) for one in (before, after)]
    explained = squares[0] > SHIFT_GAIN * squares[1] and squares[1] < 0.25 * float(np.mean(centred(a) ** 2))
    left, moved = (np.sqrt(np.mean(one**2, axis=0)) for one in (after if explained else before, a))
    return _Pair(first, second, moved, delay if explained else None, left)


def _late(pair: _Pair) -> Iterator[str]:
    """Yield a contradiction if one channel of a pair is late."""
    if pair.delay is not None and abs(pair.delay) > LARGEST_DELAY:
        late, early = (pair.first, pair.second) if pair.delay > 0.0 else (pair.second, pair.first)
        yield (
            f"late channel: {late} come{'s' if late[-1] != 's' else ''} {1e3 * abs(pair.delay):.1f} ms after {early}, "
            f"{1e3 * LARGEST_DELAY:g} ms are allowed; shift one of them"
        )


def _accelerations(position: Array, time: Array) -> Iterator[str]:
    """Yield a contradiction if the body seems to move as no flight does; only for logs without a velocity."""
    n = min(max(1, round(0.5 * COMPARED_OVER / _step(time))), len(time) // 3)
    steps = (position[n:] - position[:-n]) / (time[n:] - time[:-n])[:, None]
    bends = (steps[n:] - steps[:-n]) / (time[n:-n] - time[: -2 * n])[:, None]
    size = np.sqrt(np.mean(bends**2, axis=0))
    worst = int(np.argmax(size))
    if size[worst] > LARGEST_ACCELERATION:
        yield (
            f"position against gravity: {'xyz'[worst]} accelerates with {size[worst]:.0f} m/s2 (rms), "
            f"{LARGEST_ACCELERATION:g} are allowed; metres and seconds were expected"
        )
