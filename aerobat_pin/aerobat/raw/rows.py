"""Each raw sample as a row: what it says about the state at the start of its interval.

A sample at stamp t belongs to the last knot before it, s = t - t_k later, and is compared with the nominal motion at t:

    pose            log of the measured against the nominal,   x(t) = Ad(exp(v s))^-1 x_k + s dv_k
    gyro            R_s^T (w + dw + s a) + b_g
    accelerometer   R_s^T (v' + w x v - R^T g + ...) + b_a,    its row: a + w x dv - v x dw - [R^T g]x xi
    crank, torque   see `dynamics`

A clock offset o means that the sample shows the time t - o: its column is minus the sample's rate of change.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pinocchio as pin

from aerobat_pin.aerobat.motion import Torque
from aerobat_pin.aerobat.raw.channels import RawRecord, SensorSamples
from aerobat_pin.aerobat.raw.dynamics import LinearDynamics, cross_matrices
from aerobat_pin.aerobat.raw.layout import CRANK_ERROR, POSE_ERROR, TWIST_ERROR, Layout
from aerobat_pin.aerobat.raw.nominal_motion import NominalMotion
from aerobat_pin.aerobat.raw.recursion import SampleRows
from aerobat_pin.numerics import Array, Integers

TURNING = slice(9, 12)  # the states of the body's rate
SLOPE_OVER = 15  # samples over which the rate of change of a series is taken
EYE = np.eye(3)
LATE = 1.5  # intervals after the last knot: later samples are not used


class Sensed(NamedTuple):
    """Samples of one sensor, and about what they are linearised.

    Attributes:
        sensor: noise, place and turn; its own samples are not used.
        layout: places of the states.
        nominal: the motion.
        d: the linear model about it.
        torque: which torque is used.
        knot: (k,) last knot before each sample.
        at: (k,) times [s].
        values: (k, c) samples.
    """

    sensor: SensorSamples
    layout: Layout
    nominal: NominalMotion
    d: LinearDynamics
    torque: Torque
    knot: Integers
    at: Array
    values: Array

    @property
    def late(self) -> Array:
        """Time (k, 1) since the knot."""
        return (self.at - self.nominal.time[self.knot])[:, None]

    @property
    def interval(self) -> Integers:
        """The interval (k,) of each sample; the last one for those after its end."""
        return np.minimum(self.knot, len(self.d.push) - 1)

    def no_rows(self) -> Array:
        """Return rows (k, c, n) of zeros."""
        return np.zeros((*self.values.shape, self.layout.size))

    def shown(self, time: Array, series: Array) -> tuple[Array, Array]:
        """Return a series (m, c) at the samples' times, and its rate of change if a clock offset is estimated."""
        values, wanted = _interpolated(time, series, self.at), self.sensor.name in self.layout.offset_at
        return values, _rate_of(time, series, self.at) if wanted else np.zeros_like(values)


def sample_rows(record: RawRecord, layout: Layout, nominal: NominalMotion, dynamics: LinearDynamics) -> SampleRows:
    """Return all samples of a record as rows."""
    blocks = []
    for index, (name, channel) in enumerate(record.channels.items()):
        at, last = channel.time, nominal.time[-1] + LATE * (nominal.time[-1] - nominal.time[-2])
        use = (at >= nominal.time[0] - 1e-9) & (at < last)
        at, values = at[use], channel.values[use]
        k = np.clip(np.searchsorted(nominal.time, at + 1e-9, side="right") - 1, 0, len(nominal.time) - 1)
        sensed = Sensed(channel, layout, nominal, dynamics, record.torque, k, at, values)
        h, e, rate = ROWS_BY_SENSOR[name](sensed)
        if name in layout.offset_at:
            h[:, :, layout.offset_at[name]] = -rate
        count = e.shape[1]
        variance = np.full(e.size, channel.noise**2)
        blocks.append((np.repeat(k, count), h.reshape(-1, layout.size), e.ravel(), variance, np.full(e.size, index)))
    knot, h, e, R, sensor = (np.concatenate(parts) for parts in zip(*blocks, strict=True))
    order = np.argsort(knot, kind="stable")
    start = np.searchsorted(knot[order], np.arange(len(nominal.time) + 1))
    return SampleRows(start.astype(np.intp), np.ascontiguousarray(h[order]), e[order], R[order], sensor[order])


def _interpolated(time: Array, series: Array, at: Array) -> Array:
    """Return a series (m, c) at times `at` (k,), by straight lines that are extended at the ends."""
    if len(time) == 1:
        return np.repeat(series, len(at), axis=0)
    first = np.clip(np.searchsorted(time, at, side="right") - 1, 0, len(time) - 2)
    share = (at - time[first]) / (time[first + 1] - time[first])
    return np.asarray(series[first] + share[:, None] * (series[first + 1] - series[first]))


def _rate_of(time: Array, series: Array, at: Array) -> Array:
    """Return the rate of change of a series (m, c) at times `at` (k,), over some samples.

    Noise of the series would make up a clock offset, because a sample's own noise is in the smoothed series too.
    """
    window = np.hanning(SLOPE_OVER + 2)[1:-1]
    window /= np.sum(window)
    half = SLOPE_OVER // 2
    padded = np.pad(series, ((half, half), (0, 0)), mode="reflect", reflect_type="odd")
    smooth = np.column_stack([np.convolve(column, window, mode="valid") for column in padded.T])
    return np.column_stack([np.interp(at, time, column) for column in np.gradient(smooth, time, axis=0).T])


