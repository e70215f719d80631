"""Raw sensors: what motion capture, gyro, accelerometer, crank encoder and torque sensors record of a simulated flight.

Each sensor takes its samples at i / rate and stamps them with that time plus its delay: its clock is late by the delay.

    motion capture    p + R r,   R R_m exp(noise)                     markers at place r, turned by R_m in the body
    gyro              R_s^T w
    accelerometer     R_s^T (v' + w x v - R^T g + w' x r + w x (w x r))       w, v in body axes, at the body's COM
    crank encoder     t1, rounded to a count
    torque            motor torque at the joints

Poses, rates and angles are those of the sample's instant. An accelerometer and a torque sensor average over the time
between two samples; their stamp is the middle of that time. Place, turn and noise are attributes of each channel.
"""

from __future__ import annotations

import zlib
from typing import Any

import numpy as np
import pinocchio as pin
import xarray as xr

from aerobat_pin.aerobat import KNOWN, LABELS, MEASURED, Aerobat, FlightLog, channel
from aerobat_pin.numerics import Array
from aerobat_pin.observers import rotations
from aerobat_pin.scenario import InertialSection, MotionCaptureSection, SampledSection, SensorSection, SensorsSection


def measure_raw(log: FlightLog, robot: Aerobat, sensors: SensorsSection, seed: int) -> FlightLog:
    """Return a log of raw samples; the exact q, v, crank angle and motor torque are moved to its truth.

    Each sensor has its own stream of random numbers.
    """
    assert log.truth is not None
    exact, time = log.measured, log.time
    q, v = np.asarray(exact["q"].values, float), np.asarray(exact["v"].values, float)
    hidden = {name: exact[name] for name in ("q", "v", "crank_angle", "motor_torque") if name not in log.truth}
    kept = {name: exact[name].variable for name in exact.data_vars if str(name).startswith(KNOWN)}
    measured = xr.Dataset(kept, coords={name: exact[name] for name in exact.coords}, attrs=exact.attrs)
    channels: dict[str, tuple[Array, Array, dict[str, Any]]] = {}

    def stream(name: str) -> np.random.Generator:
        return np.random.default_rng([seed, zlib.crc32(f"raw {name}".encode())])

    if (camera := sensors.motion_capture) is not None:
        stamps, taken = _instants(time, camera, stream("motion_capture clock"))
        position, quaternion = _poses(robot.model, time, q, taken, camera, stream("motion_capture"))
        notes = {"place": list(camera.place), "turn_deg": list(camera.turn_deg)}
        channels["mocap_position"] = stamps, position, notes | {"noise": camera.position_noise}
        channels["mocap_quaternion"] = stamps, quaternion, notes | {"noise": camera.orientation_noise}
    if (gyro := sensors.gyro) is not None:
        stamps, taken = _instants(time, gyro, stream("gyro clock"))
        turned = _between(time, v[:, 3:6], taken) @ _turn(gyro)
        channels["gyro"] = stamps, _with_errors(turned, taken, gyro, stream("gyro")), _notes(gyro)
    if (accelerometer := sensors.accelerometer) is not None:
        felt = specific_force(time, q, v, robot.model.gravity.linear, np.array(accelerometer.place))
        stamps, taken, means = _means(time, felt, accelerometer, stream("accelerometer clock"))
        values = _with_errors(means @ _turn(accelerometer), taken, accelerometer, stream("accelerometer"))
        channels["accelerometer"] = stamps, values, _notes(accelerometer)
    if (encoder := sensors.crank_encoder) is not None:
        stamps, taken = _instants(time, encoder, stream("crank_encoder clock"))
        count = 2.0 * np.pi / encoder.counts
        angle = np.round(_between(time, exact["crank_angle"].values[:, None], taken)[:, 0] / count) * count
        channels["encoder"] = stamps, angle, {"noise": count / np.sqrt(12.0)}
    if (torque := sensors.motor_torque) is not None:
        joints = np.asarray(exact["motor_torque"].values, float)[:, list(robot.idx_v)]
        stamps, taken, means = _means(time, joints, torque, stream("motor_torque clock"))
        values = _with_errors(means, taken, torque, stream("motor_torque"))
        channels["joint_torque_sample"] = stamps, values, {"noise": _noise(torque)}
    labels: dict[str, Any] = {}
    for name, (stamps, values, notes) in channels.items():
        row = MEASURED[name]
        labels[row.dims[0]] = channel(stamps, row.dims[:1], "s", "stamp of the sample")
        labels |= {dim: list(LABELS[dim]) for dim in row.dims[1:]}
        measured[name] = xr.Variable(row.dims, values, {"units": row.unit, "long_name": row.meaning, **notes})
    return FlightLog(measured.assign_coords(labels), log.truth.assign(hidden))


def specific_force(time: Array, q: Array, v: Array, gravity: Array, place: Array) -> Array:
    """Return the specific force (m, 3) [m/s2], body axes, means over intervals, at a place from the body's COM [m]."""
    rate = np.diff(v[:, :6], axis=0) / np.diff(time)[:, None]
    w = v[:, 3:6]
    steady = np.cross(w, v[:, :3]) + np.cross(w, np.cross(w, place)) - np.einsum("mji,j->mi", rotations(q), gravity)
    return np.asarray(rate[:, :3] + np.cross(rate[:, 3:], place) + 0.5 * (steady[1:] + steady[:-1]))


