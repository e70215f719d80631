"""An arm of three joints that swings, with friction, rotors and a mass its URDF does not know, as a table."""

from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

from support.robot_parts import channels, efforts, joint, joint_table, link, sines

RATE, CONSTANT, HEAVIER = 500.0, 1.6, 1.06  # [Hz], [N m/A] of every joint, true mass over the believed one
COULOMB, VISCOUS, OFFSET = (np.array(values) for values in ([0.4, 0.6, 0.3], [0.2, 0.3, 0.1], [0.1, -0.2, 0.05]))
ROTOR = np.array([0.05, 0.08, 0.03])  # [kg m2]
JOINTS = ["turn", "lift", "bend"]


def arm() -> str:
    """Return an arm of 4.5 kg: a vertical axis and two hinges."""
    parts, below = [link("ground")], "ground"
    axes, heights = ("0 0 1", "0 1 0", "0 1 0"), (0.1, 0.2, 0.4)
    for name, mass, axis, height in zip(JOINTS, (2.0, 1.5, 1.0), axes, heights, strict=True):
        i = mass * 0.4**2 / 12
        parts.append(link(f"{name}_link", mass, "0 0.01 0.2", (i, i, 0.1 * i)))
        parts.append(joint(name, "revolute", below, f"{name}_link", f"0 0 {height}", axis))
        below = f"{name}_link"
    parts += [link("tool"), joint("end", "fixed", below, "tool", "0.05 0 0.4")]
    return f'<robot name="arm">{"".join(parts)}</robot>'


def recording(
    folder: Path, name: str, pushed: bool, seed: int, rate=0.02, seconds=10.0, turning=0.0, ripple=0.0, knock=(0.0, 0.0)
) -> np.ndarray:
    """Write a table of the arm, heavier than its URDF; return the force (n, 3) at its tool [N], also as a sensor's."""
    # Mean rate `turning` [rad/s]; its gear's `ripple` [N m]; 8 N upwards from and to the times of `knock` [s].
    model = pin.buildModelFromXML(arm())
    for k, inertia in enumerate(model.inertias.tolist()):
        model.inertias[k] = pin.Inertia(HEAVIER * inertia.mass, inertia.lever, HEAVIER * inertia.inertia)
    time, rng = np.arange(round(seconds * RATE)) / RATE, np.random.default_rng(seed)
    speed, phase = rng.uniform(0.8, 2.6, (2, 3)), rng.uniform(0, 6, (2, 3))
    size = [[0.6, 0.5, 0.7], [0.2, 0.2, 0.3]]
    q, v, a = sines(time, size, speed, phase, [0.0, 0.6, 0.8])
    force = np.stack([4 * np.sin(time), 3 * np.cos(1.4 * time), 8 + 5 * np.sin(0.7 * time)], axis=1) * pushed
    force[(time >= knock[0]) & (time < knock[1]), 2] += 8.0
    q[:, 0], v[:, 0] = q[:, 0] + turning * time, v[:, 0] + turning
    tau = efforts(model, "tool", q, v, a, force)
    tau += COULOMB * np.tanh(v / rate) + VISCOUS * v + ROTOR * a + OFFSET
    tau[:, 0] += ripple * (np.cos(q[:, 0] + 0.7) + 0.5 * np.sin(2.0 * q[:, 0]))
    current = tau / CONSTANT + 0.01 * rng.standard_normal((3, len(time))).T
    table = joint_table(time, JOINTS, q=q, v=v, i=current)
    table[["fx", "fy", "fz"]] = force
    table.to_csv(folder / f"{name}.csv", index=False)
    return force


def arm_map() -> dict[str, Any]:
    """Return the map of the arm, as nested values; it asks for friction, and does not say where to fit it."""
    joints = {"names": JOINTS, **channels(JOINTS, position="{}_q", velocity="{}_v", effort="{}_i")}
    joints["effort"] |= {"unit": "A", "torque_per_unit": {"*": CONSTANT}}
    joints["friction"] = {"law": "coulomb+viscous+inertia"}
    robot = {"urdf": "arm.urdf", "root": "fixed", "points": ["tool"]}
    return {"robot": robot, "joints": joints, "observer": {"gain": 100}}