def _poses_at(sensed: Sensed) -> tuple[Array, Array, Array]:
    """Return rotation (k, 3, 3), position (k, 3) and Ad(exp(v s))^-1 (k, 6, 6) at the samples' times."""
    count, nominal = len(sensed.knot), sensed.nominal
    rotation, position, ad = np.empty((count, 3, 3)), np.empty((count, 3)), np.empty((count, 6, 6))
    last = len(nominal.time) - 2
    for i, (first, t) in enumerate(zip(sensed.knot.tolist(), sensed.at.tolist(), strict=True)):
        j = min(first, last)
        before, after = nominal.body(j), nominal.body(j + 1)
        share = (t - nominal.time[j]) / (nominal.time[j + 1] - nominal.time[j])
        seen = before * pin.exp6(share * pin.log6(before.actInv(after)))
        rotation[i], position[i] = seen.rotation, seen.translation
        ad[i] = pin.exp6((t - nominal.time[first]) * nominal.twist[first]).toActionMatrixInverse()
    return rotation, position, ad


def _position(sensed: Sensed) -> tuple[Array, Array, Array]:
    (rotation, position, ad), place, h = _poses_at(sensed), sensed.sensor.place, sensed.no_rows()
    lever = np.concatenate([EYE, -cross_matrices(place[None])[0]], axis=1)
    h[:, :, POSE_ERROR] = rotation @ (lever @ ad)
    h[:, :, TWIST_ERROR] = sensed.late[:, :, None] * (rotation @ lever)
    e = sensed.values - position - rotation @ place
    return h, e, np.zeros_like(e)


def _orientation(sensed: Sensed) -> tuple[Array, Array, Array]:
    (rotation, _, ad), turn = _poses_at(sensed), sensed.sensor.turn
    seen = [pin.Quaternion(q / np.linalg.norm(q)).matrix() for q in sensed.values]
    e = np.reshape([pin.log3((R @ turn).T @ S) for R, S in zip(rotation, seen, strict=True)], (-1, 3))
    h = np.zeros((*e.shape, sensed.layout.size))
    h[:, :, POSE_ERROR] = turn.T @ ad[:, 3:]
    h[:, :, TURNING] = sensed.late[:, :, None] * turn.T
    return h, e, np.zeros_like(e)


def _gyro(sensed: Sensed) -> tuple[Array, Array, Array]:
    d, turn, s, k, h = sensed.d, sensed.sensor.turn, sensed.late, sensed.interval, sensed.no_rows()
    rate, slope = sensed.shown(sensed.nominal.time, sensed.nominal.twist[:, 3:] @ turn)
    h[:, :, TURNING] = turn.T
    h += s[:, :, None] * (turn.T @ d.acceleration[k, 3:])
    h[:, :, sensed.layout.gyro_bias] += EYE
    return h, sensed.values - rate - s * (d.push[k, 3:] @ turn), slope


def _accelerometer(sensed: Sensed) -> tuple[Array, Array, Array]:
    turn, place, d, k = sensed.sensor.turn, sensed.sensor.place, sensed.d, sensed.interval
    twist, rate, half = d.middle_twist, d.middle_acceleration, d.half[k]
    crossed = cross_matrices(np.concatenate([twist[:, :3], twist[:, 3:], rate[:, 3:], d.up]))
    (V, W, turning, up), lever = crossed.reshape(4, -1, 3, 3), cross_matrices(place[None])[0]
    by_place = turning + W @ W
    felt = rate[:, :3] - d.up + by_place @ place + (W @ twist[:, :3, None])[:, :, 0]
    expected, slope = sensed.shown(sensed.nominal.middles(), felt @ turn)
    by_rate = np.concatenate([EYE, -lever], axis=1)
    by_twist = np.concatenate([W, lever @ W - 2.0 * W @ lever - V], axis=2)[k]
    by_push, by_turn = by_rate + half * by_twist, -up[k]
    in_body = by_push @ d.acceleration[k]
    in_body[:, :, POSE_ERROR] += by_turn @ d.ad_half[k, 3:]
    in_body[:, :, TWIST_ERROR] += by_twist
    in_body[:, :, TURNING] += half * by_turn
    h = turn.T @ in_body
    h[:, :, sensed.layout.accelerometer_bias] += EYE
    if sensed.layout.mount:
        h[:, :, sensed.layout.mount_at] = np.concatenate([turn.T @ by_place[k], cross_matrices(expected)], axis=2)
    return h, sensed.values - expected - (by_push @ d.push[k, :, None])[:, :, 0] @ turn, slope


def _crank(sensed: Sensed) -> tuple[Array, Array, Array]:
    s, h = sensed.late, sensed.no_rows()
    angle, rate, bend = (part[:, None] for part in sensed.nominal.crank[sensed.knot].T)
    h[:, :, CRANK_ERROR] = np.stack([np.ones_like(s), s, 0.5 * s**2], axis=2)
    e = sensed.values - (angle + s * rate + 0.5 * s**2 * bend)
    e -= 2.0 * np.pi * np.round(e / (2.0 * np.pi))
    return h, e, rate + s * bend


def _torque(sensed: Sensed) -> tuple[Array, Array, Array]:
    d, k = sensed.d, sensed.interval
    series, h = d.torque_at, d.torque[k]
    if sensed.torque == "motor_only":
        series = np.sum(d.slope * d.torque_at, axis=1, keepdims=True)
        h = np.einsum("ki,kij->kj", d.slope[k], h)[:, None]
    expected, slope = sensed.shown(sensed.nominal.middles(), series)
    return h, sensed.values - expected, slope


ROWS_BY_SENSOR = {  # each returns rows (k, c, n), samples less their prediction (k, c), rates of change (k, c)
    "position": _position,
    "orientation": _orientation,
    "gyro": _gyro,
    "accelerometer": _accelerometer,
    "crank": _crank,
    "torque": _torque,
}
