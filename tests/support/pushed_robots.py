"""Any robot by its name, fixed or falling: joints swing, something pushes its last link; factors, friction."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pinocchio as pin

from aerobat_pin.numerics import Array
from aerobat_pin.records import PlainRobot, Record, load_robot
from support.recorded import edited, recorded
from support.robot_parts import free_map, joint_map

RATE, STEPS = 400.0, 2  # samples a second, and steps between two
DURATION, GAIN = 2.4, 100.0  # [s], [1/s]
PUSH = np.array([0.1, -0.15, 0.2])  # of what moves, by weight; world axes
EDGES = np.array([0.8, 1.0, 1.2, 1.4, 1.6])  # [s]: it begins, turns round, so that a free robot tumbles little, ends
FACTOR, FRICTION, NOISE = 0.02, 0.03, 0.01  # errors of factors; Coulomb friction and noise, of the effort's rms
SWING = 0.15  # [rad, m], or that share of a smaller range
ANGLE_NOISE, RATE_NOISE = 1e-5, 2e-3  # [rad, m], [rad/s, m/s]


@dataclass(frozen=True)
class Pushed:
    """A log of a robot: the frame at which it was pushed, the weight [N] of what moves, its table and map."""

    robot: PlainRobot
    point: str
    weight: float
    table: pd.DataFrame
    chosen: dict[str, Any]

    def record(self, folder: Path) -> Record:
        """Write the log into a folder and open it."""
        self.table.to_csv(folder / "log.csv", index=False)
        return recorded(folder / "log.csv", self.chosen)

    def true(self, time: Array) -> Array:
        """Return the force (m, 3) [N] at times (m,), world axes."""
        return np.asarray(self.weight * PUSH * push_sign(time)[:, None])


def push_sign(time: Array) -> Array:
    """Return +1, -1 or 0: which way it is pushed."""
    return np.array([0.0, 1.0, -1.0, 1.0, -1.0, 0.0])[np.searchsorted(EDGES, time, side="right")]


def last_link(model: pin.Model) -> str:
    """Return the frame of the moving body that comes last in the file."""
    bodies = (one for one in reversed(model.frames.tolist()) if one.type == pin.FrameType.BODY and one.parentJoint > 0)
    return str(next(bodies).name)


def pushed_robot(name: str, seed: int = 0) -> Pushed:
    robot, rng = load_robot(name), np.random.default_rng(seed)
    model = robot.model
    point, weight = last_link(model), 9.81 * sum(link.mass for link in model.inertias.tolist()[1:])
    log = Pushed(robot, point, weight, pd.DataFrame(), {})
    at_q, at_v = ([index(joint) for joint in robot.joints] for index in (robot.q_index, robot.v_index))
    low, high = (
        np.nan_to_num(limit[at_q], posinf=9.0, neginf=-9.0)
        for limit in (model.lowerPositionLimit, model.upperPositionLimit)
    )
    middle = np.clip(rng.uniform(-0.3, 0.3, len(at_q)), low + 0.2 * (high - low), high - 0.2 * (high - low))
    size = np.minimum(SWING, SWING * (high - low))
    omega, phase = rng.uniform(2.0, 6.0, len(at_q)), rng.uniform(0.0, 6.0, len(at_q))
    q, v = pin.neutral(model), np.zeros(model.nv)
    q[at_q], v[at_v] = middle + size * np.sin(phase), size * omega * np.cos(phase)
    if robot.free:
        v[:6] = 0.3 * rng.standard_normal(6)
    data, frame, dt = model.createData(), model.getFrameId(point), 1.0 / (RATE * STEPS)

    def moved(q: Array, v: Array, t: float, push: Array) -> tuple[Array, Array]:
        """Return how a robot accelerates at a time, and its efforts."""
        angle, a = omega * t + phase, np.zeros(model.nv)
        a[at_v] = -size * omega**2 * np.sin(angle) + 400.0 * (middle + size * np.sin(angle) - q[at_q])
        a[at_v] += 40.0 * (size * omega * np.cos(angle) - v[at_v])
        pushing = pin.computeFrameJacobian(model, data, q, frame, pin.LOCAL_WORLD_ALIGNED)[:3].T @ push
        if robot.free:
            a[:6] -= np.linalg.solve(pin.crba(model, data, q)[:6, :6], (pin.rnea(model, data, q, v, a) - pushing)[:6])
        return a, pin.rnea(model, data, q, v, a) - pushing

    states, efforts, time = [], [], np.arange(round(DURATION * RATE)) / RATE
    for t in time:
        states.append(np.concatenate([q, v]))
        push = log.true(np.array([t]))[0]
        for begin in t + dt * np.arange(STEPS):  # a small robot that was pushed tumbles by 25 rad/s
            a, _ = moved(q, v, begin, push)
            halfway = v + 0.5 * dt * a
            a, effort = moved(pin.integrate(model, q, 0.5 * dt * v), halfway, begin + 0.5 * dt, push)
            q, v = pin.integrate(model, q, dt * halfway), v + dt * a
            efforts.append(effort)
    table = log_of(robot, time, np.array(states), np.array(efforts), rng)
    return Pushed(robot, point, weight, table, map_of(name, robot, point))


def log_of(robot: PlainRobot, time: Array, states: Array, efforts: Array, rng: np.random.Generator) -> pd.DataFrame:
    """Return what sensors would write: samples of the state, and efforts as means around each sample."""
    model, n = robot.model, len(robot.joints)
    q, v = np.split(states, [model.nq], axis=1)
    table = {"t": time}
    if robot.free:
        twist = v[:, :6] + RATE_NOISE * rng.standard_normal((len(time), 6))
        names = "x y z qx qy qz qw vx vy vz wx wy wz".split()
        table |= dict(zip(names, np.column_stack([q[:, :7], twist]).T, strict=True))
    means = efforts.reshape(len(time), STEPS, -1).mean(axis=1)
    means[1:] = 0.5 * (means[1:] + means[:-1])
    rms = np.sqrt(np.mean(means**2, axis=0))
    factors = 1.0 + FACTOR * rng.standard_normal(n)
    for joint, factor in zip(robot.joints, factors, strict=True):
        i, j = robot.q_index(joint), robot.v_index(joint)
        rate = v[:, j]
        effort = factor * (means[:, j] + FRICTION * rms[j] * np.tanh(rate / 0.02))
        table[f"{joint}_q"] = q[:, i] + ANGLE_NOISE * rng.standard_normal(len(time))
        table[f"{joint}_v"] = rate + RATE_NOISE * rng.standard_normal(len(time))
        table[f"{joint}_tau"] = effort + NOISE * rms[j] * rng.standard_normal(len(time))
    return pd.DataFrame(table)


def map_of(name: str, robot: PlainRobot, point: str) -> dict[str, Any]:
    values = (free_map if robot.free else joint_map)(name, [point], robot.joints, observer={"gain": GAIN})
    if not robot.joints:
        del values["joints"]
    return edited(values, {"base.velocity.axes": "body"}) if robot.free else values
