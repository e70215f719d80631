"""A UR5 that begins and ends at rest, straight up, and moves through singular poses; its friction fits no law."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pinocchio as pin

from aerobat_pin.records import load_robot
from support.robot_parts import channels, efforts, joint_map

RATE, SECONDS = 100.0, 30.0  # [Hz], [s]
JOINTS = [f"{name}_joint" for name in ("shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3")]
COULOMB, VISCOUS = (np.array(v) for v in ([6.0, 7.0, 5.0, 1.2, 1.1, 1.0], [5.0, 6.0, 4.0, 0.8, 0.7, 0.6]))
UPRIGHT = np.array([0.0, -0.5, 0.0, -0.5, 0.0, 0.0]) * np.pi
Force = Callable[[np.ndarray], np.ndarray]


def nothing(time: np.ndarray) -> np.ndarray:
    """Return no force (n, 3) [N]."""
    return np.zeros((len(time), 3))


def pushed(time: np.ndarray) -> np.ndarray:
    """Return forces (n, 3) of 20 N, one for twelve seconds and one for three."""
    force = nothing(time)
    force[(time > 8.0) & (time < 20.0)] = [12.0, -8.0, 14.0]
    force[(time > 22.0) & (time < 25.0)] = [0.0, 20.0, 0.0]
    return force


def write_log(
    path: Path,
    seed: int,
    force: Force,
    lever: tuple[float, float, float] = (0.0, 0.0, 0.0),
    *,
    pace: float = 1.0,
    load: dict[str, Any] | None = None,
    still: int = 0,
    rotors: float = 0.0,
    rate: float = RATE,
    rubs: float = 1.0,
    late: float = 0.0,
) -> np.ndarray:
    """Write a log of the arm; return the force (n, 3) on it [N], at `lever` [m] from its tool; Stribeck's friction."""
    # It swings at a `pace`, carries a `load`; its first `still` joints rest; `rotors` [kg m2]; `late` efforts [s].
    model = load_robot("ur5").model.copy()
    if load is not None:
        frame = model.frames[model.getFrameId(load["frame"])]
        body = pin.Inertia(load["mass"], np.array(load["com"]), np.zeros((3, 3)))
        model.appendBodyToJoint(frame.parentJoint, body, frame.placement)
    rng = np.random.default_rng(seed)
    time = np.arange(round(SECONDS * rate)) / rate
    up, down = (np.clip(x, 0.0, 1.0) for x in ((time - 3.0) / 3.0, (SECONDS - 2.0 - time) / 3.0))
    fade = (up**3 * (10.0 - 15.0 * up + 6.0 * up**2)) * (down**3 * (10.0 - 15.0 * down + 6.0 * down**2))
    angle = np.zeros((len(time), 6))
    for harmonic in range(1, 5):
        size, phase = rng.uniform(0.15, 0.5, 6), rng.uniform(0.0, 2.0 * np.pi, 6)
        angle += size * np.sin(2.0 * np.pi * harmonic * 0.07 * pace * time[:, None] + phase)
    angle[:, :still] = 0.0
    q = UPRIGHT + fade[:, None] * angle
    v = np.gradient(q, time, axis=0)
    a = np.gradient(v, time, axis=0)
    push = force(time)
    torque = efforts(model, "tool0", q, v, a, np.concatenate([push, np.cross(lever, push)], axis=1))
    loaded = 1.0 + 0.15 * np.abs(torque) / np.abs(torque).max(axis=0)
    friction = COULOMB * loaded * (1.0 + 0.25 * np.exp(-((v / 0.05) ** 2))) * np.tanh(v / 0.01)
    friction += VISCOUS * np.abs(v) ** 0.8 * np.sign(v)
    friction = np.where(np.abs(v) < 1e-3, rng.uniform(-1.0, 1.0, 6) * COULOMB, friction)
    torque += rotors * np.array([1.0, 1.0, 1.0, 0.1, 0.1, 0.1]) * a
    torque += rubs * (friction + 0.03 * COULOMB * rng.standard_normal(torque.shape))
    torque = torque[np.maximum(np.arange(len(time)) - round(late * rate), 0)]
    columns = {"t": time, **{f"q{k}": q[:, k] for k in range(6)}}
    columns |= {f"v{k}": v[:, k] + 1e-3 * rng.standard_normal(len(time)) for k in range(6)}
    columns |= {f"tau{k}": torque[:, k] for k in range(6)} | {f"f{axis}": push[:, k] for k, axis in enumerate("xyz")}
    pd.DataFrame(columns).to_csv(path, index=False)
    return push


def arm_map(points: list[str], *, friction: bool = False) -> dict[str, Any]:
    values = joint_map("ur5", points, JOINTS, observer={"gain": 20.0})
    joints = values["joints"]
    joints |= channels(range(6), position="q{}", velocity="v{}", effort="tau{}")
    for part, unit in (("position", "rad"), ("velocity", "rad/s"), ("effort", "N m")):
        joints[part]["unit"] = unit
    if friction:
        joints["friction"] = {"law": "coulomb+viscous"}
    elif points:
        values["check"] = {"wrench": {"columns": ["fx", "fy", "fz"]}}
    return values
