"""Estimate a force on another robot: a fixed-base arm that is pushed at its tool while it swings."""

import numpy as np
import pinocchio as pin

from aerobat_pin.observers import MomentumObserver, external_forces, joint_wrench

model = pin.buildSampleModelManipulator()
last = model.njoints - 1
model.addFrame(pin.Frame("tool", last, 0, pin.SE3(np.eye(3), np.array([0.0, 0.0, 0.2])), pin.FrameType.OP_FRAME))
data = model.createData()
observer = MomentumObserver(model, ["tool"], gain=200.0)

np.set_printoptions(precision=3, suppress=True)
dt, q, v = 1e-3, np.array([0.2, -0.4, 0.8, 1.1, 0.3, -0.2]), np.zeros(model.nv)
observer.reset(q, v)
for k in range(300):
    force = np.array([2.0, 0.0, 0.0 if k < 150 else -1.0])  # [N], world axes
    tau = pin.rnea(model, data, q, v, np.zeros(model.nv)) - 0.5 * v  # gravity compensation and damping
    pin.forwardKinematics(model, data, q)
    wrench = np.concatenate([force, np.zeros(3)])
    pushed = joint_wrench(model, data, "tool", wrench, pin.ReferenceFrame.LOCAL_WORLD_ALIGNED)
    a = pin.aba(model, data, q, v, tau, external_forces(model, [pushed]))
    v = v + dt * a
    q = pin.integrate(model, q, dt * v)
    estimate = observer.update((k + 1) * dt, q, v, tau)
    if k % 50 == 49:
        print(f"t {1e3 * (k + 1) * dt:4.0f} ms   true {force}   estimated {estimate.force[0]} N")
