"""Gather the robot's motion from the measured channels of a log, and reconstruct quantities that were not measured.

| quantity | channel | if it was not measured |
|---|---|---|
| base placement | `q`, or `pose` | (must be in the log) |
| base twist | `v`, or `twist` | differentiated placement: weighted mean over the two neighbouring intervals |
| joint angles | `q`, or `joint_angle` | computed from `crank_angle` by closing the linkage |
| joint rates | `v`, or `joint_rate` | computed from the crank's rate, or else differentiated joint angles |
| crank rate | `crank_rate` | differentiated `crank_angle` |
| crank acceleration | | differentiated crank rate |
| wind | `wind_W` | computed from `airspeed` along the body's x axis, or else the assumed wind |
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from aerobat_pin.aerobat.air_from_scenario import wind_of
from aerobat_pin.aerobat.flight_log import FlightLog
from aerobat_pin.errors import LogError
from aerobat_pin.numerics import Array, guarded
from aerobat_pin.robot import BASE_SIZE, JOINTS, Aerobat, rotations
from aerobat_pin.scenario import AirSection


@dataclass(frozen=True)
class Motion:
    """The motion of a flight at its samples.

    Attributes:
        time: (m + 1,) times of the samples [s].
        q: (m + 1, nq) configurations.
        v: (m + 1, nv) velocities.
        crank: (3, m + 1) angle, rate and acceleration of the crank [rad, rad/s, rad/s2]; None if it is not recorded.
        wind: (m + 1, 2, 3) velocity of the air and its time derivative, world axes [m/s, m/s2].
        source: quantity -> `measured` or `reconstructed`; the wind can also be `believed`, that is, assumed.
    """

    time: Array
    q: Array
    v: Array
    crank: Array | None
    wind: Array
    source: dict[str, str]


@guarded()
def motion(log: FlightLog, robot: Aerobat, air: AirSection) -> Motion:
    """Gather the motion of a flight from its log.

    Args:
        log: the flight log.
        robot: the assumed robot; its linkage supplies joint angles that were not measured.
        air: the assumed air; it supplies the wind if that was not measured.

    Raises:
        LogError: the log contains neither the joint angles nor the crank angle.
        LinkageError: the assumed linkage cannot close at a recorded crank angle.
    """
    measured, time = log.measured, log.time
    source: dict[str, str] = {}
    crank = None
    if "crank_angle" in measured:
        angle = np.asarray(measured["crank_angle"].values, float)
        rate = np.asarray(measured["crank_rate"].values, float) if "crank_rate" in measured else _slope(angle, time)
        crank = np.stack([angle, rate, _slope(rate, time)])
    q, source["q"] = _configuration(log, robot, crank)
    v, source["v"] = _velocity(log, robot, q, crank)
    wind, source["wind"] = _wind(log, q, v, air)
    return Motion(time, q, v, crank, wind, source)


def _configuration(log: FlightLog, robot: Aerobat, crank: Array | None) -> tuple[Array, str]:
    measured = log.measured
    if "q" in measured:
        return np.array(measured["q"].values, float), "measured"
    pose = np.asarray(measured["pose"].values, float)
    if "joint_angle" in measured:
        q = robot.configuration(pose, 0.0, 0.0)
        q[:, list(robot.idx_q)] = measured["joint_angle"].sel(joint=list(JOINTS)).values
        return q, "measured"
    if crank is None:
        raise LogError("flight log: neither joints nor crank_angle are recorded: the wings' motion is unknown")
    closure = robot.linkage.solve(crank[0])
    return robot.configuration(pose, closure.theta_s, closure.theta_e), "reconstructed"


def _velocity(log: FlightLog, robot: Aerobat, q: Array, crank: Array | None) -> tuple[Array, str]:
    measured, time = log.measured, log.time
    if "v" in measured:
        return np.array(measured["v"].values, float), "measured"
    source = "measured" if "twist" in measured else "reconstructed"
    v = _differences(robot.model, time, q)
    if "twist" in measured:
        v[:, :BASE_SIZE] = measured["twist"].values
    if "joint_rate" in measured:
        v[:, list(robot.idx_v)] = measured["joint_rate"].sel(joint=list(JOINTS)).values
    elif crank is not None:
        closure = robot.linkage.solve(crank[0], crank[1])
        v = robot.velocity(v[:, :BASE_SIZE], closure.theta_s_dot, closure.theta_e_dot)
        source = "reconstructed"
    return v, source


def _wind(log: FlightLog, q: Array, v: Array, air: AirSection) -> tuple[Array, str]:
    measured, time = log.measured, log.time
    if "wind_W" in measured:
        velocity, source = np.asarray(measured["wind_W"].values, float), "measured"
    elif any(air.wind) or air.gust is not None or "airspeed" not in measured:
        return wind_of(air).field(time), "believed"
    else:
        along = v[:, 0] - np.asarray(measured["airspeed"].values, float)
        velocity, source = along[:, None] * rotations(q)[:, :, 0], "reconstructed"
    return np.stack([velocity, _slope(velocity, time)], axis=1), source


def _differences(model: pin.Model, time: Array, q: Array) -> Array:
    """Differentiate configurations numerically.

    Returns:
        Velocities (m + 1, nv): at each sample the weighted mean of the rates over the two neighbouring intervals, in
        which the shorter interval has the larger weight (the length of the other interval).
    """
    dt = np.diff(time)
    steps = np.array([pin.difference(model, a, b) for a, b in itertools.pairwise(q)])
    rates = np.divide(steps, dt[:, None], out=np.zeros_like(steps), where=dt[:, None] > 0.0)
    v = np.empty((len(time), model.nv))
    v[0], v[-1] = rates[0], rates[-1]
    total = np.maximum(dt[1:] + dt[:-1], 1e-300)[:, None]
    v[1:-1] = (dt[1:, None] * rates[:-1] + dt[:-1, None] * rates[1:]) / total
    return v


def _slope(values: Array, time: Array) -> Array:
    """Return the time derivative of values (m, ...); samples with the same time have the same derivative."""
    stamps, index = np.unique(time, return_inverse=True)
    first = np.searchsorted(time, stamps)
    if len(stamps) < 2:
        return np.zeros_like(values)
    return np.asarray(np.gradient(values[first], stamps, axis=0, edge_order=2 if len(stamps) > 2 else 1)[index])