def _sample_times(time: Array, sensor: SampledSection) -> Array:
    """Return when a sensor takes its samples (n,) [s]: at its rate, or as often as the log."""
    if sensor.rate is None:
        return time
    return np.asarray(time[0] + np.arange(int((time[-1] - time[0]) * sensor.rate + 1e-6) + 1) / sensor.rate)


def _kept(taken: Array, sensor: SampledSection, rng: np.random.Generator) -> np.ndarray[Any, np.dtype[np.bool_]]:
    kept = rng.random(len(taken)) >= sensor.dropout
    kept[:1] = kept[-1:] = True
    return kept


def _instants(time: Array, sensor: SampledSection, rng: np.random.Generator) -> tuple[Array, Array]:
    """Return the stamps of a sensor's samples, and when they were taken [s]."""
    ticks = _sample_times(time, sensor)
    taken = np.minimum(ticks[_kept(ticks, sensor, rng)], time[-1])
    return taken + sensor.delay, taken


def _means(time: Array, means: Array, sensor: SampledSection, rng: np.random.Generator) -> tuple[Array, Array, Array]:
    """Return stamps, middles [s] and means (n, c) over periods, from means (m, c) over the intervals of the log."""
    edges = _sample_times(time, sensor)
    integral = np.concatenate([np.zeros((1, means.shape[1])), np.cumsum(means * np.diff(time)[:, None], axis=0)])
    over = np.diff(_between(time, integral, np.minimum(edges, time[-1])), axis=0) / np.diff(edges)[:, None]
    middle = 0.5 * (edges[1:] + edges[:-1])
    kept = _kept(middle, sensor, rng)
    return middle[kept] + sensor.delay, middle[kept], over[kept]


def _between(time: Array, values: Array, at: Array) -> Array:
    """Interpolate values (m, c) at times `at` [s]: cubic, through the four neighbours."""
    from scipy.interpolate import make_interp_spline

    if len(at) == len(time) and np.array_equal(at, time):
        return values
    return np.asarray(make_interp_spline(time, values, k=min(3, len(time) - 1))(at))


def _poses(
    model: pin.Model, time: Array, q: Array, at: Array, camera: MotionCaptureSection, rng: np.random.Generator
) -> tuple[Array, Array]:
    """Return positions (n, 3) and quaternions xyzw (n, 4) of the markers at times `at` [s]."""
    marker = pin.SE3(pin.rpy.rpyToMatrix(*np.radians(camera.turn_deg)), np.array(camera.place))
    noise = rng.standard_normal((len(at), 6))
    position, quaternion = np.empty((len(at), 3)), np.empty((len(at), 4))
    first = np.clip(np.searchsorted(time, at + 1e-12, side="right") - 1, 0, len(time) - 2)
    for row, (k, t) in enumerate(zip(first.tolist(), at.tolist(), strict=True)):
        share = min(max((t - time[k]) / (time[k + 1] - time[k]), 0.0), 1.0)
        body = pin.XYZQUATToSE3(q[k, :7])
        body = body * pin.exp6(share * pin.log6(body.actInv(pin.XYZQUATToSE3(q[k + 1, :7]))))
        seen = body * marker
        position[row] = seen.translation + camera.position_noise * noise[row, :3]
        turned = pin.Quaternion(seen.rotation @ pin.exp3(camera.orientation_noise * noise[row, 3:])).coeffs()
        quaternion[row] = turned if row == 0 or turned @ quaternion[row - 1] >= 0.0 else -turned
    return position, quaternion


def _turn(sensor: InertialSection) -> Array:
    """Return the sensor's axes in the body (3, 3); rows of body vectors times it are in the sensor's axes."""
    return np.asarray(pin.rpy.rpyToMatrix(*np.radians(sensor.turn_deg)))


def _with_errors(true: Array, taken: Array, sensor: SensorSection, rng: np.random.Generator) -> Array:
    """Add bias, random walk and white noise to samples (n, c) taken at times (n,) [s], and round them."""
    noise, steps = rng.standard_normal((2, *true.shape))
    steps *= np.sqrt(np.diff(taken, prepend=taken[:1]))[:, None]
    values = true + sensor.noise * noise + sensor.walk * np.cumsum(steps, axis=0) + np.array(sensor.bias)
    return np.asarray(np.round(values / sensor.quantum) * sensor.quantum if sensor.quantum > 0.0 else values)


def _noise(sensor: SensorSection) -> float:
    """Return the deviation that a data sheet would state: white noise and rounding, the largest axis."""
    return float(np.hypot(max(sensor.noise), sensor.quantum / np.sqrt(12.0)))


def _notes(sensor: InertialSection) -> dict[str, Any]:
    return {"place": list(sensor.place), "turn_deg": list(sensor.turn_deg), "noise": _noise(sensor)}
