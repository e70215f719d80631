"""A bench: an arm shaken on a force plate. Without joint torques, the plate's wrench tells what pushes at the tip.

The recording is simulated here, and read through the same door as a laboratory's: `aerobat estimate LOG --map MAP`.
"""

import tempfile
from pathlib import Path

import numpy as np
import pandas as pd
import pinocchio as pin

from aerobat_pin import estimate, open_record
from aerobat_pin.records import parse_map

URDF = """<robot name="arm">
<link name="base"><inertial><mass value="0.5"/><inertia ixx="1e-3" iyy="1e-3" izz="1e-3" ixy="0" ixz="0" iyz="0"/>
</inertial></link>
<link name="arm"><inertial><origin xyz="0.1 0 0"/><mass value="0.1"/>
<inertia ixx="1e-5" iyy="3e-4" izz="3e-4" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="tip"/>
<joint name="hinge" type="revolute"><parent link="base"/><child link="arm"/><origin xyz="0 0 0.1"/><axis xyz="0 1 0"/>
<limit lower="-2" upper="2" effort="9" velocity="99"/></joint>
<joint name="end" type="fixed"><parent link="arm"/><child link="tip"/><origin xyz="0.2 0 0"/></joint>
</robot>"""
MAP = {
    "robot": {"urdf": "arm.urdf", "points": ["tip"]},
    "base": {"held": True},
    "joints": {
        "names": ["hinge"],
        "position": {"columns": ["angle"], "unit": "rad"},
        "velocity": {"from": "position", "window": 0.01},
    },
    "known": {"plate": {"columns": ["fx", "fy", "fz", "mx", "my", "mz"], "sign": -1}},  # it shows the force on itself
    "observer": {"gain": 300},
}


def bench(time: np.ndarray, push: np.ndarray) -> pd.DataFrame:
    """Return what angle encoder and force plate show while a force (m, 3) [N] pushes at the tip."""
    model = pin.buildModelFromXML(URDF, pin.JointModelFreeFlyer())
    data, tip = model.createData(), model.getFrameId("tip")
    angle = 0.5 * np.sin(12.0 * time)
    rate, bend = 6.0 * np.cos(12.0 * time), -72.0 * np.sin(12.0 * time)
    plate = []
    for k in range(len(time)):
        q = np.concatenate([[0, 0, 0, 0, 0, 0, 1, angle[k]]])
        v, a = np.concatenate([np.zeros(6), [rate[k]]]), np.concatenate([np.zeros(6), [bend[k]]])
        jacobian = pin.computeFrameJacobian(model, data, q, tip, pin.LOCAL_WORLD_ALIGNED)[:3]
        plate.append(-(pin.rnea(model, data, q, v, a) - jacobian.T @ push[k])[:6])
    names = ("fx", "fy", "fz", "mx", "my", "mz")
    return pd.DataFrame({"t": time, "angle": angle, **dict(zip(names, np.array(plate).T, strict=True))})


time = np.arange(2000) * 1e-3
push = np.outer(np.clip((time - 0.5) * 4.0, 0.0, 1.0), [0.2, 0.1, -0.5])
with tempfile.TemporaryDirectory() as place:
    folder = Path(place)
    (folder / "arm.urdf").write_text(URDF)
    bench(time, push).to_csv(folder / "bench.csv", index=False)
    found = estimate(open_record(folder / "bench.csv", parse_map(MAP, "of the example"), folder))
estimate = found.estimates["force_level"]
error = estimate.force[50:, 0] - push[50:-1]
print(estimate)
print(f"error {1e3 * np.sqrt(np.mean(error**2)):.1f} mN rms of {1e3 * np.linalg.norm(push[-1]):.0f} mN")
print("\n".join(found.notes))
