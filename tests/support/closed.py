"""Flights of the robot with its closed linkage, in MuJoCo and Pinocchio, and of the package's robot beside them."""

from pathlib import Path

import mujoco
import numpy as np
import pinocchio as pin

import aerobat_description as description
from aerobat_pin.aerobat import Aerobat, closed_state
from aerobat_pin.flight import Plant
from aerobat_pin.linkage import KineticSculpture
from aerobat_pin.scenario import parse_scenario

RATE = 2.0 * np.pi * 4.75  # [rad/s] of the crank
DOWN = -0.5 * np.pi  # [rad]: crank angle at which flights begin
MJCF = {name: str(Path(description.PACKAGE_PATH, "mjcf", f"{name}.xml")) for name in description.MORPHOLOGIES}
HINGES = ("crank", "J2", "J3", "J8", "J9", "shoulder", "elbow")


def symmetric(M: np.ndarray) -> np.ndarray:
    """Return a matrix whose upper triangle alone Pinocchio has filled."""
    return np.triu(M) + np.triu(M, 1).T


def closed_data(model: pin.Model, constraints: pin.StdVec_RigidConstraintModel) -> tuple[pin.Data, list]:
    """Return the memory that Pinocchio's constrained dynamics need."""
    data, datas = model.createData(), pin.StdVec_RigidConstraintData()
    datas.extend(one.createData() for one in constraints)
    pin.initConstraintDynamics(model, data, constraints, datas)
    return data, datas


def placed(twin: mujoco.MjModel, model: pin.Model, q: np.ndarray, v: np.ndarray) -> mujoco.MjData:
    """Return MuJoCo's data with the joints of a closed state, and the base at rest at the origin."""
    data = mujoco.MjData(twin)
    for name in list(model.names)[2:]:
        index = model.joints[model.getJointId(name)]
        data.joint(name).qpos[0], data.joint(name).qvel[0] = q[index.idx_q], v[index.idx_v]
    return data


def miss(linkage: KineticSculpture, crank: np.ndarray, shoulder: np.ndarray, elbow: np.ndarray) -> tuple[float, float]:
    """Return the largest errors of shoulder and elbow [rad] against the closed form at the actual crank angle."""
    closure = linkage.solve(crank)
    away = np.remainder(elbow - closure.theta_e + np.pi, 2.0 * np.pi) - np.pi
    return float(np.max(np.abs(shoulder - closure.theta_s))), float(np.max(np.abs(away)))


def fly_in_mujoco(twin: mujoco.MjModel, data: mujoco.MjData, steps: int) -> np.ndarray:
    """Fly on with the actuator at 4.75 Hz; return qpos (steps, nq)."""
    data.ctrl[0] = RATE
    rows = np.empty((steps, twin.nq))
    for row in rows:
        mujoco.mj_step(twin, data)
        row[:] = data.qpos
    return rows


def fly_prescribed(robot: Aerobat, steps: int, dt: float) -> np.ndarray:
    """Fly the package's robot with the crank at 4.75 Hz and no air; return q (steps, nq) after each step."""
    air = {"model": "quasi_steady", "density": 1e-30, "warm_up_cycles": 0}
    flight = {"velocity": [0.0, 0.0, 0.0], "pitch_deg": 0.0}
    plant = Plant(robot, parse_scenario({"name": "vacuum", "air": air, "flight": flight}, "vacuum"))
    return plant.fly(steps, dt, np.zeros((2, 0, steps))).q[1:]


def exact_acceleration(
    model: pin.Model,
    linkage: KineticSculpture,
    q: np.ndarray,
    v: np.ndarray,
    tau: np.ndarray,
    crank: float,
    rate: float,
) -> np.ndarray:
    """Return the acceleration (nv,) by the closed form, v = S u: S^T M S u' = S^T (tau - nle - M S' u)."""
    tangent, bend = closed_state(model, linkage, crank, 1.0)[1], closed_state(model, linkage, crank, rate)[2]
    S = np.zeros((model.nv, 8))
    S[:6, :6] = np.eye(6)
    for column, side in ((6, "left"), (7, "right")):
        rows = [model.joints[model.getJointId(f"{side}_{hinge}")].idx_v for hinge in HINGES]
        S[rows, column] = tangent[rows]
    data = model.createData()
    M, nle = symmetric(pin.crba(model, data, q)), pin.nonLinearEffects(model, data, q, v)
    return S @ np.linalg.solve(S.T @ M @ S, S.T @ (tau - nle - M @ bend)) + bend
