"""An arm of six joints whose efforts are recorded: with factors, friction, noise, wrong links and a payload."""

from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

from support.robot_parts import channels, joint, joint_table, link, sines

RATE, SECONDS = 100.0, 60.0  # [Hz], [s]
SIX = ("pan", "lift", "elbow", "wrist_1", "wrist_2", "wrist_3")
MASSES = (3.7, 8.4, 2.3, 1.2, 1.2, 1.5)  # [kg]
CENTRES = ((0, 0.05, 0.02), (0, 0, 0.2), (0, 0, 0.18), (0, 0.08, 0.01), (0, 0.01, 0.08), (0, 0.12, 0))  # [m]
PLACES = ((0, 0, 0.09), (0, 0.14, 0), (0, -0.12, 0.43), (0, 0, 0.39), (0, 0.09, 0), (0, 0, 0.09))  # [m]
AXES = ("0 0 1", "0 1 0", "0 1 0", "0 1 0", "0 0 1", "0 1 0")
COULOMB, VISCOUS = np.array([4.0, 5.0, 3.0, 1.0, 0.8, 0.8]), np.array([2.0, 3.0, 1.5, 0.5, 0.4, 0.3])
NOISE = np.array([1.0, 1.0, 0.6, 0.25, 0.25, 0.25])  # [N m] of the efforts


def six_joints() -> str:
    """Return the URDF of an arm of 18 kg, the last link a gripper on its axis, with the frame `tool` at its end."""
    parts, below = [link("ground")], "ground"
    for name, mass, centre, place, axis in zip(SIX, MASSES, CENTRES, PLACES, AXES, strict=True):
        i, at, origin = mass * 0.005, " ".join(map(str, centre)), " ".join(map(str, place))
        parts.append(link(f"{name}_link", mass, at, (i, i, 0.5 * i)))
        parts.append(joint(name, "revolute", below, f"{name}_link", origin, axis, 9))
        below = f"{name}_link"
    parts += [link("tool"), joint("end", "fixed", below, "tool", "0 0.08 0")]
    return f'<robot name="six">{"".join(parts)}</robot>'


def swing(file: Path, seed: int, factors=(1.0,) * 6, payload=None, wrong=0.0, rotors=0.0) -> None:
    """Write a table of the arm that moves all joints, and its URDF: `factors` torque over effort, `payload` [kg, m]."""
    # `wrong`: deviation of the true masses over the URDF's, a third of centres; `rotors` [kg m2], not in the URDF.
    (file.parent / "six.urdf").write_text(six_joints())
    model, rng = pin.buildModelFromXML(six_joints()), np.random.default_rng(seed)
    for k, body in enumerate(model.inertias.tolist()[1:], start=1):
        mass, *shift = wrong * np.random.default_rng(k).standard_normal(4) / [1.0, 3.0, 3.0, 3.0]
        model.inertias[k] = pin.Inertia((1.0 + mass) * body.mass, body.lever + shift, body.inertia)
    if payload is not None:
        tool = model.frames[model.getFrameId("tool")]
        point = pin.Inertia(payload[0], np.array(payload[1]), np.zeros((3, 3)))
        model.appendBodyToJoint(tool.parentJoint, point, tool.placement)
    data, time = model.createData(), np.arange(round(SECONDS * RATE)) / RATE
    speed, phase = rng.uniform(0.5, 2.5, (3, 6)), rng.uniform(0, 6, (3, 6))
    size = np.array([0.8, 0.5, 0.7, 0.8, 0.9, 0.9]) * rng.uniform(0.4, 0.8, (3, 6))
    q, v, a = sines(time, size, speed, phase, [0, 0.6, 0.9, -0.5, 0.4, 0])
    torque = np.stack([pin.rnea(model, data, *one) for one in zip(q, v, a, strict=True)])
    torque += rotors * a + COULOMB * np.tanh(v / 0.02) + VISCOUS * v + NOISE * rng.standard_normal(q.shape)
    joint_table(time, SIX, q=q, v=v, i=torque / factors).to_csv(file, index=False)


def six_map(**tables: Any) -> dict[str, Any]:
    """Return the map of such a table as nested values, with further tables; friction and factors are fitted."""
    joints = channels(SIX, position="{}_q", velocity="{}_v", effort="{}_i")
    robot = {"urdf": "six.urdf", "root": "fixed", "points": ["tool"]}
    return {"robot": robot, "joints": {"names": list(SIX), "friction": {"scale": True}, **joints}, **tables}
