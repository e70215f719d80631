"""Each raw sample as a row: what it says about the state at the start of its interval.

A sample at stamp t belongs to the last knot before it, s = t - t_k later, and is compared with the nominal motion at t:

    pose            log of the measured against the nominal,   x(t) = Ad(exp(v s))^-1 x_k + s dv_k
    gyro            R_s^T (w + dw + s a) + b_g
    accelerometer   R_s^T (v' + w x v - R^T g + ...) + b_a,    its row: a + w x dv - v x dw - [R^T g]x xi
    crank, torque   see `dynamics`

A clock offset o means that the sample shows the time t - o: its column is minus the sample's rate of change.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from aerobat_pin.estimation.raw.channels import RawChannel, RawRecord
from aerobat_pin.estimation.raw.dynamics import LinearDynamics, cross_matrices
from aerobat_pin.estimation.raw.layout import Layout
from aerobat_pin.estimation.raw.nominal import NominalMotion
from aerobat_pin.estimation.raw.rows_kernels import accelerometer_rows, felt_accelerations
from aerobat_pin.numerics import Array, Integers

SLOPE_OVER = 15  # samples over which the rate of change of a series is taken
LATE = 1.5  # intervals after the last knot: later samples are not used


@dataclass(frozen=True)
class SampleRows:
    """Samples as rows, in the order of their knots.

    Attributes:
        start: (m + 2,) first row of each knot.
        h, e, R: (k, n) rows, (k,) samples less their prediction, (k,) variances.
        sensor: (k,) index in `names`; `names` are those of the sensors.
    """

    start: Integers
    h: Array
    e: Array
    R: Array
    sensor: Integers
    names: tuple[str, ...]


def sample_rows(
    record: RawRecord, layout: Layout, nominal: NominalMotion, dynamics: LinearDynamics, shifts: dict[str, float]
) -> SampleRows:
    """Return all samples of a record as rows.

    Args:
        record: the samples.
        layout: places of the states.
        nominal: the motion.
        dynamics: the linear model about it.
        shifts: sensor -> clock offset [s] that is applied.
    """
    found, names = [], tuple(record.channels)
    for index, (name, channel) in enumerate(record.channels.items()):
        at = channel.time - shifts.get(name, 0.0)
        last = nominal.time[-1] + LATE * (nominal.time[-1] - nominal.time[-2])
        use = (at > nominal.time[0] - 1e-9) & (at < last)
        at, values = at[use], channel.values[use]
        k = np.clip(np.searchsorted(nominal.time, at + 1e-9, side="right") - 1, 0, len(nominal.time) - 1)
        h, e, rate = ROWS_BY_SENSOR[name](channel, layout, nominal, dynamics, k, at, values, record.torque)
        if name in layout.offset_at:
            h[:, :, layout.offset_at[name]] = -rate
        count = e.shape[1]
        variance = np.full(e.size, channel.noise**2)
        found.append((np.repeat(k, count), h.reshape(-1, layout.size), e.ravel(), variance, np.full(e.size, index)))
    knot, h, e, R, sensor = (np.concatenate(parts) for parts in zip(*found, strict=True))
    order = np.argsort(knot, kind="stable")
    start = np.searchsorted(knot[order], np.arange(len(nominal.time) + 1))
    return SampleRows(start.astype(np.intp), np.ascontiguousarray(h[order]), e[order], R[order], sensor[order], names)


def _interpolated(time: Array, series: Array, at: Array) -> tuple[Array, Array]:
    """Return a series (m, c) at times `at` (k,), and its rate of change there; straight lines, extended at the ends."""
    if len(time) == 1:
        return np.repeat(series, len(at), axis=0), np.zeros((len(at), series.shape[1]))
    first = np.clip(np.searchsorted(time, at, side="right") - 1, 0, len(time) - 2)
    slope = (series[first + 1] - series[first]) / (time[first + 1] - time[first])[:, None]
    return series[first] + (at - time[first])[:, None] * slope, slope


def _rate_of(time: Array, series: Array, at: Array) -> Array:
    """Return the rate of change of a series (m, c) at times `at` (k,), over some samples.

    Noise of the series would make up a clock offset, because a sample's own noise is in the smoothed series too.
    """
    if len(time) < 3 * SLOPE_OVER:
        return _interpolated(time, series, at)[1]
    window = np.hanning(SLOPE_OVER + 2)[1:-1]
    window /= np.sum(window)
    half = SLOPE_OVER // 2
    padded = np.pad(series, ((half, half), (0, 0)), mode="reflect", reflect_type="odd")
    smooth = np.column_stack([np.convolve(column, window, mode="valid") for column in padded.T])
    return np.column_stack([np.interp(at, time, column) for column in np.gradient(smooth, time, axis=0).T])


def _poses_at(nominal: NominalMotion, k: Integers, at: Array) -> tuple[Array, Array, Array]:
    """Return rotation (n, 3, 3), position (n, 3) and Ad(exp(v s))^-1 (n, 6, 6) at times `at`."""
    rotation, position, ad = np.empty((len(k), 3, 3)), np.empty((len(k), 3)), np.empty((len(k), 6, 6))
    last = len(nominal.time) - 2
    for i, (first, t) in enumerate(zip(k.tolist(), at.tolist(), strict=True)):
        j = min(first, last)
        here = pin.SE3(nominal.rotation[j], nominal.position[j])
        there = pin.SE3(nominal.rotation[j + 1], nominal.position[j + 1])
        share = (t - nominal.time[j]) / (nominal.time[j + 1] - nominal.time[j])
        seen = here * pin.exp6(share * pin.log6(here.actInv(there)))
        rotation[i], position[i] = seen.rotation, seen.translation
        ad[i] = pin.exp6((t - nominal.time[first]) * nominal.twist[first]).toActionMatrixInverse()
    return rotation, position, ad


def _position(
    channel: RawChannel,
    layout: Layout,
    nominal: NominalMotion,
    _d: LinearDynamics,
    k: Integers,
    at: Array,
    values: Array,
    _t: str,
) -> tuple[Array, Array, Array]:
    rotation, position, ad = _poses_at(nominal, k, at)
    h = np.zeros((len(k), 3, layout.size))
    lever = np.concatenate([np.eye(3), -cross_matrices(channel.place[None])[0]], axis=1)
    h[:, :, :6] = rotation @ (lever @ ad)
    h[:, :, 6:12] = (at - nominal.time[k])[:, None, None] * (rotation @ lever)
    e = values - position - rotation @ channel.place
    return h, e, np.zeros_like(e)


def _orientation(
    channel: RawChannel,
    layout: Layout,
    nominal: NominalMotion,
    _d: LinearDynamics,
    k: Integers,
    at: Array,
    values: Array,
    _t: str,
) -> tuple[Array, Array, Array]:
    rotation, _, ad = _poses_at(nominal, k, at)
    h = np.zeros((len(k), 3, layout.size))
    h[:, :, :6] = channel.turn.T @ ad[:, 3:]
    h[:, :, 9:12] = (at - nominal.time[k])[:, None, None] * channel.turn.T
    seen = [pin.Quaternion(q / np.linalg.norm(q)).matrix() for q in values]
    e = np.array([pin.log3((R @ channel.turn).T @ S) for R, S in zip(rotation, seen, strict=True)])
    return h, e, np.zeros_like(e)


def _gyro(
    channel: RawChannel,
    layout: Layout,
    nominal: NominalMotion,
    d: LinearDynamics,
    k: Integers,
    at: Array,
    values: Array,
    _t: str,
) -> tuple[Array, Array, Array]:
    h = np.zeros((len(k), 3, layout.size))
    series = nominal.twist[:, 3:] @ channel.turn
    rate = _interpolated(nominal.time, series, at)[0]
    slope = _rate_of(nominal.time, series, at) if channel.name in layout.offset_at else np.zeros_like(rate)
    s, first = (at - nominal.time[k])[:, None], np.minimum(k, len(d.push) - 1)
    h[:, :, 9:12] = channel.turn.T
    h += s[:, :, None] * (channel.turn.T @ d.acceleration[first, 3:])
    h[:, :, layout.gyro_bias] += np.eye(3)
    return h, values - rate - s * (d.push[first, 3:] @ channel.turn), slope


def _accelerometer(
    channel: RawChannel,
    layout: Layout,
    nominal: NominalMotion,
    d: LinearDynamics,
    k: Integers,
    at: Array,
    values: Array,
    _t: str,
) -> tuple[Array, Array, Array]:
    middle = 0.5 * (nominal.time[1:] + nominal.time[:-1])
    first = np.minimum(k, len(middle) - 1)
    felt = np.empty((len(middle), 3))
    felt_accelerations(d.middle_twist, d.middle_acceleration, d.up, channel.place, felt)
    felt = felt @ channel.turn
    here = _interpolated(middle, felt, at)[0]
    slope = _rate_of(middle, felt, at) if channel.name in layout.offset_at else np.zeros_like(here)
    h, constant, by_place = np.zeros((len(k), 3, layout.size)), np.empty((len(k), 3)), np.empty((len(k), 3, 3))
    accelerometer_rows(
        first, channel.turn, channel.place, d.middle_twist, d.middle_acceleration, d.up, d.acceleration, d.push,
        d.pose, d.twist, d.kick, h, constant, by_place,
    )  # fmt: skip
    h[:, :, layout.accelerometer_bias] += np.eye(3)
    if (mount := layout.mount_at) is not None:
        h[:, :, mount] = np.concatenate([channel.turn.T @ by_place, cross_matrices(here)], axis=2)
    return h, values - here - constant, slope


def _crank(
    channel: RawChannel,
    layout: Layout,
    nominal: NominalMotion,
    _d: LinearDynamics,
    k: Integers,
    at: Array,
    values: Array,
    _t: str,
) -> tuple[Array, Array, Array]:
    s = at - nominal.time[k]
    angle, rate, bend = nominal.crank[k].T
    h = np.zeros((len(k), 1, layout.size))
    h[:, 0, 12], h[:, 0, 13], h[:, 0, 14] = 1.0, s, 0.5 * s**2
    e = values[:, 0] - (angle + s * rate + 0.5 * s**2 * bend)
    e -= 2.0 * np.pi * np.round(e / (2.0 * np.pi))
    return h, e[:, None], (rate + s * bend)[:, None]


def _torque(
    channel: RawChannel,
    layout: Layout,
    nominal: NominalMotion,
    d: LinearDynamics,
    k: Integers,
    at: Array,
    values: Array,
    of: str,
) -> tuple[Array, Array, Array]:
    middle = 0.5 * (nominal.time[1:] + nominal.time[:-1])
    first = np.minimum(k, len(middle) - 1)
    if of == "motor_only":
        series = np.sum(d.slope * d.torque_at, axis=1, keepdims=True)
        h = np.einsum("ki,kij->kj", d.slope[first], d.torque[first])[:, None]
    else:
        series, h = d.torque_at, d.torque[first].copy()
    here = _interpolated(middle, series, at)[0]
    slope = _rate_of(middle, series, at) if channel.name in layout.offset_at else np.zeros_like(here)
    return h, values - here, slope


ROWS_BY_SENSOR = {
    "position": _position,
    "orientation": _orientation,
    "gyro": _gyro,
    "accelerometer": _accelerometer,
    "crank": _crank,
    "torque": _torque,
}
