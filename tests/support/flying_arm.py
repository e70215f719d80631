"""A quadrotor with an arm of two joints below it, flown by its four rotors: a table of what a laboratory measures."""

from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pinocchio as pin
from scipy.spatial.transform import Rotation

from support.robot_parts import by_axis, channels, joint, link

RATE, STEP = 200, 0.001  # [Hz] of the table, [s] of the simulation
THRUST, LATE = 12.0, 0.03  # [N] of a rotor at full speed, times the square of its command, which it follows so late [s]
YAWS = 0.016  # [m] moment about its axis over the thrust of a rotor
ARMS = 0.17 * np.array([[1, -1, 0], [-1, 1, 0], [1, 1, 0], [-1, -1, 0]])
COULOMB, VISCOUS = 0.02, 0.02  # [N m], [N m s/rad] of each joint
Push = Callable[[float], np.ndarray]


def urdf() -> str:
    """Return a quadrotor with frames of its rotors and an arm of two joints below it, at whose end the tip is."""
    parts = [link("base", 1.8, "0 0 0.01", (0.018, 0.020, 0.033))]
    for k, place in enumerate(ARMS.tolist(), start=1):
        at = " ".join(map(str, place))
        parts += [link(f"rotor_{k}"), joint(f"r{k}", "fixed", "base", f"rotor_{k}", at)]
    parts += [link("upper", 0.25, "0 0 -0.09", (1e-3, 1e-3, 1e-4)), link("fore", 0.15, "0 0 -0.09", (1e-3, 1e-3, 1e-4))]
    parts.append(joint("shoulder", "revolute", "base", "upper", "0 0 -0.06", limit=2.5))
    parts.append(joint("elbow", "revolute", "upper", "fore", "0 0 -0.2", limit=2.5))
    parts += [link("tip"), joint("end", "fixed", "fore", "tip", "0 0 -0.18")]
    return f'<robot name="flying_arm">{"".join(parts)}</robot>'


def nothing(_: float) -> np.ndarray:
    """No push."""
    return np.zeros(3)


def pushed(t: float) -> np.ndarray:
    """Return a push [N] at the tip at a time [s]: two steps, the first ahead and down, the second sideways."""
    if 2.0 < t < 4.0:
        return np.array([1.5, 0.0, -1.5])
    return np.array([0.0, -2.0, 0.0]) if 5.5 < t < 7.0 else np.zeros(3)


