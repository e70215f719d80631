"""How the robot moved, from the measured channels of a log; the linkage supplies joints where only the crank is known.

| quantity | measured as | otherwise |
|---|---|---|
| base placement | `q`, or `pose` | must be there |
| base twist | `v`, or `twist` | difference of placements: the mean of both neighbouring intervals |
| joint angles | `q`, or `joint_angle` | the closed linkage at `crank_angle` |
| joint rates | `v`, or `joint_rate` | the closed linkage at the crank's rate; else differences |
| crank's rate | `crank_rate` | difference of `crank_angle`; its acceleration is that of the rate |
| wind | `wind_W` | from `airspeed` along the body's x axis; else what is believed of it |
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from aerobat_pin.errors import LogError
from aerobat_pin.flight import FlightLog, wind_of
from aerobat_pin.numerics import Array
from aerobat_pin.robot import BASE_SIZE, JOINTS, Aerobat, rotations
from aerobat_pin.scenario import AirSection


@dataclass(frozen=True)
class Motion:
    """A flight's motion at its samples.

    Attributes:
        time: (m + 1,) [s].
        q, v: (m + 1, nq), (m + 1, nv).
        crank: (3, m + 1) angle, rate and acceleration of the crank [rad, rad/s, rad/s2]; None where it is not recorded.
        wind: (m + 1, 2, 3) velocity of the air and its rate, world axes [m/s, m/s2].
        source: quantity -> `measured` or `reconstructed`; of the wind also `believed`.
    """

    time: Array
    q: Array
    v: Array
    crank: Array | None
    wind: Array
    source: dict[str, str]


def motion(log: FlightLog, robot: Aerobat, air: AirSection) -> Motion:
    """Gather a log's motion.

    Args:
        log: the flight.
        robot: the believed robot, whose linkage supplies joints that were not measured.
        air: the believed air, for a wind that was not measured.

    Raises:
        LogError: neither joints nor crank are recorded.
        LinkageError: the believed linkage cannot close at a recorded crank angle.
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
    """Return velocities (m + 1, nv): means over both neighbouring intervals, each weighed by the other's length."""
    dt = np.diff(time)
    steps = np.array([pin.difference(model, a, b) for a, b in itertools.pairwise(q)])
    rates = np.divide(steps, dt[:, None], out=np.zeros_like(steps), where=dt[:, None] > 0.0)
    v = np.empty((len(time), model.nv))
    v[0], v[-1] = rates[0], rates[-1]
    total = np.maximum(dt[1:] + dt[:-1], 1e-300)[:, None]
    v[1:-1] = (dt[1:, None] * rates[:-1] + dt[:-1, None] * rates[1:]) / total
    return v


def _slope(values: Array, time: Array) -> Array:
    """Return the derivative by time of values (m, ...); repeated stamps share one slope."""
    stamps, index = np.unique(time, return_inverse=True)
    first = np.searchsorted(time, stamps)
    if len(stamps) < 2:
        return np.zeros_like(values)
    return np.asarray(np.gradient(values[first], stamps, axis=0, edge_order=2 if len(stamps) > 2 else 1)[index])
