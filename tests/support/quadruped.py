"""A quadruped that stands and sways, as a URDF and a CSV log: what a user of the observers' page brings along."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio as pin

from aerobat_pin.numerics.arrays import Array

FEET = ("FL_FOOT", "FR_FOOT", "HL_FOOT", "HR_FOOT")
SHARES = (6.0, 5.0, 4.0, 7.0)  # [N], about what each foot carries
PUSHED = (0.5, -0.3, 0.2, -0.4)  # [N], how much friction there is about each foot
SWAY = 0.01  # of the base [m], and ten times as much of the joints [rad]
PACE = 6.0  # [rad/s]


def write_urdf(path: Path) -> None:
    """Write a trunk of 1.6 kg with four legs of three joints: hip, shoulder, knee."""

    def link(name: str, mass: float) -> str:
        own = 2e-3 * mass  # [kg m2]
        inertia = f'<inertia ixx="{own}" iyy="{own}" izz="{own}" ixy="0" ixz="0" iyz="0"/>'
        return f'<link name="{name}"><inertial><mass value="{mass}"/>{inertia}</inertial></link>'

    def joint(name: str, kind: str, parent: str, child: str, xyz: str, axis: str) -> str:
        ends = f'<parent link="{parent}"/><child link="{child}"/><origin xyz="{xyz}"/><axis xyz="{axis}"/>'
        limit = '<limit lower="-9" upper="9" effort="9" velocity="99"/>'
        return f'<joint name="{name}" type="{kind}">{ends}{limit}</joint>'

    parts = [link("trunk", 1.6)]
    for foot in FEET:
        leg, x, y = foot[:2], 0.19 if foot[0] == "F" else -0.19, 0.08 if foot[1] == "L" else -0.08
        parts += [link(f"{leg}_{name}", 0.05) for name in ("HIP", "UPPER", "LOWER")]
        parts.append(f'<link name="{foot}"/>')
        parts += [
            joint(f"{leg}_HAA", "revolute", "trunk", f"{leg}_HIP", f"{x} {y} 0", "1 0 0"),
            joint(f"{leg}_HFE", "revolute", f"{leg}_HIP", f"{leg}_UPPER", f"0 {0.2 * y} 0", "0 1 0"),
            joint(f"{leg}_KFE", "revolute", f"{leg}_UPPER", f"{leg}_LOWER", "0 0 -0.16", "0 1 0"),
            joint(f"{leg}_END", "fixed", f"{leg}_LOWER", foot, "0 0 -0.16", "0 0 1"),
        ]
    path.write_text(f'<robot name="quadruped">{"".join(parts)}</robot>')


def write_log(urdf: Path, path: Path, count: int = 501) -> Array:
    """Write time, q, v and the joints' torques, sampled each millisecond; return the true forces (count, 4, 3) [N]."""
    model = pin.buildModelFromUrdf(str(urdf), pin.JointModelFreeFlyer())
    data, time = model.createData(), 1e-3 * np.arange(count)
    swing = np.concatenate([SWAY * np.array([1.0, -0.5, 0.7, 0.0, 0.0, 0.0]), 10.0 * SWAY * np.sin(np.arange(12))])
    stance = np.concatenate([pin.neutral(model)[:7], np.tile([0.0, 0.8, -1.6], 4)])
    rows, forces = [], np.empty((count, 4, 3))
    for k, t in enumerate(time):
        q = pin.integrate(model, stance, swing * np.sin(PACE * t))  # the base does not turn
        v, a = PACE * np.cos(PACE * t) * swing, -(PACE**2) * np.sin(PACE * t) * swing
        total = pin.rnea(model, data, q, v, a)
        pin.computeJointJacobians(model, data, q)
        pin.updateFramePlacements(model, data)
        axes = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
        J = np.vstack([pin.getFrameJacobian(model, data, model.getFrameId(foot), axes)[:3] for foot in FEET])
        wanted = np.concatenate([[push, -push, share] for push, share in zip(PUSHED, SHARES, strict=True)])
        f = wanted + np.linalg.pinv(J[:, :6].T) @ (total[:6] - J[:, :6].T @ wanted)  # nothing else carries the base
        forces[k] = f.reshape(4, 3)
        rows.append(np.concatenate([[t], q, v, (total - J.T @ f)[6:]]))
    names = ["time", *(f"{one}{i}" for one, n in (("q", model.nq), ("v", model.nv), ("tau", 12)) for i in range(n))]
    np.savetxt(path, rows, delimiter=",", header=",".join(names), comments="")
    return forces