@cache
def fly(
    seed: int, push: Push = nothing, *, seconds: float = 9.0, swings: bool = True
) -> tuple[pd.DataFrame, np.ndarray]:
    """Return a table and the true force (n, 3) at its times; rotors differ by 2 % about 1.07 times what is believed."""
    rng = np.random.default_rng(seed)
    model = pin.buildModelFromXML(urdf(), pin.JointModelFreeFlyer())
    data, tip, phases = model.createData(), model.getFrameId("tip"), rng.uniform(0.0, 6.28, 6)
    thrust_at_full = 1.07 * THRUST * (1.0 + 0.02 * rng.standard_normal(4))
    spins = YAWS * np.array([1.0, 1.0, -1.0, -1.0])
    mixing = np.stack([np.ones(4), ARMS[:, 1], -ARMS[:, 0], spins])
    weight = 9.81 * pin.computeTotalMass(model)
    q, v, pulled, summed = pin.neutral(model), np.zeros(8), np.zeros(3), np.zeros(2)
    q[7:] = 0.3, -0.6
    command = speed = np.full(4, np.sqrt(weight / 4.0 / thrust_at_full.mean()))
    rows, forces = [], []
    for k in range(round((seconds + 2.0) / STEP)):
        t = k * STEP - 2.0  # it settles for two seconds
        R = Rotation.from_quat(q[3:7]).as_matrix()
        if k % 10 == 0:
            waves = np.array([0.9, 0.7, 0.8])
            off = np.array([0.4, 0.4, 0.2]) * np.sin(waves * t + phases[:3]) + [0.0, 0.0, 1.0] - q[:3]
            pulled = np.clip(pulled + 0.01 * off, -3.0, 3.0)
            wanted = 6.0 * off - 4.0 * R @ v[:3] + 2.0 * pulled
            wanted = np.append(np.clip(wanted[:2], -5.0, 5.0), wanted[2] + 9.81)
            up = wanted / np.linalg.norm(wanted)
            left = np.cross(up, [1.0, 0.0, 0.0])
            left /= np.linalg.norm(left)
            tilt = np.stack([np.cross(left, up), left, up], axis=1).T @ R
            error = 0.5 * np.array([tilt[2, 1] - tilt[1, 2], tilt[0, 2] - tilt[2, 0], tilt[1, 0] - tilt[0, 1]])
            moment = -np.array([2.5, 2.5, 0.8]) * error - np.array([0.35, 0.35, 0.25]) * v[3:6]
            lift = np.linalg.solve(mixing, np.append(weight / 9.81 * wanted @ R[:, 2], moment))
            command = np.sqrt(np.clip(lift, 0.1, THRUST) / THRUST)
        speed = speed + STEP / LATE * (command - speed)
        goal = np.array([0.3, -0.6]) + swings * np.array([0.5, 0.6]) * np.sin(np.array([1.7, 2.3]) * t + phases[3:5])
        summed = summed + STEP * (goal - q[7:])
        effort = np.array([6.0, 3.0]) * (goal - q[7:]) - np.array([0.25, 0.12]) * v[6:] + 6.0 * summed
        force = push(t)
        J = pin.computeFrameJacobian(model, data, q, tip, pin.ReferenceFrame.LOCAL_WORLD_ALIGNED)[:3]
        wrench = mixing @ (thrust_at_full * speed**2)
        rubbed = effort - COULOMB * np.tanh(v[6:] / 0.01) - VISCOUS * v[6:]
        tau = np.concatenate([[0.0, 0.0, wrench[0]], wrench[1:], rubbed])
        a = pin.aba(model, data, q, v, tau + J.T @ force)
        if k % round(1.0 / RATE / STEP) == 0 and t > -1e-9:
            felt = a[:3] + np.cross(v[3:6], v[:3]) + R.T @ [0.0, 0.0, 9.81]
            rows.append(np.concatenate([[t], q, v[3:], effort, felt, command]))
            forces.append(force)
        v = v + STEP * a
        q = pin.integrate(model, q, STEP * v)
    table = np.array(rows)
    noise = [0.0, *3 * [3e-4], *4 * [5e-4], *2 * [1e-4], *3 * [5e-3], *2 * [5e-3], *2 * [5e-3], *3 * [0.08], *4 * [0.0]]
    table += noise * rng.standard_normal(table.shape)
    table[:, 4:8] /= np.linalg.norm(table[:, 4:8], axis=1)[:, None]
    return pd.DataFrame(table, columns=COLUMNS), np.array(forces)


JOINTS = ["shoulder", "elbow"]
MOTION = "t px py pz qx qy qz qw shoulder_q elbow_q wx wy wz shoulder_v elbow_v".split()
COLUMNS = [*MOTION, *"shoulder_tau elbow_tau ax ay az m1 m2 m3 m4".split()]


def flying_map(folder: Path, points: list[str]) -> dict[str, Any]:
    """Return a map of the table, which fits the thrusts; the robot's file is written into the folder."""
    file = folder / "flying_arm.urdf"
    file.write_text(urdf())
    rotor = {"law": "polynomial 2", "delay": LATE, "fit": {"to": "check.specific_force"}}
    return {
        "robot": {"root": "free_flyer", "points": points, "rows": {"ignore": ["base.Mz"]}, "urdf": str(file)},
        "log": {"time": {"column": "t", "unit": "s"}},
        "base": by_axis(position="p{}", quaternion="q{}", rate="w{}") | {"velocity": {"from": "pose", "window": 0.05}},
        "joints": {"names": JOINTS, **channels(JOINTS, position="{}_q", velocity="{}_v", effort="{}_tau")},
        "check": {"specific_force": {"columns": ["ax", "ay", "az"]}},
        "known": {f"rotor_{k}": {"columns": [f"m{k}"], "frame": f"rotor_{k}", **rotor} for k in range(1, 5)},
        "observer": {"names": ["force_level"], "gain": 30.0},
    }
